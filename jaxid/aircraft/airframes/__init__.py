"""Airframes that ship as data with their sources."""

from .f4 import f4 as f4
from .f4 import f4_origins as f4_origins
from .f16 import F16Aerodynamics as F16Aerodynamics
from .f16 import f16 as f16
from .f16_engine import f16_engine as f16_engine
from .f16_engine import f16_thrust as f16_thrust
from .f16_low import F16LowAerodynamics as F16LowAerodynamics
from .f16_low import f16_low as f16_low
