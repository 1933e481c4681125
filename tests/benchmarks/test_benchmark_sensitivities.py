"""Tests of the sensitivities benchmark: agreement of its four methods; times are not tested."""

import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.sensitivities")


@pytest.fixture(scope="module")
def results(benchmark):
    problem = benchmark.make_problem(120)
    return problem, {
        name: tuple(map(np.asarray, method(problem.theta)))
        for name, method in benchmark.methods(problem).items()
    }


@pytest.mark.parametrize(("method", "bound"), [("HAND", 1e-9), ("DIFFRAX", 1e-6), ("NUMPY", 1e-5)])
def test_methods_agree_with_autodiff_through_scan(benchmark, results, method, bound):
    problem, sensitivities = results
    y, S = sensitivities[benchmark.SCAN]
    assert S.shape == (120, 6, 14)
    # every output feels every parameter, so that each column is compared
    assert np.all(np.max(np.abs(S), axis=0) > 0)
    other_y, other_S = sensitivities[getattr(benchmark, method)]
    assert benchmark.disagreement(other_S, S) <= bound
    np.testing.assert_allclose(other_y / problem.noise, y / problem.noise, rtol=0, atol=1e-3)


def test_disagreement_detects_one_wrong_entry(benchmark, results):
    """One wrong entry in one weak column shows."""
    S = results[1][benchmark.SCAN][1]
    wrong = S.copy()
    wrong[60, 3, 4] += 1e-4 * np.max(np.abs(S[:, 3, 4]))
    assert benchmark.disagreement(wrong, S) == pytest.approx(1e-4)


def test_json_has_status_and_misfit(user_environment):
    command = [
        sys.executable,
        "-m",
        "benchmarks.sensitivities",
        "--json",
        "--samples",
        "60",
        "--repeats",
        "1",
    ]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env=user_environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert output["status"] == "agrees"
    assert [row["status"] for row in output["rows"]] == ["agrees"] * 4
    for row in output["rows"]:
        # 360 samples of unit variance: 4 standard deviations
        assert row["misfit"] == pytest.approx(1.0, abs=0.15)
        assert row["seconds"] > 0
