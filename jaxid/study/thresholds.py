"""Thresholds of the studies, each with its origin: derived, cited, measured, or chosen.

Levels and limits that a user may change stand in `LoopOptions` and `IdentifyOptions`.
"""

# Identification ----------------------------------------------------------------------------------

# Cited: eigenvalues below this share of the largest are not used (the report, section 4.4).
SMALLEST_EIGENVALUE = 1e-10

# Consistency of instruments ----------------------------------------------------------------------

# Chosen: share of a sensitivity that is outside the span of others, below which it is a linear
# combination of them. Above what rounding leaves, below any share that data can resolve.
COLLINEAR_SHARE = 1e-7

# Cited: correlation from which on two parameters are nearly collinear (Klein & Morelli, 2006,
# section 5.2.5).
COLLINEAR_CORRELATION = 0.9

# Chosen: ratio of corrected to plain standard errors from which on the residual is reported as
# coloured. Less reports chance correlations of short records.
COLOUR_INFLATION = 1.5
