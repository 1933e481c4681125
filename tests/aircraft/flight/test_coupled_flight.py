"""The six-degree-of-freedom flight: records of the truth, declared model, noise."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.aircraft.flight.coupled_flight import (
    COUPLED_CHECK,
    COUPLED_TEST,
    COUPLED_TRAIN,
    RECORDED_CHANNELS,
    TABLES_ARE_OFF_BY,
    TRIM_ALTITUDE,
    TRIM_SPEED,
    coupled_flight,
)
from jaxid.aircraft.flight.simulated_flight import realised_noise
from jaxid.aircraft.physics.frames import quaternion, velocity
from jaxid.models.names import parameter_names, read_parameters
from jaxid.simulation import RK4, simulate


@pytest.fixture(scope="module")
def flight():
    return coupled_flight(jax.random.key(1974))


def records(flight):
    return flight.train + flight.check + flight.test


def test_records_have_the_declared_names_and_channels(flight):
    assert [record.names[0] for record in records(flight)] == [
        *COUPLED_TRAIN,
        *COUPLED_CHECK,
        *COUPLED_TEST,
    ]
    for record in records(flight):
        assert record.z.shape == (501, len(RECORDED_CHANNELS))
        assert record.inputs == flight.model.inputs == ("stabilator", "aileron", "rudder")
        assert record.outputs == flight.model.outputs


def test_noise_has_the_base_level_of_table_6_6(flight):
    """With 3507 samples the RMS scatters by 1/sqrt(2 N) = 1.2 %; bounds at 4."""
    np.testing.assert_allclose(
        realised_noise(flight, records(flight)) / flight.noise, 1.0, atol=0.048
    )


def test_declared_model_lacks_the_planted_term_and_has_zero_corrections(flight):
    assert "Cm.beta^2" in parameter_names(flight.truth)
    assert "Cm.beta^2" not in parameter_names(flight.model)
    assert "beta^2 in Cm" in {effect.name for effect in flight.model.effects()}
    np.testing.assert_array_equal(read_parameters(flight.model, flight.free.shared), 0.0)
    for coefficient, terms in TABLES_ARE_OFF_BY.items():
        for term, value in terms.items():
            np.testing.assert_allclose(
                read_parameters(flight.truth, (f"{coefficient}.{term}",)), [value]
            )


def test_truth_with_recorded_surfaces_reproduces_the_clean_outputs(flight):
    """Every manoeuvre starts from the level trim. With the integration method of the estimator, the
    error of linear interpolation between recorded surfaces is far below the noise.
    """
    record = flight.train[1]
    clean = flight.clean[record.names[0]]
    alpha = clean[0, RECORDED_CHANNELS.index("alpha")] - flight.truth.instruments.bias["alpha"]
    place = jnp.array([0.0, 0.0, TRIM_ALTITUDE])
    start = flight.truth.flight_state(
        velocity(TRIM_SPEED, alpha, 0.0), jnp.zeros(3), quaternion(0.0, alpha, 0.0), place
    )
    y = simulate(flight.truth, record.t, record.u, start, stepper=RK4(unrolled=False)).y
    rms = np.sqrt(np.mean((np.asarray(y - clean) / np.asarray(flight.noise)) ** 2, axis=0))
    assert np.max(rms) < 0.1
