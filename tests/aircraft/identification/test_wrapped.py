"""An identification model with noises prepares records as it does without."""

import numpy as np
import pytest
from identified_flight import flown

import jaxid
from jaxid.aircraft import flight_record, from_aircraft
from jaxid.data.stack import stack
from jaxid.estimation import FirstOrder
from jaxid.models.free import Free


@pytest.mark.parametrize("noise", ["p", "gust_v"])
def test_model_with_noises_prepares_records_as_without(noise):
    """The velocities u and w, inputs of the lateral model, come from vanes and airspeed."""
    flight = flown()
    record = flight_record(flight)
    model = from_aircraft(flight.aircraft, states="lateral")
    expected = model.prepared(record)
    likelihood = jaxid.FilterError({noise: FirstOrder(0.1, 1.0)})
    noisy, _ = likelihood.prepared(model, Free(()), stack([expected]))
    prepared = noisy.prepared(record)
    assert prepared.inputs == expected.inputs
    assert prepared.outputs == expected.outputs
    np.testing.assert_allclose(prepared.u, expected.u, rtol=1e-12)
    np.testing.assert_array_equal(prepared.z, expected.z)
