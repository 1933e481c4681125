"""Tests of the benchmark of the report's cases: structure of its output and its explanations."""

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
        yield importlib.import_module("benchmarks.report_cases")


@pytest.fixture(scope="module")
def output(benchmark):
    """JSON output for two cases, the first of them symmetric, with all other readings."""

    words = io.StringIO()
    with contextlib.redirect_stdout(words):
        arguments = [
            "--json",
            "--hypotheses",
            "--flights",
            "2",
            "--cases",
            "longitudinal 2",
            "lateral 3",
        ]
        assert benchmark.main(arguments) == 0
    return json.loads(words.getvalue())


def ours(benchmark, output, case):
    return next(
        row for row in output["rows"] if (row["case"], row["reading"]) == (case, benchmark.OURS)
    )


def test_json_has_one_row_per_case_and_reading(benchmark, output):
    assert output["status"] == "flown"
    readings = [row["reading"] for row in output["rows"] if row["case"] == "lateral 3"]
    assert readings[0] == benchmark.OURS
    assert (
        len(readings)
        == len(set(readings))
        == 1 + sum("lateral 3".startswith(h.cases) for h in benchmark.HYPOTHESES)
    )
    assert set(output["explanations"]) == {"longitudinal 2", "lateral 3"}
    assert set(benchmark.EXPLANATIONS) == set(benchmark.PRINTED) == set(benchmark.CASES)


def test_symmetric_flight_has_sideslip_only_in_vane_noise(benchmark, output):
    row = ours(benchmark, output, "longitudinal 2")
    assert row["true"]["beta_sd"] == pytest.approx(0.0, abs=1e-12)
    assert row["measured"]["beta_sd"] == pytest.approx(
        0.05, rel=0.25
    )  # base noise, five standard errors of 200 samples
    assert row["difference"]["alpha_mean"] == pytest.approx(
        row["measured"]["alpha_mean"] - 15.8, abs=1e-12
    )


def test_stabilator_trim_of_longitudinal_2_moves_angle_of_attack_as_explained(output):
    """The hump: a tenth of a degree of stabilator decides longitudinal case 2, and on its far side
    the report is near.
    """
    rows = {
        row["reading"]: row["true"] for row in output["rows"] if row["case"] == "longitudinal 2"
    }
    assert (
        rows["stabilator trim -0.1 deg"]["alpha_mean"]
        - rows["as in jaxid.aircraft.flight.report_cases"]["alpha_mean"]
        > 2.0
    )
    assert rows["stabilator trim -0.75 deg"]["alpha_mean"] == pytest.approx(15.8, abs=0.3)
    assert rows["stabilator trim -0.75 deg"]["alpha_sd"] == pytest.approx(3.19, abs=0.3)


def test_tables_have_all_rows(benchmark, output):
    words = benchmark.table(output["rows"]) + benchmark.hypothesis_table(output["rows"])
    assert words.count("report") >= 4
    for hypothesis in benchmark.HYPOTHESES:
        assert (hypothesis.name in words) == any(
            case.startswith(hypothesis.cases) for case in ("longitudinal 2", "lateral 3")
        )
