"""Invalid input for an aircraft is refused with a message before any computation."""

import jax
import jax.numpy as jnp
import pytest
from small_airframe import small_airframe

from jaxid._foundation.checks import InputError
from jaxid.aircraft import Aircraft, Airframe, Instruments
from jaxid.aircraft.flight.simulate_flight import simulate_flight
from jaxid.aircraft.physics.mass import MassProperties

T = 0.1 * jnp.arange(5)
STILL = jnp.zeros(5)


@pytest.mark.parametrize(
    ("t", "inputs", "states", "words"),
    [
        (T[::-1], {}, 18, "do not increase after sample 0"),
        (T, {}, 10, r"shape \(10,\), and the aircraft has 18 states"),
        (
            T,
            {"pilot_rudder": STILL.at[3].set(jnp.nan)},
            18,
            "'pilot_rudder' is not a finite number at sample 3",
        ),
        (T, {"rudder": STILL}, 18, "Did you mean 'pilot_rudder'"),
    ],
)
def test_invalid_flight_is_refused(t, inputs, states, words):
    aircraft = Aircraft(small_airframe())
    with pytest.raises(InputError, match=words):
        simulate_flight(aircraft, t, inputs, jnp.zeros(states), key=jax.random.key(0))


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"stabilator": (-0.3, 0.3), "aileron": (-0.3, 0.3)}, "has no limits of the rudder"),
        ({"elevator": (-0.3, 0.3)}, "no control surface"),
        (
            dict.fromkeys(("stabilator", "aileron", "rudder"), (0.3, -0.3)),
            "stabilator goes from 0.3 to -0.3 rad",
        ),
    ],
)
def test_invalid_surface_limits_are_refused(limits, words):
    frame = small_airframe()
    with pytest.raises(InputError, match=words):
        Airframe(
            name="x",
            mass_properties=frame.mass_properties,
            S=1.0,
            b=1.0,
            cbar=1.0,
            aerodynamics=frame.aerodynamics,
            limits=limits,
        )


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: MassProperties(mass=-1.0, Ix=1.0, Iy=1.0, Iz=1.0), r"mass is -1.*positive"),
        (lambda: MassProperties(mass=1.0, Ix=1.0, Iy=1.0, Iz=3.0), r"sum of the two others"),
        (lambda: Instruments(("q",), noise={"q": -0.1}), r"`noise` of 'q' is -0.1.*from 0 upwards"),
        (lambda: Instruments(("q",), dropout={"q": 1.5}), r"`dropout` of 'q' is 1.5.*from 0 to 1"),
    ],
)
def test_impossible_numbers_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
