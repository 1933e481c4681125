"""`fly`: one simulated flight, as its instruments record it and as it was."""

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_float64, require_known
from .._foundation.types import Array, Bool, Float, Numbers
from ..data.build import record
from ..data.record import Record
from ..models.base import canonical
from ..simulation.inputs import AbstractHold, Linear
from ..simulation.simulate import explain_divergence, run
from ..simulation.solution import Solution
from ..simulation.steppers import RK4, AbstractStepper
from .aerodynamics import COEFFICIENTS
from .aircraft import DISTURBANCES, Aircraft

SUBSTEPS = 5  # steps of 0.02 s at the report's ten samples a second: actuators of 0.05 s are followed to 1e-4
MOTION = ("alpha", "beta", "V", "mach", "qbar", "p", "q", "r", "phi", "pitch", "psi", "altitude", "u", "v", "w")
FORCES = ("ax", "ay", "az", "pdot", "qdot", "rdot", "stabilator", "aileron", "rudder", "thrust", *COEFFICIENTS)
TRUTH_UNITS = {
    **dict.fromkeys(("alpha", "beta", "phi", "pitch", "psi", "stabilator", "aileron", "rudder"), "rad"),
    **dict.fromkeys(("V", "u", "v", "w"), "m/s"),
    **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("ax", "ay", "az"), "m/s^2"),
    **dict.fromkeys(("pdot", "qdot", "rdot"), "rad/s^2"),
    **{"qbar": "Pa", "altitude": "m", "thrust": "N"},
}


class Flight(NamedTuple):
    """What `fly` makes.

    Attributes:
        record: what pilot and instruments recorded: the pilot's inputs, and the channels of the instruments.
        truth: the same flight without instruments: its outputs are the motion, the surfaces, the thrust, the accelerations
            and the six coefficients with all that acts on them; its inputs are all there were, disturbances included.
        aircraft: the one that flew.
    """

    record: Record
    truth: Record
    aircraft: Aircraft


class Flown(NamedTuple):
    """The arrays of a flight, from the pure `flown`.

    Attributes:
        solution: states and readings free of noise.
        z: measured values, shape (time, output).
        mask: True where a sample was recorded, shape (time, output).
    """

    solution: Solution
    z: Float[Array, "time output"]
    mask: Bool[Array, "time output"]


def flown(
    aircraft: Aircraft,
    t: Float[Array, " time"],
    u: Float[Array, "time input"],
    initial_state: Float[Array, " state"],
    key: Array,
    *,
    hold: AbstractHold | None = None,
    stepper: AbstractStepper | None = None,
) -> Flown:
    """A flight as arrays: the pure part of `fly`, for `jit`, `vmap` over flights, and `jacfwd`.

    Args:
        aircraft: may have traced leaves.
        t: sample times [s].
        u: every input of the aircraft, in their order.
        initial_state: as from `Aircraft.flight_state`.
        key: of the instruments' noise.
        hold: how inputs run between samples; straight lines by default.
        stepper: Runge-Kutta with five steps a sample by default.
    """
    solution = run(aircraft, t, u, initial_state, hold or Linear(), stepper or RK4(SUBSTEPS, unrolled=False))
    return Flown(solution, *aircraft.instruments.measure(key, t, solution.y))


def fly(
    aircraft: Aircraft,
    t: Float[Numbers, " time"],
    inputs: Mapping[str, Float[Numbers, "..."]],
    initial_state: Float[Array, " state"],
    *,
    key: Array,
    name: str = "flight",
    hold: AbstractHold | None = None,
    stepper: AbstractStepper | None = None,
) -> Flight:
    """Simulate a flight and record it.

        z_i = instruments(x(t_i), u(t_i)) + noise_i

    Args:
        aircraft: model, with its instruments.
        t: sample times, strictly increasing [s].
        inputs: signal by name of an input, each of shape (time,); those left out are zero, disturbances too.
        initial_state: as from `Aircraft.flight_state` or a trim.
        key: of the instruments' noise.
        name: of the records.
        hold: how inputs run between samples; straight lines by default.
        stepper: Runge-Kutta with five steps a sample by default.

    Returns:
        The record, the truth beside it, and the aircraft.

    Raises:
        InputError: for a name that is no input, a signal of another length or with a gap, times that do not increase, a state
            of another length, a flight that leaves tables which refuse to extrapolate, or one that diverges.

    Warns:
        UserWarning: when the flight leaves the range in which its aerodynamic tables are to be trusted.
    """
    require_float64()
    t = jnp.asarray(t, float)
    backwards = np.flatnonzero(~(np.diff(np.asarray(t)) > 0))
    require(
        backwards.size == 0,
        f"Flight {name!r}: the sample times do not increase after sample {backwards[0] if backwards.size else ''}. Sort them.",
    )
    given = tuple(one for one in DISTURBANCES if one in inputs)
    aircraft = canonical(aircraft if set(given) <= set(aircraft.disturbances) else aircraft.disturbed(*given))
    u = _inputs(aircraft, t, inputs)
    require(
        jnp.shape(initial_state) == (len(aircraft.states),),
        f"Flight {name!r}: the initial state has shape {jnp.shape(initial_state)}, and the aircraft has {len(aircraft.states)} "
        "states. Take the state that a trim gives, or make one with `Aircraft.flight_state`.",
    )
    result, histories = _flown(
        aircraft, t, u, initial_state, key, hold or Linear(), stepper or RK4(SUBSTEPS, unrolled=False)
    )
    _require_inside(aircraft, result.solution, histories, name)
    if not bool(result.solution.finite):
        raise explain_divergence(result.solution, aircraft, f"flight {name!r}")
    _warn_outside(aircraft, histories, name)
    piloted = tuple(one for one in aircraft.inputs if one not in DISTURBANCES)
    z = np.where(np.asarray(result.mask), np.asarray(result.z), np.nan)
    units = aircraft.units()
    measured = record(
        t,
        u[:, : len(piloted)],
        z,
        inputs=piloted,
        outputs=aircraft.outputs,
        units=_of(units, piloted + aircraft.outputs),
        name=name,
    )
    true = tuple(dict.fromkeys((*MOTION, *FORCES)))
    z = jnp.stack([histories[one] for one in true], axis=-1)
    kept = {f"true_{one}": one for one in aircraft.inputs}
    units = {"true_" + one: unit for one, unit in _of(units, aircraft.inputs).items()} | _of(TRUTH_UNITS, true)
    truth = record(t, u, z, inputs=tuple(kept), outputs=true, units=units, name=name)
    return Flight(measured, truth, aircraft)


