"""Tests of the benchmark of the report's cases, and of the choice of unprinted trims and inputs."""

import contextlib
import importlib
import io
import json
from pathlib import Path

import numpy as np
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
        benchmark.main(arguments)
    return json.loads(words.getvalue())


def ours(benchmark, output, case):
    return next(
        row for row in output["rows"] if (row["case"], row["reading"]) == (case, benchmark.OURS)
    )


def test_json_has_one_row_per_case_and_reading(benchmark, output):
    largest = max(
        abs(difference)
        for row in output["rows"]
        if row["reading"] == benchmark.OURS
        for difference in row["difference"].values()
    )
    assert output["largest difference"] == largest
    assert output["status"] == ("within 1 deg" if largest <= 1 else "not within 1 deg")
    readings = [row["reading"] for row in output["rows"] if row["case"] == "lateral 3"]
    assert readings[0] == benchmark.OURS
    assert (
        len(readings)
        == len(set(readings))
        == 1 + sum("lateral 3".startswith(h.cases) for h in benchmark.HYPOTHESES)
    )
    assert set(benchmark.PRINTED) == set(benchmark.CASES)


def test_symmetric_flight_has_sideslip_only_in_vane_noise(benchmark, output):
    row = ours(benchmark, output, "longitudinal 2")
    assert row["true"]["beta_sd"] == pytest.approx(0.0, abs=1e-12)
    assert row["measured"]["beta_sd"] == pytest.approx(
        0.05, rel=0.25
    )  # base noise, five standard errors of 200 samples
    assert row["difference"]["alpha_mean"] == pytest.approx(
        row["measured"]["alpha_mean"] - 15.8, abs=1e-12
    )


def test_chosen_trim_takes_longitudinal_2_over_the_hump(benchmark, output):
    """With the pitching moment balanced at the start the flight turns back below the pitch-up."""
    rows = {
        row["reading"]: row["true"] for row in output["rows"] if row["case"] == "longitudinal 2"
    }
    ours, balanced = rows[benchmark.OURS], rows[benchmark.BALANCED]
    assert ours["alpha_mean"] == pytest.approx(15.8, abs=1.0)
    assert ours["alpha_sd"] == pytest.approx(3.19, abs=1.0)
    assert balanced["alpha_mean"] < 15.8 - 3.0


@pytest.fixture(scope="module")
def choices():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)
        yield importlib.import_module("benchmarks.report_choices")


def test_true_statistics_are_within_1_deg_of_the_printed_ones(benchmark, choices):
    """All cases without gusts; `python -m benchmarks.report_cases` takes errors and gusts too."""
    trims, start, pull = choices.declared()
    for case in ("lateral 1", "lateral 2", "lateral 4", "longitudinal 1", "longitudinal 2"):
        pulls = 2 * [pull] if case == "lateral 4" else []
        ours, _ = choices.statistics(choices.angles(case, 2 * [trims[case]], pulls, start))
        for value, printed in zip(ours, benchmark.PRINTED[case], strict=True):
            assert printed is None or abs(value - printed) < 1.0, case


def test_declared_trims_cost_least_among_their_neighbours(choices):
    """In steps of the grid; in the longitudinal cases the range of case 2 binds instead."""
    trims, *_ = choices.declared()
    mean = choices.coupled_mean()
    assert mean == pytest.approx(12.4, abs=0.1)
    for step in (-0.1, 0.1):  # always two flights: one compiled program
        both = choices.angles("coupled 1", [trims["coupled 1"], trims["coupled 1"] + step])
        ours, other = np.abs(both[:, 0].mean(axis=1) - mean)
        assert ours < other
    one, two = (
        choices.angles(f"longitudinal {k}", [trims[f"longitudinal {k}"] + step for step in steps])
        for k, steps in ((1, (0.0, 0.1)), (2, (-0.1, 0.0)))
    )
    (kept, calmer), (larger, inside) = one[:, 0], two[:, 0]
    assert kept.min() <= inside.min()
    assert inside.max() <= kept.max()
    assert larger.max() > kept.max()
    assert calmer.max() < inside.max()
    assert choices.cost("longitudinal 1", choices.statistics(one[1:])) < choices.cost(
        "longitudinal 1", choices.statistics(one[:1])
    )


def test_tables_have_all_rows(benchmark, output):
    words = benchmark.table(output["rows"]) + benchmark.hypothesis_table(output["rows"])
    assert words.count("report") >= 4
    for hypothesis in benchmark.HYPOTHESES:
        assert (hypothesis.name in words) == any(
            case.startswith(hypothesis.cases) for case in ("longitudinal 2", "lateral 3")
        )
