"""Checks of the noise of a fit: its size, its memory, and the signals on which it depends."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from scipy.stats import chi2

from .._foundation.grid import typical_step
from ..diagnosis.localise import LocalisationResult
from ..diagnosis.residual_report import analyse_residual
from ..estimation.autoregressive_noise import AutoregressiveNoise
from .evidence import SETTLED
from .fit import LoopFit, triangular_factor
from .hypothesis import ForceNoise, RandomForces, White
from .linear import falls, reduce
from .linear_motion import LinearMotion
from .random_forces import FUNCTIONS, force_innovations, forced_motion

# Chosen: longest memory of a noise, in durations of a record. A slower one renews itself less than
# five times in a record, and is as well a constant or a drift.
LONGEST_MEMORY = 0.1

Signals = Mapping[str, np.ndarray]


def stands_out(where: LocalisationResult, level: float) -> bool:
    """Return True if a free-form disturbance at a place explains more than chance would.

    Args:
        where: location of the residual.
        level: probability of a false alarm, over all places.
    """
    places = [place for place in where.places if place.dof]
    chances = [float(chi2.sf(place.score, place.dof)) for place in places]
    return min(chances, default=1.0) < level / max(len(chances), 1)


def above_known_noise(fitted: LoopFit, level: float) -> bool:
    """Return True if the noise is given and the whitened sum of squares is larger than chi-square
    allows.

    Args:
        fitted: a fit.
        level: probability of a false alarm.
    """
    noise = fitted.estimation.problem.likelihood.noise
    if not noise.is_known or not isinstance(fitted.hypothesis.noise, White):
        return False
    mask = np.asarray(fitted.problem.train.mask)
    squares = float(np.sum(np.where(mask, np.asarray(fitted.white_residuals), 0.0) ** 2))
    unknown = len(fitted.estimation.names) + fitted.solution.parameters.rows.size
    return bool(chi2.sf(squares, max(int(np.sum(mask)) - unknown, 1)) < level)


def memory(fitted: LoopFit) -> float:
    """Return the longest correlation time of the noise of a fit [s]; zero for white noise.

    Autoregressive noise with coefficients of characteristic roots `z` decays as `max |z|^i`.
    """
    noise = fitted.estimation.problem.likelihood.noise
    times = [v for n, (v, _) in fitted.estimates.items() if n.startswith("correlation_time.")]
    if isinstance(noise, AutoregressiveNoise):
        mask = fitted.problem.train.mask
        step = float(typical_step(fitted.problem.train.t))
        for coefficients in np.asarray(noise.coefficients(fitted.solution.residuals, mask)):
            largest = float(np.max(np.abs(np.roots(np.r_[1.0, -coefficients])), initial=0.0))
            times.append(step / max(-np.log(max(largest, 1e-300)), 1e-300))
    return max(times, default=0.0)


def is_drift(fitted: LoopFit, memory: float) -> bool:
    """Return True if a noise is so slow that it is as well a constant or a drift.

    Args:
        fitted: a fit, for its records.
        memory: correlation time of the noise [s].
    """
    t = np.asarray(fitted.problem.train.t)
    return bool(memory > LONGEST_MEMORY * float(np.max(t[:, -1] - t[:, 0])))


def followed_signals(best: LoopFit, signals: Signals, level: float) -> tuple[str, ...]:
    """Return the candidates and signals on which the noise of a fit depends; noise depends on none.

    Args:
        best: a fit with a noise model.
        signals: states, inputs and time of the declared fit.
        level: probability of a false alarm, over all of them.
    """
    noise = best.hypothesis.noise
    if isinstance(noise, RandomForces):
        return followed_by_forces(best, best.motion, noise, best.force_noise, signals, level)
    return _dependence(best, signals, level)


def _dependence(best: LoopFit, signals: Signals, level: float) -> tuple[str, ...]:
    """Return the signals on which the whitened residual depends."""
    mask, outputs = best.problem.train.mask, best.problem.model.outputs
    arrays = {name: jnp.asarray(signal) for name, signal in signals.items()}
    report = analyse_residual(jnp.asarray(best.white_residuals), mask, arrays, outputs)
    maps, cross = np.asarray(report.maps.p_value), np.asarray(report.tests.cross_p)
    limit = level / (maps.size + cross.size)
    variables, lagged = report.maps.variables, report.tests.signals
    dependent = [variables[k] for k in np.flatnonzero(np.any(maps < limit, axis=0))]
    dependent += [lagged[k] for k in np.flatnonzero(np.any(cross < limit, axis=0))]
    return tuple(dict.fromkeys(dependent))


def followed_by_forces(
    fitted: LoopFit,
    motion: LinearMotion,
    noise: RandomForces,
    values: ForceNoise,
    signals: Signals,
    level: float,
) -> tuple[str, ...]:
    """Return the candidates and the signals that random forces follow.

    A force that is a function of a signal is no random one. Each candidate, and simple functions
    of each signal as a force at each place, are scored in the innovations of the filter.

    Args:
        fitted: a fit, for its free parameters.
        motion: motion without the forces.
        noise: the forces.
        values: their parameters, and the sensor noise.
        signals: states, inputs and time of the declared fit.
        level: probability of a false alarm, over all of them.
    """
    problem, names = fitted.problem, [name for name in signals if name != "t"]
    stacked = jnp.stack([jnp.asarray(signals[name]) for name in names], axis=-1)
    v, S, probes = force_innovations(forced_motion(motion, noise), values, stacked)
    factor = triangular_factor(
        v, jnp.concatenate([S, probes], axis=-1), len(problem.free.per_record)
    )
    functions = [name for name in names for _ in FUNCTIONS]
    followers = functions * (probes.shape[-1] // len(functions))
    columns = [f"force {k}" for k in range(len(followers))]
    triangle = fitted.triangle_of(np.asarray(factor), (*problem.columns.names, *columns))
    labels = {f"{name}.gain": name for name in problem.effects}
    labels |= dict(zip(columns, followers, strict=True))
    scores = falls(reduce(triangle), np.array([[k] for k in triangle.at(list(labels))]))
    # The linear model along the motion without forces is an approximation: a small score is none.
    significant = scores > max(float(chi2.isf(level / len(labels), 1)), SETTLED)
    return tuple(dict.fromkeys(np.array(list(labels.values()))[significant].tolist()))
