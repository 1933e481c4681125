"""Tests of the benchmark on measured data: skipped sets and reported numbers of a study."""

import contextlib
import importlib
import io
import json
import types
from pathlib import Path

import numpy as np
import pytest

import jaxid
from jaxid.loop.outcome import Outcome

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.measured")


def printed(benchmark, *arguments):
    words = io.StringIO()
    with contextlib.redirect_stdout(words):
        assert benchmark.main(list(arguments)) == 0
    return words.getvalue()


def test_set_without_data_is_skipped_with_its_download_address(benchmark, tmp_path):
    output = json.loads(printed(benchmark, "--json", "--data", str(tmp_path)))
    assert output["status"] == "no data"
    assert [one["set"] for one in output["rows"]] == list(benchmark.CASES)
    for one in output["rows"]:
        assert one["status"] == "skipped"
        assert "nonlinearbenchmark.org" in one["why"]
    assert printed(benchmark, "--data", str(tmp_path), "--sets", "tanks").count("skipped: ") == 1


def test_unknown_set_raises_usage_error(benchmark, capsys):
    with pytest.raises(SystemExit):
        benchmark.main(["--sets", "drums"])
    assert "there is no set 'drums'; there are silverbox" in capsys.readouterr().err


@pytest.fixture
def study():
    """The reported part of a study of the tanks."""

    def side(level):
        return types.SimpleNamespace(
            rms={"validation": {"level": level}},
            estimate=types.SimpleNamespace(status="converged"),
            model=None,
        )

    candidate = {
        "cost_fall": 1.0,
        "name": "a",
        "score": 9.0,
        "check_fall": 0.1,
        "verdict": "added",
    }
    one = {
        "added": "a",
        "dropped": [],
        "errors": {},
        "candidates": [candidate, {"cost_fall": None}],
    }
    effects = ("overflow of upper into lower (from 90%)", "lower saturation of level")
    return types.SimpleNamespace(
        before=side(0.675),
        after=side(0.37),
        effects=effects,
        outcome=Outcome.PROXIES,
        verdict="Something is missing.",
        to_dict=lambda: {"effects": list(effects), "parameters": {}, "rounds": [one]},
    )


@pytest.fixture
def short_predictions(benchmark, monkeypatch):
    """Predictions of 32,000 samples of the arrow, or with a longer window, without a simulation."""
    asked = []

    def predict(model, record, likelihood, *, window):
        asked.append((record.t.size, window))
        return types.SimpleNamespace(rms=np.array([0.2e-3]))

    monkeypatch.setattr(benchmark, "predict", predict)
    return asked


def measured(test, samples):
    """A declared set with one test record of zeros."""
    t = np.arange(float(samples))
    zeros = np.zeros((samples, 1))
    record = jaxid.record(t, zeros, zeros, inputs=("u",), outputs=("y",))
    data = types.SimpleNamespace(test={test: record}, window={test: 5})
    return types.SimpleNamespace(data=data, likelihood=None)


def test_table_marks_missed_goal_and_unnamed_effect(benchmark, study, short_predictions):
    row = benchmark.row("tanks", study, measured("validation", 60))
    assert short_predictions == [(60, 50)] * 2
    figure, longer = row["figures"]
    assert longer["after"] == pytest.approx(0.2e-3)
    assert (figure["before"], figure["after"], figure["goal"], figure["met"]) == (
        0.675,
        0.37,
        0.36,
        False,
    )
    # The clip is at the upper end, so a saturation of the lower end does not count.
    assert row["named"] == {"sensor clip": False, "overflow": True}
    assert [one["name"] for one in row["rounds"][0]["refitted"]] == ["a"]
    words = benchmark.table([{**row, "seconds": 1.0}])
    assert "GOAL MISSED" in words
    assert "sensor clip NOT named" in words


def test_silverbox_errors_have_unit_of_goal(benchmark, study, short_predictions):
    """Errors of Silverbox are in millivolts: 0.3 mV meets the goal, 0.3 V would not."""
    for side, error in ((study.before, 14e-3), (study.after, 0.3e-3)):
        side.rms.clear()
        side.rms.update({test: {"y": error} for test in ("arrow", "multisine")})
    arrow, inside, multisine = benchmark.row("silverbox", study, measured("arrow", 40_000))[
        "figures"
    ]
    for figure in (arrow, multisine):
        assert (figure["before"], figure["after"]) == pytest.approx((14.0, 0.3))
        assert figure["met"]
    assert (inside["label"], inside["after"]) == ("arrow, 32000", pytest.approx(0.2))
    assert short_predictions == [(32_000, 5)] * 2
