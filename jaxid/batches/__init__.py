"""Many independent estimates, from many records or starts; records added to an estimate."""

from .estimate_many import estimate_many
from .multi_start import Minimum, MultiStart, multi_start
from .progress import Progress
from .summary import summary
from .update import update

__all__ = [
    "Minimum",
    "MultiStart",
    "Progress",
    "estimate_many",
    "multi_start",
    "summary",
    "update",
]
