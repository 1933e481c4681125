"""Tests of the verdicts on the report's claims: each claim on the report's own numbers or on
made-up results, held and not held.
"""

import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jaxid.aircraft.flight.report_cases import CASES

ROOT = Path(__file__).resolve().parents[2]


def module(name):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        return importlib.import_module(f"benchmarks.{name}")


@pytest.fixture(scope="module")
def verdicts():
    return module("report_tables.verdicts")


def parameter(name, regression, start, final):
    return SimpleNamespace(name=name, regression_F=regression, start_F=start, F=final)


def result(F=(), equations=(), errors=(), cost=0.0, flights=()):
    """A result with what the claims read: F by term, equations, and errors by part.

    Args:
        F: (regression, start, final) by name of the term.
        equations: (terms with F, estimated terms) by coefficient.
        errors: rms by coefficient and part.
    """
    F, equations, errors = dict(F), dict(equations), dict(errors)
    kept = {
        name: SimpleNamespace(
            kept=True,
            estimated=estimated,
            regression=SimpleNamespace(names=tuple(terms), F=np.array(list(terms.values()))),
        )
        for name, (terms, estimated) in equations.items()
    }
    return SimpleNamespace(
        identified=SimpleNamespace(
            parameters=[parameter(name, *row) for name, row in F.items()], equations=kept
        ),
        error=lambda name, part="static": SimpleNamespace(rms=errors[name, part]),
        fitted=SimpleNamespace(Jf=cost),
        flights=flights,
    )


def printed(case, table):
    """F of the report: regression, start, and final by term, without constants and biases."""
    return {
        f"{row.response}.{row.term}": (row.F_regression, row.F_start, row.F_final)
        for row in module("report_numbers").likelihood(case)
        if row.table == table and row.F_regression is not None
    }


def regression(case):
    """Equations of the report's regression, with the terms that the 4 % rule keeps."""
    equations = {}
    for row in module("report_numbers").regression(case):
        terms, kept = equations.setdefault(row.response, ({}, []))
        if row.F is not None:
            terms[row.term] = row.F
            kept += [row.term] * row.kept
    return equations


@pytest.fixture(scope="module")
def report():
    """The report's own numbers as results."""
    cases = {
        "lateral 1": result(printed("lateral 1", "6.5"), regression("lateral 1")),
        "lateral 2": result(printed("lateral 2", "6.8"), regression("lateral 2")),
        "lateral 3": result((), regression("lateral 3")),
        "longitudinal 1": result(printed("longitudinal 1", "6.5")),
    }
    return cases


def decided(verdicts, name, results, examples=()):
    decision = verdicts.DECISIONS[name]
    numbers = decision.measure(dict(results), dict(examples))
    return numbers, decision.judge(numbers)


def test_growth_of_F(verdicts, report):
    name = "F grows in the second stage"
    numbers, holds = decided(verdicts, name, report)
    assert holds
    assert (numbers["lateral 1: grew"], numbers["longitudinal 1: grew"]) == (7, 8)
    fell = {key: (F[2], F[1], F[0]) for key, F in printed("lateral 1", "6.5").items()}
    assert not decided(verdicts, name, report | {"lateral 1": result(fell)})[1]


def test_order_of_F(verdicts, report):
    name = "the order of F is kept"
    numbers, holds = decided(verdicts, name, report)
    assert holds
    np.testing.assert_allclose(list(numbers.values()), [0.88, 0.75, 0.68], atol=0.005)
    assert not decided(verdicts, name, report | {"lateral 2": report["lateral 1"]})[1]


def test_size_of_F(verdicts, report):
    name = "both stages give F of one size"
    numbers, holds = decided(verdicts, name, report)
    assert holds
    assert (numbers["lateral 1: near"], numbers["longitudinal 1: near"]) == (7, 5)
    far = {key: (F[0], 20.0 * F[0], F[2]) for key, F in printed("lateral 1", "6.5").items()}
    assert not decided(verdicts, name, report | {"lateral 1": result(far)})[1]


