"""Tests of the comparison of devices: rows, differences and crossing; times are not tested."""

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
CASES = (2, 20)


def load(name):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        return importlib.import_module(f"benchmarks.{name}")


@pytest.fixture(scope="module")
def benchmark():
    return load("many_cases_gpu")


def rows_of(milliseconds):
    return [
        {"problem": "spring", "cases": cases, "ms_per_case": cost}
        for cases, cost in milliseconds.items()
    ]


def write_estimates(path, values, errors):
    status = np.full(len(values), "successful")
    np.savez(path, values=values, standard_errors=errors, status=status)


@pytest.fixture(scope="module")
def measured(user_environment_of_module, tmp_path_factory):
    """Result of the command on the CPU alone, and the file that it wrote."""
    path = tmp_path_factory.mktemp("result") / "result.json"
    command = [sys.executable, "-m", "benchmarks.many_cases", "--gpu", "--json"]
    command += ["--cases", *map(str, CASES), "--problems", "spring", "--no-cpu-devices"]
    command += ["--output", str(path), "--seconds", "200"]
    done = subprocess.run(
        command, cwd=ROOT, env=user_environment_of_module, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), json.loads(path.read_text())


@pytest.fixture(scope="module")
def user_environment_of_module(reader_environment):
    return {**reader_environment, "JAX_PLATFORMS": "cpu"}


def test_both_processes_measure_all_numbers_of_cases_with_equal_estimates(measured):
    printed, written = measured
    assert printed == written
    for device in printed["devices"].values():
        assert device["exit_code"] == 0
        assert [row["cases"] for row in device["rows"]] == list(CASES)
        for row in device["rows"]:
            assert row["statuses"] == {"successful": row["cases"]}
            assert row["ms_per_case"] > 0
    (comparison,) = printed["summary"]
    assert (comparison["compared"], comparison["same_status"]) == (CASES[-1], True)
    assert comparison["largest_difference_in_standard_errors"] < 1e-6


def test_summary_finds_crossing_and_differences(benchmark, tmp_path):
    """Beyond the largest number on the CPU, its last cost per case counts."""
    devices = {
        "default": {"rows": rows_of({1: 50.0, 10: 6.0, 1000: 0.5})},
        "cpu": {"rows": rows_of({1: 4.0, 10: 3.0})},
    }
    values, errors = np.full((3, 2), 2.0), np.full((3, 2), 0.5)
    write_estimates(tmp_path / "cpu-spring.npz", values, errors)
    write_estimates(tmp_path / "default-spring.npz", values[:2] + 1e-3, errors[:2])
    (row,) = benchmark.summary(devices, tmp_path)
    assert (row["faster_from"], row["slower_up_to"]) == (1000, 10)
    assert row["times_as_fast"]["1000"] == pytest.approx(6.0)
    assert row["compared"] == 2
    assert row["largest_difference"] == pytest.approx(5e-4)
    assert row["largest_difference_in_standard_errors"] == pytest.approx(2e-3)


def test_unfinished_line_of_a_killed_process_is_left_out(benchmark, tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text('{"a": 1}\n{"b": ')
    assert benchmark.complete_lines(path) == ['{"a": 1}\n']
    assert benchmark.complete_lines(tmp_path / "absent") == []


def test_processes_have_processors_of_their_own(benchmark, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(16)))
    shares = benchmark.processor_shares(True)
    assert {name: len(cores) for name, cores in shares.items()} == {
        "default": 8,
        "cpu": 1,
        "cpu_cores": 7,
    }
    assert len(set().union(*shares.values())) == 16
