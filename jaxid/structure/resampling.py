"""Stability of a selection: how often each term is chosen from resampled data (bootstrap)."""

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
    """Frequencies of terms and of models over the draws.

    Attributes:
        response, names: names of the response and of the candidates.
        share: share of the draws in which each candidate is chosen, shape (term,).
        models: pairs of a model's terms, in the candidates' order, and its share of the draws; the
            most frequent model first.
        draws: number of draws.
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
        return "\n".join(
            [
                *lines,
                f"most frequent model ({share:.1%}): {', '.join(terms) or 'the constant alone'}",
            ]
        )


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
    """Return the frequencies of terms and models over data drawn with replacement.

    A draw consists of blocks of neighbouring samples, or of complete manoeuvres. A block should be
    longer than the correlation time of the residual. A column without variation in a draw is not
    chosen in that draw.

    Args:
        X: candidates, shape (time, term).
        y: the response, shape (time,).
        names: names of the candidates.
        generator: generator of random numbers, or a seed.
        draws: number of draws.
        block: number of samples in a block; by default about the cube root of the number of
            samples, at least one (Kunsch, 1989).
        groups: label of the manoeuvre of each sample; then manoeuvres are drawn, not blocks.
        options, rule: options of the stepwise regression and rule for a model of its path, by
            default `LastStep()`. A rule with labels of samples cannot be used.
        constant: fit a constant in every model.
        response: name of the response.

    Raises:
        InputError: see `prepare`; and for invalid draws, blocks or groups.

    (Kunsch, Annals of Statistics 17, 1989; Sauerbrei & Schumacher, Statistics in Medicine 11,
    1992.)
    """
    prepared = prepare(X, y, names, constant=constant, response=response)
    rule = LastStep() if rule is None else rule
    require(draws >= 1, f"The number of draws is {draws}; it must be positive.")
    require(
        not hasattr(rule, "groups"),
        f"{type(rule).__name__} holds labels of samples, which do not match the samples of a draw. "
        "Choose another rule.",
    )
    generator = np.random.default_rng(generator)
    pieces = _pieces(prepared.samples, block, groups)
    counts: Counter[tuple[str, ...]] = Counter()
    for _ in range(draws):
        rows = _rows(pieces, prepared.samples, groups is not None, generator)
        counts[_choose_terms(prepared, rows, options, rule)] += 1
    share = [
        sum(count for terms, count in counts.items() if name in terms) / draws
        for name in prepared.names
    ]
    models = tuple((terms, count / draws) for terms, count in counts.most_common())
    return Stability(response, prepared.names, np.array(share), models, draws)


def _choose_terms(
    full: Problem, rows: np.ndarray, options: SubsetOptions, rule: AbstractRule
) -> tuple[str, ...]:
    """Return the terms chosen from the drawn rows, in the candidates' order."""
    X, y = full.X[rows], full.y[rows]
    if np.ptp(y) == 0:
        return ()
    problem = prepare(X, y, full.names, constant=full.constant, response=full.response)
    terms = choose(path(problem, options), rule).names
    return tuple(name for name in full.names if name in terms)


def _pieces(samples: int, block: int | None, groups: Labels | None) -> list[np.ndarray]:
    """Return the rows of each manoeuvre, or of each complete block, starting at any sample."""
    require(
        block is None or groups is None,
        "Give the length of a block or labels of manoeuvres, not both.",
    )
    if groups is not None:
        labels = np.asarray(groups)
        require(
            labels.shape == (samples,),
            f"There are {samples} samples, and the labels of manoeuvres have shape {labels.shape}. "
            "Give one label for each sample.",
        )
        pieces = [np.flatnonzero(labels == label) for label in dict.fromkeys(labels.tolist())]
        require(
            len(pieces) >= 2,
            "There is only one manoeuvre, so that every draw is the same. Draw blocks of samples.",
        )
        return pieces
    length = max(1, round(samples ** (1 / 3))) if block is None else block
    require(
        1 <= length <= samples // 2,
        f"A block has {length} samples of {samples}. Choose 1 to {samples // 2}.",
    )
    return [np.arange(start, start + length) for start in range(samples - length + 1)]


def _rows(
    pieces: list[np.ndarray], samples: int, by_group: bool, generator: np.random.Generator
) -> np.ndarray:
    """Return the rows of a draw, with the original number of manoeuvres or of samples."""
    number = len(pieces) if by_group else -(-samples // len(pieces[0]))
    rows = np.concatenate([pieces[i] for i in generator.integers(len(pieces), size=number)])
    return rows if by_group else rows[:samples]
