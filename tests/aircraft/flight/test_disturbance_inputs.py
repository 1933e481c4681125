"""Models with gust inputs: zero gusts change nothing, and a gust is a change of airspeed."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_airframe import small_airframe

from jaxid.aircraft import Aircraft, Instruments
from jaxid.aircraft.flight.longitudinal_flight import true_aircraft
from jaxid.aircraft.identification.model import IdentificationModel
from jaxid.aircraft.physics.frames import air_angles
from jaxid.aircraft.vehicle.controls import MeasuredSurfaces
from jaxid.diagnosis.free_form import gusts_of
from jaxid.effects import Augmented
from jaxid.models import AbstractModel, LinearModel

T = jnp.zeros(())
V, GUST, OMEGA = (
    jnp.array([150.0, 4.0, 12.0]),
    jnp.array([1.5, -2.0, 3.0]),
    jnp.array([0.1, 0.2, -0.15]),
)
INSTRUMENTS = ("alpha", "beta", "V", "p", "q", "r", "ax", "ay", "az")
AT = {"p": 0.1, "q": 0.2, "r": -0.15, "phi": 0.2, "pitch": 0.1, "psi": 0.3, "altitude": 3000.0}
AT |= dict(
    zip(("e0", "e1", "e2", "e3"), (0.98, 0.1, 0.05, np.sqrt(1 - 0.98**2 - 0.0125)), strict=True)
)


def identification(**options):
    return IdentificationModel(
        small_airframe(), held={"altitude": 3000.0}, instruments=Instruments(INSTRUMENTS), **options
    )


MODELS = {
    "longitudinal": true_aircraft,
    "body": identification,
    "air path": lambda: identification(frame="air path"),
    "lateral": lambda: identification(states="lateral"),
    "six degrees of freedom": lambda: Aircraft(
        small_airframe(), controls=MeasuredSurfaces(), instruments=Instruments(INSTRUMENTS)
    ),
}


def state_of(model: AbstractModel, velocity):
    """The state with a velocity in body axes; the other states are of a manoeuvre."""
    angles = dict(zip(("V", "alpha", "beta"), air_angles(velocity), strict=True))
    known = AT | angles | dict(zip("uvw", velocity, strict=True))
    return jnp.stack([jnp.asarray(known.get(name, 0.0), float) for name in model.states])


def input_of(model: AbstractModel, velocity):
    known = dict(zip("uvw", velocity, strict=True)) | {
        "q": AT["q"],
        "stabilator": -0.05,
        "elevator": -0.05,
        "rudder": 0.03,
    }
    return jnp.stack([jnp.asarray(known.get(name, 0.0), float) for name in model.inputs])


def acceleration(model: AbstractModel, x, u, velocity):
    """The rate of the velocity in body axes; zero for components that are not propagated."""
    rates = dict(zip(model.states, model.rhs(T, x, u), strict=True))
    if "alpha" in rates:
        return model.channels.translation.accelerations(
            velocity, jnp.stack([rates[name] for name in ("V", "alpha", "beta")])
        )
    return jnp.stack([rates.get(name, jnp.zeros(())) for name in "uvw"])


@pytest.mark.parametrize("name", MODELS)
def test_gust_equals_a_flight_at_another_airspeed(name):
    """Only the velocity relative to the air matters: `vdot + omega x gust`, and all readings, are
    the same.
    """
    model = MODELS[name]()
    moved = model.with_disturbance_inputs()
    gusts = gusts_of(model)
    assert (moved.states, moved.outputs) == (model.states, model.outputs)
    assert moved.inputs == (*model.inputs, *gusts)
    wind = jnp.array(
        [GUST[k] if gust in gusts else 0.0 for k, gust in enumerate(("gust_u", "gust_v", "gust_w"))]
    )
    turning = OMEGA if name != "longitudinal" else OMEGA * jnp.array([0.0, 1.0, 0.0])
    start = V if name != "longitudinal" else V * jnp.array([1.0, 0.0, 1.0])
    x, u = state_of(model, start), input_of(model, start)
    pushed = jnp.concatenate(
        [
            u,
            jnp.stack(
                [dict(zip(("gust_u", "gust_v", "gust_w"), wind, strict=True))[g] for g in gusts]
            ),
        ]
    )
    still = jnp.concatenate([u, jnp.zeros(len(gusts))])
    np.testing.assert_allclose(moved.rhs(T, x, still), model.rhs(T, x, u), rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(
        moved.output(T, x, still), model.output(T, x, u), rtol=1e-13, atol=1e-13
    )
    through = start - wind
    there, over = state_of(model, through), input_of(model, through)
    if name == "lateral":  # u and w are measured, and equal in both
        over = u
        there = there.at[model.states.index("v")].set(through[1])
    np.testing.assert_allclose(
        moved.output(T, x, pushed), model.output(T, there, over), rtol=1e-12, atol=1e-12
    )
    actual = acceleration(moved, x, pushed, start)
    expected = acceleration(model, there, over, through) - jnp.cross(turning, wind)
    propagated = np.array([axis in "".join(model.states) or name == "air path" for axis in "uvw"])
    np.testing.assert_allclose(actual[propagated], expected[propagated], rtol=1e-11, atol=1e-11)


def test_effects_are_kept_and_a_model_without_air_has_no_gusts():
    model = true_aircraft()
    augmented = Augmented(model, model.effects()[:2])
    assert augmented.with_disturbance_inputs().effects_in == augmented.effects_in
    assert gusts_of(augmented) == ("gust_u", "gust_w")
    spring = LinearModel(
        [[0.0]], [[1.0]], [[1.0]], [[0.0]], states=("x",), inputs=("u",), outputs=("x",)
    )
    assert spring.with_disturbance_inputs() is spring
    assert gusts_of(Augmented(spring, ())) == ()


@pytest.mark.parametrize("name", MODELS)
def test_immediate_signals_equal_those_among_all_signals(name):
    model = MODELS[name]()
    x = state_of(model, V)
    u = input_of(model, V)
    rates, every = model.rhs_and_signals(T, x, u)
    np.testing.assert_array_equal(rates, model.rhs(T, x, u))
    immediate = model.immediate_signals(T, x, u)
    assert {"alpha", "V", "qhat", *model.states, *model.inputs} <= set(immediate) < set(every)
    for signal, value in immediate.items():
        np.testing.assert_array_equal(value, every[signal], err_msg=signal)