@pytest.mark.parametrize(
    ("combined", "expected"),
    [
        ({"CY": 0.6, "Cl": 0.6, "Cn": 0.6}, True),
        ({"CY": 0.5, "Cl": 0.6, "Cn": 0.6}, False),
        ({"CY": 1.0, "Cl": 1.0}, False),  # Cn was left out
    ],
)
def test_bands(verdicts, monkeypatch, combined, expected):
    """The combined bands of lateral 1 decide, whatever the others."""

    def shares(case):
        each = combined if case == "lateral 1" else {"CX": 0.1, "Cm": 0.1}
        return [
            SimpleNamespace(coefficient=name, inside={"with instruments": share, "parameters": 0.2})
            for name, share in each.items()
        ]

    monkeypatch.setattr(verdicts, "shares", shares)
    cases = {name: name for name in ("lateral 1", "longitudinal 1")}
    numbers, holds = decided(verdicts, "the bands hold the truth", cases)
    assert holds is expected
    assert (numbers["Cl"], numbers["Cl, parameters"]) == (combined["Cl"], 0.2)


def test_survival_of_terms(verdicts, report):
    name = "the leading terms survive high noise"
    numbers, holds = decided(verdicts, name, report)
    assert holds
    assert numbers == {
        "strong terms of lateral 2": 7,
        "not strong in lateral 1": 0,
        "chosen in lateral 1": 27,
        "chosen in lateral 2": 8,
    }
    other = result(equations=regression("lateral 2") | {"CY": ({"beta^3": 9.0}, ("beta^3",))})
    assert not decided(verdicts, name, report | {"lateral 2": other})[1]


def test_noise_lowers_F(verdicts, report):
    """The report's own median is 2.8, outside the bounds of "about ten times"."""
    name = "high noise lowers F"
    numbers, holds = decided(verdicts, name, report)
    assert not holds
    assert numbers["median ratio"] == pytest.approx(2.8, abs=0.05)
    lower = {key: (F[0], F[1], 0.1 * F[2]) for key, F in printed("lateral 1", "6.5").items()}
    assert decided(verdicts, name, report | {"lateral 2": result(lower)})[1]


def test_gusts(verdicts, report):
    name = "the leading terms survive gusts"
    assert decided(verdicts, name, report)[1]
    other = result(equations=regression("lateral 3") | {"CY": ({"rhat": 9.0, "beta": 1.0}, ())})
    numbers, holds = decided(verdicts, name, report | {"lateral 3": other})
    assert (numbers, holds) == ({"CY": 0.0, "Cl": 1.0, "Cn": 1.0}, False)


@pytest.mark.parametrize(("shape", "expected"), [(0.001, True), (0.003, False)])
def test_amplitude(verdicts, monkeypatch, shape, expected):
    """The shape on the common angles decides, whatever the whole error."""

    def common(cases, coefficient="Cm", by=None):
        ours = dict(zip(cases, (0.002, shape), strict=True))
        return SimpleNamespace(
            low_deg=10.0, high_deg=20.0, rms=dict.fromkeys(cases, 1.0), shape=ours
        )

    monkeypatch.setattr(verdicts, "on_common_angles", common)
    case = result(errors={("Cm", "d/d stabilator"): 0.1})
    cases = {"longitudinal 1": case, "longitudinal 2": case}
    assert decided(verdicts, "small amplitude improves Cm", cases)[1] is expected


@pytest.mark.parametrize(("rms", "expected"), [(0.009, True), (0.015, False)])
def test_combination(verdicts, monkeypatch, rms, expected):
    slopes = SimpleNamespace(
        alpha=np.radians([17.5, 20.0]),
        rms={"lateral 1": 0.01, "lateral 4": 0.02, verdicts.JOINT: 0.001, "combined": rms},
    )
    monkeypatch.setattr(verdicts, "combined", lambda *results: slopes)
    cases = dict.fromkeys(("lateral 1", "lateral 4", verdicts.JOINT), result())
    numbers, holds = decided(verdicts, "two experiments combined beat each", cases)
    assert holds is expected
    assert numbers["from deg"] == pytest.approx(17.5)


@pytest.mark.parametrize(("worse", "expected"), [(3, False), (4, True)])
def test_larger_set(verdicts, worse, expected):
    """It holds if more than three of the six errors are larger with more parameters."""
    few = dict.fromkeys(verdicts.SIX, 1.0)
    many = {part: 2.0 if k < worse else 0.5 for k, part in enumerate(verdicts.SIX)}
    cases = {"lateral 1": result(errors=few), verdicts.LARGER: result(errors=many)}
    numbers, holds = decided(verdicts, "twelve parameters beat twenty-two", cases)
    assert (numbers["larger errors of six"], holds) == (worse, expected)


