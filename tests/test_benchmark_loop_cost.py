"""The benchmark of what a loop costs counts what it says, and its study finds what is missing; no time is held here."""

import importlib
from pathlib import Path

import pytest

from jaxid.models import SensorScale

ROOT = Path(__file__).resolve().parent.parent
COUNT = 23  # all of them: twelve terms, eleven instruments


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.loop_cost")


@pytest.fixture(scope="module")
def told(benchmark):
    """The loop on the embedded flight with candidates of the pitching moment and of the instruments' scale: the whole library,
    on the command line as `python -m jaxid`, finds the same and takes some minutes."""

    def of_moment_or_scale(effect):
        return effect.name.endswith("in Cm") or isinstance(effect, SensorScale)

    return benchmark.study(benchmark.Size(COUNT, 501, 3), of_moment_or_scale)


def test_the_loop_names_the_planted_effect_and_nothing_else_and_reaches_the_noise(benchmark, told):
    assert told["effects"] == [benchmark.TRUTH]
    assert told["outcome"] == "explained"
    assert told["over_noise"] < 1.03  # as the main job promises


def test_one_compilation_of_the_pass_serves_all_rounds(benchmark, told):
    assert told["cold"]["rounds"] >= 2
    assert told["cold"]["passes_compiled"] == 1
    assert told["warm"]["passes_compiled"] == 0


def test_every_step_of_the_workbench_is_counted_once(benchmark, told):
    for run in (told["cold"], told["warm"]):
        assert set(run["steps"]) == set(benchmark.STEPS)
        assert sum(run["steps"].values()) <= run["seconds"]  # none is counted within another


def test_the_table_has_a_line_for_each_size(benchmark, told):
    lines = benchmark.table([told, told]).splitlines()
    assert sum(line.split()[:3] == [str(COUNT), "501", "3"] for line in lines) == 2
    assert "1 in 2 rounds" in lines[2]
