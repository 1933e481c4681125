"""Verdicts on the claims of the report for our aircraft: one function and its numbers for each."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.stats import spearmanr

from benchmarks.report_numbers.claims import CLAIMS, SEPARATE, Claim
from benchmarks.report_tables.cases import CaseResult
from benchmarks.report_tables.comparisons import combined, on_common_angles, predicted
from benchmarks.report_tables.examples import Small
from benchmarks.report_tables.reasons import REASONS
from benchmarks.report_tables.rows import estimated, strongest_terms

LARGER, JOINT, FIRST_10_S = (
    "lateral 1, larger set",
    "lateral 1 and 4 together",
    "coupled 1, first 10 s",
)
GOOD = 0.25  # Theil's coefficient, as in `jaxid.diagnosis.statistics`
SIX = (
    *(("Cl", "static"), ("Cn", "static"), ("CY", "static")),
    *(("Cn", "d/d rudder"), ("Cn", "d/d aileron"), ("Cl", "d/d aileron")),
)

Results = Mapping[str, CaseResult]
Examples = Mapping[str, Small]
Finding = tuple[bool, str]


class Verdict(NamedTuple):
    """Verdict on a claim.

    Attributes:
        name, section, page: of the claim.
        holds: None where its cases were not run.
        numbers: deciding numbers, in words.
        reason: known reason why it does not hold; else empty.
    """

    name: str
    section: str
    page: int
    holds: bool | None
    numbers: str
    reason: str


def verdicts(results: Results, examples: Examples, seed: int = 0) -> list[Verdict]:
    """Return the verdict on each claim, in the order of `CLAIMS`.

    For the default seed a claim that does not hold has a reason.

    Args:
        results: results by name of the case or of the further fit.
        examples: small manoeuvres by name.
        seed: seed of the results; other seeds have other instrument errors and no reasons.
    """
    judged = [_verdict(claim, results, examples) for claim in CLAIMS]
    return judged if seed == 0 else [one._replace(reason="") for one in judged]


def _verdict(claim: Claim, results: Results, examples: Examples) -> Verdict:
    identity = (claim.name, claim.section, claim.page)
    decide, also = DECISIONS[claim.name]
    missing = [
        name for name in (*claim.cases, *also) if name not in results and name not in examples
    ]
    if missing:
        return Verdict(*identity, None, f"not run: {', '.join(missing)}", "")
    holds, numbers = decide(results, examples)
    return Verdict(*identity, bool(holds), numbers, "" if holds else REASONS.get(claim.name, ""))


def _grows(results: Results, _: Examples) -> Finding:
    holds, details = True, []
    for case in SEPARATE:
        growth = [last / first for first, _, last in estimated(results[case]).values()]
        holds = holds and np.median(growth) > 1
        details.append(
            f"{case}: {np.sum(np.array(growth) > 1)} of {len(growth)} grew, median ratio "
            f"{np.median(growth):.3g}"
        )
    return holds, "; ".join(details)


def _order(results: Results, _: Examples) -> Finding:
    correlations = {}
    for case in (*SEPARATE, "lateral 2"):
        F = np.array([(first, last) for first, _, last in estimated(results[case]).values()])
        correlations[case] = float(spearmanr(F[:, 0], F[:, 1]).statistic)
    holds = (
        min(correlations[case] for case in SEPARATE) > 0.7
        and correlations["lateral 2"] < correlations["lateral 1"]
    )
    return holds, "rank correlation " + ", ".join(
        f"{case} {value:.2f}" for case, value in correlations.items()
    )


def _one_size(results: Results, _: Examples) -> Finding:
    holds, details = True, []
    for case in SEPARATE:
        ratio = np.array([start / first for first, start, _ in estimated(results[case]).values()])
        near = int(np.sum((ratio >= 0.1) & (ratio <= 10)))
        holds = holds and 2 * near >= ratio.size
        details.append(
            f"{case}: {near} of {ratio.size} within a factor of 10, median ratio "
            f"{np.median(ratio):.2g}"
        )
    return holds, "; ".join(details)


def _bands(results: Results, _: Examples) -> Finding:
    def shares(case, names):
        return {
            name: results[case].error(name).inside for name in names if _has(results[case], name)
        }

    lateral, longitudinal = (
        shares("lateral 1", ("CY", "Cl", "Cn")),
        shares("longitudinal 1", ("CX", "CZ", "Cm")),
    )
    details = ", ".join(
        f"{name} {100 * share:.0f} %" for name, share in (lateral | longitudinal).items()
    )
    return min(lateral.values()) > 0.5, "samples inside: " + details


def _survive(results: Results, _: Examples) -> Finding:
    low, high = (results[case].identified.equations for case in ("lateral 1", "lateral 2"))
    lost = [
        f"{name}.{term}"
        for name, one in high.items()
        for term in one.estimated
        if term not in low[name].estimated
    ]
    strong = sum(len(one.estimated) for one in high.values())
    chosen = [sum(len(one.regression.names) for one in each.values()) for each in (low, high)]
    details = f"{strong - len(lost)} of {strong} strong terms of lateral 2 are strong in lateral 1"
    new = f" (new: {', '.join(lost)})" if lost else ""
    return not lost, f"{details}{new}; chosen: {chosen[1]} in place of {chosen[0]}"


def _lowers(results: Results, _: Examples) -> Finding:
    low, high = (estimated(results[case]) for case in ("lateral 1", "lateral 2"))
    ratios = [low[name][2] / high[name][2] for name in low if name in high]
    median = float(np.median(ratios)) if ratios else float("nan")
    return 3 <= median <= 30, f"median ratio of final F {median:.3g}, of {len(ratios)} terms"


def _gusts(results: Results, _: Examples) -> Finding:
    pairs = {
        name: tuple(
            strongest_terms(results[case], name, count) for case in ("lateral 1", "lateral 3")
        )
        for name, count in (("CY", 1), ("Cl", 1), ("Cn", 2))
    }
    holds = all(set(first) == set(second) for first, second in pairs.values())
    return holds, "; ".join(
        f"{name}: {', '.join(a)} and {', '.join(b)}" for name, (a, b) in pairs.items()
    )


def _amplitude(results: Results, _: Examples) -> Finding:
    cases = {case: results[case] for case in ("longitudinal 1", "longitudinal 2")}
    errors = {name: one.error("Cm") for name, one in cases.items()}
    common = on_common_angles(cases)
    details = [
        f"{name}: shape {errors[name].shape:.3f}, whole {errors[name].relative:.3f}, rms "
        f"{errors[name].rms:.4f}, on the "
        f"angles of both {common[name]:.4f}, d/d stabilator rms "
        f"{one.error('Cm', 'd/d stabilator').rms:.3f} per rad"
        for name, one in cases.items()
    ]
    return errors["longitudinal 2"].shape < errors["longitudinal 1"].shape, "; ".join(details)


def _combined(results: Results, _: Examples) -> Finding:
    slopes = combined(results["lateral 1"], results["lateral 4"], results[JOINT])
    edges = np.degrees(slopes.alpha[[0, -1]])
    details = ", ".join(f"{name} {value:.4f}" for name, value in slopes.rms.items())
    holds = slopes.rms["combined"] < min(slopes.rms["lateral 1"], slopes.rms["lateral 4"])
    return holds, f"rms error of dCn/dbeta, {edges[0]:.1f} to {edges[1]:.1f} deg: {details}"


def _larger(results: Results, _: Examples) -> Finding:
    small, large = results["lateral 1"], results[LARGER]
    pairs = {
        f"{name} {part}": (small.error(name, part).relative, large.error(name, part).relative)
        for name, part in SIX
    }
    worse = sum(b > a for a, b in pairs.values())
    details = ", ".join(f"{name} {a:.3f} to {b:.3f}" for name, (a, b) in pairs.items())
    count = f"{small.fitted.parameters} to {large.fitted.parameters} parameters"
    return (
        worse > 3,
        f"{count}: {worse} of 6 errors larger ({details}); cost {small.fitted.Jf:.3f} to "
        f"{large.fitted.Jf:.3f}",
    )


def _longer(results: Results, _: Examples) -> Finding:
    names = ("coupled 1", "longitudinal 1", "longitudinal 2", FIRST_10_S)
    errors = {
        name: results[name].error("Cm").relative for name in names if _has(results[name], "Cm")
    }
    fits = {name: results[name] for name in names[:3] if name in errors}
    common = ", ".join(f"{name} {value:.4f}" for name, value in on_common_angles(fits).items())
    other_errors = [
        f"{name} {results['coupled 1'].error(name).relative:.3f} against "
        f"{results[case].error(name).relative:.3f}"
        for case, names in (("lateral 1", ("CY", "Cl", "Cn")), ("longitudinal 1", ("CZ",)))
        for name in names
        if case in results and _has(results["coupled 1"], name) and _has(results[case], name)
    ]
    lost = {
        name: ""
        if bool(results[name].identified.estimate.successful)
        else " (by regression: no fit)"
        for name in errors
    }
    details = ", ".join(f"{name} {value:.3f}{lost[name]}" for name, value in errors.items())
    holds = errors.get("coupled 1", np.inf) < min(
        errors[case] for case in ("longitudinal 1", "longitudinal 2")
    )
    return holds, f"error of Cm: {details}; rms on the angles of all: {common}; " + ", ".join(
        other_errors
    )


def _predicts(results: Results, _: Examples) -> Finding:
    prediction = predicted(results["coupled 1"], results["coupled 2"].flights[0])
    details = ", ".join(
        f"{name} {value:.2f} ({prediction.theil_of_fit[name]:.2f})"
        for name, value in prediction.theil.items()
    )
    static = ", ".join(
        f"{one.coefficient} {one.relative:.3f}" for one in prediction.errors if one.part == "static"
    )
    return max(
        prediction.theil.values()
    ) < GOOD, f"Theil's coefficient (of the fit): {details}; errors in case 2: {static}"


def _sign(_: Results, examples: Examples) -> Finding:
    pair = [examples[f"rudder doublet at {alpha} deg"] for alpha in (15, 25)]
    holds = all(np.sign(one.values["beta"]) == np.sign(one.slope) for one in pair)
    details = [f"{one.case}: {one.values['beta']:+.3f}, tables {one.slope:+.3f}" for one in pair]
    return holds, "; ".join(details)


def _has(result: CaseResult, coefficient: str) -> bool:
    equation = result.identified.equations.get(coefficient)
    return equation is not None and equation.kept


DECISIONS: dict[str, tuple[Callable[[Results, Examples], Finding], tuple[str, ...]]] = {
    "F grows in the second stage": (_grows, ()),
    "the order of F is kept": (_order, ()),
    "both stages give F of one size": (_one_size, ()),
    "the bands hold the truth": (_bands, ()),
    "the leading terms survive high noise": (_survive, ()),
    "high noise lowers F": (_lowers, ()),
    "the leading terms survive gusts": (_gusts, ()),
    "small amplitude improves Cm": (_amplitude, ()),
    "two experiments combined beat each": (_combined, (JOINT,)),
    "twelve parameters beat twenty-two": (_larger, (LARGER,)),
    "a longer coupled record improves Cm": (_longer, (FIRST_10_S,)),
    "case 1 predicts case 2": (_predicts, ()),
    "the slope of Cn changes its sign": (_sign, ()),
}
