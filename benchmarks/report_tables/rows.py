"""Numbers of a case and of the report: the rows of Tables 6.3 and 6.5 to 6.16."""

from typing import NamedTuple

import numpy as np

from benchmarks import report_numbers
from benchmarks.report_tables.cases import CaseResult
from benchmarks.report_tables.coefficients import motion_signals
from benchmarks.report_tables.settings import BIAS
from jaxid.aircraft import Flight
from jaxid.structure import REPORT, Selection, columns, stepwise

NONE = float("nan")
PRINTED_SAMPLES = 100  # Table 6.2


class Numbers(NamedTuple):
    """Numbers of both stages for a parameter; NaN where a stage does not have the number.

    Attributes:
        regression, F_regression: value and F of the regression.
        F_start: F by likelihood at the regression's values.
        final, F_final: of maximum likelihood; NaN where the term kept the regression's value.
    """

    regression: float = NONE
    F_regression: float = NONE
    F_start: float = NONE
    final: float = NONE
    F_final: float = NONE


class Row(NamedTuple):
    """A term of an equation, or a bias: our numbers and the report's.

    Attributes:
        response, term: coefficient and term; `bias` and the channel.
        ours, printed: the numbers.
    """

    response: str
    term: str
    ours: Numbers
    printed: Numbers


def parameter_rows(result: CaseResult, table: str | None = None) -> list[Row]:
    """Every term that we or the report have, ours first, strongest first within an equation.

    Args:
        result: of a case, or of a larger set for it.
        table: of the report's likelihood, where a case has two.
    """
    ours = {_key(one.name): one for one in result.identified.parameters}
    case = result.flights[0].record.names[0]
    chosen = {(one.response, one.term): one for one in report_numbers.regression(case)}
    refined = {
        (one.response, one.term): one
        for one in report_numbers.likelihood(case)
        if table in (None, one.table)
    }
    order = [*result.identified.equations, "bias"]
    keys = [key for key in dict.fromkeys((*ours, *chosen, *refined)) if key[0] in order]
    rows = []
    for key in sorted(keys, key=lambda key: (order.index(key[0]), *_rank(ours.get(key)))):
        estimate, first, last = ours.get(key), chosen.get(key), refined.get(key)
        our_numbers = (
            Numbers(
                estimate.regression,
                estimate.regression_F,
                estimate.start_F,
                estimate.value,
                estimate.F,
            )
            if estimate
            else Numbers()
        )
        begin = (
            (first.estimate, first.F)
            if first
            else (last.start, last.F_regression)
            if last
            else (None, None)
        )
        printed_numbers = Numbers(
            *map(
                _number,
                (*begin, *((last.F_start, last.final, last.F_final) if last else (None,) * 3)),
            )
        )
        rows.append(Row(*key, our_numbers, printed_numbers))
    return rows


class OverallF(NamedTuple):
    """Overall F of an equation beside the report's, `F = R2 / (1 - R2) (N - k - 1) / k`.

    Attributes:
        response: coefficient.
        ours, printed: overall F.
        terms, printed_terms: number of terms k.
        near: True if ours is within a factor of two of the report's.
        same_terms: our F at the step of the regression with the report's number of terms, NaN
            without such a step. Where this is near and ours is not, the number of terms is the
            reason.
        without_errors: the same along the true motion, with the true coefficient: the misfit of the
            polynomial to the tables alone limits it. Where it is far from the printed one, no
            noise is the reason.
        signal, form: the ratio of ours to the report's as a product: of `R2 / (1 - R2)`, signal
            over residual, and of `(N - k - 1) / k`, the number of terms.
    """

    response: str
    ours: float
    printed: float
    terms: int
    printed_terms: int
    near: bool
    same_terms: float
    without_errors: float
    signal: float
    form: float


def overall_F(result: CaseResult) -> list[OverallF]:
    """Return the overall F of each equation for which the report prints one."""
    case = result.flights[0].record.names[0]
    printed = {one.response: one.F for one in report_numbers.equations(case)}
    chosen = [one.response for one in report_numbers.regression(case) if one.F is not None]
    rows = []
    for name, equation in result.identified.equations.items():
        if name not in printed:
            continue
        regression, k = equation.regression, chosen.count(name)
        models = equation.selection.models if equation.selection else ()
        same = next((float(one.overall_F) for one in models if len(one.terms) == k), NONE)
        clean = error_free_F(result.flights[0], equation.selection, k)
        form = _form(len(regression.names)) / _form(k)
        ratio = float(regression.overall_F) / printed[name]
        rows.append(
            OverallF(
                name,
                float(regression.overall_F),
                printed[name],
                len(regression.names),
                k,
                0.5 <= ratio <= 2.0,
                same,
                clean,
                ratio / form,
                form,
            )
        )
    return rows


def error_free_F(flight: Flight, selection: Selection | None, terms: int) -> float:
    """Return the largest overall F of a regression of a true coefficient with some number of terms.

    Args:
        flight: its true motion, about the means, gives the regressors.
        selection: path of the regression of the measured coefficient, for its candidates; NaN is
            returned without one, or if no regression on the new path has this number of terms.
        terms: number of terms.
    """
    if selection is None:
        return NONE
    signals, names = motion_signals(flight), selection.problem.names
    centre = {name: float(np.mean(signals[name])) for name in ("alpha", "beta")}
    y = np.asarray(flight.truth.channel(selection.problem.response))
    path = stepwise(columns(names, signals, centre), y, names, options=REPORT)
    return max(
        (float(one.overall_F) for one in path.models if len(one.terms) == terms), default=NONE
    )


def _form(terms: int) -> float:
    return (PRINTED_SAMPLES - terms - 1) / max(terms, 1)


def estimated(result: CaseResult) -> dict[str, tuple[float, float, float]]:
    """By name, F of the regression, F at the start, and final F of each estimated term, constants
    and biases aside.
    """
    return {
        one.name: (one.regression_F, one.start_F, one.F)
        for one in result.identified.parameters
        if np.isfinite(one.regression_F) and np.isfinite(one.F) and not one.name.endswith(".1")
    }


def strongest_terms(result: CaseResult, response: str, count: int = 1) -> tuple[str, ...]:
    """The terms of the largest F in an equation's regression."""
    regression = result.identified.equations[response].regression
    order = np.argsort(-regression.F)
    return tuple(regression.names[k] for k in order[:count])


def _key(name: str) -> tuple[str, str]:
    if name.startswith(BIAS):
        return "bias", name.removeprefix(BIAS)
    response, _, term = name.partition(".")
    return response, term


def _rank(mine) -> tuple:
    """Ours before the report's, the constant last of ours, strong before weak."""
    if mine is None:
        return (2, 0.0)
    return (1 if mine.name.endswith(".1") else 0, -np.nan_to_num(mine.regression_F))


def _number(value: float | None) -> float:
    return NONE if value is None else value
