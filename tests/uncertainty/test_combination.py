"""Estimates combined after the fact equal the joint estimate of a linear problem."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from reference_estimation import rk4
from scipy.stats import kstest

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.data import record, stack
from jaxid.models import FixedNoise, LinearModel
from jaxid.uncertainty import combine, constrain

A = np.array([[0.0, 1.0], [-2.0, -0.5]])
R = np.array([[0.04, 0.03], [0.03, 0.09]])
KNOWN = jaxid.OutputError(noise=FixedNoise(R))
NAMES = {"inputs": ("force",), "outputs": ("x", "v")}
MODEL = LinearModel(A, np.zeros((2, 1)), np.eye(2), np.zeros((2, 1)), states=("x", "v"), **NAMES)
FREE = jaxid.free(MODEL, "B", per_record=("initial_state",))
ROWS = 60


def flight(rng, number, force=(0.5, 2.0)):
    t = 0.1 * np.arange(ROWS)
    u = np.sin((0.5 + 0.2 * number) * t + number)
    start = rng.normal(size=2)
    x = rk4(lambda x, u, b: A @ x + b * u, t, u, start, np.asarray(force))
    z = x + rng.multivariate_normal(np.zeros(2), R, ROWS)
    return record(t, u, z, name=f"flight {number}", **NAMES)


def columns(number):
    """Outputs of a flight by force coefficients and initial states, (time, output, column)."""
    t = 0.1 * np.arange(ROWS)
    u = np.sin((0.5 + 0.2 * number) * t + number)
    unit = np.eye(4)
    made = [rk4(lambda x, u, b: A @ x + b * u, t, u, e[2:], e[:2]) for e in unit]
    return np.stack(made, -1)


@pytest.fixture(scope="module")
def flights():
    """Estimates of four flights, and the joint estimate by dense least squares in NumPy."""
    rng = np.random.default_rng(1974)
    records = [flight(rng, number) for number in range(4)]
    alone = [jaxid.estimate(MODEL, FREE, stack([one], ROWS), KNOWN) for one in records]
    W, M, g = np.linalg.inv(R), np.zeros((10, 10)), np.zeros(10)
    for number, one in enumerate(records):
        at = [0, 1, 2 + 2 * number, 3 + 2 * number]
        S = columns(number)
        M[np.ix_(at, at)] += np.einsum("tip,ij,tjq->pq", S, W, S)
        g[at] += np.einsum("tip,ij,tj->p", S, W, np.asarray(one.z))
    return alone, (np.linalg.solve(M, g)[:2], np.linalg.inv(M)[:2, :2])


def test_combination_equals_joint_estimate(flights):
    """A linear model with known R; the initial states of the records are free."""
    alone, (values, covariance) = flights
    result = combine(alone)
    np.testing.assert_allclose(result.values, values, rtol=1e-9)
    np.testing.assert_allclose(result.covariance, covariance, rtol=1e-9)
    assert result.degrees_of_freedom == 6
    assert "std. error" in str(result)
    np.testing.assert_allclose(result.value("B[0,0]"), values[0], rtol=1e-9)


def test_misfit_is_chi_square_and_shows_flight_of_another_aircraft(flights):
    alone, _ = flights
    differences = [np.asarray(one.values) - np.asarray(combine(alone).values) for one in alone]
    expected = sum(
        d @ np.linalg.inv(np.asarray(one.covariance)) @ d
        for d, one in zip(differences, alone, strict=True)
    )
    np.testing.assert_allclose(combine(alone).misfit, expected, rtol=1e-8)
    rng = np.random.default_rng(5)
    p = []
    for _ in range(60):  # the misfit depends on the values alone: draw them
        drawn = [_with_values(one, rng) for one in alone]
        p.append(float(combine(drawn).p_value))
    assert kstest(p, "uniform").pvalue > 1e-3
    other = jaxid.estimate(MODEL, FREE, stack([flight(rng, 1, (0.5, 3.0))], ROWS), KNOWN)
    assert float(combine([*alone, other]).p_value) < 1e-3


def _with_values(estimate, rng):
    """The estimate with other values, drawn from its distribution about the truth."""
    values = rng.multivariate_normal([0.5, 2.0], np.asarray(estimate.covariance))
    return eqx.tree_at(lambda node: node.values, estimate, jnp.asarray(values))


def test_constraint_equals_estimate_of_constrained_model(flights):
    """`B1 = 4 B0` by the null space against the closed form with a multiplier."""
    joint = flights[0][0]
    result = constrain(joint, [({"B[1,0]": 1.0, "B[0,0]": -4.0}, 0.1)])
    C, a = np.asarray(joint.covariance), np.array([-4.0, 1.0])
    theta = np.asarray(joint.values)
    gap, variance = a @ theta - 0.1, a @ C @ a
    np.testing.assert_allclose(result.values, theta - C @ a * gap / variance, rtol=1e-8)
    expected = C - np.outer(C @ a, C @ a) / variance
    np.testing.assert_allclose(result.covariance, expected, rtol=1e-7)
    np.testing.assert_allclose(result.misfit, gap**2 / variance, rtol=1e-7)
    assert result.degrees_of_freedom == 1


def test_faulty_combinations_are_refused(flights):
    alone, joint = flights[0], flights[0][0]
    other = dataclasses.replace(alone[1], names=("mass", "B[1,0]"))
    with pytest.raises(InputError, match="Combine estimates of the same parameters"):
        combine([alone[0], other])
    with pytest.raises(InputError, match="no estimate"):
        combine([])
    with pytest.raises(InputError, match="independent"):
        constrain(joint, [({"B[0,0]": 1.0}, 0.0), ({"B[0,0]": 2.0}, 1.0)])
    with pytest.raises(InputError, match="no free parameter"):
        constrain(joint, [({"mass": 1.0}, 0.0)])
