"""The six-degree-of-freedom flight: made by the truth, off from the declared model, with the noise it states."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.aircraft.coupled_flight import (
    ALTITUDE,
    CHANNELS,
    CHECK,
    SPEED,
    TABLES_ARE_OFF_BY,
    TEST,
    TRAIN,
    coupled_flight,
)
from jaxid.aircraft.frames import quaternion, velocity
from jaxid.aircraft.simulated_flight import realised_noise
from jaxid.models.names import parameter_names, read
from jaxid.simulation import RK4, simulate


@pytest.fixture(scope="module")
def flight():
    return coupled_flight(jax.random.key(1974))


def records(flight):
    return flight.train + flight.check + flight.test


def test_records_and_channels(flight):
    assert [one.names[0] for one in records(flight)] == [*TRAIN, *CHECK, *TEST]
    for one in records(flight):
        assert one.z.shape == (501, len(CHANNELS))
        assert one.inputs == flight.model.inputs == ("stabilator", "aileron", "rudder")
        assert one.outputs == flight.model.outputs


def test_noise_has_the_base_level_of_table_6_6(flight):
    """With 3507 samples the RMS scatters by 1/sqrt(2 N) = 1.2 %; bounds at 4."""
    np.testing.assert_allclose(realised_noise(flight, records(flight)) / flight.noise, 1.0, atol=0.048)


def test_the_declared_model_lacks_the_planted_term_and_knows_no_correction_and_no_offset(flight):
    assert "Cm.beta^2" in parameter_names(flight.truth)
    assert "Cm.beta^2" not in parameter_names(flight.model)
    assert "beta^2 in Cm" in {effect.name for effect in flight.model.effects()}
    np.testing.assert_array_equal(read(flight.model, flight.free.shared), 0.0)
    for coefficient, terms in TABLES_ARE_OFF_BY.items():
        for term, value in terms.items():
            np.testing.assert_allclose(read(flight.truth, (f"{coefficient}.{term}",)), [value])


def test_the_truth_with_recorded_surfaces_shows_what_was_flown(flight):
    """From the level trim in which every manoeuvre starts, by the estimator's own method: what straight lines between
    recorded surfaces cost is far below the noise."""
    one = flight.train[1]
    clean = flight.clean[one.names[0]]
    alpha = clean[0, CHANNELS.index("alpha")] - flight.truth.instruments.bias["alpha"]
    place = jnp.array([0.0, 0.0, ALTITUDE])
    start = flight.truth.flight_state(velocity(SPEED, alpha, 0.0), jnp.zeros(3), quaternion(0.0, alpha, 0.0), place)
    y = simulate(flight.truth, one.t, one.u, start, stepper=RK4(unrolled=False)).y
    rms = np.sqrt(np.mean((np.asarray(y - clean) / np.asarray(flight.noise)) ** 2, axis=0))
    assert np.max(rms) < 0.1
