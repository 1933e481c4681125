"""`identify`: model structure by regression, then parameters by maximum likelihood, without manual
tuning.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_float64
from .._foundation.progress import text_progress
from ..data.record import Record
from ..data.stack import segment, single_records
from ..estimation import Estimate
from ..estimation.estimate import Case, as_stack, checked_case, divergence
from ..estimation.likelihoods import AbstractLikelihood, OutputError
from ..estimation.shared_programs import estimate_case
from ..estimation.solver import GaussNewton
from ..models.base import AbstractModel
from ..models.equation_shapes import check_equations
from ..models.free import Free, all_names, free, with_values
from ..models.polynomial import Polynomial
from ..models.replace import polynomials_of, with_polynomials, with_terms
from ..structure import Regression
from .identification import Equation, Identification
from .identify_options import IdentifyOptions
from .terms.adaptation import Adaptation, adapted
from .terms.reduction import AS_SELECTED, REDUCTIONS
from .terms.regressions import Measured, equations_of, regressions
from .terms.start import Start, a_priori

Records = Record | Sequence[Record]
PIECES = (2, 4, 8, 16)  # numbers of pieces of a record, chosen
SHORTEST_PIECE = 10  # samples, chosen


def identify(
    model: AbstractModel,
    records: Records,
    *,
    options: IdentifyOptions | None = None,
    likelihood: AbstractLikelihood | None = None,
    per_record: Sequence[str] = ("initial_state",),
    solver: GaussNewton | None = None,
    progress: bool | Callable[[str], None] = True,
) -> Identification:
    r"""Select the terms of a model, and estimate them: the report's two programs as one (Fig. 6.1,
    recommendation 7.2.1).

    1. **Regression.** The model's equations are solved for their responses
       (`model.pseudo_measurements`, Table 3.2). Each response is regressed stepwise on the terms
       that it admits (Table 6.1), and the step of the largest overall F is taken. With
       `options.weak_radius` the regression takes integrals of the equations in place of samples
       (`model.weak_measurements`), which needs no angular accelerations and no other derivatives.
    2. **Equations.** An equation that the regression hardly explains (overall F below 100, and, if
       `least_R2` is given, a smaller share) is left out; its state takes its measured history.
    3. **Terms.** Terms with at least 4 % of their equation's largest F are estimated, with the
       constants and the parameters that `options.add` names; the others keep the values of the
       regression.
    4. **Maximum likelihood**, started at the values of the regression. If the simulation diverges
       there, the regression is repeated with lower powers, then with fewer terms, until one starts
       (`REDUCTIONS`). If none does, the terms as selected are estimated from pieces of the records,
       each with its own initial state (multiple shooting); the result is their estimate, or the
       estimate from the whole records started at it, if that is finite. `reduced` of the result has
       the limits. Terms given by name are kept.

    5. With `options.adapt`, **changes of the terms**, one at a time with an estimate after each:
       terms that the records do not determine are held, terms of small F deleted, candidates of
       large score added, until none changes (`study.terms.adaptation.adapted`).

    All records are regressed together, about their common mean, and estimated together. The model
    is simulated with all candidates, the absent ones with the value zero, so that calls for records
    of the same shapes share its compiled programs whatever terms they select.

    Args:
        model: a model with `pseudo_measurements` whose responses are its polynomials, such as
            `aircraft.IdentificationModel`.
        records: records with the channels of the regression and those of the model.
        options: levels and rules, and exceptions from them by name.
        likelihood: measure of the misfit; output error with unknown noise by default. In gusts
            `FilterError`, such as `FilterError({"gust_v": FirstOrder(5.0, 0.5)})` [m/s, s].
        per_record: names of parameters with one value for each record. The initial value of a state
            whose equation is left out is not estimated, as its history is measured.
        solver: the Gauss-Newton solver.
        progress: True shows the step on a terminal or in a notebook; False does not; or a function
            that receives a short text at every step.

    Returns:
        Both stages: the regressions with their logs, the decisions and their reasons, and the
        estimate.

    Raises:
        InputError: if the model states no pseudo-measurements, a channel is missing, too few
            samples are valid, an option names a response, a term or a parameter that does not
            exist, no equation is left, every structure diverges at its starting values, or JAX is
            in 32 bit.
    """
    require_float64()
    options, likelihood = options or IdentifyOptions(), likelihood or OutputError()
    single = single_records(records)
    require(len(single) > 0, "There is no record to identify from. Give at least one.")
    with text_progress(progress) as show:
        show("regression")
        measured = list(map(equations_of(model, options.weak_radius), single))
        candidates = dict(measured[0].candidates)
        build = partial(_structure, model, likelihood, options, per_record, candidates)
        chosen, reduced = build(single, *regressions(measured, options)), ""
        show("simulation at the values of the regression")
        first = a_priori(chosen.case)
        if not np.isfinite(first.cost):
            chosen, first, limits = _restarted(build, single, measured, options, chosen, solver)
            reduced = f"{limits}, because the terms as selected diverge at the start"
        show("maximum likelihood")
        adaptation = Adaptation(estimate_case(chosen.case, solver), ())
        if options.adapt:
            show("changes of the terms")
            adaptation = adapted(chosen.case, adaptation.estimate, chosen.admitted, options, solver)
    fit = adaptation.estimate
    own_terms = {name: one.terms for name, one in polynomials_of(chosen.model).items()}
    own_terms |= adaptation.terms({name: own_terms[name] for name in chosen.terms})
    return Identification(
        chosen.equations,
        chosen.centre,
        chosen.model,
        first,
        eqx.tree_at(lambda one: one.model, fit, with_terms(fit.model, own_terms)),
        chosen.case.records,
        likelihood,
        chosen.candidates,
        reduced,
        tuple(map(str, adaptation.changes)),
    )


class _Structure(NamedTuple):
    """The second stage at the values of a regression.

    Attributes:
        equations, centre: the regressions, and the means about which the terms are written.
        model: model with the values of the regression.
        candidates: terms of the model that is simulated, by response; none for `model` itself.
        case: the problem of this model.
    """

    equations: dict[str, Equation]
    centre: dict[str, float]
    model: AbstractModel
    candidates: dict[str, tuple[str, ...]]
    case: Case

    @property
    def terms(self) -> dict[str, tuple[str, ...]]:
        """Terms of the equations kept, by response."""
        return {name: one.regression.names for name, one in self.equations.items() if one.kept}

    @property
    def admitted(self) -> dict[str, tuple[str, ...]]:
        """Terms of the equations kept that the simulated model has, by response."""
        return {name: self.candidates.get(name, own) for name, own in self.terms.items()}


def _structure(
    model,
    likelihood,
    options,
    per_record,
    candidates,
    records,
    equations,
    centre,
    values: Mapping[str, float] | None = None,
) -> _Structure:
    """Return the second stage at the values of a regression, some replaced, after all checks."""
    left_out = tuple(name for name, equation in equations.items() if not equation.kept)
    require(
        len(left_out) < len(equations),
        "No equation is left: "
        + "; ".join(f"{name} {equation.reason}" for name, equation in equations.items())
        + ". Give records with more motion, name equations to `keep`, or lower `least_F` or "
        "`least_R2`.",
    )
    polynomials = _polynomials(equations, centre, options.prior)
    start_model = with_polynomials(model.without(left_out), polynomials)
    if values:
        start_model = with_values(start_model, list(values), jnp.array([*values.values()]))
    candidates = _simulated_terms(start_model, equations, candidates)
    simulated = with_terms(start_model, candidates)
    absent = {f"initial_state.{name}" for name in {*model.states} - {*start_model.states}}
    kept = [name for name in per_record if name not in absent]
    chosen = _free(start_model, equations, options, kept)
    prepared = as_stack([start_model.prepared(record) for record in records])
    case = checked_case(simulated, chosen, prepared, likelihood)
    return _Structure(equations, centre, start_model, candidates, case)


def _simulated_terms(
    model: AbstractModel,
    equations: Mapping[str, Equation],
    candidates: Mapping[str, tuple[str, ...]],
) -> dict[str, tuple[str, ...]]:
    """Return all candidates of each response, with its own terms.

    A model with all candidates has the same structure whichever of them are selected, so that its
    compiled programs serve every selection. There are none if a candidate depends on a signal that
    is known in the regression only.
    """
    terms = {
        name: tuple(
            dict.fromkeys(
                (
                    "1",
                    *candidates.get(name, ()),
                    *equation.regression.names,
                    *_not_regressed(equation),
                )
            )
        )
        for name, equation in equations.items()
    }
    try:
        check_equations(with_terms(model, terms))
    except InputError:
        return {}
    return terms


def _restarted(
    build: Callable[..., _Structure],
    single: Sequence[Record],
    measured: Sequence[Measured],
    options: IdentifyOptions,
    selected: _Structure,
    solver: GaussNewton | None,
) -> tuple[_Structure, Start, str]:
    """Return the first structure whose simulation is finite, its start, and its limits in words.

    Raises:
        InputError: if none is; with record, time and state at which the last one diverges.
    """
    structures, diverging = [AS_SELECTED], selected
    for reduction in REDUCTIONS:
        equations, centre = regressions(measured, options, reduction)
        if not any(one.kept for one in equations.values()):
            break
        chosen = build(single, equations, centre)
        if chosen.terms == diverging.terms:
            continue
        diverging = chosen
        structures.append(reduction)
        first = a_priori(chosen.case)
        if np.isfinite(first.cost):
            return chosen, first, str(reduction)
    shot = _from_pieces(
        partial(build, equations=selected.equations, centre=selected.centre), single, solver
    )
    if shot is not None:
        return shot
    case = diverging.case
    words = divergence(case.model, case.free, case.records, case.problem.likelihood)
    raise InputError(
        "The model cannot be simulated at the values of the regression with any structure that "
        f"was tried ({'; '.join(map(str, structures))}). {words} Of the last structure: "
        + "; ".join(f"{name} = {', '.join(terms)}" for name, terms in diverging.terms.items())
        + "."
    )


def _from_pieces(
    build: Callable[..., _Structure], single: Sequence[Record], solver: GaussNewton | None
) -> tuple[_Structure, Start, str] | None:
    """Return the structure at values estimated from pieces of the records, on the complete records
    if its simulation is finite there, else on the pieces; None if no division gives an estimate.
    """
    for seconds in _lengths(single):
        pieces = build([piece for record in single for piece in segment(record, seconds)])
        start = a_priori(pieces.case)
        fit = estimate_case(pieces.case, solver) if np.isfinite(start.cost) else None
        if fit is None or not bool(fit.successful):
            continue
        complete = build(single, values=_own_values(fit, pieces.model))
        continued = a_priori(complete.case)
        if np.isfinite(continued.cost):
            return complete, continued, f"started from an estimate in pieces of {seconds:.3g} s"
        return pieces, start, f"estimated in pieces of {seconds:.3g} s with own initial states"
    return None


def _lengths(single: Sequence[Record]) -> list[float]:
    """Return the lengths of pieces to try [s], the longest first."""
    longest = max(float(record.t[-1] - record.t[0]) for record in single)
    step = max(float(np.median(np.diff(record.t))) for record in single)
    return [longest / parts for parts in PIECES if longest / parts >= SHORTEST_PIECE * step]


def _own_values(fit: Estimate, model: AbstractModel) -> dict[str, float]:
    """Return the estimated parameters of the model itself, by name."""
    values = dict(zip(fit.names, np.asarray(fit.values).tolist(), strict=True))
    return {name: value for name, value in values.items() if name in all_names(model)}


def _polynomials(
    equations: Mapping[str, Equation],
    centre: Mapping[str, float],
    prior: Mapping[str, tuple[float, float]],
) -> dict[str, Polynomial]:
    """Results of the regressions, as polynomials of the model, with a-priori values of others."""
    return {
        name: Polynomial(
            {
                "1": equation.regression.constant,
                **{term: prior[f"{name}.{term}"][0] for term in _not_regressed(equation)},
                **_values(equation.regression),
            },
            centre=centre,
        )
        for name, equation in equations.items()
    }


def _not_regressed(equation: Equation) -> tuple[str, ...]:
    """Return estimated terms that the regression does not have: those with a-priori values."""
    return tuple(term for term in equation.estimated if term not in equation.regression.names)


def _values(regression: Regression) -> dict[str, float]:
    return dict(zip(regression.names, map(float, regression.values), strict=True))


def _free(
    model: AbstractModel,
    equations: Mapping[str, Equation],
    options: IdentifyOptions,
    per_record: Sequence[str],
) -> Free:
    """Free parameters: strong terms and constants of the equations kept, and those of `add`."""
    constant = ("1",) if options.constants else ()
    terms = tuple(
        f"{name}.{term}"
        for name, equation in equations.items()
        if equation.kept
        for term in (*constant, *equation.estimated)
    )
    return free(model, *terms, *options.add, per_record=per_record, prior=options.prior)
