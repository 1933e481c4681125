"""`search_effects`: find the hypothesis that explains the records, and assess it."""

import dataclasses
from collections.abc import Callable, Mapping

from .._foundation.checks import require_float64
from .._foundation.memory import release_compiled_programs_if_needed
from .._foundation.notebook import preformatted
from ..data.record import Record
from ..estimation.estimate import as_stack
from ..models.base import AbstractModel
from .assess import Assessment, assess
from .hypothesis import Hypothesis
from .options import LoopOptions
from .outcome import Outcome
from .problem import LoopProblem
from .search import search
from .search_tree import SearchTree
from .wording import STOPPED, next_best_words, verdict_words


@dataclasses.dataclass(frozen=True, eq=False)
class EffectSearch:
    """Result of `search_effects`.

    Attributes:
        tree: all fits of the search.
        assessment: outcome and objections.
        options: levels and limits.
    """

    tree: SearchTree
    assessment: Assessment
    options: LoopOptions

    @property
    def outcome(self) -> Outcome:
        """The outcome."""
        return self.assessment.outcome

    @property
    def hypothesis(self) -> Hypothesis:
        """The best hypothesis."""
        return self.tree.best.hypothesis

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects of the best hypothesis."""
        return self.tree.best.effects

    @property
    def estimates(self) -> dict[str, tuple[float, float]]:
        """Value and standard error of each parameter, those of the noise included."""
        return self.tree.best.estimates

    @property
    def next_best(self) -> tuple[Hypothesis, float] | None:
        """The next best hypothesis and how much worse it is in chi-square, priced by parameters."""
        others = self.tree.alternatives()
        return (others[0][0].hypothesis, others[0][1]) if others else None

    @property
    def model(self) -> AbstractModel:
        """The declared model with the effects and values of the best hypothesis."""
        return self.tree.best.model

    def __str__(self) -> str:
        tree, width = self.tree, max(map(len, (*self.estimates, "parameter")))
        lines = [STOPPED] * tree.interrupted
        lines.append(verdict_words(tree, tree.best, self.assessment, self.options.level))
        lines += [next_best_words(tree), ""]
        lines.append(f"{'parameter':<{width}} {'value':>12} {'std. error':>12}")
        lines += [f"{n:<{width}} {v:>12.5g} {e:>12.3g}" for n, (v, e) in self.estimates.items()]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return preformatted(str(self))


def search_effects(
    problem: LoopProblem,
    *,
    test: Mapping[str, Record] | None = None,
    options: LoopOptions | None = None,
    progress: Callable[[str], None] | None = None,
) -> EffectSearch:
    """Find the effects and the noise that explain the records of a problem.

    A hypothesis is a set of effects and a noise model. Moves from the best hypotheses are ranked by
    the fall of chi-square in the linear model, refitted with all parameters, and compared by the
    likelihood of the training records, priced by parameters, and by the error on the check records.
    The final hypothesis passes through a list of checks before its effects are called the cause.

    Args:
        problem: model, library, free parameters and records (`LoopProblem.of`).
        test: records that decide nothing, by name of set; they can only withdraw a cause.
        options: levels and limits.
        progress: function that receives a short text at every step.

    Returns:
        The search with its verdict. Ctrl-C stops the search; the result is then its best so far.

    Raises:
        InputError: if JAX is in 32 bit, the test records cannot be predicted, or the declared model
            diverges at its starting values.
    """
    require_float64()
    release_compiled_programs_if_needed()
    options, progress = options or LoopOptions(), progress or (lambda _: None)
    tests = {name: as_stack(records) for name, records in (test or {}).items()}
    for name, records in tests.items():
        problem.check_predicted(records, f"test records {name!r}")
    tests = {name: records.anonymous() for name, records in tests.items()}
    tree = search(problem, options, progress)
    progress("assessment")
    return EffectSearch(tree, assess(tree, tests, options), options)
