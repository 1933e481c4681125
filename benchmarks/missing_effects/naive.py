"""Naive method: stepwise regression of the residual on the signals of the same candidates."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.missing_effects.reference import Reference
from jaxid.effects.base import Effect
from jaxid.estimation.problem import Problem
from jaxid.models.free import Parameters, with_values
from jaxid.structure import Action, SubsetOptions, columns, stepwise

LEVEL = 0.01  # probability of one false term among all candidates, as in the loop


class Naive(NamedTuple):
    """Result of a regression of the residual.

    Attributes:
        first: signal that enters first, in the channel with its largest F; None if no signal
            enters.
        names: candidates that have this signal.
        terms: number of signals that enter, summed over channels.
    """

    first: str | None
    names: tuple[tuple[str, str], ...]
    terms: int


def naive(reference: Reference, library: Iterable[Effect]) -> Naive:
    """Regress each channel's training residual of the declared model on the signals of all
    candidates.

    The signal of a term is its product, of a sensor's scale its output, of a delay or lag a rate of
    change, and of a bias a constant. Signals are simulated by the declared model.
    """
    signals, residuals, mask, steps = _simulated(reference)
    named: dict[str, list[tuple[str, str]]] = {}
    table: dict[str, np.ndarray] = {}
    for effect in library:
        for key, column in _signal(effect, signals, steps):
            table[key] = column
            named.setdefault(key, []).append((effect.name, effect.card.family))
    X = np.stack([table[key].reshape(-1) for key in table], axis=1)
    moving = np.ptp(X, axis=0) > 0
    keys, X = [key for key, varies in zip(table, moving, strict=True) if varies], X[:, moving]
    best, first, terms = 0.0, None, 0
    options = SubsetOptions(level_in=LEVEL / len(keys))
    for channel in range(residuals.shape[-1]):
        valid = mask[..., channel].reshape(-1)
        path = stepwise(X[valid], residuals[..., channel].reshape(-1)[valid], keys, options=options)
        terms += len(path.models[-1].terms)
        entered = next((step for step in path.steps if step.action is Action.ENTER), None)
        if entered is not None and entered.partial_F > best:
            best, first = entered.partial_F, entered.name
    return Naive(first, tuple(named[first]) if first else (), terms)


def _simulated(reference: Reference):
    """Return signals by name, residuals, mask, and the time between samples.

    The first three have shape (case, time, ...).
    """
    declared = reference.declared
    given = declared.problem
    shared = jnp.asarray(declared.values[: len(given.free.shared)])
    model = with_values(given.model, given.free.shared, shared)
    problem = Problem.of(model, given.free, given.train, given.likelihood)
    rows = jnp.asarray(declared.motion.rows)
    signals, y = _signals_of(problem, Parameters(shared, rows))
    signals = {name: np.asarray(signal) for name, signal in signals.items()}
    signals |= {f"output {n}": np.asarray(y[..., i]) for i, n in enumerate(given.train.outputs)}
    signals |= {
        f"input {n}": np.asarray(given.train.u[..., i]) for i, n in enumerate(given.train.inputs)
    }
    steps = np.diff(np.asarray(given.train.t), axis=1)
    residuals = np.asarray(declared.solution.residuals)
    return signals, residuals, np.asarray(given.train.mask), float(np.median(steps))


@eqx.filter_jit
def _signals_of(problem: Problem, parameters: Parameters):
    solutions = problem.solve(parameters)
    return jax.vmap(jax.vmap(problem.model.signals))(
        solutions.t, solutions.x, problem.records.u
    ), solutions.y


def _signal(effect: Effect, signals: Mapping[str, np.ndarray], step: float):
    """Yield key and history of the signal of a candidate; nothing for a candidate without one."""
    kind, channel = type(effect).__name__, getattr(effect, "channel", None)
    shape = next(iter(signals.values())).shape
    for _, product in effect.terms[:1]:
        flat = {name: signal.reshape(-1) for name, signal in signals.items() if " " not in name}
        bare = " ".join(factor for factor in product.split() if "_per_" not in factor) or "1"
        yield bare, columns((bare,), flat)[:, 0].reshape(shape)
    if kind == "DryFriction":
        yield f"sign({effect.speed})", np.sign(signals[effect.speed])
    elif kind == "SensorBias":
        yield f"constant in {channel}", np.ones(shape)
    elif kind == "SensorScale":
        yield f"output {channel}", signals[f"output {channel}"]
    elif kind in ("SensorDelay", "SensorLag"):
        yield f"rate of {channel}", np.gradient(signals[f"output {channel}"], step, axis=1)
    elif kind == "SensorSaturation":
        output = signals[f"output {channel}"]
        at = 0.7 * (np.max(output) if effect.end == "upper" else np.min(output))
        yield (
            f"{effect.end} end of {channel}",
            np.maximum((output - at) * (1 if effect.end == "upper" else -1), 0.0),
        )
    elif kind in ("InputDelay", "InputLag"):
        yield f"rate of {channel}", np.gradient(signals[f"input {channel}"], step, axis=1)
