"""Actuators, augmentation, autopilot and their sum, each against its equation in closed form."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.vehicle.actuators import FirstOrder, SecondOrder
from jaxid.aircraft.vehicle.augmentation import ALWAYS, Augmentation, Switch
from jaxid.aircraft.vehicle.autopilot import Autopilot
from jaxid.aircraft.vehicle.controls import SURFACES, ControlSystem, standard_actuators
from jaxid.models.names import parameter_names

LIMITS = {"stabilator": (-0.37, 0.16), "aileron": (-0.52, 0.52), "rudder": (-0.52, 0.52)}
ZERO = jnp.zeros(())


def steady(**values):
    quiet = dict.fromkeys(("p", "r", "qdot", "rdot", "ay", "phi", "gamma"), ZERO)
    return quiet | {name: jnp.asarray(value, float) for name, value in values.items()}


@pytest.mark.parametrize(
    "actuator", [FirstOrder(0.1, 0.5, -0.3, 0.3), SecondOrder(20.0, 0.7, 0.5, -0.3, 0.3)]
)
def test_actuator_rests_at_command_within_stops(actuator):
    np.testing.assert_allclose(
        actuator.rates(actuator.resting(jnp.array(0.2)), jnp.array(0.2)), 0.0, atol=1e-15
    )
    np.testing.assert_allclose(
        actuator.rates(actuator.resting(jnp.array(0.3)), jnp.array(9.0)), 0.0, atol=1e-15
    )


def test_first_order_actuator_has_lag_and_rate_limit():
    actuator = FirstOrder(0.1, 0.5, -1.0, 1.0)
    np.testing.assert_allclose(actuator.rates(jnp.array([0.1]), jnp.array(0.12)), [0.2], rtol=1e-12)
    assert float(actuator.rates(jnp.array([0.0]), jnp.array(0.9))[0]) == 0.5
    assert float(actuator.rates(jnp.array([0.0]), jnp.array(-0.9))[0]) == -0.5


def test_second_order_actuator_satisfies_its_equation():
    actuator = SecondOrder(20.0, 0.7, 0.5, -1.0, 1.0)
    rates = actuator.rates(jnp.array([0.1, 0.2]), jnp.array(0.15))
    np.testing.assert_allclose(rates, [0.2, 400.0 * 0.05 - 28.0 * 0.2], rtol=1e-12)
    assert float(actuator.rates(jnp.array([0.1, 0.9]), jnp.array(0.15))[0]) == 0.5


def test_switch_closes_and_opens_linearly():
    switch = Switch(on=2.0, off=5.0, fade=0.5)
    shown = [float(switch(jnp.array(t))) for t in (0.0, 2.0, 2.25, 3.0, 5.25, 6.0)]
    np.testing.assert_allclose(shown, [0.0, 0.0, 0.5, 1.0, 0.5, 0.0], atol=1e-15)
    assert float(Switch()(jnp.array(1e6))) == 0.0
    assert float(Switch(on=ALWAYS)(jnp.array(0.0))) == 1.0


def test_augmentation_has_gains_and_limits_of_report():
    on = Augmentation(Switch(on=ALWAYS))
    rates = on.rates(ZERO, jnp.array([0.01, 0.02]), jnp.array(0.2), jnp.array(-0.1))
    np.testing.assert_allclose(rates, [0.15 * 0.2 - 0.01, 3.0 * -0.1 - 0.5 * 0.02], rtol=1e-13)
    commands = on.commands(ZERO, jnp.array([0.001, 0.01]), steady(p=0.05, ay=2.0))
    yaw = 0.01 + np.radians(0.0168 * 2.0 / 0.3048)
    np.testing.assert_allclose(commands, [0.001, 0.265 * 0.05, yaw], rtol=1e-12)
    full = on.commands(ZERO, jnp.array([1.0, -1.0]), steady(p=9.0))
    np.testing.assert_allclose(np.degrees(full), [0.5, 7.5, -5.0], rtol=1e-12)


def test_augmentation_and_autopilot_are_off_by_default():
    system = ControlSystem(standard_actuators(LIMITS), trim={"stabilator": -0.1})
    x = system.resting()
    rates = system.rates(
        ZERO, x, jnp.zeros(3), steady(p=1.0, r=1.0, qdot=1.0, rdot=1.0, ay=1.0, phi=1.0, gamma=1.0)
    )
    np.testing.assert_allclose(rates, np.zeros(5), atol=1e-15)


def test_autopilot_has_gains_of_report():
    commands = Autopilot(Switch(on=ALWAYS)).commands(ZERO, steady(r=0.01, phi=0.2, gamma=0.05))
    np.testing.assert_allclose(commands, [0.05, 0.06, 0.27], rtol=1e-13)


def test_commands_are_summed_before_stops():
    system = ControlSystem(
        standard_actuators(LIMITS),
        trim={"stabilator": -0.1},
        autopilot=Autopilot(Switch(on=ALWAYS)),
    )
    rates = system.rates(ZERO, system.resting(), jnp.array([0.02, 0.0, 0.0]), steady(gamma=0.01))
    np.testing.assert_allclose(rates[2], 0.03 / 0.05, rtol=1e-12)
    rates = system.rates(ZERO, system.resting(), jnp.array([-0.5, 0.0, 0.0]), steady())
    np.testing.assert_allclose(rates[2], -np.radians(60.0), rtol=1e-12)


def test_control_system_names_states_and_inputs():
    system = ControlSystem(standard_actuators(LIMITS))
    assert system.states == ("sas_pitch", "sas_yaw", *SURFACES)
    names = parameter_names(system)
    assert {
        "trim.stabilator",
        "augmentation.yaw_gain",
        "augmentation.switch.on",
        "actuators.0.lag",
    } <= set(names)
    with pytest.raises(InputError, match=r"no surface 'elevator'.*stabilator"):
        ControlSystem(standard_actuators(LIMITS), trim={"elevator": 0.1})
    with pytest.raises(InputError, match="2 actuators"):
        ControlSystem(standard_actuators(LIMITS)[:2])
