"""Share of right terms selected by each rule: `python -m benchmarks.structure [--json]
[--draws 500] [--figure FILE]`.

Polynomials of two to six terms are planted among twenty candidates, in the signals of five short
manoeuvres, and noise is added to the response. Each rule of `jaxid.structure` then selects terms
from the same data. A model counts as exactly recovered when it has all of the planted terms and no
other.
"""

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np

from jaxid.structure import (
    REPORT,
    AbstractRule,
    Action,
    CrossValidation,
    Direction,
    FirstMaximumF,
    LastStep,
    MaximumF,
    Minimum,
    Selection,
    SubsetOptions,
    columns,
)
from jaxid.structure.problem import Problem, prepare
from jaxid.structure.stepwise import path

CANDIDATES = (
    *("alpha", "alpha^2", "alpha^3", "alpha^4", "beta", "beta^2", "beta^3", "|beta| beta"),
    *("alpha beta", "alpha^2 beta", "alpha beta^2", "p", "alpha p", "q", "alpha q", "r", "alpha r"),
    *("elevator", "alpha elevator", "alpha^2 elevator"),
)
SIGNALS = ("alpha", "beta", "p", "q", "r", "elevator")
MANOEUVRES, SAMPLES = 5, 50
# standard deviation of the noise over that of the response without it
NOISE = (0.01, 0.05, 0.2, 0.5)
SEED = 1974
FORWARD_AND_BACKWARD = SubsetOptions(direction=Direction.FORWARD_THEN_BACKWARD)
CEILINGS = {
    "limit: right model on the path that only adds": "forward",
    "limit: right model on the whole path": "whole",
}
NOTES = """\
Each level of F has its own path; the criteria choose from the full path, which adds and then
removes terms. PRESS, AIC and cross-validation minimise the prediction error, which extra terms
hardly increase. At 1 % noise the report's path ends at its R2 of 0.999, before chance terms
enter."""


class Method(NamedTuple):
    """A path and the rule that selects a model of it.

    The rule is made from the manoeuvre of each sample.
    """

    path: str
    rule: Callable[[np.ndarray], AbstractRule]


METHODS = {
    "report: first maximum of the overall F": Method("report", lambda _: FirstMaximumF()),
    "largest overall F": Method("whole", lambda _: MaximumF()),
    "last step, F 3 (report's levels)": Method("report", lambda _: LastStep()),
    "last step, F at 5 %": Method("5 %", lambda _: LastStep()),
    "last step, F at 1 %": Method("1 %", lambda _: LastStep()),
    "last step, F at 0.1 %": Method("0.1 %", lambda _: LastStep()),
    "PSE, bound: the response's variance": Method("whole", lambda _: Minimum("PSE")),
    "PSE, bound: 25 noise variances": Method("noise known", lambda _: Minimum("PSE")),
    "PRESS": Method("whole", lambda _: Minimum("PRESS")),
    "AIC": Method("whole", lambda _: Minimum("AIC")),
    "BIC": Method("whole", lambda _: Minimum("BIC")),
    "cross-validation by manoeuvre": Method("whole", CrossValidation),
}


def paths(problem: Problem, noise_variance: float) -> dict[str, Selection]:
    """Return the paths from which the rules select a model."""
    levels = {"5 %": 0.05, "1 %": 0.01, "0.1 %": 0.001}
    selections = {"report": path(problem, REPORT)}
    selections |= {
        name: path(problem, SubsetOptions(level_in=level)) for name, level in levels.items()
    }
    selections["whole"] = path(problem, FORWARD_AND_BACKWARD)
    selections["forward"] = Selection(
        problem, tuple(step for step in selections["whole"].steps if step.action is Action.ENTER)
    )
    bound = min(25.0 * noise_variance, problem.SST / problem.samples)
    selections["noise known"] = path(
        problem, dataclasses.replace(FORWARD_AND_BACKWARD, PSE_bound=bound)
    )
    return selections


