"""The benchmark of what a loop costs counts what it says; no time is held here."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.loop_cost")


@pytest.fixture(scope="module")
def told(benchmark):
    """A small study: two candidates, one of them what is missing."""
    return benchmark.study(benchmark.Size(2, 501, 3))


def test_one_compilation_of_the_pass_serves_all_rounds(benchmark, told):
    assert told["effects"] == [benchmark.TRUTH]
    assert told["cold"]["rounds"] >= 2
    assert told["cold"]["passes_compiled"] == 1
    assert told["warm"]["passes_compiled"] == 0


def test_every_step_of_the_workbench_is_counted_once(benchmark, told):
    for run in (told["cold"], told["warm"]):
        assert set(run["steps"]) == set(benchmark.STEPS)
        assert sum(run["steps"].values()) <= run["seconds"]  # none is counted within another


def test_the_table_has_a_line_for_each_size(benchmark, told):
    lines = benchmark.table([told, told]).splitlines()
    assert sum(line.split()[:3] == ["2", "501", "3"] for line in lines) == 2
    assert "1 in 2 rounds" in lines[2]
