"""`adapted`: terms added, deleted and frozen between estimates by maximum likelihood."""

import enum
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy.linalg

from ...estimation.coloured_errors import colour_ratio
from ...estimation.estimate import Case, checked_case
from ...estimation.result import Estimate
from ...estimation.shared_programs import estimate_case, evaluate
from ...estimation.solver import GaussNewton
from ...models.base import AbstractModel
from ...models.free import Parameters, free, with_values
from ..identify_options import IdentifyOptions

Movable = Mapping[str, tuple[str, str]]  # response and term, by name of the parameter


class Kind(enum.Enum):
    """Kind of a change of the structure."""

    ADD = "added"
    DELETE = "deleted"
    FREEZE = "held at its value"


class Change(NamedTuple):
    """A change of one term.

    Attributes:
        kind: kind of the change.
        response, term: the term, such as `alpha^2` of `Cm`.
        reason: F or score in words.
        costs: negative log-likelihood before and after; the change is not taken if the model
            diverges after it.
    """

    kind: Kind
    response: str
    term: str
    reason: str
    costs: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def name(self) -> str:
        """Name of the parameter, such as `Cm.alpha^2`."""
        return f"{self.response}.{self.term}"

    @property
    def taken(self) -> bool:
        """True if the model can be estimated after the change."""
        return bool(np.isfinite(self.costs[1]))

    def __str__(self) -> str:
        before, after = self.costs
        result = f"cost {before:.6g} to {after:.6g}" if self.taken else "not taken: diverges"
        return f"{self.name} {self.kind.value} ({self.reason}); {result}"


