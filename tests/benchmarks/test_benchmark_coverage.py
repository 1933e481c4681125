"""Tests of the benchmarks of coverage and of the unstable aircraft, on few draws and starts."""

import importlib
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
WHITE = "output error, white noise"


def load(name):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        return importlib.import_module(name)


def test_band_equals_binomial_quantiles():
    low, high = load("benchmarks.coverage.__main__").band(2000, 1)
    # 95 % -/+ 3.29 sqrt(0.95 0.05 / 2000)
    np.testing.assert_allclose([low, high], [0.934, 0.966], atol=0.002)


def test_row_of_white_noise_lies_inside_its_band():
    row = load("benchmarks.coverage.__main__").measure(WHITE, 50)
    assert row["converged"] == 1.0
    assert row["inside"]
    assert [entry["parameter"] for entry in row["rows"]] == ["Zw", "Mw", "Mq", "Md"]


def test_simulated_gust_has_its_variance_and_memory():
    """The measured angle with the aircraft's motion removed is minus the gust over the speed."""
    benchmark = load("benchmarks.coverage.flights")
    calm, gusty = (benchmark.fly(400, 40, 1, gust=gust).z for gust in (0.0, 1.0))
    first = (gusty - calm)[:, 0, 0] * benchmark.SPEED
    # 400 draws: 3.3 sigma of a variance are 23 %; the noise of both is 2 (0.2 m/s)^2
    np.testing.assert_allclose(np.var(first), 1.0 + 0.08, rtol=0.24)


def test_simulated_noise_has_its_colour_and_gaps():
    """Two records that differ by their noise alone: correlation of neighbours, share of gaps."""
    benchmark = load("benchmarks.coverage.flights")
    flights = benchmark.fly(2, 20_000, 1, colour=0.8, missing=0.3)
    noise = flights.z[0] - flights.z[1]
    both = np.all(flights.valid, axis=0)
    pairs = both[1:, 0] & both[:-1, 0]
    correlation = np.corrcoef(noise[1:, 0][pairs], noise[:-1, 0][pairs])[0, 1]
    np.testing.assert_allclose(correlation, 0.8, atol=0.03)
    np.testing.assert_allclose(np.mean(flights.valid), 0.7, atol=0.01)


def test_true_derivatives_differ_from_flight_to_flight():
    """Without noise of the sensors the pitch acceleration by the elevator is each flight's own."""
    benchmark = load("benchmarks.coverage.flights")
    flights = benchmark.fly(400, 10, 1, spread={"Md": 2.0})
    Md = flights.derivatives[:, 3]
    np.testing.assert_allclose(np.std(Md), 2.0, rtol=0.13)  # 3.3 sigma of 400 draws: 12 %
    pitch = flights.z[:, -1, 1] - flights.z[:, 0, 1]
    assert np.corrcoef(pitch, Md)[0, 1] > 0.95


def test_expected_share_of_profiles_equals_simulation():
    """Normal errors Z of an estimate with a lower bound: the interval by the rise of the cost."""
    expected = load("benchmarks.coverage.cases").expected_at_bound
    Z, q = np.random.default_rng(3).normal(size=400_000), 1.959963984540054
    for distance in (0.0, 0.5, 1.0, 1.9, 3.0):
        best = np.maximum(Z, -distance)  # error of the estimate, held at the bound
        rise = Z**2 - (Z - best) ** 2  # twice the cost at the truth over that at the estimate
        share = np.mean(rise < q**2)
        # 400,000 draws: 3.3 sigma of a share are 0.0011
        np.testing.assert_allclose(expected(distance), share, atol=0.0012)


def test_filter_error_alone_finds_unstable_aircraft_from_bad_starts():
    benchmark = load("benchmarks.unstable")
    corners = [(0.5, 1.5, 1.5, 0.5), (1.5, 0.5, 0.5, 1.5)]
    flight = benchmark.fly(400)
    fits = benchmark.attempts(flight, "filter error", corners)
    assert all(benchmark.is_found(fit) for fit in fits)
    distance = (fits[0].values - fits[1].values) / fits[0].standard_errors
    np.testing.assert_allclose(distance, 0.0, atol=1e-3)


def test_flights_with_an_effect_of_gain_zero_are_those_of_the_exact_transition():
    """Means of 400 flights by the simulation and by matrix exponentials: noise of 0.004 / 20."""
    flights, selection = (load(f"benchmarks.coverage.{name}") for name in ("flights", "selection"))
    declared = flights.ShortPeriod(*map(jnp.asarray, flights.DERIVATIVES.values()))
    nothing = eqx.tree_at(lambda effect: effect.gain, selection.missing_effect(), jnp.zeros(()))
    simulated = flights.fly_with(nothing, 400, 100, 1, declared).z.mean(axis=0)
    exact = flights.fly(400, 100, 2).z.mean(axis=0)
    # 5 standard errors of a difference of two means, of 200 values
    np.testing.assert_allclose(simulated, exact, atol=5.0 * np.sqrt(2.0) * 0.004 / 20)
    missing = selection.fly_missing(400, 100, 1).z.mean(axis=0)
    assert np.max(np.abs(missing - simulated)) > 0.01
