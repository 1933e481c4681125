"""Feet and degrees, in which the report and its sources print; they end where numbers enter the code."""

import math

FOOT = 0.3048  # m, exactly (international foot, 1959)
DEGREE = math.pi / 180.0  # rad
