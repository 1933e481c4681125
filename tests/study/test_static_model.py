"""A model without states: a calibration, or coefficients from accelerations; its outputs are its
equations.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxid
from jaxid.effects import (
    Hinge,
    InputDelay,
    InputHysteresis,
    LocationKind,
    Placement,
    SensorScale,
    Term,
    general_effects,
)
from jaxid.effects.library import uncertain_equations


class Lift(jaxid.AbstractModel):
    slope: object
    elevator: object
    states, inputs, outputs = (), ("alpha", "elevator"), ("CL",)

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return jnp.stack([self.slope * u[0] + self.elevator * u[1]])


TRUE, NOISE = -12.0, 0.01


def measured(rng):
    t = 0.04 * np.arange(400)
    alpha = 0.15 * np.sin(rng.uniform(0.8, 1.2) * t + rng.uniform(0.0, 6.0))
    u = np.column_stack([alpha, 0.05 * np.sin(3.0 * t)])
    lift = 5.0 * u[:, 0] + 0.4 * u[:, 1] + TRUE * u[:, 0] ** 3 + NOISE * rng.normal(size=t.size)
    return jaxid.record(t, u, lift[:, None], inputs=Lift.inputs, outputs=Lift.outputs)


@pytest.fixture
def records(seed):
    rng = np.random.default_rng(seed)
    return [measured(rng) for _ in range(3)]


def test_effect_changes_its_equation():
    effects = (
        Term("CL", "alpha^2", gain=jnp.array(3.0)),
        Hinge(Placement.equation("CL"), "alpha", 0.5),
    )
    model = jaxid.Augmented(Lift(jnp.array(5.0), jnp.array(0.4)), effects)
    t, u = np.arange(3.0), np.array([[0.1, 0.2], [0.2, 0.0], [-0.1, 0.1]])
    result = jaxid.simulate(model, t, u, np.zeros(0)).y[:, 0]
    np.testing.assert_allclose(
        result, 5.0 * u[:, 0] + 0.4 * u[:, 1] + 3.0 * u[:, 0] ** 2, rtol=1e-14
    )


def test_general_library_has_terms_and_hinges_of_inputs():
    model = Lift(jnp.array(5.0), jnp.array(0.4))
    assert uncertain_equations(model, np.arange(2)) == ("CL",)
    offered = {effect.name for effect in general_effects(model)}
    assert {
        "alpha^3 in CL",
        "alpha elevator in CL",
        "1 in CL",
        "delay of input alpha",
        "bias of CL",
    } <= offered
    assert any(name.startswith("dead band") and name.endswith("in CL") for name in offered)
    assert {"hysteresis of input elevator", "sign(alpha) in CL", "|alpha|alpha in CL"} <= offered
    assert not any(name.startswith("lagged") for name in offered)  # no state lags


@pytest.mark.parametrize(
    "effect", [InputDelay("elevator"), InputHysteresis("elevator", width=jnp.array(0.1))]
)
def test_static_model_receives_modified_input(effect):
    t = 0.1 * np.arange(50)
    u = np.column_stack([0.1 * np.sin(t), 0.2 * np.cos(3.0 * t)])
    model = Lift(jnp.array(5.0), jnp.array(0.4))
    there = eqx.tree_at(lambda node: node.gain, effect, jnp.array(0.1))
    before, after = (
        jaxid.simulate(variant, t, u, np.zeros(0)).y
        for variant in (model, jaxid.Augmented(model, (there,)))
    )
    assert np.max(np.abs(after - before)) > 0.2 * 0.4 * 0.2


def behind(u, gain, width):
    """An input less Bouc's and Wen's z of it, by Heun's steps on a finer grid."""
    fine = np.interp(np.arange(20 * (u.size - 1) + 1) / 20, np.arange(u.size), u)
    z = [0.0]
    for du in np.diff(fine):

        def rate(z, du=du):
            return (du - 0.5 * (abs(du) * abs(z) * z + du * z**2)) / width

        first = rate(z[-1])
        z.append(z[-1] + 0.5 * (first + rate(z[-1] + first)))
    return u - gain * np.array(z[::20])


