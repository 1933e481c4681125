"""The embedded flight: made by the truth, off from the declared model, with the noise it states."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.aircraft.longitudinal_flight import CHECK, TEST, TRAIN, longitudinal_flight
from jaxid.aircraft.simulated_flight import realised_noise
from jaxid.models import Augmented
from jaxid.models.names import read
from jaxid.simulation import RK4, simulate


@pytest.fixture(scope="module")
def flight():
    return longitudinal_flight(jax.random.key(1974))


def records(flight):
    return flight.train + flight.check + flight.test


def residual(model, one, truth):
    """Whole-record prediction from the exact start."""
    start = truth.initial_state(one)
    return one.z - simulate(model, one.t, one.u, start).y


def test_records_and_channels(flight):
    assert [one.names[0] for one in records(flight)] == [*TRAIN, *CHECK, *TEST]
    for one in records(flight):
        assert one.z.shape == (501, 6)
        assert one.inputs == flight.model.inputs
        assert one.outputs == flight.model.outputs
        assert one.output_units == ("rad", "rad/s", "rad", "m/s^2", "m/s^2", "m/s")
        np.testing.assert_allclose(jnp.diff(one.t), 0.04)
        assert np.max(np.abs(np.diff(one.u[:, 0]))) < np.radians(1.5)  # smooth: a sample is a small part of any move


def test_the_same_key_makes_the_same_flight(flight):
    again, other = longitudinal_flight(jax.random.key(1974)), longitudinal_flight(jax.random.key(1975))
    for one, same, different in zip(records(flight), records(again), records(other), strict=True):
        np.testing.assert_array_equal(one.z, same.z)
        np.testing.assert_array_equal(one.u, different.u)
        assert np.all(np.max(np.abs(one.z - different.z), axis=0) > np.asarray(flight.noise))


def test_noise_has_the_stated_level_and_is_white(flight):
    """With 3507 samples the RMS scatters by 1/sqrt(2 N) = 1.2 %, a correlation by 1/sqrt(N) = 1.7 %; bounds at 4."""
    np.testing.assert_allclose(realised_noise(flight, records(flight)) / flight.noise, 1.0, atol=0.048)
    apart = realised_noise(flight, flight.test, skip=50) - realised_noise(flight, flight.test)
    assert np.all(np.abs(apart) < 0.1 * flight.noise)
    other = longitudinal_flight(jax.random.key(7))
    v = np.concatenate([np.asarray(a.z - b.z) for a, b in zip(records(flight), records(other), strict=True)])
    v = v / np.asarray(flight.noise) / np.sqrt(2.0)
    np.testing.assert_allclose(np.mean(v[1:] * v[:-1], axis=0), 0.0, atol=0.068)
    np.testing.assert_allclose(np.corrcoef(v.T) - np.eye(6), 0.0, atol=0.068)


def test_truth_predicts_to_the_noise_and_the_declared_model_does_not(flight):
    """By the estimator's own method, fixed steps at the sample rate, from the measured start: the truth's misfit is
    noise and what the noise of the start does; without the planted effect it is many times that, also with the true
    coefficients."""
    names = flight.free.shared
    assert flight.truth.effects_in[0].name == "alpha^3 in Cm"
    off = read(flight.model, names) / read(flight.truth.model, names)
    np.testing.assert_allclose(np.abs(off - 1.0), 0.15, rtol=1e-9)
    for one in records(flight):
        rms = {}
        for label, model in (("truth", flight.truth), ("blind", flight.truth.model), ("declared", flight.model)):
            rms[label] = np.sqrt(
                np.mean((np.asarray(residual(model, one, flight.truth)) / np.asarray(flight.noise)) ** 2, axis=0)
            )
        assert np.max(rms["truth"]) < 5.0
        assert rms["blind"][0] > 5.0 * rms["truth"][0]
        assert rms["declared"][0] > 5.0 * rms["truth"][0]


def test_steps_at_the_sample_rate_are_fine_enough(flight):
    """What one Runge-Kutta step a sample costs in accuracy is far below the noise."""
    one = flight.train[1]
    start = flight.truth.initial_state(one)
    coarse, fine = (simulate(flight.truth, one.t, one.u, start, stepper=RK4(n)).y for n in (1, 4))
    assert np.all(np.max(np.abs(coarse - fine), axis=0) < 0.01 * flight.noise)


def test_free_are_the_ten_coefficients_and_each_initial_state(flight):
    assert len(flight.free.shared) == 10
    assert flight.free.per_record == tuple(f"initial_state.{name}" for name in flight.model.states)
    assert not isinstance(flight.model, Augmented)
