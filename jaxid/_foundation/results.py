"""Enumeration of the outcomes of a solve, each with a sentence on the cause and the remedy."""

from collections.abc import Sequence

import jax
import numpy as np
import optimistix as optx
from jax.core import Tracer

from .host import on_host
from .types import Array, Bool, Float


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
        "The simulation diverges at the starting values, so there is nothing to improve on. "
        "`jaxid.advice(records, model, free, likelihood)` names the probable cause. Where the "
        "model is faster than the samples, integrate in finer steps "
        "(`OutputError(stepper=RK4(10))`); else start from values for which it is stable, without "
        "a zero in a denominator, or shorten the record."
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


CONVERGED = (RESULTS.successful, RESULTS.at_bound)


def is_one_of(result: RESULTS, options: Sequence[RESULTS]) -> Bool[Array, "*batch"]:
    """True for results that are equal to one of the options."""
    (codes,) = jax.tree.leaves(result)
    return _equals_one_of(codes, jax.tree.leaves(options))


def with_undetermined(result: RESULTS, deviations: Float[Array, "*batch parameter"]) -> RESULTS:
    """Return the result, "undetermined" where it converged with an infinite standard error.

    Args:
        result: result of an estimate, or one for each case.
        deviations: standard errors of its parameters.
    """
    drifting = _drifting(is_one_of(result, CONVERGED), deviations)
    if not isinstance(drifting, Tracer) and not np.any(np.asarray(drifting)):
        return result  # `where` would compile a program
    return RESULTS.where(drifting, RESULTS.undetermined, result)


@on_host
def _drifting(xp, converged, deviations):
    return converged & xp.any(xp.isinf(deviations), axis=-1)


@on_host
def _equals_one_of(xp, codes, options):
    return xp.any(xp.stack([codes == option for option in options]), axis=0)
