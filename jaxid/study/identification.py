"""What `identify` found: both stages side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float
from ..data.record import Record
from ..data.stack import stack
from ..diagnosis.bands import Bands, bands
from ..diagnosis.validation import Prediction, predict
from ..estimation import Estimate
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..models.base import AbstractModel
from ..models.free import Free, start
from ..models.noise import FixedNoise
from ..sensitivity.spectrum import spectrum
from ..structure import Regression, Selection

THRESHOLD = 1e-10  # of eigenvalues relative to the largest, as the report has it (section 4.4)


class Equation(NamedTuple):
    """One response in the first stage.

    Attributes:
        selection: the log of its stepwise regression; None where the terms were given.
        regression: the model that was taken of it.
        kept: whether its equation goes on to maximum likelihood.
        why: in words.
        estimated: the terms that maximum likelihood estimates; the others keep the regression's values.
    """

    selection: Selection | None
    regression: Regression
    kept: bool
    why: str
    estimated: tuple[str, ...]


class Start(NamedTuple):
    """The second stage at the regression's values, before its first step.

    Attributes:
        names: of the estimated parameters.
        values: where they start.
        F: `(value / standard error)^2` with the standard errors that maximum likelihood would give there.
        cost: negative log-likelihood without its constant.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " parameter"]
    F: Float[np.ndarray, " parameter"]
    cost: float


class Parameter(NamedTuple):
    """One line of the result, as in Table 6.5; NaN where a stage does not have the number.

    Attributes:
        name: in the model.
        regression, regression_F: value and F of the regression.
        start, start_F: value and F at the start of maximum likelihood.
        value, standard_error, coloured_error, F: of maximum likelihood; a parameter that it did not estimate has none.
    """

    name: str
    regression: float
    regression_F: float  # noqa: N815
    start: float
    start_F: float  # noqa: N815
    value: float
    standard_error: float
    coloured_error: float
    F: float


@dataclass(frozen=True, eq=False)
class Identification:
    """Structure and parameters of a model, from regression and from maximum likelihood.

    Attributes:
        equations: the first stage by response, those left out included.
        centre: the means about which terms are written, by signal.
        started: the model with the regression's values.
        start: the second stage before its first step.
        estimate: the second stage.
        records: the prepared records that it was fitted to, a stack.
        likelihood: how the misfit was measured.
    """

    equations: dict[str, Equation]
    centre: dict[str, float]
    started: AbstractModel
    start: Start
    estimate: Estimate
    records: Record
    likelihood: AbstractLikelihood

    @property
    def model(self) -> AbstractModel:
        """The identified model."""
        return self.estimate.model

    @property
    def left_out(self) -> tuple[str, ...]:
        """Responses whose equation was left out."""
        return tuple(name for name, one in self.equations.items() if not one.kept)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every term of the equations that were kept and every added parameter, with what each stage says of it."""
        regressed = {
            f"{name}.{term}": (float(value), float(F))
            for name, one in self.equations.items()
            if one.kept
            for term, value, F in _terms(one.regression)
        }
        first = dict(zip(self.start.names, zip(self.start.values, self.start.F, strict=True), strict=True))
        found = self.estimate
        last = dict(
            zip(
                found.names,
                np.stack([found.values, found.standard_errors, found.coloured_errors, found.F], axis=1).tolist(),
                strict=True,
            )
        )
        none = (float("nan"),) * 4
        return tuple(
            Parameter(
                name, *regressed.get(name, none[:2]), *map(float, first.get(name, none[:2])), *last.get(name, none)
            )
            for name in dict.fromkeys((*regressed, *found.names))
        )

    def bands(self, *signals: str) -> Bands:
        """States, outputs and signals along the records that were fitted, with their standard deviations (6.4 to 6.6).

        Args:
            signals: names of the model's signals, such as `"Cm"`.
        """
        return bands(self.estimate, self.records, self.likelihood, signals)

    def predict(
        self,
        records: Record | Sequence[Record],
        *,
        window: int | None = None,
        states: Sequence[str] | None = None,
    ) -> Prediction:
        """Predict other flights with the identified model (section 6.5).

        Args:
            records: with all that was measured, as for `identify`.
            window: samples at the start in which the initial state is fitted, left out of the error; None starts at the
                measured one.
            states: those whose initial value is fitted there, all by default.
        """
        single = [records] if isinstance(records, Record) and not records.is_stack else list(records)
        prepared = [self.model.prepared(record) for record in single]
        known = eqx.tree_at(lambda one: one.noise, self.likelihood, FixedNoise(self.estimate.noise))
        return predict(self.model, stack(prepared), known, window=window, states=states)

    def __str__(self) -> str:
        lines = []
        for name, one in self.equations.items():
            found = one.regression
            lines.append(
                f"{name}: {one.why}; R2 {found.R2:.4f}, {len(found.names)} terms ({', '.join(found.names) or 'none'})"
            )
        centre = ", ".join(f"{name} - {value:.5g}" for name, value in self.centre.items())
        lines += [f"terms are written in {centre}", ""] if centre else [""]
        rows = self.parameters
        width = max([len(row.name) for row in rows] + [9])
        lines.append(f"{'':<{width}} {'regression':^23} {'start':^10} {'maximum likelihood':^46}")
        heads = ("value", "F", "F", "value", "std. error", "coloured", "F")
        lines.append(f"{'parameter':<{width}} " + " ".join(f"{head:>11}" for head in heads))
        for row in rows:
            cells = (
                row.regression,
                row.regression_F,
                row.start_F,
                row.value,
                row.standard_error,
                row.coloured_error,
                row.F,
            )
            lines.append(f"{row.name:<{width}} " + " ".join(_cell(value) for value in cells))
        lines += [f"weak: {sentence}" for sentence in self.estimate.weak_directions]
        lines.append(
            f"status: {self.estimate.status} ({int(self.estimate.iterations)} iterations, cost {self.start.cost:.6g} to "
            f"{float(self.estimate.cost):.6g})"
        )
        return "\n".join(lines)


def a_priori(model: AbstractModel, free: Free, records: Record, likelihood: AbstractLikelihood) -> Start:
    """Cost and F-values at the start of maximum likelihood.

    Args:
        model: with the regression's values.
        free: what will be estimated.
        records: a stack.
        likelihood: how the misfit is measured.
    """
    values, cost, F = _at_start(Problem.of(model, free, records, likelihood))
    return Start(free.shared, np.asarray(values), np.asarray(F), float(cost))


@eqx.filter_jit
def _at_start(problem: Problem) -> tuple[Array, Array, Array]:
    begin = start(problem.model, problem.positions, problem.records)
    cost, linearised = problem.evaluate(begin)
    information = linearised.information
    found = spectrum(information.triangle, information.rhs, problem.limits.scale)
    return begin.shared, cost, begin.shared**2 / jnp.diagonal(found.covariance(THRESHOLD))


def _terms(regression: Regression):
    """Name, value and F of each term; the constant's F is of the same kind, though it decides nothing."""
    yield from zip(regression.names, regression.values, regression.F, strict=True)
    if regression.has_constant:
        yield "1", regression.constant, (regression.constant / regression.constant_error) ** 2


def _cell(value: float) -> str:
    return f"{'':>11}" if np.isnan(value) else f"{value:>11.4g}"
