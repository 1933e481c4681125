"""`multi_start`: estimates from many starts, and the table of the minima that they reach."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require
from .._foundation.notebook import Table
from .._foundation.types import Float
from ..data.record import Record
from ..estimation.argument_checks import require_no_shooting
from ..estimation.estimate import Case, checked_case, fit_problem
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.result import Estimate
from ..estimation.solver import GaussNewton, solver_or_default
from ..models.base import AbstractModel, canonical
from ..models.free import Free, Parameters, with_values
from ..models.names import read_parameters
from .estimate_many import estimate_many
from .results import SUCCESSFUL, UNDETERMINED

# Two ends are one minimum if their costs and their values, in standard errors, differ less (chosen;
# the solver stops within 1e-6 standard errors of a minimum).
SAME_COST, SAME_VALUES = 1e-3, 0.1


class Minimum(NamedTuple):
    """A minimum of the cost.

    Attributes:
        cost: negative log-likelihood.
        starts: number of starts that end there.
        values: values of the shared parameters.
    """

    cost: float
    starts: int
    values: Float[np.ndarray, " parameter"]


class MultiStart(eqx.Module):
    """Estimates from many starts.

    Attributes:
        estimate: the estimate at the lowest minimum.
        minima: all minima, the lowest first.
        failures: number of starts by outcome, of those that reached no minimum.
    """

    estimate: Estimate
    minima: tuple[Minimum, ...]
    failures: dict[str, int] = eqx.field(static=True)

    def __str__(self) -> str:
        return "\n".join([*self._table().lines(), *self._failure_lines()])

    def _repr_html_(self) -> str:
        return self._table().html(below=self._failure_lines())

    def _table(self) -> Table:
        """Return the minima in words."""
        names = self.estimate.names
        rows = (
            (str(starts), f"{cost:.6g}", *(f"{value:.6g}" for value in values), "")
            for cost, starts, values in self.minima
        )
        return Table(("starts", "cost", *names, ""), (6, *[13] * (1 + len(names))), tuple(rows))

    def _failure_lines(self) -> list[str]:
        return [f"{count} without a minimum: {why}" for why, count in self.failures.items()]


def multi_start(
    model: AbstractModel,
    free: Free,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood,
    *,
    starts: int | np.integer | Float[np.ndarray, "start parameter"] = 20,
    spread: float = 0.5,
    seed: int = 0,
    solver: GaussNewton | None = None,
) -> MultiStart:
    """Return the estimates from many starts, by minimum.

    The first start is the model. The others are drawn: uniformly between the bounds of a parameter
    that has two, otherwise `value (1 + spread e)` with e uniform in (-1, 1), within the bounds.

    Args:
        model: the model; its values are the first start.
        free: the free parameters.
        records: one record, several records, or a stack, fitted together.
        likelihood: the likelihood.
        starts: number of starts, or the starts themselves.
        spread: largest relative change of a value without two bounds; a value of zero has none and
            needs bounds or starts of its own.
        seed: of the draws.
        solver: options of the iteration.

    Raises:
        InputError: when no start reaches a minimum, the likelihood has `shooting`, or the inputs do
            not suit `estimate`.
    """
    require_no_shooting(likelihood, "multi_start")
    model = canonical(model)
    if isinstance(starts, int | np.integer):
        require(int(starts) >= 1, f"`starts` is {starts}; give at least 1.")
        starts = _drawn(model, free, int(starts), spread, seed)
    cases = [records] * len(starts)
    results = estimate_many(model, free, cases, likelihood, starts=starts, solver=solver)
    status = results["status"].values
    reached = np.isin(status, (*SUCCESSFUL, UNDETERMINED))
    failures = {
        str(reason): int(count)
        for reason, count in zip(
            *np.unique(results["reason"].values[~reached].astype(str), return_counts=True),
            strict=True,
        )
    }
    if not reached.any():
        words = "; ".join(f"{count} starts: {reason}" for reason, count in failures.items())
        raise InputError(f"No start reaches a minimum. {words}")
    costs, values, errors, own = (
        results[name].values[reached] for name in ("cost", "values", "standard_errors", "own")
    )
    best = np.argmin(costs)
    end = Parameters(jnp.asarray(values[best]), jnp.asarray(own[best]))
    fit = _fit_from(end, checked_case(model, free, records, likelihood), solver_or_default(solver))
    return MultiStart(fit, _minima(costs, values, errors), failures)


def _fit_from(begin: Parameters, case: Case, solver: GaussNewton) -> Estimate:
    """Return the estimate of a case whose iteration starts at some parameters."""
    started = case._replace(model=with_values(case.model, case.free.shared, begin.shared))
    return started.estimate(fit_problem(case.problem, begin, solver), solver)


def _drawn(model: AbstractModel, free: Free, count: int, spread: float, seed: int) -> np.ndarray:
    """Return the value of the model and random starts, shape (start, parameter)."""
    values = np.asarray(read_parameters(model, free.shared))
    low = np.array([free.lower.get(name, -np.inf) for name in free.shared])
    high = np.array([free.upper.get(name, np.inf) for name in free.shared])
    bounded = np.isfinite(low) & np.isfinite(high)
    unit = np.random.default_rng(seed).random((count - 1, values.size))
    between = np.where(bounded, low, 0.0) + unit * np.where(bounded, high - low, 0.0)
    around = np.clip(values * (1.0 + spread * (2.0 * unit - 1.0)), low, high)
    return np.concatenate([values[None], np.where(bounded, between, around)])


def _minima(costs: np.ndarray, values: np.ndarray, errors: np.ndarray) -> tuple[Minimum, ...]:
    """Return the minima of the ends of some iterations, the lowest first."""
    minima: list[Minimum] = []
    for index in np.argsort(costs):
        for k, known in enumerate(minima):
            determined = np.isfinite(errors[index]) & (errors[index] > 0)
            apart = np.abs(values[index] - known.values)[determined] / errors[index][determined]
            if costs[index] - known.cost < SAME_COST and np.all(apart < SAME_VALUES):
                minima[k] = known._replace(starts=known.starts + 1)
                break
        else:
            minima.append(Minimum(float(costs[index]), 1, values[index]))
    return tuple(minima)
