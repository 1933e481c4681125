"""The benchmark on measured data: what is not at hand is skipped in words, and a study is reported as it is."""

import contextlib
import importlib
import io
import json
import types
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.measured")


def told(benchmark, *arguments):
    words = io.StringIO()
    with contextlib.redirect_stdout(words):
        assert benchmark.main(list(arguments)) == 0
    return words.getvalue()


def test_without_data_every_set_is_skipped_and_says_where_it_is_offered(benchmark, tmp_path):
    found = json.loads(told(benchmark, "--json", "--data", str(tmp_path)))
    assert found["status"] == "no data"
    assert [one["set"] for one in found["rows"]] == list(benchmark.CASES)
    for one in found["rows"]:
        assert one["status"] == "skipped"
        assert "nonlinearbenchmark.org" in one["why"]
    assert told(benchmark, "--data", str(tmp_path), "--sets", "tanks").count("skipped: ") == 1


def test_an_unknown_set_is_refused(benchmark, capsys):
    with pytest.raises(SystemExit):
        benchmark.main(["--sets", "drums"])
    assert "there is no set 'drums'; there are silverbox" in capsys.readouterr().err


@pytest.fixture
def study():
    """As much of a study of the tanks as is reported."""

    def side(level):
        return types.SimpleNamespace(
            rms={"validation": {"level": level}}, estimate=types.SimpleNamespace(status="converged")
        )

    candidate = {
        "cost_fall": 1.0,
        "name": "a",
        "score": 9.0,
        "significance": 3.0,
        "check_fall": 0.1,
        "verdict": "added",
    }
    one = {"added": "a", "rivals": [], "dropped": [], "errors": {}, "candidates": [candidate, {"cost_fall": None}]}
    effects = ("overflow of upper into lower (from 90%)", "lower saturation of level")
    return types.SimpleNamespace(
        before=side(0.675),
        after=side(0.37),
        effects=effects,
        outcome="proxies",
        verdict="Something is missing.",
        to_dict=lambda: {"effects": list(effects), "parameters": {}, "rounds": [one]},
    )


def test_a_missed_goal_and_an_effect_that_is_not_named_are_told(benchmark, study):
    found = benchmark.row("tanks", study)
    (figure,) = found["figures"]
    assert (figure["before"], figure["after"], figure["goal"], figure["met"]) == (0.675, 0.37, 0.36, False)
    assert found["named"] == {"sensor clip": False, "overflow": True}  # the lower end is another thing than the clip
    assert [one["name"] for one in found["rounds"][0]["refitted"]] == ["a"]
    words = benchmark.table([{**found, "seconds": 1.0}])
    assert "GOAL MISSED" in words
    assert "sensor clip NOT named" in words


def test_units_are_those_of_the_goals(benchmark, study):
    """Silverbox is told in millivolts: 0.3 mV meets its goal, and is not 0.3 V."""
    for side, error in ((study.before, 14e-3), (study.after, 0.3e-3)):
        side.rms.clear()
        side.rms.update({test: {"y": error} for test in ("arrow", "multisine")})
    for figure in benchmark.row("silverbox", study)["figures"]:
        assert (figure["before"], figure["after"]) == pytest.approx((14.0, 0.3))
        assert figure["met"]
