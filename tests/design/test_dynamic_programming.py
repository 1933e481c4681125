"""Square waves by dynamic programming: against the enumeration of all sequences, whose motions and
sensitivities are exact and superposed; carried information, envelope, refusals.
"""

import itertools
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim
from small_spring import SIGMA, Spring

from jaxid import AbstractModel, FixedNoise, OutputError, free
from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.design import (
    Determinant,
    Limits,
    Trace,
    information_of,
    sample_times,
    square_wave_design,
)
from jaxid.design.dynamic_programming import _after_stage, _start
from jaxid.design.input_design import task_of
from jaxid.design.optimisation import REACHED
from jaxid.design.shapes import stages
from jaxid.effects import Augmented, InputDelay
from jaxid.estimation import FilterError
from jaxid.simulation.hold import Cubic, ZeroOrder
from jaxid.simulation.steppers import RK4

K, C = 1.5, 0.2
SPRING = Spring(jnp.array(K), jnp.array(C))
CHOSEN = free(SPRING, "k", "c", per_record=("initial_state",))
NOISE = OutputError(FixedNoise(jnp.array([SIGMA**2])))
STAGE, COUNT = 8, 7
T = sample_times(5.6, 0.1)
RELATIVE = Trace([1.0 / K**2, 1.0 / C**2])
LIMITS = Limits({"force": 1.0}, envelope={"x": (-0.6, 0.7)})
NO_MERGING = {"cells": 10**9, "width": 10**6}


class Coupled(AbstractModel):
    """Two states and inputs, nonlinear, with direct feedthrough and a bias per record."""

    a: Array
    b: Array
    c: Array
    bias: Array
    states, inputs, outputs = ("x", "v"), ("first", "second"), ("x", "load")

    def rhs(self, t, x, u):
        force = u[0] - self.a * x[0] - self.b * x[1] - 0.3 * x[0] ** 3 + 0.1 * jnp.sin(t)
        return jnp.stack([x[1] + self.c * u[1], force])

    def output(self, t, x, u):
        return jnp.stack([x[0] + self.bias, self.b * x[1] ** 2 + self.c * u[1]])


COUPLED = Coupled(*map(jnp.array, (1.2, 0.4, 0.5, 0.1)))


def coupled_likelihood(**options):
    return OutputError(FixedNoise(jnp.array([[4e-4, 1e-4], [1e-4, 9e-4]])), **options)


def responses(A, B, derivatives, initial, inputs):
    """Return the states and their sensitivities for each input, exactly, with a linear hold.

    Args:
        A, B: matrices of the motion, of which all is linear.
        derivatives: derivatives of A by the parameters.
        initial: initial state of each case.
        inputs: inputs of each case, shape (case, time, input).

    Returns:
        States and sensitivities, shape (case, time, 1 + parameter, state).
    """
    n, count = len(A), 1 + len(derivatives)
    wide = np.kron(np.eye(count), A)
    for number, derivative in enumerate(derivatives, start=1):
        wide[number * n : (number + 1) * n, :n] = derivative
    system = wide, np.pad(B, ((0, wide.shape[0] - n), (0, 0))), np.eye(wide.shape[0])
    system = (*system, np.zeros((wide.shape[0], B.shape[1])))
    return np.stack(
        [
            lsim(system, u, np.asarray(T), np.pad(x, (0, wide.shape[0] - n)))[2]
            for u, x in zip(inputs, initial, strict=True)
        ]
    ).reshape(len(inputs), T.size, count, n)


@pytest.fixture(scope="module")
def enumeration():
    """Costs and largest positions of all sequences of the spring, by superposition."""
    sequences = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=COUNT)))
    A, B = np.array([[0.0, 1.0], [-K, -C]]), np.array([[0.0], [1.0]])
    by_k, by_c = np.array([[0.0, 0.0], [-1.0, 0.0]]), np.array([[0.0, 0.0], [0.0, -1.0]])
    units = np.asarray(stages(T, STAGE).basis).T[..., None]
    basis = responses(A, B, (by_k, by_c), np.zeros((COUNT, 2)), units)[..., 0]
    still = np.zeros((2, T.size, 1))
    own = responses(A, B, (by_k, by_c), np.eye(2), still)[:, :, 0, 0].T / SIGMA
    motion = np.einsum("sk,ktp->stp", sequences, basis)
    shared = motion[:, :, 1:] / SIGMA
    Q = np.linalg.qr(own)[0]
    left = shared - np.einsum("ta,ua,sup->stp", Q, Q, shared)
    M = np.einsum("stp,stq->spq", left, left)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = M[:, 0, 0] * M[:, 1, 1] - M[:, 0, 1] ** 2
        cost = np.log((M[:, 1, 1] / K**2 + M[:, 0, 0] / C**2) / determinant)
    cost[~np.isfinite(cost)] = np.inf
    x = motion[:, :, 0]
    return SimpleNamespace(sequences=sequences, cost=cost, low=x.min(axis=1), high=x.max(axis=1))


def spring_design(limits=LIMITS, **options):
    return square_wave_design(SPRING, CHOSEN, T, STAGE, RELATIVE, limits, NOISE, **options)


def optimum(enumeration, low, high):
    inside = (enumeration.low >= REACHED * low) & (enumeration.high <= REACHED * high)
    return np.min(enumeration.cost[inside])


@pytest.mark.parametrize("envelope", [(-0.6, 0.7), (-0.4, 0.5), (-5.0, 5.0)])
def test_search_without_merging_finds_the_best_of_all_sequences(enumeration, envelope):
    """To 1e-4 of the logarithmic variance, the error of the Runge-Kutta method."""
    result = spring_design(Limits({"force": 1.0}, envelope={"x": envelope}), **NO_MERGING)
    np.testing.assert_allclose(result.cost, optimum(enumeration, *envelope), atol=1e-4)
    levels = np.asarray(result.signal.u[:, 0])
    assert levels[0] == 0.0
    assert np.all(levels[1:].reshape(COUNT, STAGE) == levels[1::STAGE, None])
    assert set(levels) <= {-1.0, 0.0, 1.0}
