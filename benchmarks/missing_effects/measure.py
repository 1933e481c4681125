"""Comparison of one study with its truth, as plain numbers for JSON."""

import dataclasses
import functools
import importlib
import time
from typing import Any

import jax
import numpy as np

from benchmarks.missing_effects.naive import naive
from benchmarks.missing_effects.reference import Reference, mean_log, problem_of, reference
from benchmarks.missing_effects.scenarios import Flown, Planted, Scenario, System
from jaxid.data.record import Record
from jaxid.effects.base import Effect
from jaxid.estimation.estimate import as_stack
from jaxid.loop import EffectSearch, search_effects
from jaxid.loop.moves import MoveKind, Proposals
from jaxid.loop.options import LoopOptions
from jaxid.study.candidates import candidates


@functools.cache
def system_of(name: str, *, harder: bool) -> System:
    """Return the system with this name."""
    folder = "benchmarks.missing_effects" + (".harder" if harder else "")
    return importlib.import_module(f"{folder}.{name}").system()


def measure_by_name(system: str, scenario: str, seed: int, removed: bool, harder: bool) -> dict:
    """Return `measure` of a system and a scenario with these names, as another process knows
    them.
    """
    jax.config.update("jax_enable_x64", True)
    one = system_of(system, harder=harder)
    return measure(one, one.scenario(scenario), seed, removed=removed)


def measure(
    system: System,
    scenario: Scenario,
    seed: int,
    *,
    removed: bool = False,
    library: tuple[Effect, ...] | None = None,
) -> dict[str, Any]:
    """Fly a scenario, run the search on it, and return the comparison with the truth.

    It is the search of `close_loop`, which adds the refit on complete records and the report.

    Args:
        system, scenario: system and scenario to fly.
        seed: seed of the inputs and the noise.
        removed: if True, the planted effects are left out of the library.
        library: candidates; by default those of `close_loop`.
    """
    scenario = scenario.drawn(seed)
    key = {
        "system": system.name,
        "scenario": scenario.name,
        "kind": scenario.kind,
        "seed": seed,
        "removed": removed,
    }
    begin = time.perf_counter()
    try:
        flown = system.fly(scenario, seed)
        return key | _searched(system, scenario, flown, removed, library)
    except Exception as error:  # A failed study is counted and reported; the run continues.
        return key | {
            "seconds": time.perf_counter() - begin,
            "failed": f"{type(error).__name__}: {error}"[:500],
        }


def _searched(
    system: System, scenario: Scenario, flown: Flown, removed: bool, library
) -> dict[str, Any]:
    """Return the summary of one search; with `removed`, without the planted effects."""
    parts = [as_stack(list(part)) for part in (flown.train, flown.check, flown.test)]
    library = library or candidates(flown.model, flown.free, *parts)
    begin, busy = time.perf_counter(), time.process_time()
    problem = problem_of(flown, library, system.window)
    if removed:
        problem = problem.without(*names_of_planted(library, scenario.planted))
    found = search_effects(problem, test={"test": parts[2]})
    seconds = {"seconds": time.perf_counter() - begin, "processor": time.process_time() - busy}
    summary: dict[str, Any] = seconds | {"failed": None, "planted": drawn_numbers(scenario)}
    summary |= search_summary(found, scenario.planted, parts[2])
    if removed:
        return summary
    true = reference(scenario, flown, library, system.window)
    return summary | {
        "candidates": len(library),
        "chi_square": true.chi_square,
        "gains": list(true.gains),
        "identifiable": list(true.identifiable),
        "offered": list(true.offered),
        "attainable": true.error,
        "ratio": float(np.exp(summary["error_after"] - true.error)),
        "naive": _naive(true, library, scenario.planted),
    }


def drawn_numbers(scenario: Scenario) -> list[list]:
    """Return pairs of name and numbers of the planted effects; of a joint effect the first part."""
    pairs = []
    for one in scenario.planted:
        effect = getattr(one.effect, "parts", (one.effect,))[0]
        values = {field.name: getattr(effect, field.name) for field in dataclasses.fields(effect)}
        numbers = {
            name: float(value)
            for name, value in values.items()
            if isinstance(value, float | jax.Array)
        }
        pairs.append([one.effect.name, numbers])
    return pairs


def names_of_planted(library: tuple[Effect, ...], planted: tuple[Planted, ...]) -> list[str]:
    """Return the names of the candidates that count as a planted effect."""
    cards = [effect.card for effect in library]
    return [
        card.name for card in cards if any(one.accepts(card.name, card.family) for one in planted)
    ]


def search_summary(
    found: EffectSearch, planted: tuple[Planted, ...], test: Record
) -> dict[str, Any]:
    """Return the results of a search, and whether they contain the planted effects."""
    tree = found.tree
    families = {name: effect.card.family for name, effect in tree.problem.effects.items()}

    def is_right(name):
        return any(one.accepts(name, families[name]) for one in planted)

    proposals = Proposals(tree.declared, LoopOptions())
    ordered = sorted(proposals.candidates, key=lambda name: -proposals.score(name))
    leading = list(dict.fromkeys(families[name] for name in ordered))[:3]
    first = next((s.move.into for s in tree.path if s.move.kind is not MoveKind.NOISE), ())
    near = [place.location for place in tree.where.near_best()]
    expected = {place for one in planted for place in one.places}
    errors = [
        mean_log(np.asarray(fitted.predict(test.anonymous()).rms))
        for fitted in (tree.declared, tree.best)
    ]
    others = [
        [list(other.effects), type(other.hypothesis.noise).__name__, worse]
        for other, worse in tree.alternatives()[:3]
    ]
    objections = [
        [f.check.name, list(f.names), list(f.numbers)] for f in found.assessment.objections
    ]
    return {
        "outcome": found.outcome.value,
        "effects": list(found.effects),
        "noise": type(found.hypothesis.noise).__name__,
        "alternatives": others,
        "objections": objections,
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
        "rounds": [[list(s.parent.effects), list(s.fit.effects)] for s in tree.path],
    }


def _naive(true: Reference, library, planted: tuple[Planted, ...]) -> dict[str, Any]:
    regression = naive(true, library)
    right = any(one.accepts(*names) for one in planted for names in regression.names)
    return {"first": regression.first, "right": right, "terms": regression.terms}
