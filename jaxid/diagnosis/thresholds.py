"""Thresholds of the diagnosis, each with its origin: derived, cited, or chosen (and the trade)."""

# Derived: the 97.5 % point of the standard normal distribution. 95 % of the autocorrelations of a
# white residual lie within BAND / sqrt(pairs).
BAND = 1.959963984540054

# Chosen: past samples in the autoregression that measures how predictable a residual is. More
# detect longer correlations and raise the chance level, which grows with the order.
ORDER = 10

# Derived: 99.9 % point of chi-square with ORDER degrees of freedom, 29.6, less its mean.
CHANCE_LEVEL = 19.6

# Derived: samples for each degree of freedom of a variance from third differences of white noise,
# whose autocorrelations are -15/20, 6/20 and -1/20: one plus twice the sum of their squares.
SAMPLES_PER_DEGREE = 2.31

# Chosen: lags [samples] of the whiteness and cross-correlation tests in a study. More detect later
# dependence and weaken the test against dependence at short lags.
WHITENESS_LAGS = 25

# Chosen: eigenvalue of the covariance of the bin means, relative to the largest, below which a
# direction is an empty bin or one without variation. Above what rounding leaves.
WEAK_BIN = 1e-9

# Chosen: eigenvalue of the information of a disturbance, relative to the largest, below which the
# free parameters imitate the direction. Less keeps directions of rounding errors.
WEAK_DIRECTION = 1e-8

# Chosen: limit of the weight of a spline knot, times the median weight. Without a limit a few
# well-determined knots decide which variable a disturbance depends on.
LARGEST_WEIGHT = 3.0

# Chosen: numbers of spline knots in time. More follow faster disturbances and cost more columns;
# only two numbers, so that studies share their compiled programs.
FEW_KNOTS, MANY_KNOTS = 20, 60
