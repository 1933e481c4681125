"""`regressions`: a regression of each response, and the decisions on it."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from ..._foundation.checks import require, require_known
from ...data.record import Record
from ...models.base import AbstractModel
from ...models.pseudo_measurements import PseudoMeasurements, WeakMeasurements
from ...structure import Regression, choose, columns, least_squares, stepwise, strong_terms
from ...structure.selection import Selection
from ..identification import Equation
from ..identify_options import IdentifyOptions
from .lower_powers import with_lower_powers
from .reduction import AS_SELECTED, Reduction
from .weak_rows import WeakRecords, weak_rows

Measured = PseudoMeasurements | WeakMeasurements
Table = Mapping[str, np.ndarray]  # column of each term
Rows = tuple[Table, np.ndarray]  # and the response
Result = tuple[Selection | None, Regression]
WEAK_REPETITIONS = 3  # enough for the values in the noise, see `weak_form`


def equations_of(model: AbstractModel, weak_radius: float | None) -> Callable[[Record], Measured]:
    """Return the function of a record to the model's equations, in weak form for a radius."""
    return model.pseudo_measurements if weak_radius is None else model.weak_measurements


def regressions(
    measured: Sequence[Measured],
    options: IdentifyOptions,
    reduction: Reduction = AS_SELECTED,
) -> tuple[dict[str, Equation], dict[str, float]]:
    """Return the regression of each response on the valid samples of all records, and the means
    about which the terms are written.

    Args:
        measured: equations of each record, all of them pointwise or all in weak form.
        options: levels and rules.
        reduction: limits of the terms.

    Raises:
        InputError: if no sample is valid, or an option names a response or a term that does not
            exist.
    """
    candidates = dict(measured[0].candidates)
    require_known("response (in `options`)", options.named, candidates)
    signals = _signals(measured)
    centre = {name: float(np.mean(signals[name])) for name in measured[0].centred}
    tables = _tables(candidates, signals, centre, options)
    for name, terms in options.prior_terms.items():
        possible = (*candidates[name], *options.terms.get(name, ()))
        require_known(f"candidate term of {name} (in `options.prior`)", terms, possible)
    equations = {}
    for name, admitted in reduction.admitted(candidates).items():
        fit = partial(_regression, name, admitted, options=options, reduction=reduction)
        selection, regression = _fitted(fit, measured, name, tables[name], options)
        kept, reason = _decision(name, regression, options)
        named = reduction == AS_SELECTED
        estimated = _estimated(name, regression, options, named) if kept else ()
        equations[name] = Equation(selection, regression, kept, reason, estimated)
    return equations, centre


def _tables(
    candidates: Mapping[str, Sequence[str]],
    signals: Mapping[str, np.ndarray],
    centre: Mapping[str, float],
    options: IdentifyOptions,
) -> dict[str, Table]:
    """Return the column of each candidate and each given term of each response."""
    terms = {
        name: tuple(dict.fromkeys((*own, *options.terms.get(name, ()))))
        for name, own in candidates.items()
    }
    every = tuple(dict.fromkeys(term for own in terms.values() for term in own))
    values = dict(zip(every, columns(every, signals, centre).T, strict=True))
    return {name: {term: values[term] for term in own} for name, own in terms.items()}


def _fitted(
    fit: Callable[[Rows], Result],
    measured: Sequence[Measured],
    name: str,
    table: Table,
    options: IdentifyOptions,
) -> Result:
    """Return a regression on samples, or on integrals, repeated with the noise at its values."""
    weak = [one for one in measured if isinstance(one, WeakMeasurements)]
    if not weak or options.weak_radius is None:
        pointwise = [one for one in measured if isinstance(one, PseudoMeasurements)]
        return fit((table, _joined(pointwise, [one.unknown(name) for one in pointwise])))
    records = WeakRecords(weak, name, options.weak_radius)
    result = fit(weak_rows(records, table, None))
    for _ in range(WEAK_REPETITIONS):
        result = fit(weak_rows(records, table, result[1]))
    return result


def _signals(measured: Sequence[Measured]) -> dict[str, np.ndarray]:
    """Return the signals over the valid samples of all records."""
    require(
        any(np.any(np.asarray(one.valid)) for one in measured),
        "No sample has valid values of all channels of the regression. Look at the gaps of the "
        "records.",
    )
    return {
        name: _joined(measured, [one.signals[name] for one in measured])
        for name in measured[0].signals
    }


def _joined(measured: Sequence[Measured], histories: Sequence) -> np.ndarray:
    """Return histories of the records over their valid samples, joined."""
    parts = zip(measured, histories, strict=True)
    return np.concatenate([np.asarray(values)[np.asarray(one.valid)] for one, values in parts])


def _regression(
    name: str,
    candidates: Sequence[str],
    rows: Rows,
    *,
    options: IdentifyOptions,
    reduction: Reduction,
) -> Result:
    """Return the log of a stepwise regression, None for given terms, and the regression chosen."""
    table, y = rows

    def fit(terms: Sequence[str]) -> Regression:
        return least_squares(_matrix(table, terms, len(y)), y, terms, response=name)

    if name in options.terms:
        return None, fit(tuple(options.terms[name]))
    X = _matrix(table, candidates, len(y))
    selection = stepwise(X, y, candidates, options=options.subset_of(name), response=name)
    regression = choose(selection, options.rule)
    if options.lower_powers:
        stay = options.subset_of(name).F_to_stay(regression.dof)
        regression = with_lower_powers(regression, candidates, fit, stay)
    terms = reduction.kept(regression)
    return selection, regression if terms == regression.names else fit(terms)


def _matrix(table: Table, terms: Sequence[str], rows: int) -> np.ndarray:
    return np.stack([table[term] for term in terms], axis=1) if terms else np.zeros((rows, 0))


def _decision(name: str, regression: Regression, options: IdentifyOptions) -> tuple[bool, str]:
    """True if an equation is kept, and the reason."""
    F = regression.overall_F if regression.names else 0.0
    if name in options.keep:
        return True, "kept by name"
    if name in options.prior_terms:
        return True, f"overall F {F:.4g}, kept by its a-priori values"
    if name in options.leave_out:
        return False, "left out by name"
    if options.least_F > F:
        return False, f"left out: overall F {F:.4g}, below {options.least_F:g}"
    if options.least_R2 > regression.R2:
        return False, f"left out: overall F {F:.4g}, and R2 below {options.least_R2:g}"
    return True, f"overall F {F:.4g}"


def _estimated(
    name: str, regression: Regression, options: IdentifyOptions, named: bool
) -> tuple[str, ...]:
    """Terms of a response that are estimated; with `named`, terms that an option names and the
    regression lacks are refused.
    """
    for kind in ("estimate", "fix") if named else ():
        require_known(
            f"term of {name} (in `options.{kind}`)",
            getattr(options, kind).get(name, ()),
            regression.names,
        )
    prior = options.prior_terms.get(name, ())
    named_terms = (*options.estimate.get(name, ()), *prior)
    chosen = {*strong_terms(regression, options.share), *named_terms} - {*options.fix.get(name, ())}
    return tuple(term for term in dict.fromkeys((*regression.names, *prior)) if term in chosen)
