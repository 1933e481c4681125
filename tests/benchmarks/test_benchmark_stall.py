"""Tests of the stall benchmark: truth and printed numbers; the result of the loop is not tested."""

import contextlib
import importlib
import io
import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.aircraft.effects.flow_dependence import in_coefficient
from jaxid.aircraft.effects.separation import Separation
from jaxid.effects import Augmented

ROOT = Path(__file__).resolve().parents[2]
THRUST = 2e4
STATE = {"u": 66.0, "w": 17.5, "q": 0.05, "pitch": 0.2}
ELEVATOR = -0.1


@pytest.fixture(scope="module")
def flown():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.stall_flight")


@pytest.fixture(scope="module")
def benchmark(flown):
    return importlib.import_module("benchmarks.stall")


def separated(flown):
    """The right model: the true coefficients, and separation with the true shape."""
    moved = (("CX", ("u",)), ("CZ", ("w",)), ("Cm", ("q",)))
    placements = tuple(in_coefficient(*one) for one in moved)
    shape = {"gain": flown.GAIN, "alpha_star": flown.ALPHA_STAR, "steepness": flown.STEEPNESS}
    shape = {name: jnp.asarray(value) for name, value in shape.items()}
    shares = {"forward": jnp.asarray(flown.FORWARD), "pitching": jnp.asarray(flown.PITCHING)}
    times = {"lag": jnp.asarray(flown.LAG), "late": jnp.asarray(flown.LATE)}
    return Augmented(
        flown.declared(THRUST, wrong=0.0), (Separation(placements, **shape, **shares, **times),)
    )


@pytest.mark.parametrize("x", [0.95, 0.4, 0.1])
def test_rates_of_numpy_truth_equal_library_effect(flown, x):
    """Rates of the NumPy truth and of the library's effect, at a state in the middle of a stall."""
    model = separated(flown)
    alpha = np.arctan2(STATE["w"], STATE["u"])
    offset = x - flown.static(alpha)  # the effect's state is the distance from the static place
    state = jnp.array([*STATE.values(), offset])
    rates = model.rhs(jnp.zeros(()), state, jnp.array([ELEVATOR]))
    true = flown.plant(THRUST).rates(STATE | {"elevator": ELEVATOR, "x": x})
    np.testing.assert_allclose(rates[:4], [true[name] for name in STATE], rtol=1e-10)
    # d(x - x0)/dt, with the rate of x0 by a difference quotient along alpha's own rate.
    udot, wdot = true["u"], true["w"]
    alphadot = (STATE["u"] * wdot - STATE["w"] * udot) / (STATE["u"] ** 2 + STATE["w"] ** 2)
    step = 1e-5
    slope = (flown.static(alpha + step * alphadot) - flown.static(alpha - step * alphadot)) / (
        2 * step
    )
    np.testing.assert_allclose(rates[4], true["x"] - slope, rtol=1e-7)


def test_records_start_trimmed_at_idle_with_stated_noise(flown):
    """Only the thrust that idle lacks acts at first: dV/dt = -(T_level - T) cos(alpha)/m, less in
    time as drag falls.
    """
    stalls = flown.fly_stalls(0, samples=60)
    alpha, _, level = flown.trimmed()
    slowing = -(level - stalls.thrust) * np.cos(alpha) / flown.MASS
    for clean in stalls.clean.values():
        V = clean[:, flown.Longitudinal.outputs.index("V")]
        np.testing.assert_allclose([clean[0, 0], V[0]], [alpha, flown.SPEED], rtol=1e-9)
        np.testing.assert_allclose((V[5] - V[0]) / (5 * flown.SAMPLE_TIME), slowing, rtol=0.04)
    apart = np.concatenate(
        [np.asarray(stalls.records[name].z) - y for name, y in stalls.clean.items()]
    )
    # 300 samples: five standard errors of a standard deviation are 0.2 of it.
    np.testing.assert_allclose(np.std(apart, axis=0), list(flown.NOISE.values()), rtol=0.21)


def test_lift_equals_lift_of_coefficients(flown):
    truth = flown.plant(THRUST)
    signals = STATE | {"elevator": ELEVATOR, "x": 0.4}
    shown = truth.shown(signals, truth.rates(signals))
    y = np.array([shown[name] for name in truth.outputs])
    forward, down, _ = flown.coefficients(STATE, ELEVATOR, 0.4)
    alpha = np.arctan2(STATE["w"], STATE["u"])
    np.testing.assert_allclose(
        flown.lift(y, THRUST), forward * np.sin(alpha) - down * np.cos(alpha), rtol=1e-12
    )


def test_library_has_both_separation_effects(flown, benchmark):
    assert set(benchmark.ORDER) <= {
        effect.card.family for effect in benchmark.library(flown.declared(THRUST))
    }


@pytest.mark.parametrize(("order", "status", "code"), [(True, "reached", 0), (False, "missed", 1)])
def test_json_and_table_report_studies_and_order(benchmark, monkeypatch, order, status, code):
    """One study made up: the status follows the order of finding, and the table has the errors of
    lift.
    """
    rms = {"alpha": 1.0}
    lift = [{"model": "declared", "all": 0.0625, "above 13 deg": 0.125}]
    row = {"seconds": 1.0, "verdict": "found", "in order": order, "lift": lift}
    row |= {"before": rms, "after": rms, "noise": rms}
    monkeypatch.setattr(benchmark, "measure", lambda seed, progress: row | {"seed": seed})
    words = io.StringIO()
    with contextlib.redirect_stdout(words):
        assert benchmark.main(["--json", "--seeds", "2"]) == code
    output = json.loads(words.getvalue())
    assert (output["status"], len(output["studies"])) == (status, 2)
    table = benchmark.table(output["studies"])
    assert "0.0625" in table
    assert "0.1250" in table
    assert f"in {2 * order} of 2 studies" in table
