"""Published measured data sets, each with a simple declared physical model."""

from .base import Declared
from .emps import emps, emps_closed_loop
from .silverbox import silverbox
from .tanks import tanks

__all__ = ["Declared", "emps", "emps_closed_loop", "silverbox", "tanks"]
