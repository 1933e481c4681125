"""Dependence of a noise on signals: noise depends on none.

An error that is a function of a signal is no random one, whatever its shape. At each place of a
disturbance, a smooth function of each state and each input is scored as a whole: cosines over the
range of the signal,

    d_i = sum_k c_k cos(k pi (s_i - min s) / (max s - min s)),    k = 1 ... COSINES

whose response in the linear model is whitened as the residual is. The fall of chi-square by all
`c_k`, orthogonal to the free parameters, has at most `COSINES` degrees of freedom.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import chi2

from .._foundation.compiler import fast_compile_jit
from .._foundation.location import LocationKind
from .._foundation.types import Array, Float
from ..diagnosis.free_form import Linear, answers
from ..estimation.likelihoods import OutputError
from .evidence import SETTLED
from .fit import LoopFit, triangular_factor
from .hypothesis import RandomForces
from .linear import joint_fall, reduce
from .linear_motion import LinearMotion
from .random_forces import ForceFit, force_innovations, forced_motion, predicted_states

# Chosen: cosines over the range of a signal, four periods at most.
COSINES = 8


class Whitened(NamedTuple):
    """A motion whose residual a noise should explain.

    Attributes:
        motion: the motion.
        states: states at each sample, independent of the noise of this sample.
        places: places of disturbances that may follow a signal, by kind.
        white: function from residuals and columns to white ones.
    """

    motion: LinearMotion
    states: Float[Array, "case time state"]
    places: Mapping[LocationKind, tuple[str, ...]]
    white: Callable[[Array, Array], tuple[Array, Array]]


def followed_signals(best: LoopFit, level: float) -> tuple[str, ...]:
    """Return the candidates and signals on which the noise of a fit depends, with a probability of
    a false alarm of `level` over all of them.
    """
    problem, noise, motion = best.problem, best.hypothesis.noise, best.motion
    if isinstance(noise, RandomForces):
        forces = ForceFit(motion, noise.at(best.estimates, problem.model.outputs), best.cost)
        return followed_by_forces(best, forces, noise, level)
    if not isinstance(best.estimation.problem.likelihood, OutputError):
        return ()  # its rows are no function of the outputs alone
    states = motion.linear.x[..., : len(problem.model.states)]
    places = {
        LocationKind.EQUATION: problem.equations,
        LocationKind.SENSOR: problem.model.outputs,
    }
    return _followed(best, Whitened(motion, states, places, best.whitened), level)


def followed_by_forces(
    fitted: LoopFit, forces: ForceFit, noise: RandomForces, level: float
) -> tuple[str, ...]:
    """Return the candidates and the signals that random forces follow, with a probability of a
    false alarm of `level` over all of them.

    Args:
        fitted: fit whose free parameters may explain the innovations.
        forces: the most probable forces.
        noise: their places.
        level: the probability.
    """
    motion = forces.motion

    def white(v, S):
        return force_innovations(forced_motion(motion, noise, v, S), forces.noise)

    declared = len(fitted.problem.model.states)
    forced = forced_motion(motion, noise, *motion.sensitivities)
    states = predicted_states(forced, forces.noise)[..., :declared]
    return _followed(fitted, Whitened(motion, states, noise.places, white), level)


def _followed(fitted: LoopFit, whitened: Whitened, level: float) -> tuple[str, ...]:
    """Return the candidates and signals with a significant fall of chi-square."""
    motion, problem, own = whitened.motion, fitted.problem, len(fitted.problem.free.per_record)

    def triangle(v, S, names):
        return fitted.triangle_of(np.asarray(triangular_factor(*whitened.white(v, S), own)), names)

    every = triangle(*motion.sensitivities, problem.columns.names)
    reduced = reduce(every)
    tests = [(name, joint_fall(reduced, every.at([f"{name}.gain"]))) for name in problem.effects]
    signals = jnp.concatenate([whitened.states, problem.train.u], axis=-1)
    names = (*problem.model.states, *problem.model.inputs)
    free = tuple(name for name in fitted.estimation.free.shared if name in problem.columns.index)
    v, S = motion.columns_of(free)
    labels = tuple(f"{name} {k}" for name in names for k in range(COSINES))
    for kind, inside in whitened.places.items():
        for place in inside:
            forced = probes(motion.linear_at({kind: (place,)}), signals)
            one = triangle(v, jnp.concatenate([S, forced], axis=-1), (*free, *labels))
            reduced = reduce(one)
            for k, name in enumerate(names):
                first = len(free) + COSINES * k
                tests.append((name, joint_fall(reduced, range(first, first + COSINES))))
    # A small fall is none: the linear model is an approximation.
    significant = (
        name
        for name, (fall, dof) in tests
        if dof and fall > max(float(chi2.isf(level / len(tests), dof)), SETTLED)
    )
    return tuple(dict.fromkeys(significant))


@fast_compile_jit
def probes(
    linear: Linear, signals: Float[Array, "case time signal"]
) -> Float[Array, "case time output column"]:
    """Return the responses to disturbances that are cosines of signals, place by place, signal by
    signal.
    """
    forced = jax.vmap(answers)(linear, _cosines(signals))
    return forced.reshape(*forced.shape[:3], -1)


def _cosines(signals):
    """Return the cosines over the range of each signal."""
    least, most = jnp.min(signals, axis=(0, 1)), jnp.max(signals, axis=(0, 1))
    share = (signals - least[None, None]) / jnp.where(most > least, most - least, 1.0)[None, None]
    half_periods = jnp.arange(1, COSINES + 1)[None, None, None]
    return jnp.cos(jnp.pi * share[..., None] * half_periods).reshape(*signals.shape[:2], -1)
