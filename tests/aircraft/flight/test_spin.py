"""A spin of the F-16's tables: its balances by hand, and a flight from the stall into it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft import simulate_flight, steady_spin
from jaxid.aircraft.air.wind import Wind
from jaxid.aircraft.airframes import f16
from jaxid.aircraft.flight.aircraft import Aircraft
from jaxid.aircraft.instruments.instruments import Instruments
from jaxid.aircraft.physics.frames import quaternion, rotation, velocity
from jaxid.aircraft.vehicle.engine import ConstantThrust, Engine
from jaxid.data.signals import ramp

G = 9.80665
SPIN = {name: np.radians(angle) for name, angle in (("stabilator", -25), ("aileron", -21.5))}
SPIN |= {"rudder": np.radians(30.0)}  # to the left, against the ailerons


@pytest.fixture(scope="module")
def aircraft():
    engines = (Engine(ConstantThrust(0.0)),)
    frame = f16(flap_deg=25.0, xcg=0.30)
    return Aircraft(frame, engines=engines, instruments=Instruments())


@pytest.fixture(scope="module")
def flight(aircraft):
    """90 s from the stall at 12,000 m, the controls deflected in turn after 2 s."""
    t = 0.1 * np.arange(901.0)
    pilot = {
        "pilot_stabilator": np.full(t.size, SPIN["stabilator"]),
        "pilot_rudder": np.asarray(ramp(jnp.asarray(t), 2.0, 2.5, SPIN["rudder"])),
        "pilot_aileron": np.asarray(ramp(jnp.asarray(t), 3.0, 3.5, SPIN["aileron"])),
    }
    alpha = np.radians(35.0)
    place = jnp.array([0.0, 0.0, 12000.0])
    state = aircraft.flight_state(
        velocity(100.0, alpha, 0.0), jnp.zeros(3), quaternion(0.0, alpha, 0.0), place
    )
    return simulate_flight(aircraft, t, pilot, state, key=jax.random.key(0))


def columns(flight, *names):
    return np.stack([np.asarray(flight.truth.channel(name)) for name in names], axis=-1)


def down(flight):
    """The vertical in body axes, from the Euler angles."""
    phi, pitch = columns(flight, "phi", "pitch").T
    return np.stack(
        [-np.sin(pitch), np.cos(pitch) * np.sin(phi), np.cos(pitch) * np.cos(phi)], axis=-1
    )


def test_flight_stays_inside_the_tables_and_spins(flight):
    alpha, beta = np.degrees(columns(flight, "alpha", "beta")).T
    assert alpha.max() < 90.0
    assert np.abs(beta).max() < 30.0
    psi = np.unwrap(columns(flight, "psi")[:, 0])
    assert psi[-1] - psi[-101] < -5 * 2 * np.pi  # over five turns to the left in the last 10 s


def test_energy_is_lost_to_the_aerodynamic_forces(flight):
    """The change of kinetic and potential energy of the translation is the work of the specific
    force; the integral is a sum over samples of 0.1 s.
    """
    body, force = columns(flight, "u", "v", "w"), columns(flight, "ax", "ay", "az")
    (altitude,) = columns(flight, "altitude").T
    energy = 0.5 * np.sum(body**2, axis=-1) + G * altitude
    power = np.sum(force * body, axis=-1)
    work = np.sum(0.05 * (power[1:] + power[:-1]))
    assert energy[-1] - energy[0] == pytest.approx(work, rel=1e-3)


def test_developed_spin_is_balanced(flight, aircraft):
    """In the last 10 s the vertical force carries the weight and slows the descent into denser air,
    and the aerodynamic pitching moment balances the inertial one.
    """
    last = slice(-101, None)
    body, omega, force = (
        columns(flight, *names)[last] for names in (("u", "v", "w"), "pqr", ("ax", "ay", "az"))
    )
    vertical = down(flight)[last]
    sink = np.sum(body * vertical, axis=-1)
    lift = -np.mean(np.sum(force * vertical, axis=-1))
    assert lift == pytest.approx(G - (sink[-1] - sink[0]) / 10.0, rel=0.005)
    mass, frame = aircraft.airframe.mass_properties, aircraft.airframe
    qbar, Cm = columns(flight, "qbar", "Cm")[last].T
    x, _, z = np.asarray(frame.reference)
    moment = qbar * float(frame.S) * float(frame.cbar) * Cm
    moment = moment + float(mass.mass) * (z * force[:, 0] - x * force[:, 2])
    p, q, r = omega.T
    inertial = float(mass.Ix - mass.Iz) * p * r + float(mass.Ixz) * (p**2 - r**2)
    pitching = float(mass.Iy) * (q[-1] - q[0]) / 10.0
    assert np.mean(moment) == pytest.approx(np.mean(inertial) + pitching, rel=0.01)
    assert abs(pitching) < 0.1 * abs(np.mean(moment))


def test_flight_ends_about_the_steady_spin_of_its_altitude(flight, aircraft):
    """The means of the last 10 s, over five turns: the axis nods by 3 deg. The descent slows in
    denser air, so that the vertical force exceeds the weight, by the square of the speed.
    """
    altitude = float(np.mean(columns(flight, "altitude")[-101:]))
    spin = steady_spin(aircraft, altitude, SPIN, turn_rate=-2.0).trim
    alpha, beta, V = np.mean(columns(flight, "alpha", "beta", "V")[-101:], axis=0)
    psi = np.unwrap(columns(flight, "psi")[-101:, 0])
    assert float(spin.value("alpha")) == pytest.approx(alpha, abs=np.radians(1.0))
    assert float(spin.value("beta")) == pytest.approx(beta, abs=np.radians(1.0))
    force = columns(flight, "ax", "ay", "az")[-101:]
    lift = -np.mean(np.sum(force * down(flight)[-101:], axis=-1))
    assert float(spin.value("V")) == pytest.approx(V * np.sqrt(G / lift), rel=0.02)
    assert float(spin.value("turn_rate")) == pytest.approx((psi[-1] - psi[0]) / 10.0, rel=0.05)


def test_spin_in_wind_is_the_one_in_calm_air(aircraft):
    """Relative to the air; the velocity over ground has the wind in addition."""
    start = {"turn_rate": -2.0, "alpha": np.radians(60.0)}
    calm = steady_spin(aircraft, 8000.0, SPIN, **start)
    windy = steady_spin(
        eqx.tree_at(lambda node: node.wind, aircraft, Wind(north=20.0)), 8000.0, SPIN, **start
    )
    np.testing.assert_allclose(windy.trim.values, calm.trim.values, rtol=1e-9)
    signals = [
        spin.aircraft.immediate_signals(0.0, spin.state, jnp.zeros(len(aircraft.inputs)))
        for spin in (calm, windy)
    ]
    for name in ("V", "alpha", "beta"):
        np.testing.assert_allclose(signals[1][name], signals[0][name], rtol=1e-9)
    over_ground = rotation(windy.state[6:10]).T @ (windy.state[:3] - calm.state[:3])
    np.testing.assert_allclose(over_ground, [20.0, 0.0, 0.0], atol=1e-7)


def test_absent_spin_is_refused(aircraft):
    with pytest.raises(InputError, match="out of balance"):
        steady_spin(aircraft, 8000.0, {"stabilator": 0.4}, turn_rate=5.0, alpha=0.2)
    with pytest.raises(InputError, match="a spin turns"):
        steady_spin(aircraft, 8000.0, SPIN, turn_rate=0.0)
