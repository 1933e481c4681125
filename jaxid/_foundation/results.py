"""Enumeration of the outcomes of a solve, each with a sentence on the cause and the remedy."""

import optimistix as optx


# Equinox enumerations are extended by subclassing, which pyright does not accept.
class RESULTS(optx.RESULTS):  # pyright: ignore[reportGeneralTypeIssues]
    """Outcomes of a solve: those of optimistix, and those of system identification."""

    successful = ""
    no_descent = (
        "No step along the search direction lowers the cost any more, though the gradient is not "
        "zero. Where the model has a "
        "bend or a limit, its cost has corners, and this may be one. Check the units and scales of "
        "the free parameters, or start "
        "nearer."
    )
    start_diverges = (
        "The simulation diverges at the starting values, so there is nothing to improve on. Where "
        "the model is faster than the samples, integrate in finer steps "
        "(`OutputError(stepper=RK4(10))`); else start from values for which it is stable, or "
        "shorten the record."
    )
    at_bound = (
        "Converged with at least one parameter on its bound. Its standard error is not defined "
        "there; widen the bound, or "
        "fix the parameter and say so."
    )
    steps_exhausted = (
        "The iteration limit was reached before the steps became small against the standard "
        "errors. Raise `max_steps`, or "
        "look at the weak directions: an undetermined combination drifts."
    )
    unbalanced = (
        "The equations cannot be balanced within the limits of the unknowns. Ask for less, widen a "
        "limit, or start near."
    )
    undetermined = (
        "Converged, but the records do not determine at least one parameter, whose standard error "
        "is infinite. Fix one of the parameters of each weak direction, give a prior, or add "
        "records that excite it."
    )
    refused = (
        "The case was not estimated, because its records or its model did not pass the checks."
    )
