"""`noise_moves`: the noise models that should explain the residual of a fit with white noise."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from .._foundation.grid import typical_step
from .._foundation.location import LocationKind
from ..diagnosis.localise import LocalisationResult
from ..estimation.autoregressive_noise import select_order
from .evidence import INSEPARABLE
from .fit import LoopFit
from .hypothesis import Coloured, Hypothesis, NoiseHypothesis, RandomForces
from .moves import Move, MoveKind
from .noise_checks import followed_by_forces, is_drift
from .options import LoopOptions
from .random_forces import ForceFit, fit_forces

# Chosen: starting value of the correlation time of a random force [samples].
FORCE_TIME = 5.0


class NoiseMoves(NamedTuple):
    """Noise models to refit.

    Attributes:
        moves: the changes of hypothesis.
        followed: candidates and signals that forces without effects would follow; such forces are
            not random, and are not proposed.
    """

    moves: list[Move]
    followed: tuple[str, ...]


def noise_moves(
    fit: LoopFit,
    declared: LoopFit,
    where: LocalisationResult | None,
    signals: Mapping[str, np.ndarray],
    options: LoopOptions,
) -> NoiseMoves:
    """Return the noise models that should explain the residual of a fit with white noise.

    Autoregressive noise of order p should lower twice the cost of channel j by `-N_j log(1 - r_j)`,
    with r the share of the residual that its past explains; it is proposed with the effects of the
    fit and without any. Random forces are estimated by the filter along the motion without them
    (`fit_forces`), and proposed without effects: if they are better together with the effects of
    the fit, neither is the cause.

    Args:
        fit: the fit.
        declared: fit of the declared model.
        where: location of the residual; None without random forces.
        signals: states, inputs and time of the declared fit.
        options: levels.
    """
    moves, followed = [*_coloured(fit), *_given(fit, options)], ()
    for noise in _places_of_forces(fit, where) if where is not None else ():
        best = _most_probable(declared, noise)
        move = _forces_alone(fit, noise, best)
        if _worth(fit, move) <= INSEPARABLE or _better_with_effects(fit, noise, move):
            continue
        names = followed_by_forces(declared, best.motion, noise, best.noise, signals, options.level)
        followed = tuple(dict.fromkeys((*followed, *names)))
        if not names and not is_drift(declared, float(np.max(np.asarray(best.noise.time)))):
            moves.append(move)
    return NoiseMoves([move for move in moves if _worth(fit, move) > INSEPARABLE], followed)


def _worth(fit: LoopFit, move: Move) -> float:
    """Return the expected fall of chi-square by a move, less the price of its parameters."""
    columns, outputs = fit.problem.columns, len(fit.problem.model.outputs)
    hypothesis = move.hypothesis
    count = len(columns.chosen(hypothesis.effects)) + hypothesis.noise.count(outputs)
    return move.expected - fit.problem.price * (count - fit.count)


def _coloured(fit: LoopFit) -> list[Move]:
    """Return autoregressive noise with the effects of a fit, and without any."""
    mask = fit.problem.train.mask
    order = select_order(fit.white_residuals, mask)
    if not order:
        return []
    counts = np.sum(np.asarray(mask), axis=(0, 1))
    shares = np.clip(list(fit.predictable.values()), 0.0, 1.0 - 1e-12)
    expected = float(np.sum(-counts * np.log1p(-shares)))
    return _with_and_without_effects(fit, Coloured(order), expected)


def _given(fit: LoopFit, options: LoopOptions) -> list[Move]:
    """Return the noises of the user with the effects of a fit, and without any."""
    moves = [_with_and_without_effects(fit, noise, np.inf) for noise in options.noises]
    return [move for pair in moves for move in pair]


def _with_and_without_effects(fit: LoopFit, noise: NoiseHypothesis, expected: float) -> list[Move]:
    """Return the moves to a noise with the effects of a fit, and without any."""
    sets = dict.fromkeys((fit.effects, ()))
    return [Move(MoveKind.NOISE, Hypothesis(one, noise), (), expected, {}, {}) for one in sets]


def _places_of_forces(fit: LoopFit, where: LocalisationResult) -> list[RandomForces]:
    """Return random forces in the equations, and gusts, near the best place."""
    time = FORCE_TIME * float(typical_step(fit.problem.train.t))
    proposals: list[RandomForces] = []
    for kind in (LocationKind.EQUATION, LocationKind.AIR):
        places = [place for place in where.near_best() if place.location.kind is kind]
        sizes = {place.location.name: max(place.size, 1e-9) for place in places}
        if sizes:
            forces, gusts = (sizes, {}) if kind is LocationKind.EQUATION else ({}, sizes)
            proposals.append(RandomForces(forces, gusts, time))
    return proposals


def _most_probable(declared: LoopFit, noise: RandomForces) -> ForceFit:
    """Return the most probable forces without effects.

    The declared fit may have taken the forces for other parameters, so that they are estimated from
    the declared values as well.
    """
    motion, first = declared.motion, noise.initial(declared.noise_covariance)
    begin = dataclasses.replace(motion, values=declared.problem.initial_values)
    fits = [fit_forces(start, noise, first) for start in (motion, begin)]
    return min(fits, key=lambda one: one.cost)


def _forces_alone(fit: LoopFit, noise: RandomForces, best: ForceFit) -> Move:
    """Return the move from a fit to random forces without effects."""
    problem = fit.problem
    names = problem.columns.names[: problem.columns.declared]
    start = dict(zip(names, best.motion.values.tolist(), strict=False))
    start |= noise.named(best.noise, problem.model.outputs)
    fall = 2.0 * (fit.cost - best.cost)
    return Move(MoveKind.NOISE, Hypothesis((), noise), (), fall, start, {})


def _better_with_effects(fit: LoopFit, noise: RandomForces, alone: Move) -> bool:
    """Return True if forces together with the effects of a fit are better than alone: then neither
    the effects nor the forces are the cause.
    """
    if not fit.effects:
        return False
    best = fit_forces(fit.motion, noise, noise.initial(fit.noise_covariance))
    joint = dataclasses.replace(
        alone, hypothesis=Hypothesis(fit.effects, noise), expected=2.0 * (fit.cost - best.cost)
    )
    return _worth(fit, joint) > _worth(fit, alone)
