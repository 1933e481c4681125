"""A wrapper has the parameters and hooks of the model inside."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring

import jaxid
from jaxid.models.innovation import InnovationModel
from jaxid.models.stochastic import StochasticModel
from jaxid.models.wrapper import AbstractWrapper

RANGES = {"k": (0.0, 10.0)}
T = 0.1 * np.arange(3)


class Documented(Spring):
    """A spring that defines the hooks of a domain."""

    def initial_state(self, record):
        return jnp.array([1.0, 2.0])

    def signals(self, t, x, u):
        return super().signals(t, x, u) | {"power": x[1] * u[0]}

    def equations(self):
        return ("v",)

    def equations_with_terms(self):
        return ()

    def actuated(self):
        return ()

    def effects(self):
        return (jaxid.effects.DryFriction("v", "v"),)

    def prepared(self, record):
        return record.without("gyro")

    def pseudo_measurements(self, record):
        return "responses"

    def weak_measurements(self, record):
        return "weak form"

    def sensor_errors(self):
        return ("c",)

    def corrected(self, record):
        return record.window(1)

    def usual_ranges(self):
        return RANGES

    def scales(self):
        return ("k",)

    def units(self):
        return {"x": "m"}


MODEL = Documented(jnp.array(2.0), jnp.array(0.1))
WRAPPERS = (
    jaxid.Augmented(MODEL, (jaxid.effects.Term("v", "x^3"),)),
    InnovationModel(MODEL, {"v": {"x": jnp.zeros(())}}),
    StochasticModel(MODEL, {"v": jnp.ones(())}, {}, {"x": jnp.ones(())}, {}, ("force",)),
)


@pytest.fixture
def flight():
    """A record with a channel that the model does not have."""
    z = np.ones((3, 2))
    return jaxid.record(T, np.zeros((3, 1)), z, inputs=("force",), outputs=("x", "gyro"))


@pytest.mark.parametrize("wrapper", WRAPPERS, ids=lambda wrapper: type(wrapper).__name__)
def test_wrapper_has_parameters_and_hooks_of_its_model(wrapper, flight):
    assert (float(wrapper.k), float(wrapper.c)) == (2.0, 0.1)
    assert not hasattr(wrapper, "mass")
    t, x, u = jnp.zeros(()), jnp.array([3.0, 4.0]), jnp.array([5.0])
    assert wrapper.initial_state(flight).tolist() == [1.0, 2.0]
    assert float(wrapper.signals(t, x, u)["power"]) == 20.0
    assert wrapper.prepared(flight).outputs == ("x",)
    assert wrapper.pseudo_measurements(flight) == "responses"
    assert wrapper.weak_measurements(flight) == "weak form"
    assert wrapper.equations_with_terms() == wrapper.actuated() == ()
    assert [effect.name for effect in wrapper.effects()] == ["sign(v) in v"]
    assert wrapper.usual_ranges() == RANGES
    assert wrapper.scales()[0] == "k"
    assert wrapper.units()["x"] == "m"


@pytest.mark.parametrize("wrapper", WRAPPERS[1:], ids=lambda wrapper: type(wrapper).__name__)
def test_model_with_noises_corrects_records_as_its_model(wrapper, flight):
    assert wrapper.sensor_errors() == ("c",)
    assert wrapper.corrected(flight).samples == 2


def test_model_with_effects_corrects_no_record(flight):
    """Its effects may be errors of sensors, which its model does not correct."""
    assert WRAPPERS[0].sensor_errors() == ()
    with pytest.raises(jaxid.InputError, match="Augmented has no correction"):
        WRAPPERS[0].corrected(flight)


def test_these_are_all_wrappers():
    assert {type(wrapper) for wrapper in WRAPPERS} == {*AbstractWrapper.__subclasses__()}