def test_input_hysteresis_is_identified():
    def flown(seed):
        rng = np.random.default_rng(seed)
        t = 0.04 * np.arange(400)
        elevator = np.convolve(rng.normal(size=400), np.hanning(40) / 8.0, "same")
        u = np.column_stack([0.15 * np.sin(rng.uniform(0.8, 1.2) * t), elevator])
        z = 5.0 * u[:, 0] + 2.0 * behind(elevator, 0.1, 0.15) + NOISE * rng.normal(size=400)
        return jaxid.record(t, u, z, inputs=Lift.inputs, outputs=Lift.outputs)

    model = Lift(jnp.array(4.0), jnp.array(1.0))
    free = jaxid.free(model, "slope", "elevator")
    train, check, test = ([flown(3 * part + k) for k in range(3)] for part in range(3))
    study = jaxid.close_loop(model, free, jaxid.OutputError(), train=train, check=check, test=test)
    assert study.effects == ("hysteresis of input elevator",)
    for field, planted in (("gain", 0.1), ("width", 0.15)):
        name = f"hysteresis of input elevator.{field}"
        error = study.after.estimate.standard_error(name)
        assert abs(study.after.estimate.value(name) - planted) < 4.0 * error < 0.1 * planted
    # 1,200 samples, four times 2 %
    assert study.after.rms["test"]["CL"] == pytest.approx(NOISE, rel=0.08)


class Joint(jaxid.AbstractModel):
    """The torque of a joint of a robot, of its measured speed and acceleration."""

    inertia: object
    viscous: object
    states, inputs, outputs = (), ("speed", "acceleration"), ("torque",)

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return jnp.stack([self.viscous * u[0] + self.inertia * u[1]])


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("sign(speed) in torque", np.sign),
        ("|speed|speed in torque", lambda speed: np.abs(speed) * speed),
    ],
)
def test_friction_and_drag_of_an_input_are_identified(name, law):
    def moved(seed):
        rng, t = np.random.default_rng(seed), 0.02 * np.arange(400)
        size, rate = rng.uniform(0.7, 1.3, 2), rng.uniform(0.5, 2.0, 2)
        speed = np.sum(size[:, None] * np.sin(rate[:, None] * t), axis=0)
        acceleration = np.sum((size * rate)[:, None] * np.cos(rate[:, None] * t), axis=0)
        torque = 0.5 * speed + 2.0 * acceleration + 0.4 * law(speed) + NOISE * rng.normal(size=400)
        u = np.column_stack([speed, acceleration])
        return jaxid.record(t, u, torque, inputs=Joint.inputs, outputs=Joint.outputs)

    model = Joint(jnp.array(1.0), jnp.array(1.0))
    free = jaxid.free(model, "inertia", "viscous")
    train, check, test = ([moved(3 * part + k) for k in range(3)] for part in range(3))
    study = jaxid.close_loop(model, free, jaxid.OutputError(), train=train, check=check, test=test)
    assert study.effects == (name,)
    estimate = study.after.estimate
    error = estimate.standard_error(f"{name}.gain")
    assert abs(estimate.value(f"{name}.gain") - 0.4) < 4.0 * error < 0.05
    assert study.after.rms["test"]["torque"] == pytest.approx(NOISE, rel=0.08)


def test_static_curve_is_identified(records):
    model = Lift(jnp.array(4.0), jnp.array(0.0))
    free = jaxid.free(model, "slope", "elevator")
    train, check, test = records
    effects = (Term("CL", "alpha^2"), Term("CL", "alpha^3"), SensorScale("CL"))
    study = jaxid.close_loop(
        model, free, jaxid.OutputError(), train=train, check=check, test=test, effects=effects
    )
    assert study.effects == ("alpha^3 in CL",)
    value, error = (
        study.after.estimate.value("alpha^3 in CL.gain"),
        study.after.estimate.standard_error("alpha^3 in CL.gain"),
    )
    assert abs(value - TRUE) < 4.0 * error
    # 400 samples: the RMS of noise scatters by 3.5 %.
    assert study.after.rms["test"]["CL"] == pytest.approx(NOISE, rel=0.14)
    assert {place.location.kind for place in study.localisation["before"].places} == {
        LocationKind.INPUT,
        LocationKind.SENSOR,
    }
