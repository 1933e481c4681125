"""`update`: records added one by one, from the factor alone, give the joint estimate."""

import dataclasses

import numpy as np
import pytest
from reference_estimation import rk4

from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.batches import update
from jaxid.data import record
from jaxid.estimation import OutputError, estimate
from jaxid.models import AbstractModel, FixedNoise, free

NOISE = 0.05
KNOWN = OutputError(FixedNoise(np.array([NOISE**2])))
SAMPLES = 40
NAMES = {"inputs": ("u", "w"), "outputs": ("x",)}


class TwoInputs(AbstractModel):
    """A lag of one second with two inputs: linear in its gains and its initial state."""

    a: Array
    b: Array
    states, inputs, outputs = ("x",), ("u", "w"), ("x",)

    def units(self):
        return {"x": "m"}

    def rhs(self, t, x, u):
        return -x + self.a * u[0] + self.b * u[1]

    def output(self, t, x, u):
        return x


def model():
    return TwoInputs(a=0.1, b=0.2)


def chosen(**options):
    return free(model(), "a", "b", per_record=("initial_state",), **options)


def response(u, x0, gains):
    return rk4(lambda x, u, g: -x + g @ u, 0.1 * np.arange(SAMPLES), u, x0, gains)[:, 0]


def unit_responses(u, count, index):
    """Return the columns of least squares: of both gains, and of the initial state of a flight."""
    columns, zero = np.zeros((SAMPLES, 2 + count)), np.zeros(1)
    columns[:, 0] = response(u, zero, np.array([1.0, 0.0]))
    columns[:, 1] = response(u, zero, np.array([0.0, 1.0]))
    columns[:, 2 + index] = response(0.0 * u, np.ones(1), np.zeros(2))
    return columns / NOISE


def closed_form(flights, prior=None):
    """Return the joint estimate and its covariance by least squares.

    Args:
        flights: records.
        prior: standard deviation of a prior of `b` with mean zero.
    """
    rows = [unit_responses(np.asarray(f.u), len(flights), i) for i, f in enumerate(flights)]
    z = [np.asarray(flight.z)[:, 0] / NOISE for flight in flights]
    if prior:
        rows.append(np.eye(1, 2 + len(flights), 1) / prior)
        z.append(np.zeros(1))
    X = np.concatenate(rows)
    return np.linalg.lstsq(X, np.concatenate(z))[0], np.linalg.inv(X.T @ X)


@pytest.fixture(scope="module")
def flights():
    """The inputs move together in the first flight, so that it hardly separates their gains."""
    rng, made = np.random.default_rng(5), []
    for i in range(5):
        u = np.cumsum(rng.normal(size=(SAMPLES, 2)), axis=0) / 3
        if i == 0:
            u[:, 1] = u[:, 0] + 1e-2 * u[:, 1]
        z = response(u, rng.normal(size=1), np.array([1.0, -0.5])) + NOISE * rng.normal(
            size=SAMPLES
        )
        made.append(record(0.1 * np.arange(SAMPLES), u, z, name=f"flight {i}", **NAMES))
    return made


def test_updates_two_records_at_a_time_equal_the_joint_estimate(flights):
    fit = estimate(model(), chosen(), flights[0], KNOWN)
    for pair in (flights[1:3], flights[3:]):
        fit = update(fit, pair, KNOWN)
    values, covariance = closed_form(flights)
    assert bool(fit.successful)
    np.testing.assert_allclose(fit.values, values[:2], rtol=1e-9)
    np.testing.assert_allclose(fit.covariance, covariance[:2, :2], rtol=1e-9)
    np.testing.assert_allclose(fit.own[:, 0], values[-2:], rtol=1e-9)
    np.testing.assert_allclose(fit.own_errors[:, 0] ** 2, np.diag(covariance)[-2:], rtol=1e-9)
    np.testing.assert_allclose(fit.noise, [[NOISE**2]])
    assert fit.residuals.shape == (2, SAMPLES, 1)
    assert np.isnan(fit.corrected_errors).all()


def test_prior_counts_once(flights):
    """Counted again with each update, it would draw `b` nearer to zero."""
    prior = chosen(prior={"b": (0.0, 0.01)})
    fit = update(estimate(model(), prior, flights[0], KNOWN), flights[1:3], KNOWN)
    values, covariance = closed_form(flights[:3], prior=0.01)
    np.testing.assert_allclose(fit.values, values[:2], rtol=1e-9)
    np.testing.assert_allclose(fit.covariance, covariance[:2, :2], rtol=1e-9)
    twice, _ = closed_form(flights[:3], prior=0.01 / np.sqrt(2))
    assert abs(twice[1] - values[1]) > 1e-3


def test_records_in_another_unit_are_refused(flights):
    fit = estimate(model(), chosen(), flights[0], KNOWN)
    in_radians = dataclasses.replace(flights[1], output_units=("rad",))
    with pytest.raises(InputError, match=r"'x' is in \[rad\] in the records and in \[m\]"):
        update(fit, in_radians, KNOWN)


def test_estimate_on_a_bound_is_refused(flights):
    bounded = chosen(bounds={"b": (0.0, None)})
    fit = estimate(model(), bounded, flights[1], KNOWN)
    assert bool(fit.on_bound[1])
    with pytest.raises(InputError, match="has b on a bound"):
        update(fit, flights[2], KNOWN)
