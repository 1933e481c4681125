"""Tests of the report-tables benchmark: one case as JSON, and its pure functions."""

import contextlib
import importlib
import io
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from jaxid.aircraft.airframes import f4
from jaxid.aircraft.flight.report_cases import CASES

ROOT = Path(__file__).resolve().parents[2]
CASE = "longitudinal 2"


def module(name):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        return importlib.import_module(f"benchmarks.{name}")


@pytest.fixture(scope="module")
def output():
    """One case, as JSON; without the errors of whole coefficients, which take a compilation of
    their own.
    """
    main, words = module("report_tables.__main__"), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(words):
        patch.setattr(main, "run", partial(main.run, totals=False))
        assert main.main(["--json", "--cases", CASE]) == 0
    return json.loads(words.getvalue())


def test_json_has_both_stages_and_printed_numbers(output):
    assert output["status"] == "converged"
    (result,) = output["cases"].values()
    rows = {(row["response"], row["term"]): row for row in result["parameters"]}
    assert rows["Cm", "stabilator"]["printed"] == {
        "regression": -0.5,
        "F_regression": 4190.0,
        "F_start": 688.0,
        "final": -0.529,
        "F_final": 11200.0,
    }
    for name, equation in result["equations"].items():
        for term in equation["estimated"]:
            assert all(np.isfinite([*rows[name, term]["ours"].values()])), (name, term)
    free = [row for row in rows.values() if row["ours"]["final"] is not None]
    assert result["fit"]["parameters"] == len(free)
    assert result["fit"]["Jf"] < result["fit"]["J0"]


def test_cost_equals_formula_of_table_4_2(output):
    """Table 4.2: the sum of ln(sigma) and half the number of outputs, accelerations in g; a fit of
    all samples has just that.
    """
    result = output["cases"][CASE]
    sigma = [*result["sigma"].values()]
    np.testing.assert_allclose(
        result["fit"]["Jf"], np.sum(np.log(sigma)) + len(sigma) / 2, rtol=1e-9
    )


def test_errors_cover_all_kept_equations(output):
    result = output["cases"][CASE]
    kept = {name for name, one in result["equations"].items() if one["kept"]}
    (errors,) = result["errors"]
    assert {one["coefficient"] for one in errors if one["part"] == "static"} == kept
    for one in errors:
        assert 0 <= one["inside"] <= 1
        np.testing.assert_allclose(one["relative"], one["rms"] / one["range"], rtol=1e-12)
    curve = output["Cm over alpha"][CASE]
    assert len(curve["alpha"]) == len(curve["true"]) == len(curve["value"])


def test_claim_without_its_cases_has_no_verdict(output):
    claims = module("report_numbers.claims").CLAIMS
    assert [one["name"] for one in output["verdicts"]] == [one.name for one in claims]
    assert all(one["holds"] is None for one in output["verdicts"])


def test_all_claims_and_cases_have_decisions_and_settings():
    verdicts, claims = module("report_tables.verdicts"), module("report_numbers.claims").CLAIMS
    assert set(verdicts.DECISIONS) == {one.name for one in claims}
    assert set(module("report_tables.reasons").REASONS) <= set(verdicts.DECISIONS)
    assert set(module("report_tables.settings").SETTINGS) == set(CASES)
    assert {verdicts.LARGER, verdicts.JOINT, verdicts.FIRST_10_S} == set(
        module("report_tables.__main__").MORE
    )


def test_error_of_history_equals_hand_calculation():
    part = module("report_tables.coefficients")
    true, apart = np.array([0.0, 1.0, 2.0, 4.0]), np.array([0.3, 0.1, 0.3, 0.1])
    error = part.error_of("Cm", "static", part.Estimated(true + apart, np.full(4, 0.06), true))
    np.testing.assert_allclose((error.rms, error.range, error.inside), (np.sqrt(0.05), 4.0, 0.5))
    np.testing.assert_allclose((error.relative, error.shape), (np.sqrt(0.05) / 4.0, 0.1 / 4.0))


def test_table_derivative_equals_central_difference():
    part = module("report_tables.coefficients")
    at, step = {"alpha": np.radians([11.0, 17.0]), "beta": np.radians([2.0, -4.0])}, 1e-6
    tables = f4().aerodynamics
    there, back = (
        part.true_part(tables, "Cn", at | {"beta": at["beta"] + by}) for by in (step, -step)
    )
    np.testing.assert_allclose(
        part.true_part(tables, "Cn", at, "beta"), (there - back) / (2 * step), rtol=1e-6
    )


def test_plain_converts_arrays_and_nonfinite_numbers_for_json():
    plain = module("report_tables.text").plain
    small = module("report_tables.rows").Numbers(1.0)
    assert plain(
        {"a": (np.float64(2.0), np.array([1.0, np.inf])), "b": small, "c": np.bool_(True)}
    ) == {
        "a": [2.0, [1.0, None]],
        "b": {
            "regression": 1.0,
            "F_regression": None,
            "F_start": None,
            "final": None,
            "F_final": None,
        },
        "c": True,
    }
