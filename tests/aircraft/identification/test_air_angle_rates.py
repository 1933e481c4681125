"""Terms with the rates of the angles of attack and sideslip (report 3.2.2.1 b, Eq. E.21).

The flight is integrated by SciPy: with `CL` linear in alphadot the equation of alpha is solved by
hand, `alphadot (1 + qbar S cbar CL_alphadot / 2 m V^2) = ...`.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from lift_drag_flight import (
    CBAR,
    DENSITY,
    G0,
    IY,
    MASS,
    THRUST,
    S,
    accelerations,
    declared,
    flown,
)
from small_airframe import small_airframe

import jaxid
from jaxid import identify
from jaxid._foundation.checks import InputError
from jaxid.aircraft import IdentificationModel, Instruments
from jaxid.aircraft.physics.frames import air_angle_rates
from jaxid.models import Polynomial, with_polynomials
from jaxid.study import IdentifyOptions

TRUE = {
    "CD": {"1": 0.08, "alpha": 0.35},
    "CL": {"1": 0.15, "alpha": 4.3, "alphadot_hat": 3.0},
    "Cm": {"1": 0.12, "alpha": -0.95, "qhat": -25.0, "alphadot_hat": -12.0, "stabilator": -1.5},
}
SAMPLES = 750


def rates(state, stabilator):
    V, alpha, pitch, q = state
    qbar, path = 0.5 * DENSITY * V**2, pitch - alpha
    lift = sum(c * {"1": 1.0, "alpha": alpha}[n] for n, c in [*TRUE["CL"].items()][:2])
    free = q - (THRUST * np.sin(alpha) + qbar * S * lift) / (MASS * V) + G0 * np.cos(path) / V
    alphadot = free / (1.0 + qbar * S * TRUE["CL"]["alphadot_hat"] * CBAR / (2 * MASS * V**2))
    known = {
        **{"1": 1.0, "alpha": alpha, "stabilator": stabilator},
        **{"qhat": q * CBAR / (2 * V), "alphadot_hat": alphadot * CBAR / (2 * V)},
    }
    CD, CL, Cm = (sum(c * known[n] for n, c in terms.items()) for terms in TRUE.values())
    slopes = [
        (THRUST * np.cos(alpha) - qbar * S * CD) / MASS - G0 * np.sin(path),
        alphadot,
        q,
        qbar * S * CBAR * Cm / IY,
    ]
    return np.array(slopes), accelerations(V, alpha, CD, CL)


@pytest.fixture(scope="module")
def record():
    t, stabilator, states = flown(lambda x, s: rates(x, s)[0], SAMPLES, 25)
    rows = [rates(x, s) for x, s in zip(states.T, stabilator, strict=True)]
    qdot, (ax, az) = np.array([one[0][3] for one in rows]), np.array([one[1] for one in rows]).T
    z = np.column_stack([*states, ax, az, qdot])
    outputs = ("V", "alpha", "pitch", "q", "ax", "az", "qdot")
    return jaxid.record(t, stabilator[:, None], z, inputs=("stabilator",), outputs=outputs)


@pytest.fixture(scope="module")
def model(record):
    return declared(record, TRUE, outputs=("V", "alpha", "pitch", "q", "ax", "az"))


def test_rates_of_alpha_are_separated_from_pitch_damping(record, model):
    """Regression from accelerations at the samples, exact; and the same values by likelihood."""
    fit = identify(
        model,
        record,
        options=IdentifyOptions(
            terms={name: tuple(terms)[1:] for name, terms in TRUE.items()}, share=0.0
        ),
        likelihood=jaxid.OutputError(
            jaxid.models.FixedNoise([1e-4] * 6), stepper=jaxid.RK4(4, unrolled=False)
        ),
    )
    assert bool(fit.estimate.successful)
    for row in fit.parameters:
        name, _, term = row.name.partition(".")
        if term != "1":
            assert row.regression == pytest.approx(TRUE[name][term], rel=1e-9), row.name
            assert row.value == pytest.approx(TRUE[name][term], rel=2e-4), row.name


def test_rates_solve_the_equations_of_motion():
    """In six degrees of freedom the rates in the terms equal the rates of the resulting motion."""
    terms = {
        "CZ": {"1": -0.4, "alpha": -4.0, "alphadot_hat": -5.0},
        "CX": {"1": -0.05, "alphadot_hat": 0.4},
        "CY": {"beta": -0.8, "betadot_hat": 0.3},
        "Cm": {"alpha": -0.8, "alphadot_hat": -8.0},
        "Cn": {"beta": 0.1, "betadot_hat": 0.05, "alpha betadot_hat": 0.2},
        "Cl": {"beta": -0.1, "betadot_hat": 0.02},
    }
    blank = IdentificationModel(small_airframe(), held={"altitude": 2000.0})
    model = with_polynomials(blank, {name: Polynomial(each) for name, each in terms.items()})
    x = jnp.array([150.0, 8.0, 20.0, 0.1, 0.05, -0.03, 0.2, 0.1, 0.0])
    u, t = jnp.zeros(len(model.inputs)), jnp.zeros(())
    dx, signals = model.rhs_and_signals(t, x, u)
    V, frame = signals["V"], model.airframe
    alphadot, betadot = air_angle_rates(x[:3], dx[:3])
    np.testing.assert_allclose(signals["alphadot_hat"], alphadot * frame.cbar / (2 * V), rtol=1e-12)
    np.testing.assert_allclose(signals["betadot_hat"], betadot * frame.b / (2 * V), rtol=1e-12)
    constant = {name: dict.fromkeys(each, 0.0) | each for name, each in terms.items()}
    for name, each in constant.items():
        rates_of = {n: float(signals[n.split()[-1]]) for n in each if n.endswith("dot_hat")}
        rates_of = {
            n: value * (float(signals["alpha"]) if n.startswith("alpha ") else 1.0)
            for n, value in rates_of.items()
        }
        shift = sum(each[n] * value for n, value in rates_of.items())
        kept = {n: c for n, c in each.items() if n not in rates_of}
        constant[name] = {**kept, "1": kept.get("1", 0.0) + shift}
    same = with_polynomials(blank, {name: Polynomial(each) for name, each in constant.items()})
    np.testing.assert_allclose(same.rhs(t, x, u), dx, rtol=1e-12, atol=1e-12)


def test_candidates_with_these_rates_need_the_attitude(record, model):
    kept = tuple(name for name in record.outputs if name != "pitch")
    columns = [record.outputs.index(name) for name in kept]
    short = jaxid.record(
        record.t, record.u, record.z[:, columns], inputs=record.inputs, outputs=kept
    )
    with pytest.raises(InputError, match="'pitch' for the rates of the air angles"):
        model.pseudo_measurements(short)


def test_weak_form_off_the_centre_of_gravity_is_refused(record, model):
    """The rate of alpha needs the acceleration there, and this the angular accelerations."""
    moved = eqx.tree_at(
        lambda one: one.instruments, model, Instruments(position={"az": (2.0, 0.0, 0.0)})
    )
    assert "alphadot_hat" in model.weak_measurements(record).signals
    with pytest.raises(InputError, match="accelerometers at the centre of gravity"):
        moved.weak_measurements(record)


@pytest.mark.parametrize(
    ("term", "states", "words"),
    [
        ("alphadot_hat^2", "coupled", "not linear in the rates"),
        ("alphadot_hat betadot_hat", "coupled", "not linear in the rates"),
        ("alphadot_hat", "lateral", "the equation of alpha is not propagated"),
    ],
)
def test_undetermined_rates_are_refused(term, states, words):
    blank = IdentificationModel(small_airframe(), states=states, held={"altitude": 2000.0})
    model = with_polynomials(blank, {"Cn": Polynomial({term: 1.0})})
    with pytest.raises(InputError, match=words):
        model.rhs(jnp.zeros(()), jnp.ones(len(model.states)), jnp.ones(len(model.inputs)))


def test_models_without_these_terms_have_the_rates_as_signals_and_candidates():
    """As far as the angle is propagated."""
    blank = IdentificationModel(small_airframe(), held={"altitude": 2000.0})
    terms = {"CZ": {"1": -0.4, "alpha": -4.0}, "CY": {"beta": -0.8}, "Cm": {"alpha": -0.8}}
    model = with_polynomials(blank, {name: Polynomial(each) for name, each in terms.items()})
    x = jnp.array([150.0, 8.0, 20.0, 0.1, 0.05, -0.03, 0.2, 0.1, 0.0])
    dx, signals = model.rhs_and_signals(jnp.zeros(()), x, jnp.zeros(len(model.inputs)))
    alphadot, betadot = air_angle_rates(x[:3], dx[:3])
    half, frame = 2.0 * signals["V"], model.airframe
    np.testing.assert_allclose(signals["alphadot_hat"], alphadot * frame.cbar / half, rtol=1e-12)
    np.testing.assert_allclose(signals["betadot_hat"], betadot * frame.b / half, rtol=1e-12)
    wanted = {"alphadot_hat in Cm", "alphadot_hat in CZ", "betadot_hat in Cn", "betadot_hat in CY"}
    assert wanted <= {effect.name for effect in model.effects()}
    lateral = IdentificationModel(small_airframe(), states="lateral", held={"altitude": 2000.0})
    names = {effect.name for effect in lateral.effects()}
    assert "betadot_hat in Cn" in names
    assert not any("alphadot" in name for name in names)
