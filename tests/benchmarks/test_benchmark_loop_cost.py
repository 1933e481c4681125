"""Tests of the loop-cost benchmark: counts and added effect; times are not tested."""

import importlib
from pathlib import Path

import jax
import pytest

from jaxid.effects import SensorScale

ROOT = Path(__file__).resolve().parents[2]
COUNT = 6  # of the twelve terms and eleven instruments


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.loop_cost")


@pytest.fixture(scope="module")
def costs(benchmark):
    """Costs of the loop on the embedded flight with candidates of Cm and of the instruments' scale.

    The full library (`python -m jaxid`) gives the same effect and takes some minutes.
    """

    def of_moment_or_scale(effect):
        return effect.name.endswith("in Cm") or isinstance(effect, SensorScale)

    jax.clear_caches()  # programs that another module compiled are not counted
    return benchmark.study(benchmark.Size(COUNT, 501, 2), of_moment_or_scale)


def test_loop_adds_only_planted_effect_and_reaches_noise_level(benchmark, costs):
    assert costs["effects"] == [benchmark.TRUTH]
    assert costs["outcome"] == "explained"
    assert costs["over_noise"] < 1.03  # as the main job promises


def test_sensitivity_pass_is_compiled_once_for_all_rounds(benchmark, costs):
    """Once for the records, and once for the window of a check record."""
    assert costs["cold"]["rounds"] >= 2
    assert costs["cold"]["passes_compiled"] == 2
    assert costs["warm"]["passes_compiled"] == 0


def test_steps_are_timed_without_overlap(benchmark, costs):
    for run in (costs["cold"], costs["warm"]):
        assert set(run["steps"]) == set(benchmark.STEPS)
        assert sum(run["steps"].values()) <= run["seconds"]  # none is counted within another


def test_table_has_one_line_per_size(benchmark, costs):
    lines = benchmark.table([costs, costs]).splitlines()
    assert sum(line.split()[:3] == [str(COUNT), "501", "2"] for line in lines) == 2
    assert "2 in 2 rounds" in lines[2]
