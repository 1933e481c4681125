"""Tests of the benchmark of selection rules; the best rule is not tested."""

import contextlib
import importlib
import io
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.structure")


@pytest.fixture(scope="module")
def output(benchmark, tmp_path_factory):
    """Six draws, and the figure of them."""
    figure, words = tmp_path_factory.mktemp("structure") / "rules.png", io.StringIO()
    with contextlib.redirect_stdout(words):
        assert benchmark.main(["--json", "--draws", "6", "--figure", str(figure)]) == 0
    assert figure.stat().st_size > 10_000
    return json.loads(words.getvalue())


def test_json_has_one_row_per_rule_and_noise_level(benchmark, output):
    assert (output["status"], output["draws"]) == ("measured", 6)
    pairs = [(row["rule"], row["noise"]) for row in output["rows"]]
    rules = (*benchmark.METHODS, *benchmark.CEILINGS)
    assert sorted(pairs) == sorted((rule, noise) for rule in rules for noise in benchmark.NOISE)
    for row in output["rows"]:
        assert 0.0 <= row["exact"] <= 1.0
        if row["rule"] in benchmark.METHODS:
            # Exact models have no wrong term, and the others one at least.
            assert row["false"] + row["missed"] >= 1.0 - row["exact"] - 1e-12
            assert (row["false"] + row["missed"] == 0) == (row["exact"] == 1.0)


def test_rule_on_full_path_recovers_at_most_models_on_path(benchmark, output):
    share = {(row["rule"], row["noise"]): row["exact"] for row in output["rows"]}
    for name, method in benchmark.METHODS.items():
        if method.path == "whole":
            assert all(
                share[name, noise] <= share["limit: right model on the whole path", noise]
                for noise in benchmark.NOISE
            )


def test_misfit_at_low_noise_is_one(output):
    """A level of 0.1 % keeps all that is planted, so its misfit is one: 1500 samples, five standard
    deviations.
    """
    (row,) = (
        row
        for row in output["rows"]
        if row["rule"] == "last step, F at 0.1 %" and row["noise"] == 0.01
    )
    assert row["misfit"] == pytest.approx(1.0, abs=0.1)


def test_table_has_all_rules(benchmark, output):
    words = benchmark.table(output["rows"])
    assert all(words.count(name) == 3 for name in benchmark.METHODS)
    assert all(words.count(name) == 1 for name in benchmark.CEILINGS)
