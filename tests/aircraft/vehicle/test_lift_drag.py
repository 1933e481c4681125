"""Lift, drag and side force: directions from vectors, names, pseudo-measurements."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from identified_flight import flown

from jaxid._foundation.checks import InputError
from jaxid.aircraft import (
    LiftDragAerodynamics,
    PolynomialAerodynamics,
    flight_record,
    from_aircraft,
)
from jaxid.aircraft.effects.coefficient_term import CoefficientTerm
from jaxid.aircraft.physics.frames import velocity
from jaxid.aircraft.vehicle.force_axes import FORCES
from jaxid.effects import Augmented
from jaxid.models import parameter_names

AXES = {"stability": ("CD", "CY", "CL"), "wind": ("CD", "CC", "CL")}


def directions(axes, alpha, beta):
    """Unit vectors of the three forces by vector products."""
    right = np.array([0.0, 1.0, 0.0])
    along = np.asarray(velocity(1.0, alpha, beta if axes == "wind" else 0.0))
    lift = np.cross(right, along) / np.linalg.norm(np.cross(right, along))
    return [-along, np.cross(along, lift), lift]


@pytest.mark.parametrize("axes", AXES)
def test_forces_act_along_and_across_the_airspeed(axes, seed):
    rng = np.random.default_rng(seed)
    values = dict(zip((*AXES[axes], "Cl", "Cm", "Cn"), rng.normal(size=6), strict=True))
    aerodynamics = LiftDragAerodynamics({name: {"1": c} for name, c in values.items()}, axes)
    for alpha, beta in rng.uniform(-1.4, 1.4, size=(5, 2)):
        signals = {"alpha": jnp.asarray(alpha), "beta": jnp.asarray(beta)}
        parts = zip(values.values(), directions(axes, alpha, beta), strict=False)
        expected = [*sum(value * e for value, e in parts), *[*values.values()][3:]]
        np.testing.assert_allclose(aerodynamics.coefficients(signals), expected, atol=1e-14)


def test_parameters_have_the_names_of_their_coefficients():
    aerodynamics = LiftDragAerodynamics({"CL": {"alpha": 4.0}, "Cm": {"qhat": -9.0}}, "wind")
    assert set(parameter_names(aerodynamics)) == {"CL.alpha", "Cm.qhat"}
    assert aerodynamics.terms["CL"] == ("alpha",)


@pytest.fixture(scope="module")
def flight():
    return flown()


def in_axes(flight, axes, **options):
    return from_aircraft(flight.aircraft, force_axes=axes, **options)


@pytest.mark.parametrize("axes", AXES)
def test_pseudo_measurements_are_the_true_forces_in_these_axes(flight, axes):
    """With instruments off the centre of gravity and known errors, exact to rounding."""
    measured = in_axes(flight, axes).pseudo_measurements(flight_record(flight))
    assert tuple(measured.responses) == (*AXES[axes], "Cl", "Cm", "Cn")
    true = {name: np.asarray(flight.truth.channel(name)) for name in flight.truth.outputs}
    body = np.stack([true[name] for name in ("CX", "CY", "CZ")], axis=-1)
    angles = zip(true["alpha"], true["beta"], strict=True)
    rows = np.array([np.array(directions(axes, *at)) for at in angles])
    expected = np.einsum("tij,tj->ti", rows, body)
    for k, name in enumerate(AXES[axes]):
        np.testing.assert_allclose(measured.responses[name], expected[:, k], atol=1e-9)


def test_weak_form_of_lift_off_the_centre_of_gravity_is_refused(flight):
    with pytest.raises(InputError, match="accelerometers at the centre of gravity"):
        in_axes(flight, "stability").weak_measurements(flight_record(flight))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: LiftDragAerodynamics({}, "earth"), "no axes of the force 'earth'"),
        (lambda: LiftDragAerodynamics({}, "body"), "Give `PolynomialAerodynamics`"),
        (lambda: LiftDragAerodynamics({"CY": {}}, "wind"), "in wind axes. 'CY'|'CY'"),
        (lambda: PolynomialAerodynamics({"CD": {}}), "'CD'"),
    ],
)
def test_unknown_axes_and_coefficients_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_candidates_of_body_forces_serve_the_forces_in_their_place(flight):
    options = {"candidates": {"CX": ("alpha",), "CL": ("alpha^2",)}}
    chosen = dict(in_axes(flight, "wind", **options).candidates)
    assert chosen == {"CD": ("alpha",), "CL": ("alpha^2",)}
    with pytest.raises(InputError, match="candidates of CX and of CD"):
        in_axes(flight, "wind", candidates={"CX": ("alpha",), "CD": ("alpha",)})


# Effects ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axes", AXES)
def test_effects_name_the_axes_of_their_force(flight, axes):
    """Absent terms are in the axes of the model, all other forces in body axes by their words."""
    effects = in_axes(flight, axes).effects()
    forces = [each for each in effects if each.card.location.name in FORCES]
    expected = {"1 varying with mach in CX", "alpha varying with mach in CZ"}
    assert expected <= {each.name for each in forces}
    assert all("(body axes)" in each.card.description for each in forces)
    terms = {each.coefficient for each in effects if isinstance(each, CoefficientTerm)}
    assert {*AXES[axes]} <= terms
    others = [each for each in effects if each.card.location.name not in FORCES]
    assert not any("body axes" in each.card.description for each in others)


def test_effects_act_in_the_axes_that_they_name(flight):
    """A change of CX accelerates along x alone, one of CL across the velocity in the x-z plane."""
    model = in_axes(flight, "stability")
    values = {name: flight.truth.channel(name)[30] for name in ("u", "v", "w")}
    x = jnp.stack([jnp.asarray(values.get(name, 0.1)) for name in model.states])
    u = jnp.full(len(model.inputs), 0.01).at[model.inputs.index("altitude")].set(3000.0)
    candidates = {effect.name: effect for effect in model.effects()}
    at = np.array([model.states.index(name) for name in ("u", "w")])

    def added(name):
        effect = eqx.tree_at(lambda one: one.gain, candidates[name], jnp.array(1.0))
        larger = Augmented(model, (effect,))
        return np.asarray(larger.rhs(jnp.zeros(()), x, u) - model.rhs(jnp.zeros(()), x, u))[at]

    forward, lift = added("1 varying with mach in CX"), added("alpha^2 in CL")
    assert forward[0] > 1.0
    assert abs(forward[1]) < 1e-9
    across = np.array([x[at[1]], -x[at[0]]])
    np.testing.assert_allclose(lift @ across, np.linalg.norm(lift) * np.linalg.norm(across))
    assert np.min(np.abs(lift)) > 0.01
