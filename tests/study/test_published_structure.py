"""The structure that agencies publish for a longitudinal flight, from a study file without code:
lift, drag and pitching moment, with the rate reduced by a reference speed, and biases.

The flight is integrated by SciPy from the equations of speed, angle of attack, pitch and pitch
rate, without any of the package's equations.
"""

import contextlib
import dataclasses
import importlib
import io
import json

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
    B,
    S,
    accelerations,
    declared,
    flown,
)

import jaxid
from jaxid.aircraft import LiftDragAerodynamics
from jaxid.models import Polynomial, with_polynomials

COMMAND = importlib.import_module("jaxid.__main__").identify_file

V0 = 100.0
# V is in V/V0 and q in q cbar/2V0 in the publications: parameters of V and q are divided by these
TRUE = {
    "CD": {"1": 0.06, "V": 0.02 / V0, "alpha": 0.35},
    "CL": {"1": 0.10, "V": 0.05 / V0, "alpha": 4.3},
    "Cm": {
        "1": 0.115,
        "V": 0.01 / V0,
        "alpha": -0.95,
        "q": -30.0 * CBAR / (2.0 * V0),
        "stabilator": -1.5,
    },
}
BIAS = {"ax": 0.15, "az": -0.25}  # m/s^2
NOISE = {
    **{"V": 0.1, "alpha": 0.001, "pitch": 0.0005, "q": 0.0005},
    **{"ax": 0.02, "az": 0.05, "qdot": 0.005},
}
SAMPLES = 1000
STUDY = f"""
[model]
use = "aircraft"

[model.aircraft]
states = "longitudinal"
frame = "air path"
force_axes = "stability"
mass = {MASS}
Iy = {IY}
S = {S}
b = {B}
cbar = {CBAR}
held = {{ aileron = 0.0, rudder = 0.0, thrust = {THRUST}, density = {DENSITY}, altitude = 4000.0 }}
outputs = ["V", "alpha", "pitch", "q", "ax", "az"]

[model.terms]
CD = ["V", "alpha"]
CL = ["V", "alpha"]
Cm = ["V", "alpha", "q", "stabilator"]

[records]
inputs = ["stabilator"]
outputs = ["V", "alpha", "pitch", "q", "ax", "az", "qdot"]
train = ["flight.csv"]

[identify]
add = ["instruments.bias.ax", "instruments.bias.az"]
"""


def coefficients(V, alpha, q, stabilator):
    values = {"1": 1.0, "V": V, "alpha": alpha, "q": q, "stabilator": stabilator}
    return [sum(c * values[term] for term, c in terms.items()) for terms in TRUE.values()]


def rates(state, stabilator):
    V, alpha, pitch, q = state
    CD, CL, Cm = coefficients(V, alpha, q, stabilator)
    qbar, path = 0.5 * DENSITY * V**2, pitch - alpha
    return np.array(
        [
            (THRUST * np.cos(alpha) - qbar * S * CD) / MASS - G0 * np.sin(path),
            q - (THRUST * np.sin(alpha) + qbar * S * CL) / (MASS * V) + G0 * np.cos(path) / V,
            q,
            qbar * S * CBAR * Cm / IY,
        ]
    )


@pytest.fixture(scope="module")
def flight():
    """True histories by channel: an elevator in steps, and the motion that follows."""
    t, stabilator, states = flown(rates, SAMPLES, 20)
    V, alpha, pitch, q = states
    slopes = np.array([rates(x, s) for x, s in zip(states.T, stabilator, strict=True)])
    CD, CL, _ = np.array([coefficients(*x) for x in zip(V, alpha, q, stabilator, strict=True)]).T
    ax, az = accelerations(V, alpha, CD, CL)
    return {
        **{"t": t, "stabilator": stabilator, "V": V, "alpha": alpha, "pitch": pitch, "q": q},
        **{"ax": ax, "az": az, "qdot": slopes[:, 3]},
    }