class Adaptation(NamedTuple):
    """The estimate of an adapted structure.

    Attributes:
        estimate: of the model with all candidates.
        changes: the changes in their order.
    """

    estimate: Estimate
    changes: tuple[Change, ...]

    def terms(self, selected: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
        """Return the terms of the adapted model.

        Args:
            selected: terms of each response before the changes.
        """
        names = {f"{one}.{term}": (one, term) for one, own in selected.items() for term in own}
        for change in self.changes:
            if change.taken and change.kind is Kind.ADD:
                names[change.name] = (change.response, change.term)
            elif change.taken and change.kind is Kind.DELETE:
                del names[change.name]
        return {
            response: tuple(term for one, term in names.values() if one == response)
            for response in selected
        }


def adapted(
    case: Case,
    estimate: Estimate,
    candidates: Mapping[str, Sequence[str]],
    options: IdentifyOptions,
    solver: GaussNewton | None,
) -> Adaptation:
    """Return the estimate after changes of its terms, each followed by a new estimate (report
    sections 1.3 and 4.3.2).

    1. A term of a direction that the records do not determine is held at its value: the rank of the
       information limits the structure.
    2. Otherwise the term of least F, with errors corrected for coloured residuals, is deleted if
       its F does not reach the level to stay.
    3. Otherwise the candidate of the largest score is added if it reaches the level to enter, and
       is not nearly a combination of the free parameters (`SubsetOptions.tolerance`).

    The score is the expected reduction of twice the cost at the estimate, divided by the square of
    the median ratio of corrected to white errors. A term changes twice at most, because one that
    left does not return. Constants, added parameters and terms that an option names stay.

    Args:
        case: the problem of the estimate, with its likelihood.
        estimate: estimate of the selected terms.
        candidates: terms of each response that may be estimated; the model has all of them.
        options: levels, and terms that stay.
        solver: the Gauss-Newton solver.
    """
    every = _movable(candidates, options)
    closed: set[str] = set()
    changes: list[Change] = []
    while True:
        movable = {name: term for name, term in every.items() if name not in closed}
        change = _departure(estimate, movable, options) or _entry(case, estimate, movable, options)
        if change is None:
            return Adaptation(estimate, tuple(changes))
        changed = _changed(case, estimate, change)
        begin = Parameters(changed.begin.shared, estimate.own)
        trial = estimate_case(changed, solver, begin)
        change = change._replace(costs=(float(estimate.cost), float(trial.cost)))
        changes.append(change)
        if change.kind is not Kind.ADD or not change.taken:
            closed.add(change.name)
        estimate = trial if change.taken else estimate


def _movable(candidates: Mapping[str, Sequence[str]], options: IdentifyOptions) -> Movable:
    """Return the terms that may leave or enter, by name of the parameter."""
    return {
        f"{response}.{term}": (response, term)
        for response, terms in candidates.items()
        for term in terms
        if _is_movable(response, term, options)
    }


def _is_movable(response: str, term: str, options: IdentifyOptions) -> bool:
    """True for a term that may leave or enter."""
    return not (
        term == "1"
        or response in options.terms
        or term in (*options.estimate.get(response, ()), *options.fix.get(response, ()))
        or term in options.subset_of(response).force_in + options.subset_of(response).force_out
    )


def _departure(estimate: Estimate, movable: Movable, options: IdentifyOptions) -> Change | None:
    """Return the change that freezes or deletes a term, None if all terms stay."""
    errors, corrected = np.asarray(estimate.standard_errors), np.asarray(estimate.corrected_errors)
    inside = [k for k, name in enumerate(estimate.names) if name in movable]
    undetermined = [k for k in inside if np.isinf(errors[k])]
    if undetermined:
        weak = np.asarray(estimate.spectrum.weak(estimate.threshold))
        share = np.abs(np.asarray(estimate.spectrum.directions)[weak]).sum(axis=0)
        largest = max(undetermined, key=lambda k: share[k])
        return Change(Kind.FREEZE, *movable[estimate.names[largest]], "not determined")
    with np.errstate(divide="ignore"):
        F = (np.asarray(estimate.values) / corrected) ** 2
    dof = _dof(estimate)
    small = [
        k for k in inside if F[k] < options.subset_of(movable[estimate.names[k]][0]).F_to_stay(dof)
    ]
    if not small:
        return None
    least = min(small, key=lambda k: F[k])
    return Change(Kind.DELETE, *movable[estimate.names[least]], f"F {F[least]:.3g}")


def _entry(
    case: Case,
    estimate: Estimate,
    movable: Movable,
    options: IdentifyOptions,
) -> Change | None:
    """Return the change that adds the candidate of the largest score, None if none enters."""
    outside = [name for name in movable if name not in estimate.names]
    if not outside:
        return None
    gain, tolerance = _scores(case, estimate, outside)
    ratio = colour_ratio(estimate.standard_errors, estimate.corrected_errors)
    score = gain / float(np.median(np.asarray(ratio))) ** 2
    dof = _dof(estimate) - 1
    able = [
        k
        for k, name in enumerate(outside)
        if tolerance[k] >= options.subset_of(movable[name][0]).tolerance
        and score[k] >= options.subset_of(movable[name][0]).F_to_enter(dof)
    ]
    if not able:
        return None
    best = max(able, key=lambda k: score[k])
    return Change(Kind.ADD, *movable[outside[best]], f"score {score[best]:.3g}")


def _dof(estimate: Estimate) -> int:
    """Return degrees of freedom of the residual, also where the noise is known."""
    return int(np.sum(np.asarray(estimate.mask))) - len(estimate.names)


def _scores(
    case: Case, estimate: Estimate, outside: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return expected reduction of twice the cost by each candidate, and tolerances.

        gain = (t' r)^2 / t' t,    tolerance = t' t

    with t and r the parts of the candidate's column of the triangle, of length one, and of the
    right-hand side that are orthogonal to the columns of the free parameters.
    """
    together = _case(estimate.model, (*estimate.names, *outside), case)
    _, linearised = evaluate(together, Parameters(together.begin.shared, estimate.own))
    information, count = linearised.information, len(estimate.names)
    T, r = np.asarray(information.triangle), np.asarray(information.rhs)
    lengths = np.linalg.norm(T, axis=0)
    T = T / np.where(lengths > 0, lengths, 1.0)
    basis = scipy.linalg.orth(T[:, :count])
    parts = T[:, count:] - basis @ (basis.T @ T[:, count:])
    tolerance = np.sum(parts**2, axis=0)
    gain = (parts.T @ (r - basis @ (basis.T @ r))) ** 2
    return gain / np.where(tolerance > 0, tolerance, 1.0), tolerance


def _changed(case: Case, estimate: Estimate, change: Change) -> Case:
    """Return the problem after a change, started at the estimate."""
    model, names = estimate.model, [name for name in estimate.names if name != change.name]
    if change.kind is Kind.ADD:
        names.append(change.name)
    if change.kind is Kind.DELETE:
        model = with_values(model, [change.name], jnp.zeros(1))
    return _case(model, names, case)


def _case(model: AbstractModel, names: Sequence[str], case: Case) -> Case:
    """Return the problem of a case for another model and other shared parameters."""
    chosen = free(model, *names, per_record=case.free.per_record)
    return checked_case(model, chosen, case.records, case.problem.likelihood)