class Planted(NamedTuple):
    """One draw: candidates, the right terms, the response without noise, and noise of unit
    variance.
    """

    X: np.ndarray
    terms: frozenset[str]
    response: np.ndarray
    noise: np.ndarray


def plant(draws: int) -> list[Planted]:
    """Polynomials in the signals of manoeuvres. The planted terms move the response by like
    amounts, within a factor of four.
    """
    generator = np.random.default_rng(SEED)
    shape = (draws, MANOEUVRES, SAMPLES)
    signals = {name: _manoeuvres(generator, shape).reshape(-1) for name in SIGNALS}
    every = columns(CANDIDATES, signals).reshape(draws, MANOEUVRES * SAMPLES, len(CANDIDATES))
    planted = []
    for X in every:
        chosen = generator.choice(len(CANDIDATES), size=generator.integers(2, 7), replace=False)
        size = 4.0 ** generator.uniform(-0.5, 0.5, size=len(chosen)) * generator.choice(
            [-1.0, 1.0], size=len(chosen)
        )
        response = X[:, chosen] @ (size / np.std(X[:, chosen], axis=0))
        noise = generator.normal(size=len(X))
        planted.append(Planted(X, frozenset(CANDIDATES[i] for i in chosen), response, noise))
    return planted


def _manoeuvres(generator: np.random.Generator, shape: tuple[int, int, int]) -> np.ndarray:
    """Sums of three sines of random frequency and phase, at most one in size, about a random mean
    in each manoeuvre.
    """
    t = np.linspace(0.0, 1.0, shape[-1])
    turns = generator.uniform(0.5, 4.0, size=(*shape[:2], 3, 1))
    phase = generator.uniform(0.0, 2 * np.pi, size=(*shape[:2], 3, 1))
    waves = np.sin(2 * np.pi * turns * t + phase).mean(axis=2)
    return 0.7 * waves + generator.uniform(-0.3, 0.3, size=(*shape[:2], 1))


class Score(NamedTuple):
    """Comparison of one model of one draw with the right model."""

    exact: bool
    false: int
    missed: int
    misfit: float


def score(model, truth: Planted, noise: float) -> Score:
    """Return the score of a step's terms against the planted terms.

    The misfit is the standard deviation of the residual over that of the noise.
    """
    terms = frozenset(model.terms)
    return Score(
        terms == truth.terms, len(terms - truth.terms), len(truth.terms - terms), model.s / noise
    )


def measure(draws: int) -> list[dict]:
    """Return one row per noise level and rule.

    A row has the share of models exactly recovered, false and missed terms per model, and misfit.
    """
    groups = np.repeat(np.arange(MANOEUVRES), SAMPLES)
    rules = {name: method.rule(groups) for name, method in METHODS.items()}
    planted, rows = plant(draws), []
    for level in NOISE:
        scores: dict[str, list[Score]] = {name: [] for name in METHODS}
        attained = dict.fromkeys(CEILINGS, 0)
        for truth in planted:
            noise = level * float(np.std(truth.response))
            problem = prepare(truth.X, truth.response + noise * truth.noise, CANDIDATES)
            selections = paths(problem, noise**2)
            for name, method in METHODS.items():
                selection = selections[method.path]
                scores[name].append(
                    score(selection.models[rules[name].pick(selection)], truth, noise)
                )
            for name, which in CEILINGS.items():
                attained[name] += any(
                    frozenset(model.terms) == truth.terms for model in selections[which].models
                )
        for name, all_ in scores.items():
            exact, false, missed, misfit = np.array(all_, float).T.mean(axis=1)
            numbers = {"exact": exact, "false": false, "missed": missed, "misfit": misfit}
            rows.append({"rule": name, "noise": level, **numbers})
        rows += [
            {"rule": name, "noise": level, "exact": count / draws}
            for name, count in attained.items()
        ]
    return rows


