"""The loop on measured data: `python -m benchmarks.measured [--json] [--sets silverbox,emps,tanks] [--data FOLDER]`.

Each set is given the simple physical model that `jaxid.measured` declares for it, the general library and the default options:
nothing is tuned by set. EMPS is run twice, from the recorded force (open loop) and from the reference, with its controller in the
model. Errors are RMS of the simulation on the test records, which decide nothing. The files are not part of the project: a set
that is not at hand is told as such and skipped.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax

from jaxid import Study, close_loop
from jaxid._foundation.checks import InputError
from jaxid.measured import Declared, emps, emps_closed_loop, silverbox, tanks

ORIGIN = (
    "M. D. Champneys, G. I. Beintema, R. Toth, M. Schoukens, T. J. Rogers, Baseline Results for Selected Nonlinear System "
    "Identification Benchmarks, IFAC-PapersOnLine 58(15), 2024, pp. 474-479: the results kept with their code, github.com/"
    "MDCHAMP/nonlinear_baselines, of free-running simulation on the same test records, the first samples left out in their own "
    "way. 'Best known' of the tanks is about what the best published models reach, handed down without a printed source."
)
NOTES = f"""'simple fit': an independent fit of the declared model, without and with the effects that are known to matter.
'others': {ORIGIN}
A cause is claimed only where the verdict begins with 'The model lacked'."""


class Figure(NamedTuple):
    """One error: of a test record, in `unit` (by `scale` from SI), with its goal, a simple fit, and what others reached."""

    test: str
    unit: str
    scale: float
    goal: float | None
    simple: tuple[float, float] | None
    others: dict[str, float]


class Case(NamedTuple):
    """A set: its loader, the declared model in words, what is reported, and how the effects' names begin that it should name."""

    load: Callable[..., Declared]
    declared: str
    figures: tuple[Figure, ...]
    named: dict[str, tuple[str, ...]]


FRICTION = {
    "dry friction": ("sign(velocity) in velocity",),
    "its asymmetry": ("1 in velocity", "velocity^2 in velocity", "hinge of velocity"),
}
CASES = {
    "silverbox": Case(
        silverbox,
        "a linear oscillator",
        (
            Figure("arrow", "mV", 1e3, 0.32, (14.21, 0.96), {"LSTM": 2.68, "GRU": 2.80, "RNN": 4.88}),
            Figure("multisine", "mV", 1e3, 0.32, (7.02, 0.92), {"GRU": 1.49, "LSTM": 1.50}),
        ),
        {"cubic spring": ("x^3 in v",)},
    ),
    "emps": Case(
        emps,
        "a mass with viscous friction, force in",
        (Figure("pulses", "mm", 1e3, 5.0, (93.0, 5.05), {"LSTM": 74.0, "GRU": 220.0}),),
        FRICTION,
    ),
    "emps closed loop": Case(
        emps_closed_loop,
        "a mass with viscous friction and the published controller, reference in",
        (Figure("pulses", "um", 1e6, None, None, {}),),
        FRICTION,
    ),
    "tanks": Case(
        tanks,
        "two tanks after Bernoulli",
        (Figure("validation", "V", 1.0, 0.36, (0.671, 0.362), {"best known": 0.34, "GRU": 0.396, "ARX": 0.685}),),
        {"sensor clip": ("upper saturation of level",), "overflow": ("overflow of upper",)},
    ),
}
SETS = {"silverbox": ("silverbox",), "emps": ("emps", "emps closed loop"), "tanks": ("tanks",)}


def measure(name: str, folder: str | None, tell: Callable[[str], None]) -> dict[str, Any]:
    """The loop on one set, or why it is skipped."""
    start = time.perf_counter()
    try:
        found = CASES[name].load(folder)
    except InputError as missing:
        return {"set": name, "status": "skipped", "why": str(missing)}
    study = close_loop(
        **found.parts, progress=lambda words: tell(f"{time.perf_counter() - start:6.0f} s  {name}: {words}")
    )
    return {**row(name, study), "seconds": round(time.perf_counter() - start, 1)}


