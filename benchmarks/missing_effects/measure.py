"""One study held against its truth, as plain numbers for JSON."""

import contextlib
import time
from collections.abc import Iterator
from typing import Any
from unittest import mock

import equinox as eqx
import numpy as np

from benchmarks.missing_effects.naive import naive
from benchmarks.missing_effects.reference import Reference, mean_log, reference
from benchmarks.missing_effects.scenarios import Flown, Planted, Scenario, System
from jaxid import OutputError, close_loop
from jaxid.estimation.estimate import as_stack
from jaxid.models.effects import Effect
from jaxid.study import Study, doubts
from jaxid.study.close_loop import candidates
from jaxid.study.search import Search
from jaxid.study.workbench import Workbench

SHOWN = 6  # candidates of each round that are kept for a diagnosis


def measure(
    system: System,
    scenario: Scenario,
    seed: int,
    *,
    removed: bool = False,
    library: tuple[Effect, ...] | None = None,
) -> dict[str, Any]:
    """Fly a scenario, let the loop loose on it, and compare.

    Args:
        system, scenario: what.
        seed: of the inputs and the noise.
        removed: whether what is planted is left out of the library.
        library: the candidates; by default those of `close_loop`.
    """
    key = {"system": system.name, "scenario": scenario.name, "kind": scenario.kind, "seed": seed, "removed": removed}
    begin, busy = time.perf_counter(), time.process_time()
    try:
        flown = system.fly(scenario, seed)
        begin, busy = time.perf_counter(), time.process_time()
        with left_out(scenario.planted if removed else ()):
            study = _study(system, flown, library)
        seconds = {"seconds": time.perf_counter() - begin, "processor": time.process_time() - busy}
        told = key | seconds | {"failed": None} | found(study, scenario.planted)
        return told if removed else told | compared(system, scenario, flown, study, library)
    except Exception as error:  # a study that fails is counted and told, and the run goes on
        return key | {"seconds": time.perf_counter() - begin, "failed": f"{type(error).__name__}: {error}"[:500]}


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
    """No study inside sees what is planted; the compiled programs stay the same, as those of another library would not."""
    scored, filtered, near_kin = Search.candidates, Workbench.filtered, doubts.near_kin

    def without(self, fitted, scores):
        every = scored(self, fitted, scores)
        return tuple(one for one in every if not any(effect.accepts(one.name, one.family) for effect in planted))

    def filtered_without(self, *arguments):
        noise, scores = filtered(self, *arguments)
        barred = [
            self.columns.gains[name]
            for name, one in self.effects.items()
            if any(p.accepts(name, one.family) for p in planted)
        ]
        parts = (scores.score.at[np.array(barred, int)].set(0.0), scores.left.at[np.array(barred, int)].set(0.0))
        return noise, eqx.tree_at(lambda one: (one.score, one.left), scores, parts)

    def kin_without(*arguments):
        return tuple(name for name in near_kin(*arguments) if not any(one.accepts(name, name) for one in planted))

    with contextlib.ExitStack() as stack:
        if planted:
            stack.enter_context(mock.patch.object(Search, "candidates", without))
            stack.enter_context(mock.patch.object(Workbench, "filtered", filtered_without))
            stack.enter_context(mock.patch.object(doubts, "near_kin", kin_without))
        yield


def found(study: Study, planted: tuple[Planted, ...]) -> dict[str, Any]:
    """What a study says of itself, and whether what is planted is in it."""
    first = study.rounds[0]
    singles = [one for one in first.candidates if len(one.parts) == 1]
    families = {one.name: one.family for a_round in study.rounds for one in a_round.candidates}
    parts = {one.name: one.parts for a_round in study.rounds for one in a_round.candidates}
    told = [part for name in (first.added, *first.rivals) if name for part in parts[name]]
    leading = {*list(dict.fromkeys(one.family for one in singles))[:3], *(families[name] for name in told)}

    def is_right(name):
        return any(one.accepts(name, families[name]) for one in planted)

    rivals = study.where["before"].rivals()
    expected = {place for one in planted for place in one.places}
    return {
        "outcome": study.outcome,
        "effects": list(study.effects),
        "rivals": sorted({rival.name for rival in study.rivals}),
        "first_right": first.added is not None and all(map(is_right, parts[first.added])),
        "top_three": [any(one.accepts(name, name) for name in leading) for one in planted],
        "in": [any(one.accepts(name, families[name]) for name in study.effects) for one in planted],
        "wrong": sum(not is_right(name) for name in study.effects),
        "where": [f"{place.kind} {place.name}" for place in rivals],
        "place_right": bool({(place.kind, place.name) for place in rivals} & expected),
        "fall": 2.0 * float(study.before.estimate.cost - study.after.estimate.cost),
        "error_before": mean_log(study.before.rms["test"]),
        "error_after": mean_log(study.after.rms["test"]),
        "rounds": [_round(one) for one in study.rounds],
    }


def compared(
    system: System, scenario: Scenario, flown: Flown, study: Study, library: tuple[Effect, ...] | None
) -> dict[str, Any]:
    """What the true model attains, and what the naive way says, on the same records."""
    if library is None:
        library = candidates(flown.model, flown.free, as_stack(list(flown.train)))
    true = reference(scenario, flown, library, system.window)
    told = _naive(true, library, scenario.planted)
    return {
        "candidates": len(library),
        "chi_square": true.chi_square,
        "gains": list(true.gains),
        "identifiable": list(true.identifiable),
        "attainable": true.error,
        "ratio": float(np.exp(mean_log(study.after.rms["test"]) - true.error)),
        "naive": told,
    }


def _naive(true: Reference, library, planted: tuple[Planted, ...]) -> dict[str, Any]:
    told = naive(true, library)
    right = any(one.accepts(*names) for one in planted for names in told.names)
    return {"first": told.first, "right": right, "terms": told.terms}


def _round(one) -> dict[str, Any]:
    """A round in short: what was added, and the leading candidates with what became of them."""
    refitted = [c for c in one.candidates if c.cost_fall is not None]
    shown = list({c.name: c for c in (*one.candidates[:SHOWN], *refitted)}.values())
    return {
        "added": one.added,
        "rivals": list(one.rivals),
        "dropped": list(one.dropped),
        "predictable": one.predictable,
        "threshold": one.threshold,
        "candidates": [[c.name, c.score, c.significance, c.cost_fall, c.check_fall, c.verdict] for c in shown],
    }