def record_of(flight):
    outputs = tuple(NOISE)
    return jaxid.record(
        flight["t"],
        flight["stabilator"][:, None],
        np.column_stack([flight[name] for name in outputs]),
        inputs=("stabilator",),
        outputs=outputs,
    )


def test_pseudo_measurements_are_lift_and_drag(flight):
    record = record_of(flight)
    measured = declared(record, TRUE).pseudo_measurements(record)
    assert tuple(measured.responses) == ("CD", "CL", "Cm")
    true = np.array(
        [
            coefficients(*x)
            for x in zip(*(flight[n] for n in ("V", "alpha", "q", "stabilator")), strict=True)
        ]
    )
    for k, name in enumerate(measured.responses):
        np.testing.assert_allclose(measured.responses[name], true[:, k], atol=1e-12)


def test_model_reproduces_the_motion(flight):
    record = record_of(flight)
    blank = declared(record, TRUE)
    assert isinstance(blank.airframe.aerodynamics, LiftDragAerodynamics)
    true = with_polynomials(blank, {name: Polynomial(terms) for name, terms in TRUE.items()})
    prepared = true.prepared(record)
    y = jaxid.simulate(
        true,
        prepared.t,
        prepared.u,
        true.initial_state(prepared),
        stepper=jaxid.RK4(4, unrolled=False),
    ).y
    for k, name in enumerate(true.outputs):
        scale = np.ptp(flight[name])
        np.testing.assert_allclose(y[:, k], flight[name], atol=2e-6 * scale, err_msg=name)


def test_candidate_effect_in_lift_equals_a_term(flight):
    """A term added to CL as an effect changes the rates as one more term of the polynomial does."""
    record = record_of(flight)
    true = with_polynomials(
        declared(record, TRUE), {name: Polynomial(terms) for name, terms in TRUE.items()}
    )
    effect = next(one for one in true.effects() if one.card.name == "alpha^3 in CL")
    with_effect = jaxid.Augmented(true, (dataclasses.replace(effect, gain=jnp.array(20.0)),))
    with_term = with_polynomials(true, {"CL": Polynomial({**TRUE["CL"], "alpha^3": 20.0})})
    prepared = true.prepared(record)
    x, u = true.initial_state(prepared), prepared.u[0]
    np.testing.assert_allclose(
        with_effect.rhs(jnp.zeros(()), x, u), with_term.rhs(jnp.zeros(()), x, u), rtol=1e-12
    )


def test_published_structure_is_estimated_from_a_study_file(flight, tmp_path):
    rng = np.random.default_rng(8)
    noisy = {
        name: flight[name] + BIAS.get(name, 0.0) + rng.normal(scale=NOISE[name], size=SAMPLES)
        for name in NOISE
    }
    columns = [flight["t"], flight["stabilator"], *noisy.values()]
    header = ",".join(("t", "stabilator", *noisy))
    np.savetxt(
        tmp_path / "flight.csv", np.column_stack(columns), delimiter=",", header=header, comments=""
    )
    (tmp_path / "study.toml").write_text(STUDY)
    with contextlib.redirect_stdout(io.StringIO()) as output:
        COMMAND(tmp_path / "study.toml", json=tmp_path / "terms.json")
    assert "status: converged" in output.getvalue()
    content = json.loads((tmp_path / "terms.json").read_text())
    centre = content["centre"]["alpha"]
    true = {f"{name}.{term}": c for name, terms in TRUE.items() for term, c in terms.items()}
    true |= {f"{name}.1": true[f"{name}.1"] + centre * true[f"{name}.alpha"] for name in TRUE}
    true |= {f"instruments.bias.{name}": value for name, value in BIAS.items()}
    rows = content["parameters"]
    assert set(true) == set(rows)
    for name, value in true.items():
        error = abs(rows[name]["value"] - value)
        assert error < 4.0 * rows[name]["standard_error"], name