def row(name: str, study: Study) -> dict[str, Any]:
    """What is reported of one study."""
    case, told = CASES[name], study.to_dict()
    return {
        "set": name,
        "status": "measured",
        "declared": case.declared,
        "figures": [_figure(one, study) for one in case.figures],
        "named": {what: any(one.startswith(words) for one in study.effects) for what, words in case.named.items()},
        "outcome": study.outcome,
        "verdict": study.verdict,
        "effects": told["effects"],
        "parameters": told["parameters"],
        "last_estimate": study.after.estimate.status,
        "rounds": [_round(one) for one in told["rounds"]],
    }


def _figure(one: Figure, study: Study) -> dict[str, Any]:
    (channel,) = study.before.rms[one.test]
    before, after = (one.scale * side.rms[one.test][channel] for side in (study.before, study.after))
    met = None if one.goal is None else bool(after <= one.goal)
    return {**one._asdict(), "channel": channel, "before": before, "after": after, "met": met}


def _round(one: dict[str, Any]) -> dict[str, Any]:
    """What a round did, with the candidates that were refitted."""
    kept = ("name", "score", "significance", "check_fall", "verdict")
    refitted = [{key: c[key] for key in kept} for c in one["candidates"] if c["cost_fall"] is not None]
    return {key: one[key] for key in ("added", "rivals", "dropped", "errors")} | {"refitted": refitted}


def table(rows: list[dict[str, Any]]) -> str:
    """The figures in lines, and below them what was found."""
    head = f"{'set':<17} {'test record':<11} {'before':>8} {'after':>8} {'goal':>6} {'unit':<4}  {'simple fit':<14}  others"
    lines = [head, "-" * (len(head) + 30)]
    for one in rows:
        if one["status"] == "skipped":
            lines.append(f"{one['set']:<17} skipped: {one['why']}")
        lines += [_line(one["set"], figure) for figure in one.get("figures", ())]
    for one in rows:
        if one["status"] == "measured":
            named = ", ".join(f"{what} {'named' if seen else 'NOT named'}" for what, seen in one["named"].items())
            lines += [
                "",
                f"{one['set']}: declared {one['declared']}; {one['outcome']}; {named}; {one['seconds']:.0f} s",
            ]
            lines += [f"    {one['verdict']}"]
            lines += [f"    Last estimate: {one['last_estimate']}"]
    return "\n".join([*lines, "", NOTES])


def _line(name: str, figure: dict[str, Any]) -> str:
    goal = "-" if figure["goal"] is None else f"{figure['goal']:g}"
    simple = f"{figure['simple'][0]:g} -> {figure['simple'][1]:g}" if figure["simple"] else "-"
    others = ", ".join(f"{who} {error:g}" for who, error in figure["others"].items()) or "-"
    return (
        f"{name:<17} {figure['test']:<11} {figure['before']:>8.4g} {figure['after']:>8.3g} {goal:>6} {figure['unit']:<4}  "
        f"{simple:<14}  {others}" + ("" if figure["met"] in (None, True) else "   GOAL MISSED")
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; 0 where every set that is at hand ran."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.measured", description="The loop on measured data.")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    parser.add_argument("--sets", default=",".join(SETS), help=f"which, of {', '.join(SETS)} (default: all)")
    parser.add_argument("--data", metavar="FOLDER", help="where the sets are (default: the variable JAXID_DATA)")
    options = parser.parse_args(arguments)
    known = SETS | {name: (name,) for name in CASES if name not in SETS}
    asked = [name.strip() for name in options.sets.split(",")]
    for name in asked:
        if name not in known:
            parser.error(f"there is no set {name!r}; there are {', '.join(known)}")
    jax.config.update("jax_enable_x64", True)
    rows = [measure(name, options.data, _tell) for one in asked for name in known[one]]
    status = "measured" if any(one["status"] == "measured" for one in rows) else "no data"
    print(json.dumps({"status": status, "origin": ORIGIN, "rows": rows}, indent=1) if options.json else table(rows))
    return 0


def _tell(words: str) -> None:
    print(words, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