def table(rows: list[dict]) -> str:
    """Return a table of rules by noise levels, one block for each of the three numbers."""
    lines = []
    heads = {
        "exact": "share of models exactly recovered, %",
        "false": "false terms per model",
        "missed": "missed terms per model",
    }
    for key, head in heads.items():
        lines += ["", f"{head:<46}" + "".join(f"{f'noise {level:.0%}':>12}" for level in NOISE)]
        for name in dict.fromkeys(row["rule"] for row in rows):
            if name in CEILINGS and key != "exact":
                continue
            values = [row[key] for row in rows if row["rule"] == name]
            cells = [f"{100 * v:>12.1f}" if key == "exact" else f"{v:>12.2f}" for v in values]
            lines.append(f"{name:<46}" + "".join(cells))
    return "\n".join(lines[1:])


def draw(rows: list[dict], draws: int, file: str) -> None:
    """Draw the three numbers side by side, one dot for each rule and noise level."""
    from jaxid.report.style import BEFORE, FONT, INK, canvas, key, plain

    shades = dict(zip(NOISE, ("#9ecae1", "#4292c6", "#2171b5", "#08306b"), strict=True))
    names = list(dict.fromkeys(row["rule"] for row in rows))
    mean = {name: np.mean([row["exact"] for row in rows if row["rule"] == name]) for name in names}
    names.sort(key=lambda name: (name in CEILINGS, mean[name]))  # the limits on top, then the best
    figure, [panels] = canvas(6.2, 1, 3, sharey=True, width_ratios=(1.5, 1.0, 1.0))
    heads = ("models exactly recovered, %", "false terms per model", "missed terms per model")
    for panel, column, head in zip(panels, ("exact", "false", "missed"), heads, strict=True):
        for row in (row for row in rows if column in row):
            value = 100 * row["exact"] if column == "exact" else row[column]
            lower = 0.17 * (NOISE.index(row["noise"]) - 1.5)  # so that no dot hides another
            panel.plot(
                value,
                names.index(row["rule"]) - lower,
                "o",
                color=shades[row["noise"]],
                ms=5,
                clip_on=False,
            )
        plain(panel, x=head)
        panel.grid(False, axis="y")
        for k in range(0, len(names), 2):
            panel.axhspan(k - 0.5, k + 0.5, color="#f4f4f4", zorder=-2, linewidth=0)
        panel.axhline(len(names) - len(CEILINGS) - 0.5, color=INK, linewidth=0.8)
        panel.set_xlim(0, 100 if column == "exact" else None)
        panel.tick_params(axis="y", length=0)
    panels[0].set_yticks(range(len(names)), names, fontsize=FONT, color=INK)
    for label in panels[0].get_yticklabels():
        label.set_color(BEFORE if "report" in label.get_text() else INK)
    panels[0].set_ylim(-0.5, len(names) - 0.5)
    key(
        figure,
        [(f"{level:.0%}", shades[level]) for level in NOISE],
        title=f"noise over response, {draws} draws each:",
    )
    figure.savefig(file, dpi=150)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.structure", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else"
    )
    parser.add_argument(
        "--draws",
        type=int,
        default=500,
        help="planted polynomials at each noise level (default: 500)",
    )
    parser.add_argument("--figure", metavar="FILE", help="write the figure to this file")
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    start = time.perf_counter()
    rows = measure(options.draws)
    seconds = time.perf_counter() - start
    if options.figure:
        draw(rows, options.draws, options.figure)
    if options.json:
        print(
            json.dumps(
                {"status": "measured", "draws": options.draws, "seconds": seconds, "rows": rows}
            )
        )
    else:
        print(table(rows))
        size = f"{len(CANDIDATES)} candidates, {MANOEUVRES} manoeuvres of {SAMPLES} samples"
        error = 100 * np.sqrt(0.25 / options.draws)
        print(f"\n{options.draws} draws at each noise level, {size}, {seconds:.0f} s.")
        print(f"One standard error of a share is {error:.1f} % at most.")
        print(NOTES)
    return 0


if __name__ == "__main__":
    sys.exit(main())
