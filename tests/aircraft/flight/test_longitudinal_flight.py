"""The longitudinal flight: records of the truth, declared model, noise."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.aircraft.flight.longitudinal_flight import (
    LONGITUDINAL_CHECK,
    LONGITUDINAL_TEST,
    LONGITUDINAL_TRAIN,
    longitudinal_flight,
)
from jaxid.aircraft.flight.simulated_flight import realised_noise
from jaxid.effects import Augmented
from jaxid.models.names import read_parameters
from jaxid.simulation import RK4, Adaptive, simulate


@pytest.fixture(scope="module")
def flight():
    return longitudinal_flight(jax.random.key(1974))


def records(flight):
    return flight.train + flight.check + flight.test


def residual(model, record, truth):
    """Residual of the prediction of a record from the initial state of the truth."""
    start = truth.initial_state(record)
    return record.z - simulate(model, record.t, record.u, start).y


def test_records_have_the_declared_names_and_channels(flight):
    assert [record.names[0] for record in records(flight)] == [
        *LONGITUDINAL_TRAIN,
        *LONGITUDINAL_CHECK,
        *LONGITUDINAL_TEST,
    ]
    for record in records(flight):
        assert record.z.shape == (501, 6)
        assert record.inputs == flight.model.inputs
        assert record.outputs == flight.model.outputs
        assert record.output_units == ("rad", "rad/s", "rad", "m/s^2", "m/s^2", "m/s")
        np.testing.assert_allclose(jnp.diff(record.t), 0.04)
        # smooth: the change over a sample is small
        assert np.max(np.abs(np.diff(record.u[:, 0]))) < np.radians(1.5)


def test_same_key_gives_the_same_flight(flight):
    again, other = (
        longitudinal_flight(jax.random.key(1974)),
        longitudinal_flight(jax.random.key(1975)),
    )
    for record, same, different in zip(
        records(flight), records(again), records(other), strict=True
    ):
        np.testing.assert_array_equal(record.z, same.z)
        np.testing.assert_array_equal(record.u, different.u)
        assert np.all(np.max(np.abs(record.z - different.z), axis=0) > np.asarray(flight.noise))


def test_noise_has_the_stated_level_and_is_white(flight):
    """With 3507 samples the RMS scatters by 1/sqrt(2 N) = 1.2 %, a correlation by 1/sqrt(N) = 1.7
    %; bounds at 4.
    """
    np.testing.assert_allclose(
        realised_noise(flight, records(flight)) / flight.noise, 1.0, atol=0.048
    )
    apart = realised_noise(flight, flight.test, skip=50) - realised_noise(flight, flight.test)
    assert np.all(np.abs(apart) < 0.1 * flight.noise)
    other = longitudinal_flight(jax.random.key(7))
    v = np.concatenate(
        [np.asarray(a.z - b.z) for a, b in zip(records(flight), records(other), strict=True)]
    )
    v = v / np.asarray(flight.noise) / np.sqrt(2.0)
    np.testing.assert_allclose(np.mean(v[1:] * v[:-1], axis=0), 0.0, atol=0.068)
    np.testing.assert_allclose(np.corrcoef(v.T) - np.eye(6), 0.0, atol=0.068)


def test_truth_predicts_to_the_noise_and_the_declared_model_does_not(flight):
    """The method is that of the estimator: fixed steps at the sample rate from the measured start.
    The error of the truth is the noise and the influence of the noise of the start; without the
    planted effect it is many times larger, also with the true coefficients.
    """
    names = flight.free.shared
    assert flight.truth.effects_in[0].name == "alpha^3 in Cm"
    off = read_parameters(flight.model, names) / read_parameters(flight.truth.model, names)
    np.testing.assert_allclose(np.abs(off - 1.0), 0.15, rtol=1e-9)
    for record in records(flight):
        rms = {}
        for label, model in (
            ("truth", flight.truth),
            ("blind", flight.truth.model),
            ("declared", flight.model),
        ):
            rms[label] = np.sqrt(
                np.mean(
                    (np.asarray(residual(model, record, flight.truth)) / np.asarray(flight.noise))
                    ** 2,
                    axis=0,
                )
            )
        assert np.max(rms["truth"]) < 5.0
        assert rms["blind"][0] > 5.0 * rms["truth"][0]
        assert rms["declared"][0] > 5.0 * rms["truth"][0]


def test_error_of_steps_at_the_sample_rate_is_below_the_noise(flight):
    """The error of one Runge-Kutta step per sample is below 1 % of the noise."""
    record = flight.train[1]
    start = flight.truth.initial_state(record)
    coarse, fine = (
        simulate(flight.truth, record.t, record.u, start, stepper=RK4(n, unrolled=False)).y
        for n in (1, 4)
    )
    assert np.all(np.max(np.abs(coarse - fine), axis=0) < 0.01 * flight.noise)


def test_free_parameters_are_ten_coefficients_and_each_initial_state(flight):
    assert len(flight.free.shared) == 10
    assert flight.free.per_record == tuple(f"initial_state.{name}" for name in flight.model.states)
    assert not isinstance(flight.model, Augmented)


def test_records_equal_an_adaptive_simulation(flight):
    """To a millionth of each output's deviation; a noise is a hundredth or more."""
    record = flight.test[1]
    clean = flight.clean[record.names[0]]
    start = flight.truth.initial_state(eqx.tree_at(lambda one: one.z, record, clean))
    y = simulate(flight.truth, record.t, record.u, start, stepper=Adaptive()).y
    difference = np.asarray(clean - y)
    assert np.all(np.abs(difference) < 1e-6 * np.std(np.asarray(y), axis=0)[None])
