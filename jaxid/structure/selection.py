"""The path of a selection: each step with its model, its criteria and its reason."""

import enum
from dataclasses import dataclass

import numpy as np

from . import criteria
from .fit import Fit, leverages
from .problem import Problem


class Action(enum.Enum):
    """Action of a step of a selection; the value is the word of the printed log.

    Attributes:
        START: the path starts with a model.
        FORCE: a term is forced in.
        ENTER, REMOVE: a term is added to the model, or removed from it.
        SUBSET: the model is the best one of its size.
        BAR: a candidate is not admitted, because its tolerance is too low.
        STOP: the path ends.
    """

    START = "start"
    FORCE = "force"
    ENTER = "enter"
    REMOVE = "remove"
    SUBSET = "subset"
    BAR = "bar"
    STOP = "stop"

    @property
    def changes_model(self) -> bool:
        """True if the step has a new model, the first one included."""
        return self not in (Action.BAR, Action.STOP)


@dataclass(frozen=True, eq=False)
class Step:
    """One step, and the model after it.

    Attributes:
        action: kind of the step.
        name: the term that enters, leaves or is barred; empty for the start, the stop and a subset.
        partial_F, partial_correlation: values of that term when it enters, or before it is removed;
            NaN without a term.
        tolerance: tolerance of that term before it enters or when it is barred; NaN otherwise.
        reason: reason of the step, for the printed log.
        terms, F: the model after the step, in order of entry, and each term's F (B.28).
        R2, overall_F, s: see `Regression`.
        PSE, PRESS, AIC, BIC: see `criteria`.
    """

    action: Action
    name: str
    partial_F: float  # noqa: N815
    partial_correlation: float
    tolerance: float
    reason: str
    terms: tuple[str, ...]
    F: np.ndarray
    R2: float
    overall_F: float  # noqa: N815
    s: float
    PSE: float
    PRESS: float
    AIC: float
    BIC: float


@dataclass(frozen=True, eq=False)
class Selection:
    """All steps of a selection. `choose` selects one of its models.

    Attributes:
        problem: columns and response.
        steps: the steps, in order.
    """

    problem: Problem
    steps: tuple[Step, ...]

    @property
    def models(self) -> tuple[Step, ...]:
        """The steps that changed the model, the start included."""
        return tuple(step for step in self.steps if step.action.changes_model)

    def __str__(self) -> str:
        shown = ("partial_F", "tolerance", "R2", "overall_F", "s", "PSE", "PRESS", "AIC", "BIC")
        heads = ("F", "tolerance", "R2", "overall F", "s", "PSE", "PRESS", "AIC", "BIC")
        width = max(len(step.name) for step in self.steps)
        first = f"{'step':>4} {'':<6} {'term':<{max(width, 4)}} {'terms':>5}"
        lines = [
            f"{self.problem.response}: {len(self.problem.names)} candidates, "
            f"{self.problem.samples} samples"
        ]
        lines.append(first + "".join(f" {head:>10}" for head in heads) + "  reason")
        for number, step in enumerate(self.steps):
            values = "".join(_cell(name, getattr(step, name)) for name in shown)
            label = (
                f"{number:>4} {step.action.value:<6} {step.name:<{max(width, 4)}} "
                f"{len(step.terms):>5}"
            )
            lines.append(f"{label}{values}  {step.reason}")
        return "\n".join(lines)


def step(
    problem: Problem,
    fitted: Fit,
    action: Action,
    name: str = "",
    reason: str = "",
    *,
    F: float = float("nan"),
    tolerance: float = float("nan"),
    PSE_bound: float | None = None,
) -> Step:
    """Return the step that led to a fit, with all criteria.

    Args:
        problem, fitted: the problem, and its fit after the step.
        action, name, reason: see `Step`.
        F, tolerance: values of the step's term.
        PSE_bound: upper bound of the noise variance [response^2]; mean square of the response by
            default.
    """
    terms, samples, SST = len(fitted.active), problem.samples, problem.SST
    parameters = terms + problem.constant
    dof_with_it = fitted.dof - 1 if action is Action.REMOVE else fitted.dof
    residuals = problem.Q @ fitted.residual
    bound = SST / samples if PSE_bound is None else PSE_bound
    return Step(
        action=action,
        name=name,
        partial_F=F,
        partial_correlation=criteria.partial_correlation(F, dof_with_it),
        tolerance=tolerance,
        reason=reason,
        terms=tuple(problem.names[i] for i in fitted.active),
        F=fitted.partial_F,
        R2=criteria.r_squared(fitted.SSE, SST),
        overall_F=criteria.overall_F(fitted.SSE, SST, terms, fitted.dof),
        s=float(np.sqrt(fitted.SSE / fitted.dof)),
        PSE=criteria.PSE(fitted.SSE, samples, parameters, bound),
        PRESS=criteria.PRESS(residuals, leverages(problem, fitted)),
        AIC=criteria.AIC(fitted.SSE, samples, parameters),
        BIC=criteria.BIC(fitted.SSE, samples, parameters),
    )


def _cell(name: str, value: float) -> str:
    return (
        f" {'':>10}"
        if np.isnan(value)
        else f" {value:>10.4f}"
        if name == "R2"
        else f" {value:>10.4g}"
    )
