"""The record that separates two explanations: `python -m benchmarks.next_record [--json]`.

Ten pairs of effects (`benchmarks.rival_pairs`) on a spring and a small aircraft. A first flight, a
doublet, a step or a sine, is simulated with one of the two as the truth, and both are fitted to it.
The input of the next flight is designed from these two fits alone (`jaxid.study.separating_input`,
as used by `next_record` for a study) and flown with the same truth. Both are then fitted to the two
flights together, by SciPy. The decision is right if the wrong explanation loses 6 or more of
chi-square, wrong if the true one does, else open. For comparison a 3-2-1-1 of the same peak,
reduced where it would leave the envelope. Goal: 9 of 10 pairs right, with either truth,
within the envelope.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from jaxid import Augmented, configure, free
from jaxid.design import Design, Explanation, InputSignal, conventional_inputs
from jaxid.effects import Effect
from jaxid.models import AbstractModel
from jaxid.models.base import canonical
from jaxid.models.free import with_values
from jaxid.models.names import read_parameters
from jaxid.simulation.simulate import run
from jaxid.study import separating_input

from .rival_pairs import Pair, pairs

DECISIVE = 6.0  # chi-square; a likelihood ratio of 20
STARTS = (0.3, 1.0)  # values of an effect from which a fit begins, over those of the truth


class Fit(NamedTuple):
    """A least-squares fit of an explanation.

    Attributes:
        explanation: the fitted model, its free parameters and their information.
        chi_square: the whitened sum of squares.
    """

    explanation: Explanation
    chi_square: float


class Fits(NamedTuple):
    """Fits of both explanations, and by how much the second is worse [chi-square]."""

    both: tuple[Fit, Fit]
    difference: float


@eqx.filter_jit
def outputs_and_states(model: AbstractModel, t, u, start, likelihood):
    """Return the outputs and the states of a flight; further states than `start` begin at zero."""
    state = jnp.pad(start, (0, len(model.states) - start.size))
    solution = run(model, t, u, state, likelihood.hold, likelihood.stepper)
    return solution.y, solution.x


def simulated(pair: Pair, model: AbstractModel, u, start=(0.0, 0.0)):
    """Return the outputs and the states of a flight as NumPy arrays."""
    arguments = pair.first.t, jnp.asarray(u), jnp.asarray(start), pair.likelihood
    return map(np.asarray, outputs_and_states(canonical(model), *arguments))


class Flight(NamedTuple):
    """Input and noisy outputs of one flight."""

    u: np.ndarray
    z: np.ndarray


def deviations(pair: Pair) -> np.ndarray:
    """Return the standard deviations of the noise."""
    return np.sqrt(np.diagonal(np.asarray(pair.likelihood.noise.R)))


def flown(pair: Pair, truth: AbstractModel, signal: InputSignal, seed: int) -> Flight:
    """Return a flight with noise."""
    y, _ = simulated(pair, truth, signal.u)
    noise = deviations(pair) * np.random.default_rng(seed).normal(size=y.shape)
    return Flight(np.asarray(signal.u), y + noise)


def fit(pair: Pair, effect: Effect, estimated: Sequence[str], flights: Sequence[Flight]) -> Fit:
    """Return the best least-squares fit of an explanation from several starts, by SciPy.

    The initial state of each flight is estimated, and eliminated from the information.
    """
    names = (*pair.declared, *(f"{effect.name}.{name}" for name in estimated))
    model = Augmented(pair.model, (effect,))
    start, sigma = read_parameters(model, names), deviations(pair)
    count, states = len(names), len(pair.model.states)
    scale = np.concatenate([np.abs(start), np.full(states * len(flights), 0.01)])

    def residuals(scaled):
        values, own = np.split(scale * scaled, [count])
        changed = with_values(model, names, jnp.asarray(values))
        parts = [
            (flight.z - next(simulated(pair, changed, flight.u, state))) / sigma
            for flight, state in zip(flights, own.reshape(-1, states), strict=True)
        ]
        return np.nan_to_num(np.concatenate(parts).ravel(), nan=1e3, posinf=1e3, neginf=-1e3)

    results = []
    for share in STARTS:
        values = np.where(np.arange(count) < len(pair.declared), start, share * start)
        begin = np.concatenate([values, np.zeros(states * len(flights))]) / scale
        results.append(least_squares(residuals, begin, method="lm"))
    best = min(results, key=lambda result: result.cost)
    order = np.r_[count : scale.size, :count]  # own parameters first, to be eliminated
    triangle = np.linalg.qr((best.jac / scale)[:, order], mode="r")[-count:, -count:]
    fitted = with_values(model, names, jnp.asarray((scale * best.x)[:count]))
    chosen = free(fitted, *names, per_record=("initial_state",))
    return Fit(Explanation(fitted, chosen, triangle), 2.0 * float(best.cost))


def fits(pair: Pair, flights: Sequence[Flight]) -> Fits:
    """Return the fits of both explanations."""
    first, second = (
        fit(pair, effect, names, flights)
        for effect, names in zip(pair.effects, pair.estimated, strict=True)
    )
    return Fits((first, second), second.chi_square - first.chi_square)


def use_of_envelope(pair: Pair, truth: AbstractModel, signal: InputSignal) -> float:
    """Return the largest share of a limit of the motion that a flight uses; infinite if it
    diverges.
    """
    _, states = simulated(pair, truth, signal.u)
    uses = []
    for name, (low, high) in pair.limits.envelope.items():
        motion = states[:, truth.states.index(name)]
        uses.append(np.max(np.maximum(motion / high, motion / low)))
    return float(np.nan_to_num(max(uses), nan=np.inf))


def conventional(pair: Pair, peak: float, truth: AbstractModel) -> InputSignal:
    """Return a 3-2-1-1 of a given peak, reduced where it would leave the envelope."""
    inputs = pair.model.inputs
    band = (0.5 * pair.frequency, 3.0 * pair.frequency)
    usual = conventional_inputs(pair.first.t, pair.frequency, band, inputs, start=0.5)
    signal = usual["3-2-1-1"].with_peak(peak)
    while (used := use_of_envelope(pair, truth, signal)) > 1.0:
        signal = signal.with_peak(float(jnp.max(signal.peak)) * max(0.98 / used, 0.5))
    return signal


def next_input(pair: Pair, first: Fits) -> Design:
    """Return the designed input, from the fits alone."""
    explanations = (one.explanation for one in first.both)
    return separating_input(*explanations, pair.first.t, pair.limits, pair.likelihood)


def decision(difference: float, true: int) -> str:
    """Return the decision in a word.

    Args:
        difference: chi-square by which the second explanation is worse.
        true: which one is the truth, 0 or 1.
    """
    towards = difference if true == 0 else -difference
    return "right" if towards >= DECISIVE else "wrong" if towards <= -DECISIVE else "open"


def case(pair: Pair, true: int, seed: int) -> dict[str, Any]:
    """Return the results of one pair with one of its effects as the truth."""
    begin = time.process_time()
    truth = Augmented(pair.model, (pair.effects[true],))
    flight = flown(pair, truth, pair.first, seed)
    first = fits(pair, [flight])
    design = next_input(pair, first)
    peak = float(jnp.max(design.signal.peak))
    signals = {"designed": design.signal, "3-2-1-1": conventional(pair, peak, truth)}
    result: dict[str, Any] = {
        "pair": pair.words,
        "truth": pair.effects[true].name,
        "first_difference": first.difference,
        "first": decision(first.difference, true),
        "expected_chi_square": design.chi_square,
    }
    for name, signal in signals.items():
        both = [flight, flown(pair, truth, signal, seed + 1000)]
        difference = fits(pair, both).difference
        result[name] = {
            "difference": difference,
            "decision": decision(difference, true),
            "use_of_envelope": use_of_envelope(pair, truth, signal),
            "peak": float(jnp.max(signal.peak)),
        }
    result["processor_seconds"] = time.process_time() - begin
    return result


def measure(seed: int, numbers: Sequence[int], report=lambda result: None) -> dict[str, Any]:
    """Return the results of some of the pairs, with either truth."""
    results = []
    for number, pair in enumerate(pairs()):
        if number in numbers:
            for true in (0, 1):
                results.append(case(pair, true, seed + 2 * number + true))
                report(results[-1])
    words = {name: _right(results, name) for name in ("first", "designed", "3-2-1-1")}
    return {"cases": results, "pairs_right_with_either_truth": words, "pairs": len(numbers)}


def _right(results: list[dict[str, Any]], name: str) -> int:
    """Return the number of pairs whose decisions are both right."""
    right = [
        (one[name] if name == "first" else one[name]["decision"]) == "right" for one in results
    ]
    return sum(a and b for a, b in zip(right[::2], right[1::2], strict=True))


def row(result: dict[str, Any]) -> str:
    """Return one case as a line of the table."""
    cells = [f"{result['truth']:<34} {result['first_difference']:>8.1f} {result['first']:>6}"]
    for name in ("designed", "3-2-1-1"):
        one = result[name]
        use = f"{100 * one['use_of_envelope']:.0f} %"
        cells.append(f"{one['difference']:>10.1f} {one['decision']:>6} {use:>6}")
    return " ".join(cells)


def table(results: dict[str, Any]) -> str:
    """Return the results as text."""
    heads = [f"{'truth':<34} {'first':>15}"]
    heads += [f"{name:>24}" for name in ("designed", "3-2-1-1")]
    lines = [" ".join(heads), *map(row, results["cases"])]
    for name, count in results["pairs_right_with_either_truth"].items():
        lines.append(f"{name}: {count} of {results['pairs']} pairs right with either truth")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the pairs and print them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pairs", nargs="*", type=int, default=list(range(10)))
    options = parser.parse_args(arguments)
    configure()
    results = measure(
        options.seed,
        options.pairs,
        lambda result: print(row(result), file=sys.stderr, flush=True),
    )
    sys.stdout.write((json.dumps(results, indent=2) if options.json else table(results)) + "\n")


if __name__ == "__main__":
    main()
