"""Truth of the cheap systems: NumPy equations, integrated by SciPy's DOP853, all records at once.

Nothing of `jaxid`'s equations, effects or steppers is used.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853

from benchmarks.missing_effects.truth_effects import (
    Inputs,
    Signals,
    after_mass_steps,
    force,
    kind,
    memories,
    read,
    recorded,
)

RTOL, ATOL = 1e-9, 1e-11


class Plant(NamedTuple):
    """A declared model in NumPy.

    Attributes:
        states, inputs, outputs: names of the channels.
        rates: rates of the states from the signals, by name.
        shown: outputs from the signals and the rates, by name.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rates: Callable[[Signals], Signals]
    shown: Callable[[Signals, Signals], Signals]


def fly(
    plant: Plant,
    effects: Sequence,
    t: np.ndarray,
    u: Signals,
    x0: Signals,
    disturbance: Mapping[str, np.ndarray] | None = None,
) -> np.ndarray:
    """Return the outputs without noise, shape (record, time, output).

    Args:
        plant: the equations.
        effects: effects that act in addition.
        t: uniform sample times [s].
        u: inputs by name, shape (record, time).
        x0: initial states by name, shape (record,).
        disturbance: unrecorded forces by state, shape (record, time), linear between samples.
    """
    inputs, hidden, carried = (
        Inputs(t, u, effects),
        Inputs(t, dict(disturbance or {})),
        memories(effects, x0, u),
    )
    at = {id(one.effect): index for index, one in enumerate(carried)}
    start = np.concatenate(
        [np.stack([x0[name] for name in plant.states]), *(one.start for one in carried)]
    )
    ends = len(plant.states) + np.cumsum([0, *(len(one.start) for one in carried)])

    def parts(time, x):
        """Return signals, states of the effects, inputs of the plant, and rates of the plant."""
        effect_states, plant_inputs = (
            [x[begin:end] for begin, end in itertools.pairwise(ends)],
            inputs.plant_input(time),
        )
        signals = dict(zip(plant.states, x, strict=False)) | plant_inputs
        for one, value in zip(carried, effect_states, strict=True):
            if kind(one.effect) == "InputLag":
                name = one.effect.channel
                signals[name] = signals[name] + float(one.effect.gain) * (value[0] - signals[name])
        rates = after_mass_steps(effects, time, dict(plant.rates(signals)))
        added = [
            force(one, signals, effect_states[at[id(one)]][0] if id(one) in at else None)
            for one in effects
        ]
        added += [(state, hidden.recorded(state, time)) for state in hidden.u]
        for state, addition in filter(None, added):
            rates[state] = rates[state] + addition
        return signals, effect_states, plant_inputs, rates

    def right_hand_side(time, flat):
        signals, effect_states, plant_inputs, rates = parts(time, flat.reshape(start.shape))
        memory = [
            one.rate(value, plant_inputs, signals, rates)
            for one, value in zip(carried, effect_states, strict=True)
        ]
        return np.concatenate(
            [*(rates[name] for name in plant.states), *(row for one in memory for row in one)]
        )

    shown = []
    for time, flat in zip(t, integrated(right_hand_side, t, start.reshape(-1)), strict=True):
        signals, _, _, rates = parts(time, flat.reshape(start.shape))
        outputs = plant.shown(signals, rates)
        shown.append([outputs[name] for name in plant.outputs])
    return read(effects, t, np.moveaxis(np.array(shown), 2, 0), plant.outputs)


def integrated(right_hand_side: Callable, t: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the states at the sample times.

    The integration restarts at each sample, because the slope of the inputs jumps there.
    """
    states = [start]
    for begin, end in itertools.pairwise(t):
        solver = DOP853(
            right_hand_side, begin, states[-1], end, rtol=RTOL, atol=ATOL, first_step=end - begin
        )
        while solver.status == "running":
            solver.step()
        if solver.status == "failed" or not np.all(np.isfinite(solver.y)):
            raise ValueError(f"the truth cannot be integrated beyond {begin:g} s")
        states.append(solver.y)
    return np.array(states)


def measured(
    plant: Plant,
    effects: Sequence,
    generator: np.random.Generator,
    setting: Mapping,
    t: np.ndarray,
    u: Signals,
    x0: Signals,
    noise: Sequence[float],
) -> np.ndarray:
    """Return the recorded outputs, shape (record, time, output), NaN where a sample is missing.

    Args:
        plant, effects, t, u, x0: as in `fly`.
        generator: generator of noise, gusts and gaps.
        setting: `memory` is the correlation of the noise from sample to sample; `gust` has the
            sizes of unrecorded forces by state, and `gust_time` their correlation time [s]; `bias`
            has the sizes of offsets by output; `gaps` is the share of missing samples.
        noise: standard deviations of the outputs.
    """
    shape = (*next(iter(u.values())).shape, len(plant.outputs))
    error = noise_of(generator, shape, setting.get("memory", 0.0))
    keep = np.exp(-(t[1] - t[0]) / setting.get("gust_time", 1.0))
    gusts = {
        name: size * noise_of(generator, shape[:2], keep)
        for name, size in setting.get("gust", {}).items()
    }
    clean = fly(plant, effects, t, u, x0, gusts)
    for name, size in setting.get("bias", {}).items():
        clean[..., plant.outputs.index(name)] += size * generator.normal()
    z = recorded(effects, clean + np.asarray(noise) * error, plant.outputs)
    if "gaps" in setting:
        z[generator.uniform(size=z.shape) < setting["gaps"]] = np.nan
    return z


def noise_of(generator: np.random.Generator, shape: tuple[int, ...], memory: float) -> np.ndarray:
    """Return first-order autoregressive noise of unit variance along the second axis."""
    white = generator.normal(size=shape)
    coloured = np.array(white)
    for i in range(1, shape[1] if memory else 0):
        coloured[:, i] = memory * coloured[:, i - 1] + np.sqrt(1.0 - memory**2) * white[:, i]
    return coloured
