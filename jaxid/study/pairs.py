"""Pairs of effects that hide each other: weak alone, strong together."""

from collections.abc import Mapping

import numpy as np

from ..diagnosis.scores import Scores
from .rounds import Candidate

# Overlap up to which two effects are tried as a pair: beyond it their gains run away against each
# other.
PAIR_OVERLAP = 0.99


def pairs_of(
    candidates: tuple[Candidate, ...], scores: Scores, gains: Mapping[str, int], count: int
) -> tuple[Candidate, ...]:
    """The best pairs of different families whose parts the data can tell apart, the best joint
    score first.

    Args:
        candidates: single ones.
        scores: of all columns.
        gains: column of each candidate's gain.
        count: so many at most.
    """
    at = np.array([gains[one.name] for one in candidates], int)
    b = np.sign(np.asarray(scores.estimated_gain)[at]) * np.sqrt(np.asarray(scores.score)[at])
    rho = np.asarray(scores.overlap)[np.ix_(at, at)]
    apart = np.abs(rho) < PAIR_OVERLAP
    joint = (b[:, None] ** 2 + b[None] ** 2 - 2.0 * rho * b[:, None] * b[None]) / np.where(
        apart, 1.0 - rho**2, 1.0
    )
    colour = np.maximum(
        np.asarray(scores.variance_inflation)[at][:, None],
        np.asarray(scores.variance_inflation)[at][None],
    )
    rows, columns = np.triu_indices(len(candidates), 1)
    order = np.argsort(-joint[rows, columns], kind="stable")
    found = []
    for i, j in zip(rows[order], columns[order], strict=True):
        one, other = candidates[i], candidates[j]
        if len(found) == count:
            break
        if apart[i, j] and one.family != other.family and joint[i, j] > 0:
            found.append(
                one.with_other(other, float(joint[i, j]), float(joint[i, j] / colour[i, j]))
            )
    return tuple(found)
