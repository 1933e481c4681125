"""`second_opinion`: the score that chance alone reaches in a round, by random signs of the
residual.

A threshold for many candidates that share one level (Bonferroni) neglects their correlation and
takes the noise as normal. The second opinion estimates both from the records. Let `u_k` be the
whitened column of candidate k at the fit of a round, orthogonal to the free columns and of unit
length, and `e` the whitened residual of the result of the search. If nothing is missing, `e` with
random signs `s_b` of blocks b of successive samples has the distribution of the round's residual,
and the best score of the round has the distribution of

    q = max_k ( sum_b s_b B_bk )^2,    B_bk = sum_(i in b) u_ik' e_i

For pairs of candidates the fall of chi-square takes the place of the square. No draw needs a
simulation or a refit. One sign for all channels keeps their correlation, and one for a block keeps
a memory that is short compared with the block.

A candidate whose shape was set from the residual, a `Resonance`, is taken at that shape, as if it
had been given: its p-value is too small.

Source: Westfall & Young, *Resampling-Based Multiple Testing*, 1993 (the largest of many
statistics); Hemerik, Goeman & Finos, J. R. Stat. Soc. B 82, 2020 (random signs in the score test).
"""

import dataclasses
import enum
from collections.abc import Sequence

import numpy as np

from .._foundation.host import to_device
from .._foundation.types import Float
from ..estimation.likelihoods import OutputError
from ..loop.evidence import is_noise_like
from ..loop.fit import LoopFit
from ..loop.linear import basis, largest_falls
from ..loop.moves import Move, MoveKind, Proposals
from ..loop.search_tree import Step

# Chosen: number of blocks in all records. Fewer keep a longer memory, but the variance of a score
# is less certain (20 % with 50). Measured, share of records with nothing missing that have
# p < 0.05: white noise, 5.5 % of 400; noise with a memory that is too short for `is_noise_like` to
# object, a correlation of 0.2 in 600 samples, 7.5 % of 243, and of 0.3 in 200 samples, 5.9 % of 222
# (with one block per sample 16 % and 20 %).
BLOCKS = 50


class Refusal(enum.Enum):
    """Reason why a round has no second opinion; its value is the reason in words."""

    PREDICTABLE = (
        "the residual that remains is predictable from its past, so that its signs are not random"
    )
    OTHER_NOISE = (
        "the result has another noise model than this round, or noise that acts on the motion"
    )
    EXCHANGE = "the change replaced an effect, and chance does not decide between two effects"
    GROUP = "the change added a group of terms, and groups of several sizes have no common score"
    SCORE_BLIND = "the linear model does not show this effect, so that its score is no measure"


@dataclasses.dataclass(frozen=True)
class SecondOpinion:
    """The score of a round, compared with the scores that chance alone reaches.

    Attributes:
        score: fall of chi-square in the linear model by the change that was made; by the best
            candidate if none was.
        p_value: share of the draws, with the records themselves as one more, in which the best of
            all candidates scores as much. With n draws it is at least `1 / (n + 1)`.
        threshold: score beyond which the p-value is at most `level`; infinite if the draws are too
            few for this level.
        level: probability of one false effect in a study in which nothing is missing.
        draws: number of draws.
    """

    score: float
    p_value: float
    threshold: float
    level: float
    draws: int


def second_opinion(
    proposals: Proposals, made: Step | None, result: LoopFit
) -> SecondOpinion | Refusal | None:
    """Return the second opinion on a round.

    Args:
        proposals: candidates of the round; their options give the level, draws and seed.
        made: the step that was made; None if none was.
        result: fit of the result of the search, whose residual is taken for noise.

    Returns:
        The second opinion, the reason why there is none, or None without draws or candidates.
    """
    fit, options = proposals.fit, proposals.options
    move = made.move if made else None
    sets = _sets(proposals, move)
    if not options.draws or not sets:
        return None
    if (reason := _refusal(proposals, move, result)) is not None:
        return reason
    blocks = block_products(fit, result, proposals.candidates)
    rng = np.random.default_rng(options.seed)
    signs = rng.integers(0, 2, (options.draws, len(blocks))) * 2.0 - 1.0
    order = {name: k for k, name in enumerate(proposals.candidates)}
    into = np.array([[order[name] for name in names] for names in sets], int)
    at = fit.triangle.at([f"{name}.gain" for name in proposals.candidates])
    correlation = proposals.reduced.correlation[np.ix_(at, at)]
    chance = largest_falls(correlation, signs @ blocks, into)
    score = move.expected if move else max(map(proposals.score, proposals.candidates))
    return compared(score, chance, options.level)


