"""Feet and degrees, the units of the report and its sources, in SI units; used only where printed
numbers are converted.
"""

import math

FOOT = 0.3048  # m, exactly (international foot, 1959)
DEGREE = math.pi / 180.0  # rad
