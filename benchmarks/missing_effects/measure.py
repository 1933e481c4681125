"""Comparison of one study with its truth, as plain numbers for JSON."""

import contextlib
import time
from collections.abc import Iterator
from typing import Any
from unittest import mock

import equinox as eqx
import numpy as np

from benchmarks.missing_effects.measure_search import run_search
from benchmarks.missing_effects.naive import naive
from benchmarks.missing_effects.reference import Reference, mean_log, reference
from benchmarks.missing_effects.scenarios import Flown, Planted, Scenario, System
from jaxid import OutputError, close_loop
from jaxid.effects.base import Effect
from jaxid.estimation.estimate import as_stack
from jaxid.study import Study, doubts
from jaxid.study.candidates import candidates
from jaxid.study.search import Search
from jaxid.study.workbench import Workbench

SHOWN = 6  # candidates of each round kept in the results; chosen


def measure(
    system: System,
    scenario: Scenario,
    seed: int,
    *,
    removed: bool = False,
    library: tuple[Effect, ...] | None = None,
    over_hypotheses: bool = False,
) -> dict[str, Any]:
    """Fly a scenario, run the loop on it, and return the comparison with the truth.

    Args:
        system, scenario: system and scenario to fly.
        seed: seed of the inputs and the noise.
        removed: if True, the planted effects are left out of the library.
        library: candidates; by default those of `close_loop`.
        over_hypotheses: True for the search of `jaxid.loop`, False for that of `close_loop`.
    """
    key = {
        "system": system.name,
        "scenario": scenario.name,
        "kind": scenario.kind,
        "seed": seed,
        "removed": removed,
    }
    begin, busy = time.perf_counter(), time.process_time()
    try:
        flown = system.fly(scenario, seed)
        if over_hypotheses:
            return key | run_search(system, scenario, flown, removed, library)
        begin, busy = time.perf_counter(), time.process_time()
        with left_out(scenario.planted if removed else ()):
            study = _study(system, flown, library)
        seconds = {"seconds": time.perf_counter() - begin, "processor": time.process_time() - busy}
        summary = key | seconds | {"failed": None} | study_summary(study, scenario.planted)
        return summary if removed else summary | compared(system, scenario, flown, study, library)
    except Exception as error:  # A failed study is counted and reported; the run continues.
        return key | {
            "seconds": time.perf_counter() - begin,
            "failed": f"{type(error).__name__}: {error}"[:500],
        }


def _study(system: System, flown: Flown, library: tuple[Effect, ...] | None) -> Study:
    return close_loop(
        flown.model,
        flown.free,
        OutputError(),
        train=list(flown.train),
        check=list(flown.check),
        test=list(flown.test),
        effects=library,
        window=system.window,
    )


@contextlib.contextmanager
def left_out(planted: tuple[Planted, ...]) -> Iterator[None]:
    """Hide the planted effects from all studies in this context.

    Candidates are filtered after scoring: the compiled programs stay the same, while a smaller
    library would need new ones.
    """
    scored, filtered, neighbours = (
        Search.candidates,
        Workbench.whiten_with_noise_model,
        doubts.near_kin,
    )

    def without(self, fitted, scores):
        every = scored(self, fitted, scores)
        return tuple(
            one
            for one in every
            if not any(effect.accepts(one.name, one.family) for effect in planted)
        )

    def filtered_without(self, *arguments):
        noise, scores = filtered(self, *arguments)
        barred = [
            self.columns.gains[name]
            for name, one in self.effects.items()
            if any(p.accepts(name, one.card.family) for p in planted)
        ]
        parts = (
            scores.score.at[np.array(barred, int)].set(0.0),
            scores.identifiable_fraction.at[np.array(barred, int)].set(0.0),
        )
        return noise, eqx.tree_at(lambda one: (one.score, one.identifiable_fraction), scores, parts)

    def neighbours_without(*arguments):
        return tuple(
            name
            for name in neighbours(*arguments)
            if not any(one.accepts(name, name) for one in planted)
        )

    with contextlib.ExitStack() as stack:
        if planted:
            stack.enter_context(mock.patch.object(Search, "candidates", without))
            stack.enter_context(
                mock.patch.object(Workbench, "whiten_with_noise_model", filtered_without)
            )
            stack.enter_context(mock.patch.object(doubts, "near_kin", neighbours_without))
        yield