def compared(score: float, chance: Float[np.ndarray, " draw"], level: float) -> SecondOpinion:
    """Return the comparison of a score with the best scores of all draws.

        p = (1 + number of draws with the score or more) / (1 + number of draws)

    Source: Davison & Hinkley, *Bootstrap Methods and their Application*, 1997, equation (4.11).

    Args:
        score: fall of chi-square.
        chance: best fall in each draw.
        level: probability of a false effect.
    """
    total = len(chance) + 1
    allowed = int(np.floor(level * total + 1e-9))  # draws beyond the threshold, and the score
    threshold = np.sort(chance)[-allowed] if allowed else np.inf
    p_value = (1 + int(np.sum(chance >= score))) / total
    return SecondOpinion(float(score), p_value, float(threshold), level, len(chance))


def block_products(
    fit: LoopFit, result: LoopFit, candidates: Sequence[str]
) -> Float[np.ndarray, "block candidate"]:
    """Return the products `B` of the candidates' columns with the residual, summed over blocks.

    Args:
        fit: fit of the round.
        result: fit whose whitened residual is taken for noise. The parameters that it estimated
            have made it smaller than the noise, for which the products are corrected.
        candidates: names of the candidates, whose columns are scaled to unit length.
    """
    problem = fit.problem
    own, at = fit.motion.own, fit.triangle.at([f"{n}.gain" for n in candidates])
    free = [own + k for k, is_free in enumerate(fit.triangle.free) if is_free]
    v, S = fit.motion.sensitivities
    chosen = np.asarray(S)[..., [*range(own), *free, *(own + k for k in at)]]
    rows = np.asarray(fit.whitened(v, to_device(chosen))[1])
    cases, samples, outputs, _ = rows.shape
    records = rows.reshape(cases, samples * outputs, -1)
    columns = np.concatenate([_orthogonal(r[:, own:], r[:, :own]) for r in records])
    orthogonal = _orthogonal(columns[:, len(free) :], columns[:, : len(free)])
    length = np.linalg.norm(orthogonal, axis=0)
    unit = orthogonal / np.where(length > 0, length, 1.0)

    estimated = len(result.estimation.free.shared) + result.motion.rows.size
    inflation = problem.samples / max(problem.samples - estimated, 1)
    mask = np.asarray(problem.train.mask)
    e = np.where(mask, np.asarray(result.white_residuals), 0.0) * np.sqrt(inflation)
    products = np.sum(unit.reshape(cases, samples, outputs, -1) * e[..., None], axis=2)
    duration = -(-int(np.sum(np.any(mask, axis=-1))) // BLOCKS)
    starts = np.arange(0, samples, duration)
    return np.add.reduceat(products, starts, axis=1).reshape(cases * len(starts), -1)


def _sets(proposals: Proposals, move: Move | None) -> list[tuple[str, ...]]:
    """Return the sets of effects among which a change was selected."""
    if move is not None and move.kind is MoveKind.PAIR:
        return proposals.pair_sets()
    return [(name,) for name in proposals.candidates]


def _refusal(proposals: Proposals, move: Move | None, result: LoopFit) -> Refusal | None:
    """Return the reason why a round has no second opinion; None if it has one."""
    fit = proposals.fit
    white = isinstance(fit.estimation.problem.likelihood, OutputError)
    if not white or type(fit.hypothesis.noise) is not type(result.hypothesis.noise):
        return Refusal.OTHER_NOISE
    if not is_noise_like(result, proposals.options):
        return Refusal.PREDICTABLE
    if move is None:
        return None
    if not set(fit.effects) <= set(move.hypothesis.effects):
        return Refusal.EXCHANGE
    if move.kind is MoveKind.GROUP:
        return Refusal.GROUP
    return Refusal.SCORE_BLIND if any(map(proposals.is_blind, move.into)) else None


def _orthogonal(columns, others):
    """Return the part of some columns that is orthogonal to others."""
    span = basis(others)
    return columns - span @ (span.T @ columns)
