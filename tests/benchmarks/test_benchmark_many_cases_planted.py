"""300 short cases with planted failures: statuses, single estimates, and a second store.

That a killed run continues to the same store is tested in `tests/batches/test_store.py`.
"""

import importlib
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
CASES = 300


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.many_cases_planted")


@pytest.fixture(scope="module")
def measured(benchmark):
    return benchmark.measure(Namespace(cases=CASES, singles=CASES, kills=0))


def test_failed_cases_carry_planted_status_and_reason(measured):
    assert measured["wrong"] == []
    assert measured["statuses"] == {
        "successful": 291,
        "refused": 3,
        "start_diverges": 3,
        "undetermined": 3,
    }


def test_healthy_cases_equal_single_estimates(measured):
    assert 0 <= measured["singles_differ_by"] < 1e-9


def test_stores_of_two_runs_are_equal(measured):
    """Numbers to rounding: a case may be computed in another lane of its group."""
    assert measured["stores_differ_by"] < 1e-9


def test_differences_and_wrong_statuses_are_seen(benchmark):
    cases = benchmark.planted_cases(12)
    results = benchmark.run(cases)
    assert benchmark.wrong_statuses(cases, results) == []
    changed, healthy = results.copy(deep=True), np.flatnonzero(cases.kinds == benchmark.HEALTHY)
    changed["values"][healthy[0]] *= 1.0 + 1e-6
    assert benchmark.largest_difference(results, changed) == pytest.approx(1e-6, rel=1e-3)
    changed["status"][healthy[1]] = "refused"
    assert benchmark.largest_difference(results, changed) == float("inf")
    assert len(benchmark.wrong_statuses(cases, changed)) == 1
