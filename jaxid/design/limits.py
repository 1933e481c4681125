"""Limits of a designed manoeuvre: the inputs' size, rate and energy, and the flight envelope."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Array, Bool, Float
from ..models.base import AbstractModel
from ..simulation.solution import Solution

# Sharpness of a smooth maximum, which lies above the maximum by at most log(samples) over it, and
# number of parts of the time, each with a maximum (chosen: 2 % for 500 samples).
SHARPNESS, PARTS = 200.0, 12


def _number(value: Any) -> float | None:
    """Return a number of any kind, such as `np.radians(3.0)`, as a float."""
    return None if value is None else float(value)


def _numbers(values: Mapping[str, Any]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items()}


def _ranges(values: Mapping[str, Any]) -> dict[str, tuple[float | None, float | None]]:
    return {name: (_number(low), _number(high)) for name, (low, high) in values.items()}


class Limits(eqx.Module):
    """Limits of a manoeuvre.

    Attributes:
        amplitude: largest deviation of each input from trim [unit of the input].
        rate: largest rate of each input [unit/s]; none by default.
        energy: largest integral of the sum of squares of all deviations [unit^2 s].
        envelope: lowest and highest value of states, outputs and signals of the model; None for no
            bound.
    """

    amplitude: dict[str, float] = eqx.field(static=True, converter=_numbers)
    rate: dict[str, float] = eqx.field(static=True, converter=_numbers, default_factory=dict)
    energy: float | None = eqx.field(static=True, converter=_number, default=None)
    envelope: dict[str, tuple[float | None, float | None]] = eqx.field(
        static=True, converter=_ranges, default_factory=dict
    )


class Ratios(eqx.Module):
    """Limited quantities over their limits, 1 at the limit; the core of `Limits` as arrays.

    Attributes:
        amplitude, rate: limits of all inputs, infinite without one.
        energy: limit of the energy, infinite without one.
        room: distance from trim to the lower and the upper limit of each quantity of the envelope.
        trim: value of each quantity at trim.
        axes: positions of the inputs that move.
        names: names of the quantities of the envelope.
    """

    amplitude: Float[Array, " axis"]
    rate: Float[Array, " axis"]
    energy: Float[Array, ""]
    room: Float[Array, "quantity 2"]
    trim: Float[Array, " quantity"]
    axes: tuple[int, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    def labels(self) -> tuple[str, ...]:
        """Return the name of each ratio."""
        return (
            *(f"{name}, amplitude" for name in self.inputs),
            *(f"{name}, rate" for name in self.inputs),
            "energy",
            *(f"{name}, {side}" for name in self.names for side in ("lower", "upper")),
        )

    def is_given(self) -> Bool[np.ndarray, " ratio"]:
        """Return which of the ratios have a limit."""
        limits = (self.amplitude, self.rate, self.energy[None], self.room.reshape(-1))
        return np.isfinite(np.concatenate([np.asarray(part) for part in limits]))

    def ramp(self, step: float, sample_time: float) -> int:
        """Return the number of sample times in which the rates allow a step of all inputs.

        Args:
            step: size of the step, over the amplitudes.
            sample_time: time between samples [s].
        """
        needed = step * np.asarray(self.amplitude) / (np.asarray(self.rate) * sample_time)
        # A ramp that just keeps a limit would exceed it by rounding.
        return max(int(np.ceil(np.max(needed) * (1.0 + 1e-9))), 1)

    def of(
        self, t: Float[Array, " time"], deviation: Float[Array, "time input"], quantities, largest
    ) -> Float[Array, " ratio"]:
        """Return the ratios of a manoeuvre.

        Args:
            t: sample times [s].
            deviation: inputs less their values at trim.
            quantities: values of the envelope's quantities, shape (time, quantity).
            largest: function that returns the maximum over time, smooth or exact.
        """
        moved = deviation[:, jnp.array(self.axes, int)]
        step = jnp.diff(t)[:, None]
        rate = jnp.abs(jnp.diff(moved, axis=0)) / step / self.rate[None]
        # Each sample is held for the step behind it, the last one for the step before it.
        energy = jnp.sum(moved**2 * jnp.concatenate([step, step[-1:]])) / self.energy
        away = quantities - self.trim[None]
        sides = jnp.stack([-away / self.room[:, 0][None], away / self.room[:, 1][None]], axis=-1)
        return jnp.concatenate(
            [
                largest(jnp.abs(moved) / self.amplitude[None]),
                largest(rate),
                energy[None],
                largest(sides.reshape(t.size, -1)),
            ]
        )


def smooth_maxima(values: Float[Array, "time ratio"]) -> Float[Array, " maximum"]:
    """Return differentiable upper bounds of the maxima over parts of the time.

    Single maxima over all times have slopes that jump where another time takes over.
    """
    length = -(-len(values) // PARTS)
    padding = ((0, PARTS * length - len(values)), (0, 0))
    parts = jnp.pad(values, padding, mode="edge").reshape(PARTS, length, values.shape[1])
    return (jax.nn.logsumexp(SHARPNESS * parts, axis=1) / SHARPNESS).ravel()


def exact_maximum(values: Float[Array, "time ratio"]) -> Float[Array, " ratio"]:
    """Return the maximum over time."""
    return jnp.max(values, axis=0)


def quantities(
    model: AbstractModel, names: tuple[str, ...], solution: Solution, u: Float[Array, "time input"]
) -> Float[Array, "time quantity"]:
    """Return states, outputs or signals of the model along a trajectory, by name."""

    def at(t, x, y, u):
        known = {
            **model.signals(t, x, u),
            **dict(zip(model.outputs, y, strict=True)),
            **dict(zip(model.states, x, strict=True)),
        }
        return jnp.stack([known[name] for name in names]) if names else jnp.zeros(0)

    return jax.vmap(at)(solution.t, solution.x, solution.y, u)


def ratios(
    limits: Limits,
    model: AbstractModel,
    axes: tuple[str, ...],
    initial_state: Float[Array, " state"],
    trim_input: Float[Array, " input"],
) -> Ratios:
    """Return the limits of a model at a trim as arrays.

    Raises:
        InputError: for an unknown name, an axis without amplitude, a limit that is not positive, or
            an envelope that excludes the trim.
    """
    for option in (limits.amplitude, limits.rate):
        require_known("input", option, model.inputs)
    require_amplitudes(axes, limits)
    require_positive({**limits.amplitude, **limits.rate, "energy": limits.energy})
    names = tuple(limits.envelope)
    known = quantity_names(model, initial_state, trim_input)
    require_known("state, output or signal", names, known)
    trim = trim_values(model, names, initial_state, trim_input)
    room = np.full((len(names), 2), np.inf)
    for row, (name, (low, high)) in enumerate(limits.envelope.items()):
        value = trim[row]
        low, high = -np.inf if low is None else low, np.inf if high is None else high
        require_inside(name, low, high, float(value))
        room[row] = value - low, high - value
    return Ratios(
        jnp.array([limits.amplitude[axis] for axis in axes], float),
        jnp.array([limits.rate.get(axis, np.inf) for axis in axes], float),
        jnp.asarray(np.inf if limits.energy is None else limits.energy, float),
        jnp.asarray(room),
        jnp.asarray(trim),
        tuple(model.inputs.index(axis) for axis in axes),
        axes,
        names,
    )


def quantity_names(model: AbstractModel, x, u) -> tuple[str, ...]:
    """Return the names of the states, outputs and signals of a model, each once."""
    signals = jax.eval_shape(lambda x, u: model.signals(jnp.zeros(()), x, u), x, u)
    return tuple(dict.fromkeys((*model.states, *model.outputs, *signals)))


@eqx.filter_jit
def trim_values(
    model: AbstractModel,
    names: tuple[str, ...],
    x: Float[Array, " state"],
    u: Float[Array, " input"],
) -> Float[Array, " quantity"]:
    """Return states, outputs or signals of the model at an instant, by name."""
    t = jnp.zeros(())
    y = model.output(t, x, u)
    solution = Solution(t[None], x[None], y[None], jnp.asarray(True))
    return quantities(model, names, solution, u[None])[0]


def require_amplitudes(axes: tuple[str, ...], limits: Limits) -> None:
    """Refuse an input that moves and whose amplitude has no limit."""
    for axis in axes:
        require(
            limits.amplitude.get(axis, np.inf) < np.inf,
            f"The amplitude of the input {axis!r} has no limit. Give one in `amplitude`.",
        )


def require_inside(name: str, low: float, high: float, trim: float) -> None:
    """Refuse a range of the envelope that excludes the trim."""
    require(
        low < trim < high,
        f"The limits of {name!r}, {low:g} to {high:g}, exclude the trim, where it is {trim:g}. "
        "Widen the limits, or begin at another trim.",
    )


def require_positive(values: Mapping[str, float | None]) -> None:
    """Refuse limits that are zero or negative; None is no limit."""
    for name, value in values.items():
        require(
            value is None or bool(value > 0.0),
            f"The limit of {name!r} is {value}; it must be positive.",
        )
