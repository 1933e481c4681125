"""The loop on measured data: `python -m benchmarks.measured [--json] [--sets silverbox,emps,tanks]
[--data FOLDER]`.

Each study has the simple physical model that `jaxid.measured` declares for its set, the general
library and the default options: nothing is tuned by set. EMPS is run twice, from the recorded force
(open loop) and from the reference, with its controller in the model. Errors are RMS of the
simulation on the test records, which take no part in any decision. The files are not part of the
project: a set without its files is reported as skipped.
"""

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax

from benchmarks.command_line import add_json, print_rows, report_progress, requested
from jaxid import Study, close_loop, predict
from jaxid._foundation.checks import InputError
from jaxid.data import split_at
from jaxid.measured import Declared, emps, emps_closed_loop, silverbox, tanks
from jaxid.study.study import Side

ORIGIN = (
    "M. D. Champneys, G. I. Beintema, R. Toth, M. Schoukens, T. J. Rogers, Baseline Results for "
    "Selected Nonlinear System Identification Benchmarks, IFAC-PapersOnLine 58(15), 2024, pp. "
    "474-479: the results kept with their code, github.com/MDCHAMP/nonlinear_baselines, of "
    "free-running simulation on the same test records, the first samples left out by their own "
    "rule. 'Best known' of the tanks is the approximate error of the best published models, "
    "quoted without a printed source."
)
NOTES = f"""'simple fit': an independent fit of the declared model, without and with the effects
that are known to matter.
'others': {ORIGIN}
A cause is claimed only where the verdict begins with 'The model lacked'."""


class Figure(NamedTuple):
    """Error of a test record in `unit` (`scale` converts from SI), with its goal and references.

    The references are errors of a simple fit and of other published models. `samples` is the number
    of samples that count from the start of the record, and `window` of those in which its initial
    state is fitted; by default they are those of the set.
    """

    test: str
    unit: str
    scale: float
    goal: float | None
    simple: tuple[float, float] | None
    others: dict[str, float]
    samples: int | None = None
    window: int | None = None

    @property
    def label(self) -> str:
        """The test record, with what differs from the set."""
        first = f", {self.samples}" if self.samples else ""
        return f"{self.test}{first}" + (f", w {self.window}" if self.window else "")


class Case(NamedTuple):
    """A data set: its loader, declared model in words, reported errors and expected effects.

    `named` maps each expected effect to the possible beginnings of its name.
    """

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
            Figure(
                "arrow", "mV", 1e3, 0.32, (14.21, 0.96), {"LSTM": 2.68, "GRU": 2.80, "RNN": 4.88}
            ),
            # No extrapolation, by the split of github.com/GerbenBeintema/nonlinear_benchmarks.
            Figure("arrow", "mV", 1e3, None, None, {}, samples=32_000),
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
        (
            Figure(
                "validation",
                "V",
                1.0,
                0.36,
                (0.671, 0.362),
                {"best known": 0.34, "GRU": 0.396, "ARX": 0.685},
            ),
            # In 50 samples the level that is not measured shows more.
            Figure("validation", "V", 1.0, None, None, {}, window=50),
        ),
        {"sensor clip": ("upper saturation of level",), "overflow": ("overflow of upper",)},
    ),
}
SETS = {"silverbox": ("silverbox",), "emps": ("emps", "emps closed loop"), "tanks": ("tanks",)}


def measure(name: str, folder: str | None, report: Callable[[str], None]) -> dict[str, Any]:
    """Run the loop on one set; return its row, or the reason why it is skipped."""
    start = time.perf_counter()
    try:
        declared_set = CASES[name].load(folder)
    except InputError as missing:
        return {"set": name, "status": "skipped", "why": str(missing)}
    study = close_loop(
        **declared_set.parts,
        progress=lambda words: report(f"{time.perf_counter() - start:6.0f} s  {name}: {words}"),
    )
    result = {**row(name, study, declared_set), "seconds": round(time.perf_counter() - start, 1)}
    for figure in result["figures"]:
        report(_line(name, figure))  # at once: a later set may be interrupted
    return result