@pytest.mark.parametrize(("rms", "expected"), [(0.5, True), (1.5, False)])
def test_longer_record(verdicts, monkeypatch, rms, expected):
    def common(cases, coefficient="Cm", by=None):
        assert by == ("beta" if coefficient in ("CY", "Cl", "Cn") else None)
        return SimpleNamespace(rms={name: rms if name == "coupled 1" else 1.0 for name in cases})

    monkeypatch.setattr(verdicts, "on_common_angles", common)
    whole = result(equations={name: ({}, ()) for name in ("CY", "CZ", "Cl", "Cm", "Cn")})
    names = ("coupled 1", "longitudinal 1", "longitudinal 2", "lateral 1")
    numbers, holds = decided(
        verdicts, "a longer coupled record improves Cm", dict.fromkeys(names, whole)
    )
    assert holds is expected
    assert numbers["Cn: coupled 1"] == rms


@pytest.mark.parametrize(("largest", "expected"), [(0.2, True), (0.3, False), (np.nan, False)])
def test_prediction(verdicts, monkeypatch, largest, expected):
    """A prediction that diverges, with a Theil coefficient of nan, is no good one."""
    made = SimpleNamespace(
        theil={"alpha": 0.1, "q": largest},
        theil_of_fit={"alpha": 0.9, "q": 0.9},
        errors=(SimpleNamespace(part="static", coefficient="Cm", rms=0.01),),
    )
    monkeypatch.setattr(verdicts, "predicted", lambda *given: made)
    cases = dict.fromkeys(("coupled 1", "coupled 2"), result(flights=(None,)))
    assert decided(verdicts, "case 1 predicts case 2", cases)[1] is expected


@pytest.mark.parametrize(("slope", "expected"), [(-0.1, True), (0.1, False)])
def test_sign_of_slope(verdicts, slope, expected):
    pair = {
        "rudder doublet at 15 deg": SimpleNamespace(values={"beta": 0.05}, slope=0.04),
        "rudder doublet at 25 deg": SimpleNamespace(values={"beta": slope}, slope=-0.06),
    }
    assert decided(verdicts, "the slope of Cn changes its sign", {}, pair)[1] is expected


def test_all_claims_and_cases_have_decisions_and_settings(verdicts):
    claims = module("report_numbers.claims").CLAIMS
    assert list(verdicts.DECISIONS) == [one.name for one in claims]
    assert {verdicts.LARGER, verdicts.JOINT, verdicts.FIRST_10_S} == set(
        module("report_tables.__main__").MORE
    )
    assert set(module("report_tables.settings").SETTINGS) == set(CASES)


def test_share_over_seeds_has_an_exact_interval(verdicts):
    """Clopper and Pearson: of 20 seeds without a failure the lower end is 0.025^(1/20)."""
    name = "high noise lowers F"

    def seeds(held, count, unknown=0):
        rows = [
            verdicts.Judged(name, k < held, {"median ratio": float(k)}, ()) for k in range(count)
        ]
        rows += [verdicts.Judged(name, None, {}, ("lateral 2",))] * unknown
        (one,) = (row for row in verdicts.verdicts([[row] for row in rows]) if row.name == name)
        return one

    whole = seeds(20, 20, unknown=3)
    assert (whole.held, whole.judged, whole.share, whole.verdict) == (20, 20, 1.0, "holds")
    assert whole.low == pytest.approx(0.025 ** (1 / 20))
    assert whole.numbers == {"median ratio": 9.5}
    assert seeds(2, 3).verdict == "undecided"
    assert seeds(0, 6).verdict == "does not hold"
    never = seeds(0, 0, unknown=2)
    assert (never.share, never.low, never.high, never.verdict) == (None, 0.0, 1.0, "undecided")


def test_missing_results_are_named(verdicts, report):
    judged = {row.name: row for row in verdicts.judge({"lateral 1": report["lateral 1"]}, {})}
    row = judged["high noise lowers F"]
    assert (row.holds, row.numbers, row.missing) == (None, {}, ("lateral 2",))
