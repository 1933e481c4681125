"""`update`: an estimate with further records added, from its square-root factor alone.

The factor enters the iteration as further rows of misfit of the new records, so that earlier
records need not be kept.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_float64
from .._foundation.types import Array, Float, Int
from ..data.record import Record
from ..estimation.argument_checks import check_arguments
from ..estimation.estimate import as_stack, check_channels, check_known, fit_problem
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.result import Estimate
from ..estimation.solver import GaussNewton, solver_or_default
from ..models.base import canonical
from ..models.free import Free, initial_parameters
from ..models.names import flatten
from ..models.noise import FixedNoise


class WithFactor(AbstractLikelihood):
    """A likelihood with the information of earlier records.

        J = J_new(theta) + 1/2 |r - T (theta - origin)|^2

    The rows `r - T (theta - origin)`, divided by the square root of the number of records, are
    further rows of misfit at the first sample of each record.

    Attributes:
        noise: of the outputs, with unit variance for the further rows.
        new: the likelihood of the new records.
        T, r: factor of the earlier records, divided.
        origin: parameters about which the factor is.
        positions: of the parameters in the flat vector of the model.
    """

    noise: FixedNoise
    new: AbstractLikelihood
    T: Float[Array, "row parameter"]
    r: Float[Array, " row"]
    origin: Float[Array, " parameter"]
    positions: Int[Array, " parameter"]

    def solve(self, model, record, initial_state):
        return self.new.solve(model, record, initial_state)

    def rows(self, model, record, initial_state):
        rows = self.new.rows(model, record, initial_state)
        return self._extended(rows, self._misfit(flatten(model)[0][self.positions]))

    def n_sensitive(self, n_outputs):
        return n_outputs + self.r.size

    def row_mask(self, mask):
        rows = self.new.row_mask(mask)
        first = jnp.arange(rows.shape[-2]) == 0
        shape = (*rows.shape[:-1], self.r.size)
        return jnp.concatenate([rows, jnp.broadcast_to(first[:, None], shape)], axis=-1)

    def residuals(self, rows, mask):
        return self.new.residuals(rows[..., : -self.r.size], mask)

    def measurement_covariance(self, model, rows, mask):
        count = mask.shape[-1]
        return self.noise.R[:count, :count]

    def sensitivities(self, family, theta, record):
        rows, S = self.new.sensitivities(family, theta, record)
        shared = theta[theta.size - self.origin.size :]
        own = jnp.zeros((self.r.size, theta.size - self.origin.size))
        columns = jnp.concatenate([own, self.T], axis=1)
        return self._extended(rows, self._misfit(shared)), self._extended(S, columns)

    def check(self, model, records):
        self.new.check(model, records)

    def check_times(self, t):
        self.new.check_times(t)

    def _misfit(self, shared):
        return self.r - self.T @ (shared - self.origin)

    def _extended(self, rows, further):
        """Return rows with further ones at the first sample, and zeros at the others."""
        columns = jnp.zeros((rows.shape[0], *further.shape)).at[0].set(further)
        return jnp.concatenate([rows, columns], axis=1)


def update(
    estimate: Estimate,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood,
    *,
    solver: GaussNewton | None = None,
) -> Estimate:
    """Return an estimate with further records, from the square-root factor of the earlier ones.

        theta = argmin J_new(theta) + 1/2 |r - T (theta - theta_earlier)|^2

    For a model that is linear in its parameters and a known R it equals the joint estimate from
    all records. Otherwise the earlier records count by their quadratic approximation at their own
    estimate. The result has the factor of all records and can be updated again. To combine
    estimates that were made separately, use `jaxid.uncertainty.combine`.

    Args:
        estimate: from `estimate` or `update`, of one case, without a parameter on a bound.
        records: the new records; parameters of a record are estimated for these alone.
        likelihood: likelihood of the new records, whose rows are the residuals, such as
            `OutputError()`. If its R is unknown, R is fixed at that of the estimate.
        solver: options of the iteration, which starts at the estimate.

    Returns:
        The estimate; `residuals`, `own` and the start are those of this update. The corrected
        errors are NaN, as the colour of the earlier residuals is not in the factor.

    Raises:
        InputError: when the estimate has several cases or a parameter on a bound, channels differ,
            or the likelihood has rows other than residuals.
    """
    require_float64()
    _check_estimate(estimate)
    records = as_stack(records)
    model = canonical(estimate.model)
    check_arguments(model, records, likelihood)
    check_channels(model, records)
    check_known(model, records, likelihood)
    # The factor contains the priors.
    old = canonical(estimate.free)
    free = Free(old.shared, old.per_record, old.lower, old.upper, old.scale)
    extended = _with_factor(estimate, likelihood, free.positions(model).shared, records.n_cases)
    require(
        likelihood.row_mask(records.mask).shape == records.mask.shape,
        f"The rows of {type(likelihood).__name__} are not residuals. Update with `OutputError`, or "
        "estimate from all records.",
    )
    solver = solver_or_default(solver)
    problem = Problem.of(model, free, records, extended)
    begin = initial_parameters(model, problem.positions, problem.records)
    fit = fit_problem(problem, begin, solver)
    result = Estimate.of(fit, model, free, records, solver.policy.threshold, noise_known=True)

    def corrected(one):
        return one.corrected_errors, one.corrected_dof, one.corrected_own

    unknown = [jnp.full(array.shape, jnp.nan) for array in corrected(result)]
    return eqx.tree_at(corrected, result, unknown)


def _with_factor(
    estimate: Estimate,
    likelihood: AbstractLikelihood,
    positions: Int[Array, " parameter"],
    count: int,
) -> WithFactor:
    """Return the likelihood with the factor of an estimate, for a number of records."""
    R = np.asarray(estimate.noise)
    if isinstance(likelihood.noise, FixedNoise):
        R = np.asarray(likelihood.noise.R)
    size = len(estimate.names)
    covariance = np.eye(len(R) + size)
    covariance[: len(R), : len(R)] = R
    factor = np.asarray(estimate.information.factor)[:size] / np.sqrt(count)
    return WithFactor(  # pyright: ignore[reportCallIssue]
        FixedNoise(covariance),
        canonical(likelihood),
        jnp.asarray(factor[:, :-1]),
        jnp.asarray(factor[:, -1]),
        jnp.asarray(estimate.values),
        positions,
    )


def _check_estimate(estimate: Estimate) -> None:
    """Refuse a batch of cases, and a parameter on a bound, which has no information."""
    if np.ndim(estimate.values) != 1:
        raise InputError("The estimate is a batch of cases. Update its cases one by one.")
    on = np.flatnonzero(np.asarray(estimate.on_bound))
    names = ", ".join(estimate.names[index] for index in on)
    require(
        not names,
        f"The estimate has {names} on a bound, where its factor has no information. Estimate "
        "without the bound, or fix the parameter.",
    )
