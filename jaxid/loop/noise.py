"""Noise of a fit: the models that should explain its residual.

Noise has no drift, depends on no signal, and is not in one place more than chance allows.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
import scipy

from .._foundation.grid import typical_step
from .._foundation.location import LocationKind
from ..diagnosis.localise import LocalisationResult
from ..estimation.autoregressive_noise import select_order
from .dependence import followed_by_forces
from .evidence import INSEPARABLE, is_drift
from .fit import LoopFit
from .hypothesis import Coloured, Hypothesis, NoiseHypothesis, RandomForces
from .moves import Move, MoveKind
from .options import LoopOptions
from .random_forces import ForceFit, fit_forces

# Chosen: starting value of the correlation time of a random force [samples].
FORCE_TIME = 5.0
# Chosen: number of steps of random forces from each start, before the better one is continued.
FIRST_STEPS = 6
# Chosen: share of the largest standard deviation below which a component of the gusts is none.
NEGLIGIBLE_GUST = 0.05


def noise_moves(
    fit: LoopFit,
    declared: LoopFit,
    where: LocalisationResult | None,
    options: LoopOptions,
) -> tuple[list[Move], tuple[str, ...]]:
    """Return the noise models that should explain the residual of a fit with white noise.

    Autoregressive noise of order p should lower twice the cost of channel j by `-N_j log(1 - r_j)`,
    with r the share of the residual that its past explains; it and the noises of the user are
    proposed with the effects of the fit and without any. Random forces are estimated by the filter
    along the motion without them (`fit_forces`), and proposed without effects: if they are better
    together with the effects of the fit, neither is the cause.

    Args:
        where: location of the residual; None without random forces.

    Returns:
        The changes of hypothesis, and the candidates and signals that forces without effects would
        follow; such forces are not random, and are not proposed.
    """
    noises, sets = _sensor_noises(fit, options), dict.fromkeys((fit.effects, ()))
    moves = [_move(Hypothesis(one, noise), fall) for noise, fall in noises for one in sets]
    followed: dict[str, None] = {}
    for noise in _places_of_forces(fit, where):
        noise, best = _without_negligible(declared, noise)
        move = _forces_alone(fit, noise, best)
        if _worth(fit, move) <= INSEPARABLE or _better_with_effects(fit, noise, move):
            continue
        names = followed_by_forces(declared, best, noise, options.level)
        followed |= dict.fromkeys(names)
        if not names and not is_drift(declared, float(np.max(np.asarray(best.noise.time)))):
            moves.append(move)
    return [move for move in moves if _worth(fit, move) > INSEPARABLE], tuple(followed)


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


def _without_negligible(declared: LoopFit, noise: RandomForces) -> tuple[RandomForces, ForceFit]:
    """Return random forces and their most probable values, negligible gusts left out: the
    correlation time of a gust that is none is not determined.
    """
    best = _most_probable(declared, noise)
    sizes = dict(zip(noise.sizes, np.asarray(best.noise.deviation).tolist(), strict=True))
    gusts = {name: sizes[name] for name in noise.air}
    kept = {n: s for n, s in gusts.items() if s > NEGLIGIBLE_GUST * max(gusts.values())}
    if len(kept) == len(gusts):
        return noise, best
    return _without_negligible(declared, RandomForces(dict(noise.forces), kept, noise.time))


def _most_probable(declared: LoopFit, noise: RandomForces) -> ForceFit:
    """Return the most probable forces without effects.

    The declared fit may have taken the forces for other parameters, so that they are estimated from
    the declared values as well, and the better of both starts is continued.
    """
    motion, first = declared.motion, noise.initial(declared.noise_covariance)
    begin = dataclasses.replace(motion, values=declared.problem.initial_values)
    fits = [fit_forces(start, noise, first, FIRST_STEPS) for start in (motion, begin)]
    best = min(fits, key=lambda one: one.cost)
    return fit_forces(best.motion, noise, best.noise)


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


def stands_out(where: LocalisationResult, level: float) -> bool:
    """Return True if a free-form disturbance at a place explains more than chance would, with a
    probability of a false alarm of `level` over all places.
    """
    places = [place for place in where.places if place.dof]
    chances = [float(scipy.stats.chi2.sf(place.score, place.dof)) for place in places]
    return min(chances, default=1.0) < level / max(len(chances), 1)


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
