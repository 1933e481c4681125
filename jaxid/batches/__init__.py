"""Many independent estimates in one call: `estimate_many`, its store and its progress."""

from .estimate_many import estimate_many
from .progress import Progress

__all__ = ["Progress", "estimate_many"]
