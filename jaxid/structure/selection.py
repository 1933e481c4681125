"""The path of a selection: each step, what it left, and why it was taken."""

from dataclasses import dataclass

import numpy as np

from . import criteria
from .fit import Fit, leverages
from .problem import Problem

CHANGES = ("start", "force", "enter", "remove", "subset")  # actions after which the model is another one


@dataclass(frozen=True, eq=False)
class Step:
    """One step, and the model after it.

    Attributes:
        action: `"start"`, `"force"`, `"enter"`, `"remove"`, `"subset"` (best of its size), `"bar"` (its tolerance is too low)
            or `"stop"`.
        name: the term that the action is about; empty at the start, at the stop, and for a whole subset.
        partial_F, partial_correlation: of that term when it enters, or before it is removed; NaN without one.
        tolerance: of that term before it enters or when it is barred; NaN otherwise.
        why: in words.
        terms, F: the model after the step, in order of entry, and each term's F (B.28).
        R2, overall_F, s: as in `Regression`.
        PSE, PRESS, AIC, BIC: as in `criteria`.
    """

    action: str
    name: str
    partial_F: float  # noqa: N815
    partial_correlation: float
    tolerance: float
    why: str
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
    """All steps of a selection. `choose` picks one of its models.

    Attributes:
        problem: columns and response.
        steps: the log.
    """

    problem: Problem
    steps: tuple[Step, ...]

    @property
    def models(self) -> tuple[Step, ...]:
        """The steps that changed the model, the start included."""
        return tuple(step for step in self.steps if step.action in CHANGES)

    def __str__(self) -> str:
        shown = ("partial_F", "tolerance", "R2", "overall_F", "s", "PSE", "PRESS", "AIC", "BIC")
        heads = ("F", "tolerance", "R2", "overall F", "s", "PSE", "PRESS", "AIC", "BIC")
        width = max(len(step.name) for step in self.steps)
        first = f"{'step':>4} {'':<6} {'term':<{max(width, 4)}} {'terms':>5}"
        lines = [f"{self.problem.response}: {len(self.problem.names)} candidates, {self.problem.samples} samples"]
        lines.append(first + "".join(f" {head:>10}" for head in heads) + "  why")
        for number, step in enumerate(self.steps):
            values = "".join(_cell(name, getattr(step, name)) for name in shown)
            label = f"{number:>4} {step.action:<6} {step.name:<{max(width, 4)}} {len(step.terms):>5}"
            lines.append(f"{label}{values}  {step.why}")
        return "\n".join(lines)


def step(
    problem: Problem,
    found: Fit,
    action: str,
    name: str = "",
    why: str = "",
    *,
    F: float = float("nan"),
    tolerance: float = float("nan"),
    PSE_bound: float | None = None,
) -> Step:
    """The step that led to this fit, with everything that it is judged by.

    Args:
        problem, found: the model after the step.
        action, name, why: as in `Step`.
        F, tolerance: of the term that the step is about.
        PSE_bound: largest variance of the noise [response^2]; mean square of the response by default.
    """
    terms, samples, SST = len(found.active), problem.samples, problem.SST
    fitted = terms + problem.constant
    dof_with_it = found.dof - 1 if action == "remove" else found.dof
    residuals = problem.Q @ found.rest
    bound = SST / samples if PSE_bound is None else PSE_bound
    return Step(
        action=action,
        name=name,
        partial_F=F,
        partial_correlation=criteria.partial_correlation(F, dof_with_it),
        tolerance=tolerance,
        why=why,
        terms=tuple(problem.names[i] for i in found.active),
        F=found.partial_F,
        R2=criteria.r_squared(found.SSE, SST),
        overall_F=criteria.overall_F(found.SSE, SST, terms, found.dof),
        s=float(np.sqrt(found.SSE / found.dof)),
        PSE=criteria.PSE(found.SSE, samples, fitted, bound),
        PRESS=criteria.PRESS(residuals, leverages(problem, found)),
        AIC=criteria.AIC(found.SSE, samples, fitted),
        BIC=criteria.BIC(found.SSE, samples, fitted),
    )


def _cell(name: str, value: float) -> str:
    return f" {'':>10}" if np.isnan(value) else f" {value:>10.4f}" if name == "R2" else f" {value:>10.4g}"
