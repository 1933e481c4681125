"""`Identification`: the result of `identify`, with both of its stages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.json_text import json_text
from .._foundation.notebook import Table
from ..data.record import Record
from ..data.stack import single_records, stack
from ..diagnosis.bands import Band, Bands, prediction_bands
from ..diagnosis.combined_bands import CombinedBand, combined_bands
from ..diagnosis.derivative_bands import derivative_bands
from ..diagnosis.validation import Prediction, predict
from ..estimation import Estimate, FilterError, OutputError
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel
from ..models.free import all_names, with_values
from ..models.noise import FixedNoise
from ..models.replace import polynomials_of, with_polynomials, with_terms
from ..models.stochastic import StochasticModel
from ..structure import Regression, Selection
from .terms.start import Start
from .terms.unusual_values import Parameter, unusual_values


class Equation(NamedTuple):
    """One response in the first stage.

    Attributes:
        selection: the log of its stepwise regression; None if the terms were given.
        regression: the regression model that was chosen.
        kept: True if its equation is used in maximum likelihood.
        reason: reason for `kept`, in words.
        estimated: the terms that maximum likelihood estimates; the others keep the regression's
            values.
    """

    selection: Selection | None
    regression: Regression
    kept: bool
    reason: str
    estimated: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Identification:
    """Structure and parameters of a model, from regression and from maximum likelihood.

    Attributes:
        equations: the first stage by response, including the equations left out.
        centre: the means about which terms are written, by signal.
        start_model: the model with the values of the regression.
        start: the second stage before its first step.
        estimate: the second stage.
        records: the prepared records that were fitted, a stack.
        likelihood: measure of the misfit.
        candidates: terms by response that the compiled programs of the model have, the absent ones
            with the value zero; none where the model has its own terms only.
        reduced: reason and limits of a structure that was reduced, because the selected one
            diverges at the values of the regression; empty if it starts.
        changes: changes of the terms after the first estimate, in words.
    """

    equations: dict[str, Equation]
    centre: dict[str, float]
    start_model: AbstractModel
    start: Start
    estimate: Estimate
    records: Record
    likelihood: AbstractLikelihood
    candidates: Mapping[str, tuple[str, ...]]
    reduced: str = ""
    changes: tuple[str, ...] = ()

    @property
    def model(self) -> AbstractModel:
        """The identified model, without process noise."""
        fitted, estimate = self.estimate.model, self.estimate
        if not isinstance(fitted, StochasticModel):
            return fitted
        own = with_polynomials(self.start_model, polynomials_of(fitted))
        named = [name for name in estimate.names if name in all_names(own)]
        values = [estimate.values[estimate.names.index(name)] for name in named]
        return with_values(own, named, jnp.stack(values))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Responses whose equation was left out."""
        return tuple(name for name, equation in self.equations.items() if not equation.kept)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Results of both stages for every term of the equations kept and every added parameter."""
        regressed = {
            f"{name}.{term}": (float(value), float(F))
            for name, equation in self.equations.items()
            if equation.kept
            for term, value, F in _terms(equation.regression)
        }
        start, estimate = self.start, self.estimate
        first = dict(zip(start.names, zip(start.values, start.F, strict=True), strict=True))
        columns = (
            estimate.values,
            estimate.standard_errors,
            estimate.corrected_errors,
            estimate.F,
        )
        last = dict(zip(estimate.names, np.stack(columns, axis=1).tolist(), strict=True))
        none = (float("nan"),) * 4
        return tuple(
            Parameter(
                name,
                *regressed.get(name, none[:2]),
                *map(float, first.get(name, none[:2])),
                *last.get(name, none),
            )
            for name in dict.fromkeys((*regressed, *estimate.names))
        )

    @property
    def caveats(self) -> tuple[str, ...]:
        """Estimates outside the usual range of their parameter, in words."""
        return unusual_values(self.parameters, self.start_model.usual_ranges())

    def prediction_bands(self, *signals: str) -> Bands:
        """Return states, outputs and signals along the fitted records, with their standard
        deviations (6.4 to 6.6), corrected for the colour of the residuals: a polynomial that is
        not the true function leaves coloured ones.

        Args:
            signals: names of the model's signals, such as `"Cm"`.
        """
        return prediction_bands(
            self.estimate, self.records, self.likelihood, signals, coloured=True
        )

    def combined_bands(
        self,
        records: Record | Sequence[Record],
        deviations: Mapping[str, float] | None = None,
    ) -> dict[str, CombinedBand]:
        """Return the kept responses with bands for their true values along the records.

        They include the misfit of the polynomials and the errors of instruments; see
        `jaxid.diagnosis.combined_bands`.

        Args:
            records: the records of `identify`, in the same order.
            deviations: standard deviations of constants of the model that are not estimated.
        """
        return combined_bands(
            self.estimate, single_records(records), self.likelihood, deviations, self.model
        )

    def derivatives(
        self, records: Record | Sequence[Record], pairs: Mapping[str, Sequence[str]]
    ) -> dict[str, Band]:
        """Return derivatives of responses along the measured signals of records, with deviations;
        see `jaxid.diagnosis.derivative_bands`.

        Args:
            records: the records of `identify`, in the same order.
            pairs: signals by response, such as `{"Cn": ("rudder", "rhat")}`.

        Returns:
            Bands of shape (case, time) by name: `dCn/drudder`, `dCn/drhat`.
        """
        kept = {name: one.regression for name, one in self.equations.items() if one.kept}
        return derivative_bands(self.estimate, kept, self.model, single_records(records), pairs)

    def plot(
        self,
        case: int = 0,
        records: Record | Sequence[Record] | None = None,
        *,
        derivatives: Mapping[str, Sequence[str]] | None = None,
        deviations: Mapping[str, float] | None = None,
        truth: Mapping[str, Any] | None = None,
    ) -> Any:
        """Return a figure with bands of two deviations, by matplotlib (`jaxid[report]`).

        It has measured and fitted outputs (Figs. 6.3, 6.6); with `records` the responses by
        `combined_bands` (6.4, 6.7); with `derivatives` these in their place (6.5, 6.8).

        Args:
            case: which record.
            records: the records of `identify`, in the same order.
            derivatives: signals by response, as for `derivatives`.
            deviations: as for `combined_bands`.
            truth: true histories by response or derivative, such as `dCn/drudder`, if known.
        """
        from ..report import figures_identification as figures

        if records is None:
            return figures.responses(self.records, self.prediction_bands().measured, case)
        single = single_records(records)
        if derivatives is not None:
            return figures.derivatives(single, self.derivatives(single, derivatives), truth, case)
        measured = [self.model.pseudo_measurements(record) for record in single]
        bands = self.combined_bands(single, deviations)
        return figures.coefficients(single, measured, bands, truth, case)

    def predict(
        self,
        records: Record | Sequence[Record],
        *,
        window: int | None = None,
        states: Sequence[str] | None = None,
    ) -> Prediction:
        """Predict other flights with the identified model (section 6.5).

        Args:
            records: records with the same channels as for `identify`.
            window: samples at the start in which the initial state is fitted, left out of the
                error; None starts at the measured state.
            states: states whose initial value is fitted there, all by default.
        """
        prepared = [self.model.prepared(record) for record in single_records(records)]
        known = self._simulation()
        model = with_terms(self.model, self.candidates)
        return predict(model, stack(prepared), known, window=window, states=states)

    def _simulation(self) -> AbstractLikelihood:
        """Return the likelihood with the estimated noise, without a filter."""
        noise = FixedNoise(self.estimate.noise)
        if isinstance(self.likelihood, FilterError):
            return OutputError(noise, self.likelihood.hold, self.likelihood.stepper)
        return eqx.tree_at(lambda node: node.noise, self.likelihood, noise)

    def to_dict(self) -> dict[str, Any]:
        """Return the results of both stages as plain numbers and words; a number that a stage does
        not have is NaN.
        """
        return {
            "equations": {
                name: {
                    "kept": equation.kept,
                    "reason": equation.reason,
                    "terms": list(equation.regression.names),
                    "R2": float(equation.regression.R2),
                }
                for name, equation in self.equations.items()
            },
            "centre": {name: float(value) for name, value in self.centre.items()},
            "parameters": {row.name: _without_name(row) for row in self.parameters},
            "reduced": self.reduced,
            "changes": list(self.changes),
            "caveats": list(self.caveats),
            "start_cost": float(self.start.cost),
            "estimate": self.estimate.to_dict(),
        }

    def to_xarray(self) -> Any:
        """Return the results of both stages as an `xarray.Dataset` with the axes `parameter` and
        `equation`; a number that a stage does not have is NaN.
        """
        import xarray as xr  # imported here because it is slow to import

        rows, equations = self.parameters, self.equations.values()
        columns = Parameter._fields[1:]
        return xr.Dataset(
            {name: ("parameter", [getattr(row, name) for row in rows]) for name in columns}
            | {
                "R2": ("equation", [float(equation.regression.R2) for equation in equations]),
                "kept": ("equation", [bool(equation.kept) for equation in equations]),
            },
            coords={
                "parameter": [row.name for row in rows],
                "equation": list(self.equations),
            },
            attrs={"model": type(self.model).__name__, "reduced": self.reduced},
        )

    def to_json(self) -> str:
        """Return the results as a JSON object; a number that is not finite is null."""
        return json_text(self.to_dict())

    def _repr_html_(self) -> str:
        return self._table().html(above=self._equation_lines(), below=self._notes())

    def __str__(self) -> str:
        lines = [*self._equation_lines(), "", *self._table().lines(), *self._notes()]
        return "\n".join(lines)

    def _equation_lines(self) -> list[str]:
        """Lines on the equations of the first stage."""
        lines = [f"reduced: {self.reduced}"] if self.reduced else []
        for name, equation in self.equations.items():
            regression = equation.regression
            lines.append(
                f"{name}: {equation.reason}; R2 {regression.R2:.4f}, {len(regression.names)} terms "
                f"({', '.join(regression.names) or 'none'})"
            )
        centre = ", ".join(f"{name} - {value:.5g}" for name, value in self.centre.items())
        return [*lines, f"terms are written in {centre}"] if centre else lines

    def _table(self) -> Table:
        """Both stages by parameter: value and F of the regression, F at the start, and maximum
        likelihood.
        """
        stages = ("regression", "F", "F at start", "likelihood", "std. error", "coloured", "F")
        units = dict(zip(self.estimate.names, self.estimate.units, strict=True))
        rows = []
        for name, value, F, _, start_F, *last in self.parameters:
            cells = (_cell(number) for number in (value, F, start_F, *last))
            rows.append((name, *cells, units.get(name, "")))
        return Table(("parameter", *stages, "unit"), (9,) + (11,) * 7, tuple(rows))

    def _notes(self) -> list[str]:
        """Changes of the terms and weak directions in words, and the status."""
        lines = [f"change: {words}" for words in self.changes]
        lines += [f"caveat: {sentence}" for sentence in self.caveats]
        lines += [f"weak: {sentence}" for sentence in self.estimate.weak_directions]
        status = (
            f"status: {self.estimate.status} ({int(self.estimate.iterations)} iterations, cost "
            f"{self.start.cost:.6g} to {float(self.estimate.cost):.6g})"
        )
        return [*lines, status]


def _terms(regression: Regression):
    """Name, value and F of each term and of the constant, whose F decides nothing."""
    yield from zip(regression.names, regression.values, regression.F, strict=True)
    if regression.has_constant:
        yield "1", regression.constant, (regression.constant / regression.constant_error) ** 2


def _without_name(row: Parameter) -> dict[str, float]:
    return {key: value for key, value in row._asdict().items() if key != "name"}


def _cell(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.4g}"
