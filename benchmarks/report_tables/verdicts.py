"""Verdicts on the claims of the report for our aircraft: numbers of one seed, shares over seeds.

Each claim has two functions: one takes the results of a seed to its numbers, the other judges the
numbers. Errors of coefficients are absolute, and those of several records are compared on the
angles of attack that all of them cover.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import binomtest, spearmanr

from benchmarks.report_numbers.claims import CLAIMS, SEPARATE
from benchmarks.report_tables.bands import shares
from benchmarks.report_tables.cases import CaseResult
from benchmarks.report_tables.comparisons import combined, on_common_angles, predicted
from benchmarks.report_tables.examples import Small
from benchmarks.report_tables.rows import estimated, strongest_terms

LARGER, JOINT, FIRST_10_S = (
    "lateral 1, larger set",
    "lateral 1 and 4 together",
    "coupled 1, first 10 s",
)
GOOD = 0.25  # Theil's coefficient, as in `jaxid.diagnosis.statistics`
LEVEL = 0.95  # of the interval of a share
SIX = (
    *(("Cl", "static"), ("Cn", "static"), ("CY", "static")),
    *(("Cn", "d/d rudder"), ("Cn", "d/d aileron"), ("Cl", "d/d aileron")),
)
LATERAL = ("CY", "Cl", "Cn")

Results = Mapping[str, CaseResult]
Examples = Mapping[str, Small]
Measured = dict[str, float]


class Decision(NamedTuple):
    """How a claim is decided.

    Attributes:
        measure: numbers of the results of one seed.
        judge: True if the claim holds with these numbers.
        also: further fits that it needs, in addition to the cases of the claim.
    """

    measure: Callable[[Results, Examples], Measured]
    judge: Callable[[Measured], bool]
    also: tuple[str, ...] = ()


class Judged(NamedTuple):
    """A claim in one seed.

    Attributes:
        name: of the claim.
        holds: None where a result that it needs is missing.
        numbers: deciding numbers by name; empty where it is not judged.
        missing: results that it needs and that were not run or failed.
    """

    name: str
    holds: bool | None
    numbers: Measured
    missing: tuple[str, ...]


class Verdict(NamedTuple):
    """A claim over seeds.

    Attributes:
        name, section, page: of the claim.
        held, judged: number of seeds in which it holds, and in which it could be judged.
        share: the first over the second; None where it was never judged.
        low, high: interval of the share, exact binomial, 95 %; 0 and 1 where it was never judged.
        verdict: "holds" if the interval lies above one half, "does not hold" if below, else
            "undecided".
        numbers: medians over the judged seeds.
    """

    name: str
    section: str
    page: int
    held: int
    judged: int
    share: float | None
    low: float
    high: float
    verdict: str
    numbers: Measured


def judge(results: Results, examples: Examples) -> list[Judged]:
    """Return each claim with the results of one seed, in the order of `CLAIMS`.

    Args:
        results: results by name of the case or of the further fit; those without a finite fit are
            left out.
        examples: small manoeuvres by name.
    """
    judged = []
    for claim in CLAIMS:
        decision = DECISIONS[claim.name]
        missing = tuple(
            name
            for name in (*claim.cases, *decision.also)
            if name not in results and name not in examples
        )
        if missing:
            judged.append(Judged(claim.name, None, {}, missing))
            continue
        numbers = decision.measure(results, examples)
        judged.append(Judged(claim.name, bool(decision.judge(numbers)), numbers, ()))
    return judged


def verdicts(seeds: Sequence[Sequence[Judged]]) -> list[Verdict]:
    """Return the verdict on each claim over seeds, in the order of `CLAIMS`.

    Args:
        seeds: the claims of each seed.
    """
    result = []
    for claim in CLAIMS:
        rows = [row for seed in seeds for row in seed if row.name == claim.name]
        rows = [row for row in rows if row.holds is not None]
        held, judged = sum(bool(row.holds) for row in rows), len(rows)
        low, high = 0.0, 1.0
        if judged:
            interval = binomtest(held, judged).proportion_ci(LEVEL, method="exact")
            low, high = float(interval.low), float(interval.high)
        word = "holds" if low > 0.5 else "does not hold" if high < 0.5 else "undecided"
        names = list(dict.fromkeys(name for row in rows for name in row.numbers))
        medians = {
            name: float(np.median([row.numbers[name] for row in rows if name in row.numbers]))
            for name in names
        }
        share = held / judged if judged else None
        identity = (claim.name, claim.section, claim.page)
        result.append(Verdict(*identity, held, judged, share, low, high, word, medians))
    return result


# F grows in the second stage; its order; its size -----------------------------------------------


def measure_growth(results: Results, _: Examples) -> Measured:
    numbers = {}
    for case in SEPARATE:
        growth = np.array([last / first for first, _, last in estimated(results[case]).values()])
        numbers |= {f"{case}: median ratio": float(np.median(growth))}
        numbers |= {f"{case}: grew": float(np.sum(growth > 1)), f"{case}: terms": len(growth)}
    return numbers


def judge_growth(numbers: Measured) -> bool:
    return all(numbers[f"{case}: median ratio"] > 1 for case in SEPARATE)


def measure_order(results: Results, _: Examples) -> Measured:
    correlations = {}
    for case in (*SEPARATE, "lateral 2"):
        F = np.array([(first, last) for first, _, last in estimated(results[case]).values()])
        correlations[case] = float(spearmanr(F[:, 0], F[:, 1]).statistic) if len(F) > 2 else np.nan
    return correlations


def judge_order(numbers: Measured) -> bool:
    near = min(numbers[case] for case in SEPARATE) > 0.7
    return near and numbers["lateral 2"] < numbers["lateral 1"]


def measure_size(results: Results, _: Examples) -> Measured:
    numbers = {}
    for case in SEPARATE:
        ratio = np.array([start / first for first, start, _ in estimated(results[case]).values()])
        near = np.sum((ratio >= 0.1) & (ratio <= 10))
        numbers |= {f"{case}: near": float(near), f"{case}: terms": ratio.size}
        numbers |= {f"{case}: median ratio": float(np.median(ratio))}
    return numbers


def judge_size(numbers: Measured) -> bool:
    return all(2 * numbers[f"{case}: near"] >= numbers[f"{case}: terms"] for case in SEPARATE)


# Bands, noise and gusts -------------------------------------------------------------------------


def measure_bands(results: Results, _: Examples) -> Measured:
    rows = [row for case in SEPARATE for row in shares(results[case])]
    combined = {row.coefficient: row.inside["with instruments"] for row in rows}
    alone = {f"{row.coefficient}, parameters": row.inside["parameters"] for row in rows}
    return combined | alone


def judge_bands(numbers: Measured) -> bool:
    return all(numbers.get(name, 0.0) > 0.5 for name in LATERAL)


def measure_survival(results: Results, _: Examples) -> Measured:
    low, high = (results[case].identified.equations for case in ("lateral 1", "lateral 2"))
    strong = [(name, term) for name, one in high.items() for term in one.estimated]
    new = [pair for pair in strong if pair[1] not in low[pair[0]].estimated]
    chosen = [sum(len(one.regression.names) for one in each.values()) for each in (low, high)]
    return {
        "strong terms of lateral 2": len(strong),
        "not strong in lateral 1": len(new),
        "chosen in lateral 1": chosen[0],
        "chosen in lateral 2": chosen[1],
    }


def judge_survival(numbers: Measured) -> bool:
    return numbers["strong terms of lateral 2"] > 0 and numbers["not strong in lateral 1"] == 0


def measure_noise(results: Results, _: Examples) -> Measured:
    low, high = (estimated(results[case]) for case in ("lateral 1", "lateral 2"))
    ratios = [low[name][2] / high[name][2] for name in low if name in high]
    return {"median ratio": float(np.median(ratios)) if ratios else np.nan, "terms": len(ratios)}


def judge_noise(numbers: Measured) -> bool:
    return 3 <= numbers["median ratio"] <= 30


def measure_gusts(results: Results, _: Examples) -> Measured:
    return {
        name: float(
            set(strongest_terms(results["lateral 1"], name, count))
            == set(strongest_terms(results["lateral 3"], name, count))
        )
        for name, count in (("CY", 1), ("Cl", 1), ("Cn", 2))
    }


def judge_gusts(numbers: Measured) -> bool:
    return min(numbers.values()) == 1.0


# Inputs, several records, more parameters -------------------------------------------------------


def measure_amplitude(results: Results, _: Examples) -> Measured:
    cases = {case: results[case] for case in ("longitudinal 1", "longitudinal 2")}
    common = on_common_angles(cases)
    numbers = {"from deg": common.low_deg, "to deg": common.high_deg}
    for case in cases:
        numbers |= {f"{case}: shape": common.shape[case], f"{case}: rms": common.rms[case]}
        slope = cases[case].error("Cm", "d/d stabilator").rms
        numbers |= {f"{case}: d/d stabilator per rad": slope}
    return numbers


def judge_amplitude(numbers: Measured) -> bool:
    return numbers["longitudinal 2: shape"] < numbers["longitudinal 1: shape"]


def measure_combination(results: Results, _: Examples) -> Measured:
    slopes = combined(results["lateral 1"], results["lateral 4"], results[JOINT])
    edges = np.degrees(slopes.alpha[[0, -1]])
    return {"from deg": float(edges[0]), "to deg": float(edges[1]), **slopes.rms}


def judge_combination(numbers: Measured) -> bool:
    return numbers["combined"] < min(numbers["lateral 1"], numbers["lateral 4"])


def measure_larger(results: Results, _: Examples) -> Measured:
    small, large = results["lateral 1"], results[LARGER]
    numbers, worse = {}, 0
    for name, part in SIX:
        pair = [one.error(name, part).rms for one in (small, large)]
        numbers |= {f"{name} {part}: fewer": pair[0], f"{name} {part}: more": pair[1]}
        worse += pair[1] > pair[0]
    numbers |= {"larger errors of six": worse}
    numbers |= {"cost, fewer": small.fitted.Jf, "cost, more": large.fitted.Jf}
    return numbers


def judge_larger(numbers: Measured) -> bool:
    return numbers["larger errors of six"] > 3


def measure_longer(results: Results, _: Examples) -> Measured:
    three = ("coupled 1", "longitudinal 1", "longitudinal 2")
    numbers = {f"Cm: {case}": rms for case, rms in _common(results, three, "Cm", None).items()}
    if FIRST_10_S in results and has(results[FIRST_10_S], "Cm"):
        pair = _common(results, ("coupled 1", FIRST_10_S), "Cm", None)
        numbers |= {f"Cm, first 10 s: {case}": rms for case, rms in pair.items()}
    for case, names, by in (("lateral 1", LATERAL, "beta"), ("longitudinal 1", ("CZ",), None)):
        for name in names:
            if case in results and has(results[case], name) and has(results["coupled 1"], name):
                pair = _common(results, ("coupled 1", case), name, by)
                numbers |= {f"{name}: {one}": rms for one, rms in pair.items()}
    return numbers


def judge_longer(numbers: Measured) -> bool:
    separate = [numbers.get(f"Cm: {case}", np.inf) for case in ("longitudinal 1", "longitudinal 2")]
    return numbers.get("Cm: coupled 1", np.inf) < min(separate)


def _common(results: Results, cases, coefficient: str, by: str | None) -> dict[str, float]:
    have = {case: results[case] for case in cases if has(results[case], coefficient)}
    return on_common_angles(have, coefficient, by).rms if have else {}


# Prediction and the sign of a slope -------------------------------------------------------------


def measure_prediction(results: Results, _: Examples) -> Measured:
    prediction = predicted(results["coupled 1"], results["coupled 2"].flights[0])
    numbers = {f"Theil {name}": value for name, value in prediction.theil.items()}
    numbers |= {f"Theil of the fit {k}": value for k, value in prediction.theil_of_fit.items()}
    static = [one for one in prediction.errors if one.part == "static"]
    return numbers | {f"rms {one.coefficient}": one.rms for one in static}


def judge_prediction(numbers: Measured) -> bool:
    theil = [v for k, v in numbers.items() if k.startswith("Theil ") and "fit" not in k]
    return all(value < GOOD for value in theil)  # nan, of a diverging prediction, is not below


def measure_sign(_: Results, examples: Examples) -> Measured:
    numbers = {}
    for alpha in (15, 25):
        one = examples[f"rudder doublet at {alpha} deg"]
        numbers |= {f"{alpha} deg": one.values["beta"], f"{alpha} deg, tables": one.slope}
    return numbers


def judge_sign(numbers: Measured) -> bool:
    return all(
        np.sign(numbers[f"{alpha} deg"]) == np.sign(numbers[f"{alpha} deg, tables"])
        for alpha in (15, 25)
    )


def has(result: CaseResult, coefficient: str) -> bool:
    """Return True if a result has an equation of this coefficient."""
    equation = result.identified.equations.get(coefficient)
    return equation is not None and equation.kept


DECISIONS: dict[str, Decision] = {
    "F grows in the second stage": Decision(measure_growth, judge_growth),
    "the order of F is kept": Decision(measure_order, judge_order),
    "both stages give F of one size": Decision(measure_size, judge_size),
    "the bands hold the truth": Decision(measure_bands, judge_bands),
    "the leading terms survive high noise": Decision(measure_survival, judge_survival),
    "high noise lowers F": Decision(measure_noise, judge_noise),
    "the leading terms survive gusts": Decision(measure_gusts, judge_gusts),
    "small amplitude improves Cm": Decision(measure_amplitude, judge_amplitude),
    "two experiments combined beat each": Decision(
        measure_combination, judge_combination, (JOINT,)
    ),
    "twelve parameters beat twenty-two": Decision(measure_larger, judge_larger, (LARGER,)),
    "a longer coupled record improves Cm": Decision(measure_longer, judge_longer),
    "case 1 predicts case 2": Decision(measure_prediction, judge_prediction),
    "the slope of Cn changes its sign": Decision(measure_sign, judge_sign),
}
