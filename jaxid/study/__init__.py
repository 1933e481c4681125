"""What a user runs whole."""

from .close_loop import close_loop
from .consistency import consistency
from .consistency_result import Consistency
from .options import LoopOptions
from .study import Study

__all__ = ["Consistency", "LoopOptions", "Study", "close_loop", "consistency"]
