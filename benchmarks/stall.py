"""Quasi-steady stalls with hysteresis, the declared aircraft of attached flow: `python -m
benchmarks.stall [--json] [--seeds 3]`.

Five simulated stalls at 25 Hz, angle of attack to 16 deg; the truth has the separation point
as a state, and is integrated by another code (`benchmarks.stall_flight`). The candidates of the
loop are the general effects, the aircraft's own terms and all unsteady aerodynamics. Goal: the loop
adds static separation first, and then its lag. The table shows the error of lift on the test stall,
for all samples and above 13 deg.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.stall_flight import NOISE, TRAIN, Stalls, fly_stalls, lift
from jaxid import FixedNoise, OutputError, close_loop, estimate, free
from jaxid.aircraft import aircraft_effects
from jaxid.aircraft.flight.longitudinal import Longitudinal
from jaxid.diagnosis.validation import predict
from jaxid.effects import Augmented, general_effects
from jaxid.effects.base import Effect
from jaxid.loop.columns import own_parameters
from jaxid.models.base import AbstractModel
from jaxid.study import Study

ORDER = ("static separation", "separation with hysteresis")
WINDOW = 50  # samples in which the test stall's first state is fitted
HIGH = np.radians(13.0)


def library(model: Longitudinal) -> tuple[Effect, ...]:
    """Return the general effects, the model's terms and unsteady aerodynamics, without repeats."""
    effects = (
        *general_effects(model, ()),
        *model.effects(),
        *aircraft_effects(model, groups=("unsteady",)),
    )
    return tuple({effect.name: effect for effect in effects}.values())


def studied(stalls: Stalls, effects: Sequence[Effect], progress=None) -> Study:
    """Close the loop on the training stalls."""
    records = list(stalls.records.values())
    chosen = free(stalls.model, "CX", "CZ", "Cm", per_record=("initial_state",))
    return close_loop(
        stalls.model,
        chosen,
        OutputError(),
        train=records[:TRAIN],
        check=records[TRAIN],
        test=records[TRAIN + 1],
        effects=effects,
        window=WINDOW,
        progress=progress,
    )


def lift_errors(stalls: Stalls, model: AbstractModel) -> dict[str, float]:
    """Return the RMS error of the predicted lift coefficient on the test stall, after the window.

    One value is for all samples, the other for the samples with alpha above 13 deg.

    Args:
        stalls: records and truth.
        model: fitted model; it predicts from an initial state fitted in the window.
    """
    noise = FixedNoise(jnp.diag(jnp.array(list(NOISE.values())) ** 2))
    states = stalls.model.states
    prediction = predict(
        model, stalls.records["test"], OutputError(noise), window=WINDOW, states=states
    )
    true = stalls.clean["test"]
    apart = (lift(np.asarray(prediction.y[0]), stalls.thrust) - lift(true, stalls.thrust))[WINDOW:]
    high = true[WINDOW:, Longitudinal.outputs.index("alpha")] > HIGH
    return {"all": _rms(apart), "above 13 deg": _rms(apart[high])}


def after_each(stalls: Stalls, study: Study) -> list[dict]:
    """Return the lift errors of the declared model and of the model after each round.

    All parameters are estimated for each model.
    """
    rows = [{"model": "declared", **lift_errors(stalls, study.before.estimate.model)}]
    names: tuple[str, ...] = ()
    for one in study.rounds:
        names = tuple(name for name in (*names, *one.added_effects) if name not in one.dropped)
        if one.added is None:
            continue
        last = set(names) == set(study.effects)
        model = study.after.estimate.model if last else refitted(stalls, study, names)
        rows.append({"model": f"with {one.added}", **lift_errors(stalls, model)})
    return rows


def refitted(stalls: Stalls, study: Study, names: Sequence[str]) -> AbstractModel:
    """Return the declared model with the named effects, estimated on the training stalls."""
    final = study.after.estimate.model
    assert isinstance(final, Augmented)
    known = {effect.name: effect for effect in library(stalls.model)} | {
        one.name: one for one in final.effects_in
    }
    effects = tuple(from_finer(known[name], final.effects_in) for name in names)
    effect_parameters = tuple(name for effect in effects for name in own_parameters(effect))
    model = Augmented(study.before.estimate.model, effects)
    chosen = free(
        model,
        "CX",
        "CZ",
        "Cm",
        *effect_parameters,
        per_record=tuple(f"initial_state.{one}" for one in stalls.model.states),
    )
    return estimate(model, chosen, list(stalls.records.values())[:TRAIN], OutputError()).model


