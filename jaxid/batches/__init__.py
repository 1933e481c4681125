"""Many independent estimates in one call, and records added to a finished estimate."""

from .estimate_many import estimate_many
from .progress import Progress
from .update import update

__all__ = ["Progress", "estimate_many", "update"]
