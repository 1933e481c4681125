"""`SearchTree`: all fits of a search, and the steps between them."""

import dataclasses
from collections.abc import Iterable
from functools import cached_property

import numpy as np

from ..diagnosis.places import LocalisationResult
from .evidence import Comparison
from .fit import LoopFit
from .moves import Move, localise_fit
from .problem import LoopProblem


@dataclasses.dataclass(frozen=True, eq=False)
class Step:
    """A move from one fit to another, and the comparison of both."""

    parent: LoopFit
    move: Move
    fit: LoopFit
    comparison: Comparison


@dataclasses.dataclass(eq=False)
class SearchTree:
    """All fits of a search.

    Attributes:
        declared: fit of the declared model, whose problem has the shapes set from it.
        best: fit of the best hypothesis.
        steps: all refits, in order.
        path: accepted steps from the declared model to the best hypothesis.
        followed: candidates and signals that refused noises depend on.
        interrupted: True if the user stopped the search.
    """

    declared: LoopFit
    best: LoopFit
    steps: list[Step] = dataclasses.field(default_factory=list)
    path: list[Step] = dataclasses.field(default_factory=list)
    followed: tuple[str, ...] = ()
    interrupted: bool = False

    @property
    def problem(self) -> LoopProblem:
        """The problem of the search."""
        return self.declared.problem

    def note_followed(self, names: Iterable[str]) -> None:
        """Add candidates and signals that a refused noise depends on."""
        self.followed = tuple(dict.fromkeys((*self.followed, *names)))

    @cached_property
    def where(self) -> LocalisationResult:
        """Location of the residual of the declared model."""
        return localise_fit(self.declared)

    @cached_property
    def where_after(self) -> LocalisationResult:
        """Location of the residual of the best hypothesis, once the search has ended."""
        return localise_fit(self.best, self.where.splines)

    def fits(self) -> list[LoopFit]:
        """Return all different fits, the declared one first."""
        by_key = {self.declared.hypothesis.key: self.declared}
        for step in self.steps:
            known = by_key.get(step.fit.hypothesis.key)
            if known is None or step.fit.cost < known.cost:
                by_key[step.fit.hypothesis.key] = step.fit
        return list(by_key.values())

    def alternatives(self) -> list[tuple[LoopFit, float]]:
        """Return the fits that lack an effect or the noise of the best one, and by how much worse
        each is in chi-square, priced by parameters; the nearest first.
        """
        best = self.best
        worse = [
            (other, other.price - best.price)
            for other in self.fits()
            if not set(best.effects) <= set(other.effects)
            or other.hypothesis.noise.key != best.hypothesis.noise.key
        ]
        return sorted((one for one in worse if np.isfinite(one[1])), key=lambda one: one[1])