def study_summary(study: Study, planted: tuple[Planted, ...]) -> dict[str, Any]:
    """Return the results of a study, and whether they contain the planted effects."""
    near_best = study.localisation["before"].near_best()
    expected = {place for one in planted for place in one.places}
    return {
        "outcome": study.outcome.value,
        "effects": list(study.effects),
        "alternatives": sorted({effect.name for effect in study.alternatives}),
        **_planted_results(study, planted),
        "where": [place.location.label for place in near_best],
        "place_right": bool({place.location for place in near_best} & expected),
        "fall": 2.0 * float(study.before.estimate.cost - study.after.estimate.cost),
        "error_before": mean_log(study.before.rms["test"]),
        "error_after": mean_log(study.after.rms["test"]),
        "rounds": [_round(one) for one in study.rounds],
    }


def _planted_results(study: Study, planted: tuple[Planted, ...]) -> dict[str, Any]:
    """Return whether first round, top three and final model contain the planted effects.

    `wrong` is the number of added effects that were not planted.
    """
    first = study.rounds[0]
    all_candidates = [one for a_round in study.rounds for one in a_round.candidates]
    families = {one.name: one.family for one in all_candidates}
    parts = {one.name: one.parts for one in all_candidates}
    leading_names = [
        part for name in (first.added, *first.alternatives) if name for part in parts[name]
    ]
    singles = [one for one in first.candidates if len(one.parts) == 1]
    leading = {
        *list(dict.fromkeys(one.family for one in singles))[:3],
        *(families[name] for name in leading_names),
    }

    def is_right(name):
        return any(one.accepts(name, families[name]) for one in planted)

    return {
        "first_right": first.added is not None and all(map(is_right, parts[first.added])),
        "top_three": [any(one.accepts(name, name) for name in leading) for one in planted],
        "in": [any(one.accepts(name, families[name]) for name in study.effects) for one in planted],
        "wrong": sum(not is_right(name) for name in study.effects),
    }


def compared(
    system: System,
    scenario: Scenario,
    flown: Flown,
    study: Study,
    library: tuple[Effect, ...] | None,
) -> dict[str, Any]:
    """Return the results of the true model and of the naive regression on the same records."""
    if library is None:
        library = candidates(flown.model, flown.free, as_stack(list(flown.train)))
    true = reference(scenario, flown, library, system.window)
    regression = _naive(true, library, scenario.planted)
    return {
        "candidates": len(library),
        "chi_square": true.chi_square,
        "gains": list(true.gains),
        "identifiable": list(true.identifiable),
        "attainable": true.error,
        "ratio": float(np.exp(mean_log(study.after.rms["test"]) - true.error)),
        "naive": regression,
    }


def _naive(true: Reference, library, planted: tuple[Planted, ...]) -> dict[str, Any]:
    regression = naive(true, library)
    right = any(one.accepts(*names) for one in planted for names in regression.names)
    return {"first": regression.first, "right": right, "terms": regression.terms}


def _round(one) -> dict[str, Any]:
    """Return a summary of a round: changes, and leading candidates with their verdicts."""
    refitted = [c for c in one.candidates if c.cost_fall is not None]
    shown = list({c.name: c for c in (*one.candidates[:SHOWN], *refitted)}.values())
    return {
        "added": one.added,
        "alternatives": list(one.alternatives),
        "dropped": list(one.dropped),
        "predictable": one.predictable,
        "threshold": one.threshold,
        "candidates": [
            [c.name, c.score, c.significance, c.cost_fall, c.check_fall, c.verdict] for c in shown
        ],
    }