def row(name: str, study: Study, declared: Declared) -> dict[str, Any]:
    """Return the reported numbers of one study."""
    case, summary = CASES[name], study.to_dict()
    return {
        "set": name,
        "status": "measured",
        "declared": case.declared,
        "figures": [_figure(one, study, declared) for one in case.figures],
        "named": {
            label: any(one.startswith(words) for one in study.effects)
            for label, words in case.named.items()
        },
        "outcome": study.outcome.value,
        "verdict": study.verdict,
        "effects": summary["effects"],
        "parameters": summary["parameters"],
        "last_estimate": study.after.estimate.status,
        "rounds": [_round(one) for one in summary["rounds"]],
    }


def _figure(one: Figure, study: Study, declared: Declared) -> dict[str, Any]:
    (channel,) = study.before.rms[one.test]
    before, after = (
        one.scale * _error(one, side, declared) for side in (study.before, study.after)
    )
    met = None if one.goal is None else bool(after <= one.goal)
    return {
        **one._asdict(),
        "label": one.label,
        "channel": channel,
        "before": before,
        "after": after,
        "met": met,
    }


def _error(one: Figure, side: Side, declared: Declared) -> float:
    """Return the RMS error of a test record, in SI."""
    if one.samples is None and one.window is None:
        (error,) = side.rms[one.test].values()
        return error
    record = declared.data.test[one.test]
    record = split_at(record, one.samples)[0] if one.samples else record
    window = one.window or declared.data.window[one.test]
    (rms,) = predict(side.model, record, declared.likelihood, window=window).rms
    return float(rms)


def _round(one: dict[str, Any]) -> dict[str, Any]:
    """Return the changes of a round, with its refitted candidates."""
    kept = ("name", "score", "check_fall", "verdict")
    refitted = [
        {key: c[key] for key in kept} for c in one["candidates"] if c["cost_fall"] is not None
    ]
    return {key: one[key] for key in ("added", "dropped", "errors")} | {"refitted": refitted}


def table(rows: list[dict[str, Any]]) -> str:
    """Return the errors as a text table, followed by the effects and the verdict of each set."""
    head = (
        f"{'set':<17} {'test record':<16} {'before':>8} {'after':>8} {'goal':>6} {'unit':<4}  "
        f"{'simple fit':<14}  others"
    )
    lines = [head, "-" * (len(head) + 30)]
    for one in rows:
        if one["status"] == "skipped":
            lines.append(f"{one['set']:<17} skipped: {one['why']}")
        lines += [_line(one["set"], figure) for figure in one.get("figures", ())]
    for one in rows:
        if one["status"] == "measured":
            named = ", ".join(
                f"{label} {'named' if is_named else 'NOT named'}"
                for label, is_named in one["named"].items()
            )
            lines += [
                "",
                f"{one['set']}: declared {one['declared']}; {one['outcome']}; {named}; "
                f"{one['seconds']:.0f} s",
            ]
            lines += [f"    {one['verdict']}"]
            lines += [f"    Last estimate: {one['last_estimate']}"]
    return "\n".join([*lines, "", NOTES])


def _line(name: str, figure: dict[str, Any]) -> str:
    goal = "-" if figure["goal"] is None else f"{figure['goal']:g}"
    simple = f"{figure['simple'][0]:g} -> {figure['simple'][1]:g}" if figure["simple"] else "-"
    others = ", ".join(f"{method} {error:g}" for method, error in figure["others"].items()) or "-"
    return (
        f"{name:<17} {figure['label']:<16} {figure['before']:>8.4g} {figure['after']:>8.3g} "
        f"{goal:>6} {figure['unit']:<4}  "
        f"{simple:<14}  {others}" + ("" if figure["met"] in (None, True) else "   GOAL MISSED")
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if every available set ran."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.measured", description="The loop on measured data."
    )
    add_json(parser)
    parser.add_argument(
        "--sets", default=",".join(SETS), help=f"which, of {', '.join(SETS)} (default: all)"
    )
    parser.add_argument(
        "--data", metavar="FOLDER", help="where the sets are (default: the variable JAXID_DATA)"
    )
    options = parser.parse_args(arguments)
    known = SETS | {name: (name,) for name in CASES if name not in SETS}
    names = requested(parser, options.sets, known, "set")
    jax.config.update("jax_enable_x64", True)
    rows = [measure(name, options.data, report_progress) for one in names for name in known[one]]
    print_rows(rows, ORIGIN, table, options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
