"""What a user runs whole."""

from .close_loop import close_loop
from .options import LoopOptions
from .study import Study

__all__ = ["LoopOptions", "Study", "close_loop"]
