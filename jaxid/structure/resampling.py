"""Stability of a selection: how often each term is chosen when the data are drawn again."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._foundation.checks import require
from .._foundation.types import Float, Numbers
from .options import SubsetOptions
from .problem import Labels, Problem, prepare
from .rules import AbstractRule, LastStep, choose
from .stepwise import DEFAULTS, path


@dataclass(frozen=True, eq=False)
class Stability:
    """How often terms, and whole models, were chosen.

    Attributes:
        response, names: of what is explained and of the candidates.
        share: of the draws in which each candidate was chosen, shape (term,).
        models: terms of the models that occurred, in the candidates' order, and the share of the draws; the most frequent first.
        draws: how many.
    """

    response: str
    names: tuple[str, ...]
    share: np.ndarray
    models: tuple[tuple[tuple[str, ...], float], ...]
    draws: int

    def __str__(self) -> str:
        width = max(map(len, self.names))
        lines = [f"{self.response}: share of {self.draws} draws in which a term is chosen"]
        for i in np.argsort(-self.share, kind="stable"):
            lines.append(f"{self.names[i]:<{width}} {self.share[i]:>7.1%}")
        terms, share = self.models[0]
        return "\n".join([*lines, f"most frequent model ({share:.1%}): {', '.join(terms) or 'the constant alone'}"])


def stability(
    X: Float[Numbers, "time term"],
    y: Float[Numbers, " time"],
    names: Sequence[str],
    *,
    generator: int | np.random.Generator,
    draws: int = 200,
    block: int | None = None,
    groups: Labels | None = None,
    options: SubsetOptions = DEFAULTS,
    rule: AbstractRule | None = None,
    constant: bool = True,
    response: str = "y",
) -> Stability:
    """Choose again from data drawn with replacement: blocks of neighbouring samples, or whole manoeuvres.

    A block should be longer than the time over which the residual remembers itself. A column that a draw leaves without
    variation is not chosen in that draw.

    Args:
        X: candidates, shape (time, term).
        y: the response, shape (time,).
        names: of the candidates.
        generator: of random numbers, or a seed.
        draws: how often.
        block: samples in a block; about the cube root of their number by default, at least one (Kunsch, 1989).
        groups: label of the manoeuvre of each sample, to draw those instead of blocks.
        options, rule: how a model is chosen; the rule is `LastStep()` by default. One with labels of samples cannot serve here.
        constant: fit a constant in every model.
        response: name of what is explained.

    Raises:
        InputError: as `prepare` says, and for draws, blocks or groups that make no sense.

    (Kunsch, Annals of Statistics 17, 1989; Sauerbrei & Schumacher, Statistics in Medicine 11, 1992.)
    """
    prepared = prepare(X, y, names, constant=constant, response=response)
    rule = LastStep() if rule is None else rule
    require(draws >= 1, f"The number of draws is {draws}; it must be positive.")
    require(
        not hasattr(rule, "groups"),
        f"{type(rule).__name__} holds labels of samples, which a draw mixes up. Take another rule.",
    )
    generator = np.random.default_rng(generator)
    pieces = _pieces(prepared.samples, block, groups)
    counts: Counter[tuple[str, ...]] = Counter()
    for _ in range(draws):
        counts[_chosen(prepared, _rows(pieces, prepared.samples, groups is not None, generator), options, rule)] += 1
    share = [sum(count for terms, count in counts.items() if name in terms) / draws for name in prepared.names]
    models = tuple((terms, count / draws) for terms, count in counts.most_common())
    return Stability(response, prepared.names, np.array(share), models, draws)


def _chosen(whole: Problem, rows: np.ndarray, options: SubsetOptions, rule: AbstractRule) -> tuple[str, ...]:
    """Terms chosen from the drawn rows, in the candidates' order."""
    X, y = whole.X[rows], whole.y[rows]
    if np.ptp(y) == 0:
        return ()
    problem = prepare(X, y, whole.names, constant=whole.constant, response=whole.response)
    terms = choose(path(problem, options), rule).names
    return tuple(name for name in whole.names if name in terms)


def _pieces(samples: int, block: int | None, groups: Labels | None) -> list[np.ndarray]:
    """What is drawn: rows of each manoeuvre, or of each block, which may start at any sample that leaves it whole."""
    require(block is None or groups is None, "Give the length of a block or labels of manoeuvres, not both.")
    if groups is not None:
        labels = np.asarray(groups)
        require(labels.shape == (samples,), f"There are {samples} samples and {labels.shape} labels of manoeuvres.")
        pieces = [np.flatnonzero(labels == label) for label in dict.fromkeys(labels.tolist())]
        require(
            len(pieces) >= 2, "There is one manoeuvre, so that nothing can be drawn. Draw blocks of samples instead."
        )
        return pieces
    length = max(1, round(samples ** (1 / 3))) if block is None else block
    require(1 <= length <= samples // 2, f"A block has {length} samples of {samples}. Choose 1 to {samples // 2}.")
    return [np.arange(start, start + length) for start in range(samples - length + 1)]


def _rows(pieces: list[np.ndarray], samples: int, whole: bool, generator: np.random.Generator) -> np.ndarray:
    """Drawn rows: as many manoeuvres as there are, or as many samples."""
    number = len(pieces) if whole else -(-samples // len(pieces[0]))
    rows = np.concatenate([pieces[i] for i in generator.integers(len(pieces), size=number)])
    return rows if whole else rows[:samples]
