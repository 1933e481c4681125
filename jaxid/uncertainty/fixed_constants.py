"""`consider`: the errors that fixed but uncertain constants of the model add to an estimate.

They are the consider parameters of the field (Schmidt, Application of state-space methods to
navigation problems, 1966; Bierman, Factorization Methods for Discrete Sequential Estimation, 1977,
chapter 8).
"""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.compiler import fast_compile_jit
from .._foundation.notebook import Table
from .._foundation.types import Array, Float
from ..data.record import Record
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.result import Estimate
from ..models.free import Free, Parameters, all_names, flat_vectors
from ..sensitivity.information import Information
from ..sensitivity.spectrum import spectrum
from .argument_checks import stack_of_estimate


class FixedConstants(eqx.Module):
    """Fixed constants with their uncertainty, and the errors that they add to an estimate.

    Attributes:
        names: names of the constants.
        values, deviations: the fixed values and their standard deviations.
        parameters: names of the shared parameters of the estimate.
        gain: change of each estimate by a change of each constant, `dtheta/dc`.
        own_gain: the same of the parameters of each single record, with the shared ones held.
        covariance: of the shared parameters, with that of the constants.
        standard_errors: from this covariance.
        without: standard errors without the constants.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    values: Float[Array, " constant"]
    deviations: Float[Array, " constant"]
    parameters: tuple[str, ...] = eqx.field(static=True)
    gain: Float[Array, "parameter constant"]
    own_gain: Float[Array, "case own constant"]
    covariance: Float[Array, "parameter parameter"]
    standard_errors: Float[Array, " parameter"]
    without: Float[Array, " parameter"]

    @property
    def contributions(self) -> Float[Array, "parameter constant"]:
        """Standard error of each parameter that is due to each constant alone."""
        return jnp.abs(self.gain) * self.deviations[None]

    def _repr_html_(self) -> str:
        return self._table().html()

    def __str__(self) -> str:
        return "\n".join(self._table().lines())

    def _table(self) -> Table:
        """Return the errors of each parameter in words."""
        columns = ("std. error", *(f"by {name}" for name in self.names), "together")
        numbers = np.column_stack([self.without, self.contributions, self.standard_errors])
        rows = (
            (name, *(f"{value:.3g}" for value in row), "")
            for name, row in zip(self.parameters, numbers, strict=True)
        )
        widths = (9, *(max(10, len(column)) for column in columns))
        return Table(("parameter", *columns, ""), widths, tuple(rows))


def consider(
    estimate: Estimate,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood,
    deviations: Mapping[str, float],
) -> FixedConstants:
    """Return the errors of an estimate with those that its fixed constants add.

        P = C + K diag(sigma^2) K',    K = dtheta/dc = -M^-1 sum_i S_i' R^-1 dy_i/dc

    The unknowns of each record are eliminated. The constants are independent of each other and of
    the noise, and the result is of first order in their errors: exact where the model is linear in
    parameters and constants and R is known. A direction that the data do not determine is held.

    Args:
        estimate: from `estimate`, of one case.
        records: the records of the estimate, in the same order.
        likelihood: the likelihood of the estimate.
        deviations: standard deviation of each constant [its unit], by the dotted name of a
            parameter that is not free, such as a mass or the position of a sensor.

    Returns:
        The widened covariance, and the share of each constant.

    Raises:
        InputError: for a name that is no parameter or is free, a standard deviation that is not
            positive, or a constant that differs from record to record.
    """
    records, free = stack_of_estimate(estimate, records, likelihood), estimate.free
    names = tuple(deviations)
    available = all_names(estimate.model)
    require_known("fixed constant", names, available)
    for name in names:
        require(
            name not in free.shared + free.per_record,
            f"{name!r} is free, so its uncertainty is estimated. Fix it, or give it a prior.",
        )
        require(
            bool(np.isfinite(deviations[name]) and deviations[name] > 0),
            f"The standard deviation of {name!r} is {deviations[name]}; it must be positive.",
        )
    flat = np.asarray(flat_vectors(estimate.model, records))
    constants = flat[:, [available.index(name) for name in names]]
    for name, column in zip(names, constants.T, strict=True):
        require(
            bool(np.all(column == column[0])),
            f"{name!r} is {column.min():g} to {column.max():g} in these records. Consider one "
            "record at a time: a common error needs a common value.",
        )
    extended = Free(
        free.shared + names, free.per_record, free.lower, free.upper, free.scale, free.prior
    )
    problem = Problem.of(estimate.model, extended, records, likelihood)
    shared = jnp.concatenate([estimate.values, jnp.asarray(constants[0])])
    information = _information(problem, Parameters(shared, estimate.own))
    sigma = jnp.asarray([float(deviations[name]) for name in names])
    gain, own_gain, added = _gains(
        information, problem.limits.scale[: len(free.shared)], sigma, estimate.threshold
    )
    covariance = estimate.covariance + added
    held = np.asarray(estimate.on_bound)
    errors = np.where(held, np.nan, np.sqrt(np.diagonal(covariance)))
    return FixedConstants(
        names=names,
        values=jnp.asarray(constants[0]),
        deviations=sigma,
        parameters=estimate.names,
        gain=gain,
        own_gain=own_gain,
        covariance=covariance,
        standard_errors=jnp.asarray(errors),
        without=estimate.standard_errors,
    )


@fast_compile_jit
def _information(problem: Problem, parameters: Parameters) -> Information:
    """Return the information on parameters and constants together."""
    return problem.linearise(parameters).information


@eqx.filter_jit
def _gains(information: Information, scale, sigma, threshold: float):
    """Return the gains of shared and own parameters and the covariance that they add."""
    count = scale.size
    T, by_constant = information.triangle[:, :count], information.triangle[:, count:]
    half = spectrum(T, information.rhs, scale).square_root(threshold)
    gain = -half @ (half.T @ (T.T @ by_constant))
    own_gain = -information.own.inverse @ information.own.coupling[..., count:]
    weighted = gain * sigma[None]
    return gain, own_gain, weighted @ weighted.T
