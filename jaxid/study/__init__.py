"""What a user runs whole."""

from .close_loop import close_loop
from .consistency import consistency
from .consistency_result import Consistency
from .identification import Identification
from .identify import identify
from .identify_options import LONG_RECORDS, IdentifyOptions
from .options import LoopOptions
from .rivals import Rival, told_apart
from .study import Study

__all__ = [
    "LONG_RECORDS",
    "Consistency",
    "Identification",
    "IdentifyOptions",
    "LoopOptions",
    "Rival",
    "Study",
    "close_loop",
    "consistency",
    "identify",
    "told_apart",
]
