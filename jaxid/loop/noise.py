"""Noise of a fit: the models that should explain its residual.

Noise has no drift, depends on no signal, and is not in one place more than chance allows.
"""

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np
import scipy

from .._foundation.grid import typical_step
from .._foundation.location import LocationKind
from ..diagnosis.places import LocalisationResult
from ..estimation.autoregressive_noise import select_order
from .dependence import followed_by_forces
from .evidence import INSEPARABLE, is_drift
from .fit import LoopFit
from .hypothesis import Coloured, ForceNoise, Hypothesis, NoiseHypothesis, RandomForces
from .moves import Move, MoveKind
from .options import LoopOptions
from .random_forces import ForceFit, fit_forces

# Chosen: starting value of the correlation time of a random force [samples].
FORCE_TIME = 5.0
# Chosen: number of steps of random forces from each start, before the better one is continued.
FIRST_STEPS = 6


def noise_moves(
    fit: LoopFit,
    declared: LoopFit,
    where: LocalisationResult | None,
    options: LoopOptions,
) -> Iterator[tuple[list[Move], tuple[str, ...]]]:
    """Yield in stages the noise models that should explain the residual of a fit with white noise.

    Autoregressive noise of order p should lower twice the cost of channel j by `-N_j log(1 - r_j)`,
    with r the share of the residual that its past explains; it and the noises of the user are
    proposed with the effects of the fit and without any. Random forces are estimated by the filter
    along the motion without them (`fit_forces`), and proposed without effects: if they are better
    together with the effects of the fit, neither is the cause. The first stage has the noises of
    the sensors and the best random forces; the next best forces follow one by one.

    Args:
        where: location of the residual; None without random forces.

    Yields:
        The changes of hypothesis, and the candidates and signals that forces without effects would
        follow; such forces are not random, and are not proposed.
    """
    noises, sets = _sensor_noises(fit, options), dict.fromkeys((fit.effects, ()))
    every = [_move(Hypothesis(one, noise), fall) for noise, fall in noises for one in sets]
    moves = [move for move in every if _worth(fit, move) > INSEPARABLE]
    for noise, rough in _rough_fits(fit, declared, _places_of_forces(fit, where)):
        best = fit_forces(rough.motion, noise, rough.noise)
        noise, best = _without_needless(fit, noise, best)
        move = _forces_alone(fit, noise, best)
        if _worth(fit, move) <= INSEPARABLE or _better_with_effects(fit, noise, move):
            continue
        followed = followed_by_forces(declared, best, noise, options.level)
        if followed:
            yield [], followed
        elif not is_drift(declared, float(np.max(np.asarray(best.noise.time)))):
            yield [*moves, move], ()
            moves = []
    if moves:
        yield moves, ()


def _sensor_noises(fit: LoopFit, options: LoopOptions) -> list[tuple[NoiseHypothesis, float]]:
    """Return autoregressive noise and the noises of the user, each with its fall of chi-square."""
    mask, given = fit.problem.train.mask, [(noise, np.inf) for noise in options.noises]
    order = select_order(fit.white_residuals, mask)
    if not order:
        return given
    counts = np.sum(np.asarray(mask), axis=(0, 1))
    shares = np.clip(list(fit.predictable.values()), 0.0, 1.0 - 1e-12)
    return [(Coloured(order), float(np.sum(-counts * np.log1p(-shares)))), *given]


def _move(hypothesis: Hypothesis, fall: float, start: Mapping[str, float] | None = None) -> Move:
    return Move(MoveKind.NOISE, hypothesis, (), fall, start or {}, {})


def _worth(fit: LoopFit, move: Move) -> float:
    """Return the expected fall of chi-square by a move, less the price of its parameters."""
    problem, hypothesis = fit.problem, move.hypothesis
    return move.expected - problem.price * (hypothesis.count(problem) - fit.count)


def _places_of_forces(fit: LoopFit, where: LocalisationResult | None) -> list[RandomForces]:
    """Return random forces in the equations near the best place, and gusts near it: alone, and with
    all other components of the wind, as turbulence has them all.
    """
    if where is None:
        return []
    time = FORCE_TIME * float(typical_step(fit.problem.train.t))

    def sizes(places, kind: LocationKind) -> dict[str, float]:
        chosen = (place for place in places if place.location.kind is kind)
        return {place.location.name: max(place.size, 1e-9) for place in chosen}

    forces, gusts = (sizes(where.near_best(), k) for k in (LocationKind.EQUATION, LocationKind.AIR))
    turbulence = sizes(where.places, LocationKind.AIR)
    noises = [RandomForces(forces, {}, time), RandomForces({}, gusts, time)]
    if gusts and turbulence.keys() != gusts.keys():
        noises.append(RandomForces({}, turbulence, time))
    return [noise for noise in noises if noise.places]