def from_finer(effect: Effect, effects: Sequence[Effect]) -> Effect:
    """Return an effect with the values of the finer effect that replaced it.

    Only the fields that both effects have are copied.
    """
    finer = next((one for one in effects if one.card.refines == effect.card.family), effect)
    fields = [
        name
        for name in ("gain", "alpha_star", "steepness", "forward", "pitching")
        if hasattr(effect, name)
    ]
    return eqx.tree_at(
        lambda one: [getattr(one, name) for name in fields],
        effect,
        [getattr(finer, name) for name in fields],
    )


def measure(seed: int, progress=None) -> dict:
    """Fly the stalls and close the loop; return the summary of the study and its lift errors."""
    stalls = fly_stalls(seed)
    start = time.perf_counter()
    study = studied(stalls, library(stalls.model), progress)
    seconds = time.perf_counter() - start
    return {"seed": seed, "seconds": seconds, **summary(study), "lift": after_each(stalls, study)}


def summary(study: Study) -> dict:
    """Return the verdict, the rounds and the values of the effects of the final model."""
    rounds = []
    for one in study.rounds:
        kept = [c for c in one.candidates if c.check_fall is not None]
        best = [
            {
                "name": c.name,
                "score": c.score,
                "cost_fall": c.cost_fall,
                "check_fall": c.check_fall,
                "verdict": c.verdict,
            }
            for c in sorted(kept, key=lambda c: -(c.check_fall or 0.0))
        ]
        rounds.append(
            {
                "added": one.added,
                "dropped": list(one.dropped),
                "refitted": best,
            }
        )
    report = study.to_dict()
    families = [c.family for one in study.rounds for c in one.candidates if c.name == one.added]
    return {
        "outcome": study.outcome.value,
        "verdict": study.verdict,
        "families": families,
        "in order": tuple(families[:2]) == ORDER,
        "rounds": rounds,
        "parameters": {
            name: value
            for name, value in report["parameters"].items()
            if any(name.startswith(e) for e in study.effects)
        },
        **{side: report[side] for side in ("before", "after", "noise")},
    }


def table(rows: list[dict]) -> str:
    """Return the results as text, one block for each seed."""
    lines = []
    for row in rows:
        lines += [f"seed {row['seed']}, {row['seconds']:.0f} s: {row['verdict']}", ""]
        lines.append(
            f"  {'RMS error of the lift coefficient':<58}{'all samples':>14}{'above 13 deg':>14}"
        )
        lines += [
            f"  {one['model']:<58}{one['all']:>14.4f}{one['above 13 deg']:>14.4f}"
            for one in row["lift"]
        ]
        lines += ["", f"  {'error on the test stall':<24}{'before':>12}{'after':>12}{'noise':>12}"]
        for name in row["before"]:
            lines.append(
                f"  {name:<24}{row['before'][name]:>12.4g}{row['after'][name]:>12.4g}"
                f"{row['noise'][name]:>12.4g}"
            )
        lines.append("")
    share = sum(row["in order"] for row in rows)
    return "\n".join(
        [*lines, f"{' first, then '.join(ORDER)}: in {share} of {len(rows)} studies (goal: all)"]
    )


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if the order was right in every study, else 1."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.stall", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else"
    )
    parser.add_argument("--seeds", type=int, default=1, help="how many studies (default: 1)")
    parser.add_argument(
        "--progress", action="store_true", help="print the progress on standard error"
    )
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    progress = (
        (lambda words: print(words, file=sys.stderr, flush=True)) if options.progress else None
    )
    rows = [measure(seed, progress) for seed in range(options.seeds)]
    reached = all(row["in order"] for row in rows)
    if options.json:
        print(json.dumps({"status": "reached" if reached else "missed", "studies": rows}))
    else:
        print(table(rows))
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
