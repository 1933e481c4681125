"""Independent simulations: jaxid's simulator with the stated truths gives them; the judgement."""
# pyright: reportCallIssue=false, reportArgumentType=false

import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.independent_truth.judge import Verdict, judge
from benchmarks.independent_truth.signals import (
    autoregressive,
    chirp,
    doublet,
    integrate,
    square_3211,
)
from benchmarks.independent_truth.systems import (
    AIRCRAFT,
    SHIP,
    SYSTEMS,
    TANK,
    elevator,
    hidden_tank,
    ship,
    stall,
)
from jaxid import Augmented, hold, simulate
from jaxid.effects import Hinge, LaggedSignal, Placement, Term
from jaxid.loop import Outcome
from jaxid.models.free import with_values

BY_NAME = {system.name: system for system in SYSTEMS}


def with_truth(model, names, values, effects):
    return Augmented(with_values(model, names, jnp.array(values)), effects)


def test_stall_has_two_hinges():
    level = jnp.radians(10.0)
    hinges = (
        Hinge(Placement.equation(state), "alpha", gain=jnp.array(gain), level=level)
        for state, gain in (("alpha", 0.66), ("q", -4.0))
    )
    names, values = ("Za", "Zd", "Ma", "Mq", "Md"), (-1.1, -0.12, -7.0, -1.5, -11.0)
    model, flown = with_truth(AIRCRAFT, names, values, tuple(hinges)), stall(0)
    u = np.asarray(flown.u)
    start = np.linalg.solve([[1.1, -1.0], [7.0, 1.5]], [-0.12 * u[0, 0], -11.0 * u[0, 0]])
    y = np.asarray(simulate(model, flown.t, flown.u, jnp.array(start)).y)
    noise = np.std(np.asarray(flown.z) - y, axis=0)
    np.testing.assert_allclose(noise, np.radians([0.1, 0.15]), rtol=0.1)
    assert 0.02 < np.mean(y[:, 0] > np.radians(10.0)) < 0.1


def test_ship_has_cubic_resistance():
    model = with_truth(SHIP, ("K", "T"), (0.18, 25.0), (Term("r", "r^3", jnp.array(-160.0)),))
    flown = ship(1)
    y = simulate(model, flown.t, flown.u, jnp.zeros(2), hold=hold.ZeroOrder()).y
    noise = np.std(np.asarray(flown.z) - np.asarray(y), axis=0)
    np.testing.assert_allclose(noise, [2e-4, 2e-3], rtol=0.25)


def test_hidden_tank_is_lagged_level():
    gain, time = jnp.array(0.008), jnp.array(1.0 / 0.0056)
    lagged = LaggedSignal(Placement.equation("h"), "h", gain=gain, time=time)
    model, filled = with_truth(TANK, ("k", "c"), (0.0025, 0.01), (lagged,)), hidden_tank(0)
    start = jnp.array([0.3, 0.0])
    y = simulate(model, filled.t, filled.u, start, hold=hold.ZeroOrder()).y
    assert np.std(np.asarray(filled.z) - np.asarray(y)) == pytest.approx(0.001, rel=0.1)


def test_every_record_is_of_its_own():
    for system in SYSTEMS:
        first, second = (np.asarray(system.measure(number).z) for number in (0, 1))
        assert np.all(np.isfinite(first))
        assert not np.array_equal(first, second)


@pytest.mark.parametrize(
    ("name", "outcome", "families", "expected"),
    [
        ("ship", Outcome.EXPLAINED, {"r^3 in r"}, Verdict.RIGHT),
        ("ship", Outcome.EXPLAINED, {"r^3 in r", "bias of r"}, Verdict.WRONG),
        ("ship", Outcome.PROXIES, {"r^3 in r"}, Verdict.DOUBT),
        ("ship", Outcome.NOTHING_MISSING, set(), Verdict.WRONG),
        ("oven", Outcome.EXPLAINED, {"T^3 in T"}, Verdict.WRONG),
        ("oven", Outcome.UNEXPLAINED, set(), Verdict.RIGHT),
        ("oven", Outcome.COLOURED_NOISE, set(), Verdict.WRONG),
        ("alpha-dot", Outcome.NOTHING_MISSING, set(), Verdict.RIGHT),
        ("alpha-dot", Outcome.PROXIES, {"q^3 in q"}, Verdict.DOUBT),
        ("boat in waves", Outcome.PROCESS_NOISE, set(), Verdict.RIGHT),
        ("boat in waves", Outcome.EXPLAINED, {"bias of p"}, Verdict.WRONG),
    ],
)
def test_judge(name, outcome, families, expected):
    assert judge(BY_NAME[name], outcome, families) is expected


def test_integrator_and_signals():
    """Closed forms: a held input of a first-order system, a ramp, levels, frequencies, memory."""
    t = np.linspace(0.0, 1.0, 11)
    held = integrate(lambda _, x, u: u - x, np.zeros(1), t, np.ones(11))[:, 0]
    np.testing.assert_allclose(held, 1.0 - np.exp(-t), atol=1e-7)
    ramp = integrate(lambda _, x, u: np.full(1, u), np.zeros(1), t, t, held=False)[:, 0]
    np.testing.assert_allclose(ramp, 0.5 * t**2, atol=1e-7)
    np.testing.assert_array_equal(doublet(np.arange(5.0), 1.0, 1.0, 2.0), [0, 2, -2, 0, 0])
    np.testing.assert_array_equal(square_3211(np.arange(8.0), 0, 1, 1), [1, 1, 1, -1, -1, 1, -1, 0])
    slow = chirp(np.linspace(0.0, 1.0, 5), 1.0, 1.0, 3.0)
    np.testing.assert_allclose(slow, 3.0 * np.sin(2 * np.pi * np.linspace(0, 1, 5)), atol=1e-9)
    noise = autoregressive(np.random.default_rng(1), 20_000, 2.0, 0.8)
    assert np.std(noise) == pytest.approx(2.0, rel=0.05)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.8, abs=0.02)
    assert np.max(np.abs(elevator(t, 0, 9.0))) == pytest.approx(np.radians(9.0))
