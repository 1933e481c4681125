"""Columns and units of published layouts of flight data; no data.

A layout is a mapping of channels to `(column, unit)`, columns counted from 1. In place of a column
a mapping of columns to factors may be given: `({28: -0.5, 29: 0.5}, "deg")` is half of column 29
minus half of column 28.
"""

from collections.abc import Mapping

Columns = Mapping[str, tuple[int | Mapping[int, float], str]]

# SIDPAC, the standard array `fdata` of 90 columns. Sources: E. A. Morelli, System Identification
# Programs for Aircraft (SIDPAC), AIAA 2002-4704; V. Klein, E. A. Morelli, Aircraft System
# Identification, AIAA 2006, and the programs that come with it: `f16_fltdatsel` fills the columns,
# `massprop` and `compmcrp` (45 to 52), `compfc` (38 to 41, summed; 48 in slug, because it computes
# forces from accelerations in g), `compmc` (42 to 44) and `accel_cor` read them. 45 to 47 are
# fuselage station, butt line and waterline, positive aft, right and up. Left out: 17 to 26 and 31
# to 37 (further controls and other recorded quantities), 53 to 60 (accelerometers before their
# correction for position) and 61 to 76 (coefficients and rates derived from the other columns).
SIDPAC: Columns = {
    "t": (1, "s"),
    "V": (2, "ft/s"),
    "alpha": (4, "deg"),
    "beta": (3, "deg"),
    "p": (5, "deg/s"),
    "q": (6, "deg/s"),
    "r": (7, "deg/s"),
    "phi": (8, "deg"),
    "pitch": (9, "deg"),
    "psi": (10, "deg"),
    "ax": (11, "g0"),
    "ay": (12, "g0"),
    "az": (13, "g0"),
    "stabilator": (14, "deg"),
    "aileron": (15, "deg"),
    "rudder": (16, "deg"),
    "qbar": (27, "psf"),
    "mach": (28, ""),
    "density": (29, "slug/ft^3"),
    "altitude": (30, "ft"),
    "thrust": ({38: 1.0, 39: 1.0, 40: 1.0, 41: 1.0}, "lbf"),
    "pdot": (42, "deg/s^2"),
    "qdot": (43, "deg/s^2"),
    "rdot": (44, "deg/s^2"),
    "xcg": (45, "in"),
    "ycg": (46, "in"),
    "zcg": (47, "in"),
    "mass": (48, "slug"),
    "Ix": (49, "slug*ft^2"),
    "Iy": (50, "slug*ft^2"),
    "Iz": (51, "slug*ft^2"),
    "Ixz": (52, "slug*ft^2"),
    "S": (77, "ft^2"),
    "b": (78, "ft"),
    "cbar": (79, "ft"),
}

# HFB-320 of DLR, `hfb320_1_10.asc`, 10 Hz. Source: R. V. Jategaonkar, Flight Vehicle System
# Identification: A Time Domain Methodology, 2nd ed., AIAA 2015, the list of channels that comes
# with its flight data. That list names column 11 AZCG and 12 AYCG, and has their descriptions
# exchanged; the book's programs take 11 as az (test case 4) and 12 as ay. Positive elevator is nose
# down, because the book's Cm_de is negative; the signs of aileron and rudder are not documented.
HFB320: Columns = {
    "t": (1, "s"),
    "stabilator": (2, "rad"),
    "qbar": (3, "Pa"),
    "thrust": (4, "N"),
    "V": (5, "m/s"),
    "alpha": (6, "rad"),
    "pitch": (7, "rad"),
    "q": (8, "rad/s"),
    "qdot": (9, "rad/s^2"),
    "ax": (10, "m/s^2"),
    "az": (11, "m/s^2"),
    "ay": (12, "m/s^2"),
    "p": (13, "rad/s"),
    "r": (14, "rad/s"),
    "pdot": (15, "rad/s^2"),
    "rdot": (16, "rad/s^2"),
    "beta": (17, "rad"),
    "phi": (18, "rad"),
    "aileron": (19, "rad"),
    "rudder": (20, "rad"),
}

# ATTAS of DLR, `fAttas*`, 25 Hz. Source: as above. The aileron is half of right minus left, and
# thrust the sum of both engines, as in the book's programs; positive aileron rolls left and
# positive rudder yaws left (Lda and Ndr of test case 3 are negative). The book's `umr_reg_attas`
# treats accelerations and flow angles of `fAttasElv1`, `fAttasAil1` and `fAttasRud1` as measured
# away from the centre of gravity (1.0 m behind it, and 13 m ahead), and those of `fAttas_qst*` as
# corrected, though the list marks all of them as CG. Files named `_pqrDot` have derivatives of the
# rates in columns 46 to 48.
ATTAS: Columns = {
    "t": (1, "s"),
    "ax": (2, "m/s^2"),
    "ay": (3, "m/s^2"),
    "az": (4, "m/s^2"),
    "p": (7, "deg/s"),
    "q": (8, "deg/s"),
    "r": (9, "deg/s"),
    "phi": (10, "deg"),
    "pitch": (11, "deg"),
    "psi": (12, "deg"),
    "alpha": (13, "deg"),
    "beta": (14, "deg"),
    "V": (15, "m/s"),
    "altitude": (16, "ft"),
    "pdot": (17, "deg/s^2"),
    "qdot": (18, "deg/s^2"),
    "rdot": (19, "deg/s^2"),
    "stabilator": (22, "deg"),
    "aileron": ({28: -0.5, 29: 0.5}, "deg"),
    "rudder": (30, "deg"),
    "mach": (31, ""),
    "density": (34, "kg/m^3"),
    "thrust": ({37: 1.0, 38: 1.0}, "N"),
}
# The quasi-steady stalls `fAttas_qst*`: the header of `fAttas_qst01_withHeader.asc` has the
# pressure altitude in metres, although the list gives feet. The static pressure confirms metres: it
# is 520 hPa on average at 5,322, and in `fAttasElv1` 549 hPa at 16,008.
ATTAS_STALL: Columns = ATTAS | {"altitude": (16, "m")}