def _rough_fits(
    fit: LoopFit, declared: LoopFit, noises: list[RandomForces]
) -> list[tuple[RandomForces, ForceFit]]:
    """Return random forces after the first steps, without effects, those with the most evidence
    first.

    The declared fit may have taken the forces for other parameters, so that they are estimated from
    the declared values as well, and the better of both starts is returned.
    """
    motion = declared.motion
    begin = dataclasses.replace(motion, values=declared.problem.initial_values)

    def better(noise: RandomForces) -> ForceFit:
        first = noise.initial(declared.noise_covariance)
        starts = (fit_forces(start, noise, first, FIRST_STEPS) for start in (motion, begin))
        return min(starts, key=lambda one: one.cost)

    fits = [(noise, better(noise)) for noise in noises]
    return sorted(fits, key=lambda one: -_worth_alone(fit, *one))


def _without_needless(
    fit: LoopFit, noise: RandomForces, best: ForceFit
) -> tuple[RandomForces, ForceFit]:
    """Return random forces and their most probable values, without the gusts that are not worth
    their parameters, the smallest first: the correlation time of a gust that is none is not
    determined.
    """
    if len(noise.air) < 2:
        return noise, best
    sizes = dict(zip(noise.sizes, np.asarray(best.noise.deviation).tolist(), strict=True))
    smallest = min(noise.air, key=lambda name: sizes[name])
    kept = np.array([name != smallest for name in sizes])
    gusts = {name: size for name, size in noise.gusts if name != smallest}
    smaller = RandomForces(dict(noise.forces), gusts, noise.time)
    deviation, time, sensors = best.noise
    others = fit_forces(best.motion, smaller, ForceNoise(deviation[kept], time[kept], sensors))
    if _worth_alone(fit, smaller, others) < _worth_alone(fit, noise, best):
        return noise, best
    return _without_needless(fit, smaller, others)


def without_slow(parent: LoopFit, refused: LoopFit) -> Move | None:
    """Return the move to the random forces of a refused fit without those as slow as a drift; None
    if none or all of them are.

    Args:
        parent: the fit from which the refused one was a move.
        refused: a fit with noise that was refused as a drift.
    """
    noise, estimates = refused.hypothesis.noise, refused.estimates
    if not isinstance(noise, RandomForces):
        return None
    kept = {n for n in noise.sizes if not is_drift(refused, estimates[f"correlation_time.{n}"][0])}
    if not kept or kept == {*noise.sizes}:
        return None
    forces, gusts = ({n: s for n, s in part if n in kept} for part in (noise.forces, noise.gusts))
    smaller = Hypothesis((), RandomForces(forces, gusts, noise.time))
    start = {name: value for name, (value, _) in estimates.items()}
    return _move(smaller, 2.0 * (parent.cost - refused.cost), start)


def _worth_alone(fit: LoopFit, noise: RandomForces, best: ForceFit) -> float:
    """Return the expected worth of random forces without effects."""
    return _worth(fit, _forces_alone(fit, noise, best))


def _forces_alone(fit: LoopFit, noise: RandomForces, best: ForceFit) -> Move:
    """Return the move from a fit to random forces without effects."""
    start = dict(zip(fit.problem.free.shared, best.motion.values.tolist(), strict=False))
    start |= noise.named(best.noise, fit.problem.model.outputs)
    return _move(Hypothesis((), noise), 2.0 * (fit.cost - best.cost), start)


def _better_with_effects(fit: LoopFit, noise: RandomForces, alone: Move) -> bool:
    """Return True if forces together with the effects of a fit are better than alone: then neither
    the effects nor the forces are the cause.
    """
    if not fit.effects:
        return False
    best = fit_forces(fit.motion, noise, noise.initial(fit.noise_covariance))
    joint = _move(Hypothesis(fit.effects, noise), 2.0 * (fit.cost - best.cost))
    return _worth(fit, joint) > _worth(fit, alone)


def above_known_noise(fitted: LoopFit, level: float) -> bool:
    """Return True if the noise is given and the whitened sum of squares is larger than chi-square
    allows, with a probability of a false alarm of `level`.
    """
    if not fitted.estimation.problem.likelihood.noise.is_known:
        return False
    mask = np.asarray(fitted.problem.train.mask)
    squares = float(np.sum(np.where(mask, np.asarray(fitted.white_residuals), 0.0) ** 2))
    unknown = len(fitted.estimation.free.shared) + fitted.motion.rows.size
    return bool(scipy.stats.chi2.sf(squares, max(int(np.sum(mask)) - unknown, 1)) < level)