@eqx.filter_jit
def _flown(aircraft, t, u, initial_state, key, hold, stepper):
    """The flight, and every signal along it."""
    result = flown(aircraft, t, u, initial_state, key, hold=hold, stepper=stepper)
    return result, jax.vmap(aircraft.signals)(t, result.solution.x, u)


def _inputs(aircraft: Aircraft, t: Array, inputs: Mapping[str, Numbers]) -> Float[Array, "time input"]:
    """All inputs of the aircraft in their order, those that are not given as zero."""
    require_known("input", inputs, (*aircraft.inputs, *DISTURBANCES))
    for one, signal in inputs.items():
        require(
            np.shape(signal) == t.shape,
            f"The input {one!r} has shape {np.shape(signal)} for {t.size} sample times. Give one value for each.",
        )
        lost = np.flatnonzero(~np.isfinite(np.asarray(signal, float)))
        require(
            lost.size == 0,
            f"The input {one!r} is not a finite number at sample {lost[0] if lost.size else ''}. Fill the gap.",
        )
    return jnp.stack([jnp.asarray(inputs.get(one, jnp.zeros_like(t)), float) for one in aircraft.inputs], axis=-1)


def _require_inside(aircraft: Aircraft, solution: Solution, histories: Mapping[str, Array], name: str) -> None:
    """Refuse a flight that has left tables which refuse to extrapolate, and say by which signal."""
    left = []
    for signal, (low, high) in aircraft.airframe.aerodynamics.refuses.items():
        history = np.asarray(histories[signal])
        row, value = _departure(history, low, high)
        if row < history.size:
            left.append((row, signal, value, low, high))
    if left:
        row, signal, value, low, high = min(left)
        unit, scale = ("deg", 180.0 / np.pi) if TRUTH_UNITS.get(signal) == "rad" else (TRUTH_UNITS.get(signal, ""), 1.0)
        raise InputError(
            f"Flight {name!r}: {signal} is {scale * value:.4g} {unit} at t = {float(solution.t[row]):g} s, and a table of "
            f"{aircraft.airframe.name} that refuses to extrapolate covers {scale * low:.4g} to {scale * high:.4g} {unit}. "
            "Fly within it, or choose the extrapolation 'hold' or 'linear'."
        )


def _departure(history: np.ndarray, low: float, high: float) -> tuple[int, float]:
    """The sample at which a signal is outside its range, and its value; a row beyond the last one when it never is.

    Outside, all is NaN from the first stage of the integration on, so that the sample itself may be lost. Then the
    signal is taken to have gone on straight from the two before; the NaN is another's doing where that stays inside.
    """
    outside = np.flatnonzero((history < low) | (history > high))
    if outside.size:
        return int(outside[0]), float(history[outside[0]])
    lost = np.flatnonzero(np.isnan(history))
    if lost.size and lost[0] > 1:
        row = int(lost[0])
        ahead = float(2.0 * history[row - 1] - history[row - 2])
        if not low <= ahead <= high:
            return row, ahead
    return history.size, np.nan


def _warn_outside(aircraft: Aircraft, histories: Mapping[str, Array], name: str) -> None:
    for signal, (low, high) in aircraft.airframe.trusted.items():
        history = np.asarray(histories[signal])
        share = np.mean((history < low) | (history > high))
        if share > 0:
            warnings.warn(
                f"Flight {name!r}: {signal} is outside {np.degrees(low):.4g} to {np.degrees(high):.4g} deg, where the data of "
                f"{aircraft.airframe.name} are to be trusted, in {100 * share:.0f} % of the samples (it reaches "
                f"{np.degrees(history.min()):.3g} to {np.degrees(history.max()):.3g} deg).",
                stacklevel=3,
            )


def _of(units: Mapping[str, str], names: tuple[str, ...]) -> dict[str, str]:
    return {one: units[one] for one in names if one in units}
