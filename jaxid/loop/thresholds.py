"""Thresholds of the search for missing effects: derived, measured or chosen, as each states."""

# Closed loop ------------------------------------------------------------------------------------

# Chosen: chi-square by which two fits differ at least to be distinguished; a likelihood ratio of
# 20. Less names an arbitrary one of two, more reports alternatives that the records do distinguish.
INSEPARABLE = 6.0

# Derived: chi-square of five standard errors, the convention for a discovery. An effect is
# called the cause only if the nearest alternative fits worse by at least this.
SETTLED = 25.0

# Fits of the closed loop -------------------------------------------------------------------------

# Chosen: largest number of continuations of a fit that its iteration limit stopped. Comparing fits
# that have not converged can select the wrong candidate; more cost time where a direction is
# undetermined.
MAX_CONTINUATIONS = 10

# Chosen: fall of the cost (half of chi-square) below which a fit is not continued: one unit of
# chi-square changes no choice at INSEPARABLE.
MIN_COST_FALL = 0.5

# Chosen: share of the fall of all continuations so far below which a fit is not continued. Stops
# fits that creep along an undetermined direction.
MIN_CONTINUATION_SHARE = 0.1

# Chosen: parameters of effects are padded to multiples of this, so that few widths are compiled.
# More padding costs arithmetic, less costs compilations.
COLUMN_BLOCK = 8

# Compilation -------------------------------------------------------------------------------------

# Measured: cost of compiling a fit, in operations that the 24 passes of a refit do per sample:
# 3 s and 10 ms per operation of its model, at 0.3 us per operation and sample (0.15 to 0.6), on
# two cores, for models of 6 to 1,435 operations.
COMPILE_COST, COMPILE_COST_PER_OPERATION = 400_000, 1400

# Chosen: compiled fits that are kept. At most as many are added in one round, and those of a
# large model then leave half of the memory maps of a process free.
MAX_COMPILED_FITS = 48

# Counted: programs of one kind in a study that fits all sets of effects by one program.
PROGRAMS_OF_A_STUDY = 4
