"""Sensitivities of a flight with augmentation, tables and instruments against finite differences.

A flight in fixed steps is piecewise smooth. The pieces meet where a stage of a step is at a knot of
a table, or at a corner of a limit or switch: with linear tables and limits the first derivative
jumps there, with monotone tables the second. The derivative thus exists for almost all parameters,
and a difference quotient approximates it if no stage passes a knot or a corner between its points.
This depends on the step, which is chosen here from the quotients alone.

The derivative does not exist with respect to a value of a monotone table that equals its neighbour:
the slope at the knot is zero on one side of the value and not on the other. None of the forty
parameters is such a value; the last test has one.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import RK4
from jaxid.aircraft.air.wind import Wind
from jaxid.aircraft.airframes import f4
from jaxid.aircraft.flight.aircraft import Aircraft
from jaxid.aircraft.flight.simulate_flight import flight_solution
from jaxid.aircraft.instruments.instruments import Instruments
from jaxid.aircraft.physics.frames import quaternion, velocity
from jaxid.aircraft.vehicle.augmentation import Augmentation, Switch
from jaxid.aircraft.vehicle.controls import ControlSystem, standard_actuators
from jaxid.aircraft.vehicle.engine import ConstantThrust, Engine
from jaxid.data.signals import half_sine
from jaxid.models.free import with_values
from jaxid.models.names import read_parameters
from jaxid.models.tables import Table
from jaxid.sensitivity import value_and_jacobian

SIZES = {  # forty parameters, and a change of each that has a measurable influence
    **dict.fromkeys(
        ("CX.alpha=15,beta=0", "CZ.alpha=12.5,beta=0", "CZ.alpha=15,beta=0", "CY.alpha=15,beta=5"),
        0.1,
    ),
    **dict.fromkeys(("Cm.alpha=17.5,beta=0", "Cm.alpha=15,beta=0", "Cm.alpha=12.5,beta=0"), 0.01),
    **dict.fromkeys(("Cl.alpha=16,beta=5", "Cn.alpha=15,beta=5"), 0.01),
    **{"Cmq.alpha=15": 1.0, "Clp.alpha=15": 0.1, "Cnr.alpha=16": 1.0, "Cmds.alpha=12.5": 0.1},
    **{"Clda.alpha=15": 0.01, "Cndr.alpha=12.5": 0.01},
    **{"mass": 1e4, "Ix": 1e4, "Iy": 1e5, "Iz": 1e5, "Ixz": 1e3},
    **dict.fromkeys(
        (
            "instruments.position.alpha.x",
            "instruments.position.beta.z",
            "instruments.position.ay.x",
        ),
        1.0,
    ),
    **{
        "instruments.position.az.x": 1.0,
        "instruments.bias.p": 0.01,
        "instruments.scale.alpha": 0.1,
    },
    **{"instruments.misalignment.q.psi": 0.1},
    **{
        f"controls.augmentation.{name}_gain": size
        for name, size in (("pitch", 1.0), ("yaw", 3.0), ("roll", 0.3))
    },
    **{"controls.augmentation.acceleration_gain": 0.1, "controls.augmentation.switch.on": 0.1},
    **{
        "controls.actuators.0.lag": 0.05,
        "controls.actuators.2.lag": 0.05,
        "controls.trim.stabilator": 0.1,
    },
    **{"engines.0.source.force": 1e5, "wind.north": 10.0},
    **{"initial_state.w": 10.0, "initial_state.p": 0.1, "initial_state.e1": 0.1},
}
STARTS = ("initial_state.w", "initial_state.p", "initial_state.e1")
STEPS = 10.0 ** -np.arange(2.0, 5.5, 0.5)  # steps of the differences, times the sizes
T = 0.1 * jnp.arange(26)
COARSE = RK4(2, unrolled=False)


def aircraft(interpolation):
    airframe = f4(interpolation=interpolation)
    # The switch is between stages, so that no stage is at its corner.
    controls = ControlSystem(
        standard_actuators(airframe.limits),
        trim={"stabilator": -0.07, "rudder": 0.01},
        augmentation=Augmentation(Switch(on=0.763)),
    )
    channels = (
        "alpha",
        "beta",
        "V",
        "p",
        "q",
        "r",
        "pdot",
        "qdot",
        "phi",
        "pitch",
        "psi",
        "ax",
        "ay",
        "az",
    )
    places = {name: (10.0, 0.2, 0.1) for name in ("alpha", "beta", "ay", "az")}
    return Aircraft(
        airframe,
        engines=(Engine(ConstantThrust(5.5e4)),),
        controls=controls,
        instruments=Instruments(channels, position=places, misalignment={"q": {"psi": 0.01}}),
        wind=Wind(north=5.0, east=-3.0),
    )


@pytest.fixture(scope="module", params=["monotone", "linear"])
def flight(request):
    """Readings of the flight as a function of the forty parameters, and their Jacobian (jitted)."""
    model = aircraft(request.param)
    state = model.flight_state(
        velocity(136.0, 0.31, 0.01),
        jnp.array([0.02, 0.0, 0.01]),
        quaternion(0.05, 0.31, 0.0),
        jnp.array([0.0, 0.0, 10000.0]),
    )
    u = jnp.stack(
        [half_sine(T, 0.0, 2.0, 0.06), half_sine(T, 0.8, 1.6, -0.06), half_sine(T, 0.0, 1.6, 0.12)],
        axis=1,
    )
    names = [name for name in SIZES if name not in STARTS]
    at = jnp.array([model.states.index(name.split(".")[1]) for name in STARTS])

    def readings(values):
        changed, start = (
            with_values(model, names, values[: len(names)]),
            state.at[at].set(values[len(names) :]),
        )
        return flight_solution(changed, T, u, start, jax.random.key(0), stepper=COARSE).solution.y

    values = jnp.concatenate([read_parameters(model, tuple(names)), state[at]])
    return (
        model,
        values,
        jax.jit(jax.vmap(readings)),
        jax.jit(lambda values: value_and_jacobian(readings, values)),
    )


@pytest.fixture(scope="module")
def compared(flight):
    """The Jacobian (time, output, parameter), and central differences of fourth order by step."""
    model, values, readings, with_jacobian = flight
    y, jacobian = map(np.asarray, with_jacobian(values))
    h = STEPS[:, None] * np.array([*SIZES.values()])
    shifts = np.array([-2.0, -1.0, 1.0, 2.0])[:, None, None] * np.eye(len(SIZES)) * h[:, None, None]
    moved = readings(jnp.asarray((np.asarray(values) + shifts).reshape(-1, len(SIZES))))
    far_below, below, above, far_above = np.moveaxis(
        np.asarray(moved).reshape(*shifts.shape[:3], *y.shape), 1, 0
    )
    quotients = (8.0 * (above - below) - (far_above - far_below)) / (12.0 * h[:, :, None, None])
    return model, y, jacobian, np.moveaxis(quotients, 1, -1)


def relative_difference(a, b):
    """Largest difference over time by parameter, relative to the largest value of each output."""
    size = np.max(np.abs(b), axis=0)
    # A column of zeros, as for another instrument's bias, must be zero.
    return np.max(np.max(np.abs(a - b), axis=0) / np.where(size > 0, size, 1.0), axis=0)


def test_jacobian_matches_finite_differences(compared):
    _, _, jacobian, quotients = compared
    assert jacobian.shape[-1] == 40
    assert np.all(np.max(np.abs(jacobian), axis=(0, 1)) > 0)  # each has an influence
    # The step is the one at which the quotients change least, independent of the Jacobian.
    pairs = itertools.pairwise(quotients)
    changes = np.stack([relative_difference(small, large) for large, small in pairs])
    best = np.argmin(changes, axis=0) + 1
    chosen = np.take_along_axis(quotients, best[None, None, None], axis=0)[0]
    worst = dict(zip(SIZES, relative_difference(chosen, jacobian), strict=True))
    assert max(worst.values()) <= 1e-6, {
        name: value for name, value in worst.items() if value > 1e-6
    }


def test_flight_crosses_knots_and_the_augmentation_switches_on(compared):
    model, y, jacobian, quotients = compared
    alpha = np.degrees(y[:, model.outputs.index("alpha")])
    knots = np.array([5.0, 7.5, 10.0, 12.5, 15.0, 16.0, 17.5])
    assert np.sum((alpha.min() + 0.2 < knots) & (knots < alpha.max() - 0.2)) >= 5
    switch, trim = (
        list(SIZES).index(f"controls.{name}")
        for name in ("augmentation.switch.on", "trim.stabilator")
    )
    moved = np.max(np.abs(jacobian[:, :, switch]), axis=1)
    assert np.all(moved[T < 0.763] == 0.0)
    assert np.all(moved[T > 0.9] > 0.0)
    # With a step large enough to move stages over knots, the error is far above rounding and the
    # error of the formula.
    assert relative_difference(quotients[0], jacobian)[trim] > 1e-4


@pytest.mark.parametrize(("interpolation", "corner"), [("monotone", True), ("cubic", False)])
def test_monotone_table_has_a_corner_at_two_equal_values(interpolation, corner):
    """Values of `Cmds` from 12.5 to 20 deg, looked up at 15.5 deg."""
    knots = np.radians([12.5, 15.0, 16.0, 17.5, 20.0])

    @jax.jit
    def moment(value):
        values = jnp.array([-0.46, -0.485, -0.5, -0.5, -0.485]).at[2].set(value)
        return Table(values, [knots], ("alpha",), interpolation=interpolation)(
            {"alpha": jnp.radians(15.5)}
        )

    at, h = jnp.asarray(-0.5), 1e-6
    up, down = (moment(at + h) - moment(at)) / h, (moment(at) - moment(at - h)) / h
    slope = jax.jit(jax.jacfwd(moment))(at)
    np.testing.assert_allclose(
        slope, down, rtol=1e-4
    )  # the derivative of the side on which the slope stays zero
    assert bool(abs(up - slope) > 0.1) == corner
