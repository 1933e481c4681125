"""Thresholds of the checks of records, each with its origin: derived, cited, or chosen."""

# Chosen: past samples in the regressions of a channel on its past and on the inputs. More cover a
# longer memory and need more samples.
LAGS = 20
FEWEST_LAGS = 4
# Chosen: rows of a regression per coefficient.
ROWS_PER_COEFFICIENT = 5
# Chosen: step of the regressions that show delays and drift, times the rate of the fastest mode.
# Twenty lags then cover three units of the mode's time.
FASTEST_STEP = 0.15
# Chosen: condition of a regression, columns of unit length, above which it shows no delay: the
# input is too smooth, and a delay cannot be distinguished from its past.
LARGEST_CONDITION = 1e6

# Chosen: lags of the correlation of noise and later changes of an input. Derived: the point of the
# standard normal distribution that one of five lags exceeds with probability 1e-6.
FEEDBACK_LAGS = 5
CORRELATION_ERRORS = 5.2
# Chosen: correlation below which feedback is too weak to matter, however long the record.
LEAST_CORRELATION = 0.1
# Chosen: changes of an input beyond this number of deviations (from the median absolute deviation)
# are steps of a programme and are left out.
LARGEST_CHANGE = 3.0
TRIMMINGS = 4  # chosen: repetitions of the regression without large changes
# Chosen: standard errors by which the direct response to an input exceeds three times that of the
# model, whose parameters are not fitted; and its least share of the power.
DIRECT_ERRORS = 6.0
DIRECT_RATIO = 3.0
DIRECT_SHARE = 0.1
# Chosen: share of an input's power that its own past leaves, below which the input is computed from
# its past (a sum of sinusoids) and shows no feedback.
LEAST_INNOVATION = 1e-10
# Chosen: the fall of chi-square by a delay. A constant shift that noise imitates reaches 25 with
# probability 6e-7 (one degree of freedom).
DELAY_FALL = 25.0
# Chosen: standard errors of a trend (5: probability 6e-7) and of an offset at rest.
TREND_ERRORS = 5.0
OFFSET_ERRORS = 5.0
# Chosen: share of a channel's range, below which an offset at rest does not matter.
OFFSET_SHARE = 0.02
# Chosen: samples at rest that show an offset, and the change of an input, relative to its range,
# up to which it rests.
SAMPLES_AT_REST = 10
REST = 1e-3

# Chosen: share of an input's power within a factor MODE_BAND of a mode, below which the mode is not
# excited. A step has 5e-3 in this band one period before the end of a record.
MODE_POWER = 1e-4
MODE_BAND = 3.0
# Derived: the error of one Runge-Kutta step, (w h)^5/120, is 1 % of the motion at w h = 1; a period
# then has six samples.
LARGEST_STEP = 1.0
# Chosen: share of missing samples that is reported.
MISSING_SHARE = 0.01
# Chosen: relative deviation of a step from the median up to which times count as uniform.
JITTER = 0.01

# Derived: degrees in a radian, 57.3, and half and twice of it.
DEGREES_RATIO = (28.0, 115.0)
# Chosen: logarithm of a ratio of responses in two records over the ratio of two units; and standard
# errors of a response that has a size.
SIZE_TOLERANCE = 0.2
GAIN_ERRORS = 5.0
# Derived: an angle beyond one revolution [rad].
REVOLUTION = 6.284
# Chosen: rate of the fastest mode times the step, above which whole numbers of time are
# milliseconds.
MILLISECONDS_STEP = 10.0
# Chosen: free parameters of a model without a selection, above which information is not computed.
MOST_PARAMETERS = 40
# Chosen: least share of a channel's motion, less its trend, that its integrated rate explains.
RATE_SHARE = 0.9
# Chosen: factor between a channel and its integrated rate from which a unit is wrong. Turbulence at
# the vane, which the altitude hardly follows, reaches 2.2 (288 simulated records); a foot is 3.28.
RATE_FACTOR = 2.5
# Chosen: logarithm of that factor over the ratio of two units. Vertical gusts act on the vane and
# not on the altitude; in moderate turbulence the factor is off by up to 0.3.
UNIT_TOLERANCE = 0.3
