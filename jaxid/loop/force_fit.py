"""`fit_forces`: estimate of random forces by the filter along the motion without forces.

Gauss-Newton: the motion and its linear model are computed at the parameters, the forces estimated
(`estimate_forces`), and the parameters moved. No program holds
the model but those of fits with white noise, so that a search tries random forces without compiling
a filter for them.
"""

from typing import NamedTuple

import numpy as np

from .._foundation.host import to_device
from .._foundation.location import LocationKind
from .force_innovations import ForcedMotion, ForceEstimate, ForceNoise, estimate_forces
from .hypothesis import RandomForces
from .linear_motion import LinearMotion

# Chosen: number of steps, smallest share of one, and fall of the cost below which none is made.
MOST_STEPS, SMALLEST_SHARE, LEAST_FALL = 20, 0.01, 0.05
# Chosen: ratio of a refused step to the next one tried.
SHORTER = 0.25


class ForceFit(NamedTuple):
    """The most probable random forces with the parameters of the model.

    Attributes:
        motion: the motion without forces at the parameters.
        noise: parameters of the forces and of the sensor noise.
        cost: negative log-likelihood.
    """

    motion: LinearMotion
    noise: ForceNoise
    cost: float


def forced_motion(
    motion: LinearMotion, noise: RandomForces, names: tuple[str, ...] | None = None
) -> ForcedMotion:
    """Return a motion for random forces at their places.

    Args:
        motion: the motion without forces.
        noise: the forces.
        names: names of the shared parameters; all by default.
    """
    places = {LocationKind.EQUATION: noise.equations, LocationKind.AIR: noise.air}
    linear = motion.without_absent_states(motion.linear_at(places))
    v, S = motion.sensitivities if names is None else motion.columns_of(names)
    records = motion.problem.train
    return ForcedMotion(linear, records.t, records.mask, v, S)


def fit_forces(start: LinearMotion, noise: RandomForces, first: ForceNoise) -> ForceFit:
    """Return the most probable random forces and parameters; an infinite cost if the start
    diverges.

    Args:
        start: motion at the starting values.
        noise: the forces.
        first: starting values of their parameters and of the sensor noise.
    """
    columns, own = start.problem.columns, len(start.problem.free.per_record)
    chosen = columns.chosen(start.effects)
    names = tuple(columns.names[k] for k in chosen)
    best, step = ForceFit(start, first, np.inf), None
    motion, share = start, 1.0
    for _ in range(MOST_STEPS):
        forced = forced_motion(motion, noise, names)
        here = estimate_forces(forced, own, best.noise) if _is_finite(forced) else None
        if here is not None and here.cost < best.cost:
            best, step, share = ForceFit(motion, here.noise, here.cost), here, 1.0
        else:
            share *= SHORTER
        if step is None or step.fall < LEAST_FALL or share < SMALLEST_SHARE:
            break
        motion = _moved(best.motion, chosen, step, share)
    return best


def _is_finite(motion: ForcedMotion) -> bool:
    return all(bool(np.all(np.isfinite(np.asarray(part)))) for part in (motion.v, motion.S))


def _moved(motion: LinearMotion, chosen, step: ForceEstimate, share: float) -> LinearMotion:
    """Return the motion after a share of a step, within the bounds."""
    limits = motion.problem.columns.limits(chosen, 0, motion.problem.train.n_cases)
    values = motion.values.copy()
    shared = values[chosen] + share * step.shared
    values[chosen] = np.clip(
        shared, np.asarray(limits.lower.shared), np.asarray(limits.upper.shared)
    )
    rows = np.asarray(motion.rows) + share * step.own
    rows = np.clip(rows, np.asarray(limits.lower.rows), np.asarray(limits.upper.rows))
    return LinearMotion(motion.problem, motion.effects, values, to_device(rows))
