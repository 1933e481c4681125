"""Comparison of one search over hypotheses (`jaxid.loop`) with its truth, as numbers for JSON.

The keys are those of `measure`, so that both searches compare on the same seeds.
"""

import time
from typing import Any

import numpy as np

from benchmarks.missing_effects.reference import mean_log as mean_log_of
from benchmarks.missing_effects.reference import reference
from benchmarks.missing_effects.scenarios import Flown, Planted, Scenario, System
from jaxid import OutputError
from jaxid.data.record import Record
from jaxid.estimation.estimate import as_stack
from jaxid.loop import Coloured, EffectSearch, LoopProblem, search_effects
from jaxid.loop.assess import Verdict, localise_fit
from jaxid.loop.moves import MoveKind, Proposals
from jaxid.loop.options import LoopOptions
from jaxid.study.candidates import candidates
from jaxid.study.outcome import Outcome

OUTCOMES = {
    Verdict.NOTHING_MISSING: Outcome.NOTHING_MISSING,
    Verdict.CAUSE: Outcome.EXPLAINED,
    Verdict.PROXIES: Outcome.PROXIES,
    Verdict.UNEXPLAINED: Outcome.UNEXPLAINED,
}


def run_search(
    system: System, scenario: Scenario, flown: Flown, removed: bool, library=None
) -> dict[str, Any]:
    """Return the summary of one search; with `removed`, without the planted effects.

    Args:
        system, scenario: system and scenario that were flown.
        flown: declared model and records.
        removed: True to leave the planted effects out of the library.
        library: candidates; by default those of `close_loop`.
    """
    parts = [as_stack(list(part)) for part in (flown.train, flown.check, flown.test)]
    train, check, test = parts
    library = library or candidates(flown.model, flown.free, *parts)
    begin, busy = time.perf_counter(), time.process_time()
    problem = LoopProblem.of(
        flown.model, library, flown.free, OutputError(), train, check, window=system.window
    )
    if removed:
        cards = [effect.card for effect in library]
        names = [
            card.name
            for card in cards
            if any(one.accepts(card.name, card.family) for one in scenario.planted)
        ]
        problem = problem.without(*names)
    found = search_effects(problem, test={"test": test})
    seconds = {"seconds": time.perf_counter() - begin, "processor": time.process_time() - busy}
    summary: dict[str, Any] = seconds | {"failed": None} | _summary(found, scenario.planted, test)
    if removed:
        return summary
    true = reference(scenario, flown, library, system.window)
    return summary | {
        "candidates": len(library),
        "chi_square": true.chi_square,
        "gains": list(true.gains),
        "identifiable": list(true.identifiable),
        "attainable": true.error,
        "ratio": float(np.exp(summary["error_after"] - true.error)),
        "naive": {"first": None, "right": False, "terms": 0},
    }


def _summary(found: EffectSearch, planted: tuple[Planted, ...], test: Record) -> dict[str, Any]:
    """Return the results of a search, and whether they contain the planted effects."""
    tree = found.tree
    families = {name: effect.card.family for name, effect in tree.problem.effects.items()}

    def is_right(name):
        return any(one.accepts(name, families[name]) for one in planted)

    proposals = Proposals(tree.declared, LoopOptions())
    ordered = sorted(proposals.candidates, key=lambda effect: -proposals.score(effect))
    leading = list(dict.fromkeys(effect.card.family for effect in ordered))[:3]
    first = next((s.move.into for s in tree.path if s.move.kind is not MoveKind.NOISE), ())
    where = found.assessment.where or localise_fit(tree.declared)
    near = [place.location for place in where.near_best()]
    expected = {place for one in planted for place in one.places}
    errors = [
        mean_log_of(np.asarray(fitted.predict(test.anonymous()).rms))
        for fitted in (tree.declared, tree.best)
    ]
    others = [
        [list(other.effects), type(other.hypothesis.noise).__name__, worse]
        for other, worse in tree.alternatives()[:3]
    ]
    findings = [[f.check.name, list(f.names), list(f.numbers)] for f in found.assessment.findings]
    return {
        "outcome": _outcome(found).value,
        "effects": list(found.effects),
        "noise": type(found.hypothesis.noise).__name__,
        "alternatives": others,
        "findings": findings,
        "first_right": bool(first) and all(map(is_right, first)),
        "top_three": [
            any(one.accepts(name, name) for name in (*leading, *(families[n] for n in first)))
            for one in planted
        ],
        "in": [any(one.accepts(n, families[n]) for n in found.effects) for one in planted],
        "wrong": sum(not is_right(name) for name in found.effects),
        "where": [location.label for location in near],
        "place_right": bool(set(near) & expected),
        "fall": 2.0 * (tree.declared.cost - tree.best.cost),
        "error_before": errors[0],
        "error_after": errors[1],
        "refits": len(tree.steps),
        "rounds": [],
    }


def _outcome(found: EffectSearch) -> Outcome:
    if found.verdict is Verdict.NOISE:
        coloured = isinstance(found.hypothesis.noise, Coloured)
        return Outcome.COLOURED_NOISE if coloured else Outcome.PROCESS_NOISE
    return OUTCOMES[found.verdict]
