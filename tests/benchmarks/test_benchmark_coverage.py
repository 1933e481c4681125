"""Tests of the benchmarks of coverage and of the unstable aircraft, on few draws and starts."""

import importlib
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
WHITE = "output error, white noise"


def load(name):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        return importlib.import_module(name)


def test_band_equals_binomial_quantiles():
    low, high = load("benchmarks.coverage").band(2000, 1)
    # 95 % -/+ 3.29 sqrt(0.95 0.05 / 2000)
    np.testing.assert_allclose([low, high], [0.934, 0.966], atol=0.002)


def test_row_of_white_noise_lies_inside_its_band():
    row = load("benchmarks.coverage").measure(WHITE, 50)
    assert row["converged"] == 1.0
    assert row["inside"]
    assert [entry["parameter"] for entry in row["rows"]] == ["Zw", "Mw", "Mq", "Md"]


def test_simulated_gust_has_its_variance_and_memory():
    """The measured angle with the aircraft's motion removed is minus the gust over the speed."""
    benchmark = load("benchmarks.coverage")
    calm, gusty = (benchmark.fly(400, 40, 1, gust).z for gust in (0.0, 1.0))
    first = (gusty - calm)[:, 0, 0] * benchmark.SPEED
    # 400 draws: 3.3 sigma of a variance are 23 %; the noise of both is 2 (0.2 m/s)^2
    np.testing.assert_allclose(np.var(first), 1.0 + 0.08, rtol=0.24)


def test_filter_error_alone_finds_unstable_aircraft_from_bad_starts():
    benchmark = load("benchmarks.unstable")
    corners = [(0.5, 1.5, 1.5, 0.5), (1.5, 0.5, 0.5, 1.5)]
    flight = benchmark.fly(400)
    fits = benchmark.attempts(flight, "filter error", corners)
    assert all(benchmark.is_found(fit) for fit in fits)
    distance = (fits[0].values - fits[1].values) / fits[0].standard_errors
    np.testing.assert_allclose(distance, 0.0, atol=1e-3)
