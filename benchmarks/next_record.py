"""The record that separates two explanations: `python -m benchmarks.next_record [--json]`.

Ten pairs of effects (`benchmarks.rival_pairs`) on a spring and a small aircraft. A first flight, a
doublet, is simulated with one of the two as the truth; both are fitted to it. The input of the next
record is designed from these two fits alone (`jaxid.study.separating_input`, as used by
`next_record` for a study), flown with the same truth, and both are fitted to the two records
together. The decision is right if the wrong explanation loses 6 or more of chi-square, wrong if the
true one does, else open. Beside it the same with a 3-2-1-1 of the same peak, reduced where it would
leave the envelope. Goal: 9 of 10 pairs right, with either truth, within the envelope.
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

from jaxid import Augmented, Estimate, Record, configure, estimate, free, stack
from jaxid.design import (
    Design,
    Explanation,
    InputSignal,
    conventional_inputs,
    planned_record,
)
from jaxid.effects import Effect
from jaxid.models import AbstractModel
from jaxid.simulation import simulate
from jaxid.study import separating_input

from .rival_pairs import Pair, pairs

DECISIVE = 6.0  # chi-square; a likelihood ratio of 20
STARTS = (0.3, 1.0)  # values of an effect from which a fit begins, over those of the truth
FINER = 4  # factor of the sample rate at which the envelope is checked


class Fits(NamedTuple):
    """Fits of both explanations, and by how much the second is worse [chi-square]."""

    both: tuple[Estimate, Estimate]
    difference: float


def flown(pair: Pair, truth: AbstractModel, signal: InputSignal, seed: int) -> Record:
    """Return the record of a flight with noise."""
    record = planned_record(truth, signal, pair.likelihood)
    deviation = np.sqrt(np.diagonal(np.asarray(pair.likelihood.noise.R)))
    noise = deviation * np.random.default_rng(seed).normal(size=record.z.shape)
    return eqx.tree_at(lambda node: node.z, record, record.z + noise)


def fit(pair: Pair, effect: Effect, estimated: Sequence[str], records: Record) -> Estimate:
    """Return the best fit of an explanation from several starts."""
    results = []
    for share in STARTS:
        start = effect
        for name in estimated:
            value = share * getattr(effect, name)
            start = eqx.tree_at(lambda e, name=name: getattr(e, name), start, value)
        model = Augmented(pair.model, (start,))
        names = [f"{effect.name}.{name}" for name in estimated]
        chosen = free(model, *pair.declared, *names, per_record=("initial_state",))
        results.append(estimate(model, chosen, records, pair.likelihood))
    return min(results, key=lambda result: np.nan_to_num(float(result.cost), nan=np.inf))


def fits(pair: Pair, records: Record) -> Fits:
    """Return the fits of both explanations."""
    first, second = (
        fit(pair, effect, names, records)
        for effect, names in zip(pair.effects, pair.estimated, strict=True)
    )
    return Fits((first, second), 2.0 * float(second.cost - first.cost))


def _blank(record: Record) -> Record:
    """Return a record without valid samples: one and two flights then share a compiled program."""
    return eqx.tree_at(lambda node: node.mask, record, jnp.zeros_like(record.mask))


def use_of_envelope(pair: Pair, truth: AbstractModel, signal: InputSignal) -> float:
    """Return the largest share of a limit of the motion that a flight uses, finely simulated."""
    count = FINER * (signal.t.size - 1) + 1
    t = jnp.linspace(signal.t[0], signal.t[-1], count)
    u = jnp.stack([jnp.interp(t, signal.t, column) for column in signal.u.T], axis=1)
    states = simulate(truth, t, u, jnp.zeros(len(truth.states))).x
    uses = []
    for name, (low, high) in pair.limits.envelope.items():
        motion = np.asarray(states[:, truth.states.index(name)])
        uses.append(np.max(np.maximum(motion / high, motion / low)))
    return float(max(uses))


def conventional(pair: Pair, peak: float, truth: AbstractModel) -> InputSignal:
    """Return a 3-2-1-1 of a given peak, reduced where it would leave the envelope."""
    inputs = pair.model.inputs
    band = (0.5 * pair.frequency, 3.0 * pair.frequency)
    usual = conventional_inputs(pair.first.t, pair.frequency, band, inputs, start=0.5)
    signal = usual["3-2-1-1"].with_peak(peak)
    for _ in range(6):
        used = use_of_envelope(pair, truth, signal)
        if used <= 1.0:
            break
        signal = signal.with_peak(0.98 * float(jnp.max(signal.peak)) / used)
    return signal


def next_input(pair: Pair, first: Fits) -> Design:
    """Return the designed input, from the fits alone."""
    explanations = (
        Explanation(one.model, one.free, np.asarray(one.information.triangle)) for one in first.both
    )
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
    record = flown(pair, truth, pair.first, seed)
    first = fits(pair, stack([record, _blank(record)]))
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
        both = stack([record, flown(pair, truth, signal, seed + 1000)])
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
