"""Dependence of a noise on signals: noise depends on none.

An error that is a function of a signal is no random one, whatever its shape. At each place of a
disturbance, a smooth function of each state and each input, and of time for noise of the sensors,
is scored as a whole: cosines over the range of the signal,

    d_i = sum_k c_k cos(k pi (s_i - min s) / (max s - min s)),    k = 1 ... order

whose response in the linear model is whitened as the residual is. The fall of chi-square by all
`c_k`, orthogonal to the free parameters, has at most `order` degrees of freedom. Several orders are
tested (Neyman, Skandinavisk Aktuarietidskrift 20, 1937): few cosines show a trend, many a kink.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from .._foundation.compiler import fast_compile_jit
from .._foundation.host import to_device
from .._foundation.location import LocationKind
from .._foundation.types import Array, Float
from ..diagnosis.free_form import Linear, answers
from ..estimation.likelihoods import OutputError
from .evidence import SETTLED
from .fit import LoopFit
from .hypothesis import RandomForces
from .linear import joint_fall, reduce
from .linear_motion import LinearMotion
from .random_forces import (
    ForceFit,
    fit_forces,
    force_innovations,
    forced_motion,
    predicted_states,
)

# Name of a candidate or a signal, and a fall of chi-square with its degrees of freedom.
Test = tuple[str, tuple[float, int]]
# Chosen: numbers of cosines over the range of a signal, eight periods at most.
ORDERS = (1, 2, 4, 8, 16)
COSINES = ORDERS[-1]
# Chosen: share of the fall of chi-square by random forces, up to which a dependence is the error of
# the linear model along the motion without them, if the declared model is not linear: 0.5 % on a
# simulated F-4, 20 s in gusts of 1 m/s.
APPROXIMATION_SHARE = 0.01


class Whitened(NamedTuple):
    """A motion whose residual a noise should explain.

    Attributes:
        motion: the motion.
        signals: signals by name, at each sample independent of the noise of this sample.
        places: places of disturbances that may follow a signal, with their kind.
        white: function from residuals and columns to white ones.
    """

    motion: LinearMotion
    signals: Mapping[str, Float[np.ndarray, "case time"]]
    places: Sequence[tuple[LocationKind, str]]
    white: Callable[[Array, Array], tuple[Array, Array]]


def followed_signals(best: LoopFit, level: float) -> tuple[str, ...]:
    """Return the candidates and signals on which the noise of a fit depends, with a probability of
    a false alarm of `level` over all of them.
    """
    problem, noise, motion = best.problem, best.hypothesis.noise, best.motion
    if isinstance(noise, RandomForces):
        # The filter of the fit has another force between samples: if the force forgets within a
        # step, the estimates of that filter do not whiten the innovations of this one.
        forces = fit_forces(motion, noise, noise.initial(best.noise_covariance))
        return followed_by_forces(best, forces, noise, level)
    if not isinstance(best.estimation.problem.likelihood, OutputError):
        return ()  # its rows are no function of the outputs alone
    places = [(LocationKind.EQUATION, name) for name in problem.equations]
    places += [(LocationKind.SENSOR, name) for name in problem.model.outputs]
    return _followed(best, Whitened(motion, motion.variables, places, best.whitened), level)


def followed_by_forces(
    fitted: LoopFit, forces: ForceFit, noise: RandomForces, level: float
) -> tuple[str, ...]:
    """Return the candidates and signals that random forces at the places of a noise follow
    (`followed_signals`); the free parameters of `fitted` may explain the innovations.
    """
    motion = forces.motion

    def white(v, S):
        return force_innovations(forced_motion(motion, noise, v, S), forces.noise)

    forced = forced_motion(motion, noise, *motion.sensitivities)
    states = np.moveaxis(np.asarray(predicted_states(forced, forces.noise)), -1, 0)
    predicted = dict(zip(fitted.problem.model.states, states, strict=False))
    inputs = {name: motion.variables[name] for name in fitted.problem.model.inputs}
    places = [(kind, name) for kind, names in noise.places.items() for name in names]
    whitened = Whitened(motion, predicted | inputs, places, white)
    share = 0.0 if motion.is_linear else APPROXIMATION_SHARE
    v, mask = motion.sensitivities[0], motion.problem.train.mask
    white_cost = float(motion.problem.likelihood.noise.cost(v, mask))
    least = share * 2.0 * (white_cost - forces.cost)
    return _followed(fitted, whitened, level, least)


def _followed(
    fitted: LoopFit, whitened: Whitened, level: float, least_fall: float = 0.0
) -> tuple[str, ...]:
    """Return the candidates and signals with a significant fall of chi-square of at least
    `least_fall`, the most significant first.
    """
    tests = [*_candidate_tests(fitted, whitened), *_signal_tests(fitted, whitened)]
    chances: dict[str, float] = {}
    for name, (fall, dof) in tests:
        # A small fall is none, as the linear model is an approximation; time is known exactly.
        least = 0.0 if name == "t" else max(SETTLED, least_fall)
        if dof and fall > max(float(scipy.stats.chi2.isf(level / len(tests), dof)), least):
            chances[name] = min(chances.get(name, 0.0), float(scipy.stats.chi2.logsf(fall, dof)))
    return tuple(sorted(chances, key=lambda name: chances[name]))


def _candidate_tests(fitted: LoopFit, whitened: Whitened) -> Iterator[Test]:
    """Yield each candidate with its fall of chi-square."""
    names = fitted.problem.columns.names
    white = whitened.white(*whitened.motion.sensitivities)
    triangle = fitted.white_triangle(*white, names)
    reduced = reduce(triangle)
    for name in fitted.problem.effects:
        yield name, joint_fall(reduced, triangle.at([f"{name}.gain"]))


def _signal_tests(fitted: LoopFit, whitened: Whitened) -> Iterator[Test]:
    """Yield each signal with the fall of chi-square by functions of it, at each place."""
    problem, motion = fitted.problem, whitened.motion
    names = tuple(whitened.signals)
    signals = to_device(np.stack([*whitened.signals.values()], axis=-1))
    free = tuple(name for name in fitted.estimation.free.shared if name in problem.columns.index)
    v, S = motion.columns_of(free)
    labels = (*free, *(f"{name} {k}" for name in names for k in range(COSINES)))
    for kind, place in whitened.places:
        forced = probes(motion.linear_at({kind: (place,)}), signals)
        columns = jnp.concatenate([S, forced], axis=-1)
        reduced = reduce(fitted.white_triangle(*whitened.white(v, columns), labels))
        for first, name in zip(itertools.count(len(free), COSINES), names, strict=False):
            for order in ORDERS:
                yield name, joint_fall(reduced, range(first, first + order))


@fast_compile_jit
def probes(
    linear: Linear, signals: Float[Array, "case time signal"]
) -> Float[Array, "case time output column"]:
    """Return the responses to disturbances that are cosines over the range of each signal, place by
    place, signal by signal.
    """
    least, most = jnp.min(signals, axis=(0, 1)), jnp.max(signals, axis=(0, 1))
    share = (signals - least[None, None]) / jnp.where(most > least, most - least, 1.0)[None, None]
    half_periods = jnp.arange(1, COSINES + 1)[None, None, None]
    cosines = jnp.cos(jnp.pi * share[..., None] * half_periods).reshape(*signals.shape[:2], -1)
    forced = jax.vmap(answers)(linear, cosines)
    return forced.reshape(*forced.shape[:3], -1)
