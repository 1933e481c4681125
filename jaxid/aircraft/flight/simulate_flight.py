"""`simulate_flight`: simulate a flight, with its measured record and its true histories."""

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import InputError, require, require_float64, require_known
from ..._foundation.types import Array, Bool, Float, Numbers
from ...data.build import record
from ...data.record import Record
from ...models.base import canonical
from ...models.equation_shapes import check_equations
from ...simulation.hold import AbstractHold, Linear
from ...simulation.simulate import explain_divergence, run
from ...simulation.solution import Solution
from ...simulation.steppers import RK4, AbstractStepper
from ..vehicle.aerodynamics import COEFFICIENTS
from .aircraft import DISTURBANCES, Aircraft

# chosen: steps of 0.02 s at the report's ten samples a second integrate actuators with a time
# constant of 0.05 s to 1e-4
SUBSTEPS = 5
TRUE_MOTION = (
    "alpha",
    "beta",
    "V",
    "mach",
    "qbar",
    "p",
    "q",
    "r",
    "phi",
    "pitch",
    "psi",
    "altitude",
    "u",
    "v",
    "w",
)
TRUE_FORCES = (
    "ax",
    "ay",
    "az",
    "pdot",
    "qdot",
    "rdot",
    "stabilator",
    "aileron",
    "rudder",
    "thrust",
    *COEFFICIENTS,
)
TRUTH_UNITS = {
    **dict.fromkeys(
        ("alpha", "beta", "phi", "pitch", "psi", "stabilator", "aileron", "rudder"), "rad"
    ),
    **dict.fromkeys(("V", "u", "v", "w"), "m/s"),
    **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("ax", "ay", "az"), "m/s^2"),
    **dict.fromkeys(("pdot", "qdot", "rdot"), "rad/s^2"),
    **{"qbar": "Pa", "altitude": "m", "thrust": "N"},
}


class Flight(NamedTuple):
    """Result of `simulate_flight`.

    Attributes:
        record: measured record: the pilot's inputs, and the channels of the instruments.
        truth: true histories: the outputs are the motion, the surfaces, the thrust, the
            accelerations and the six coefficients including the contributions of all effects; the
            inputs are all inputs, disturbances included.
        aircraft: simulated aircraft.
    """

    record: Record
    truth: Record
    aircraft: Aircraft


class FlightSolution(NamedTuple):
    """Arrays of a flight, from the pure function `flight_solution`.

    Attributes:
        solution: states and noise-free readings.
        z: measured values, shape (time, output).
        mask: True where a sample was recorded, shape (time, output).
    """

    solution: Solution
    z: Float[Array, "time output"]
    mask: Bool[Array, "time output"]


def flight_solution(
    aircraft: Aircraft,
    t: Float[Array, " time"],
    u: Float[Array, "time input"],
    initial_state: Float[Array, " state"],
    key: Array,
    *,
    hold: AbstractHold | None = None,
    stepper: AbstractStepper | None = None,
) -> FlightSolution:
    """Return a flight as arrays.

    This is the pure part of `simulate_flight`, for `jit`, `vmap` over flights, and `jacfwd`.

    Args:
        aircraft: model; its leaves may be traced.
        t: sample times [s].
        u: all inputs of the aircraft, in their order.
        initial_state: state from `Aircraft.flight_state`.
        key: random key of the instruments' noise.
        hold: interpolation of inputs between samples; linear by default.
        stepper: integrator; Runge-Kutta with five steps per sample by default.
    """
    solution = run(
        aircraft, t, u, initial_state, hold or Linear(), stepper or RK4(SUBSTEPS, unrolled=False)
    )
    return FlightSolution(solution, *aircraft.instruments.measure(key, t, solution.y))


def simulate_flight(
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
    """Simulate a flight and its measured record.

        z_i = instruments(x(t_i), u(t_i)) + noise_i

    Args:
        aircraft: model, with its instruments.
        t: sample times, strictly increasing [s].
        inputs: signals by name of the input, each of shape (time,); inputs and disturbances that
            are not given are zero.
        initial_state: state from `Aircraft.flight_state` or a trim.
        key: random key of the instruments' noise.
        name: name of the records.
        hold: interpolation of inputs between samples; linear by default.
        stepper: integrator; Runge-Kutta with five steps per sample by default.

    Returns:
        The measured record, the true histories, and the aircraft.

    Raises:
        InputError: for an unknown input, a signal of another length or with a gap, times that do
            not increase, a state of another length, a flight that leaves tables without
            extrapolation, or a flight that diverges.

    Warns:
        UserWarning: if the flight leaves the valid range of its aerodynamic tables.
    """
    require_float64()
    t = jnp.asarray(t, float)
    _require_increasing(t, name)
    given = tuple(disturbance for disturbance in DISTURBANCES if disturbance in inputs)
    aircraft = canonical(
        aircraft if set(given) <= set(aircraft.disturbances) else aircraft.disturbed(*given)
    )
    u = _inputs(aircraft, t, inputs)
    require(
        jnp.shape(initial_state) == (len(aircraft.states),),
        f"Flight {name!r}: the initial state has shape {jnp.shape(initial_state)}, and the "
        f"aircraft has {len(aircraft.states)} states. Take the state of a trim, or make one with "
        "`Aircraft.flight_state`.",
    )
    check_equations(aircraft)
    hold, stepper = hold or Linear(), stepper or RK4(SUBSTEPS, unrolled=False)
    stepper.check(t, (name,))
    result, histories = _solution_and_signals(
        aircraft,
        t,
        u,
        initial_state,
        key,
        hold,
        stepper,
    )
    _require_inside(aircraft, result.solution, histories, name)
    if not bool(result.solution.finite):
        raise explain_divergence(result.solution, aircraft, f"flight {name!r}")
    _warn_outside(aircraft, histories, name)
    measured = _measured(aircraft, t, u, result, name)
    return Flight(measured, _truth(aircraft, t, u, histories, name), aircraft)


def _require_increasing(t: Float[Array, " time"], name: str) -> None:
    for sample in np.flatnonzero(~(np.diff(np.asarray(t)) > 0))[:1]:
        raise InputError(
            f"Flight {name!r}: the sample times do not increase after sample {sample}. Sort them."
        )


def _measured(aircraft: Aircraft, t: Array, u: Array, result: FlightSolution, name: str) -> Record:
    """Return the measured record: pilot inputs and instrument channels."""
    piloted = tuple(channel for channel in aircraft.inputs if channel not in DISTURBANCES)
    return record(
        t,
        u[:, : len(piloted)],
        np.where(np.asarray(result.mask), np.asarray(result.z), np.nan),
        inputs=piloted,
        outputs=aircraft.outputs,
        units=_selected(aircraft.units(), piloted + aircraft.outputs),
        name=name,
    )


def _truth(
    aircraft: Aircraft, t: Array, u: Array, histories: Mapping[str, Array], name: str
) -> Record:
    """Return the record of the true motion, forces and inputs."""
    outputs = tuple(dict.fromkeys((*TRUE_MOTION, *TRUE_FORCES)))
    inputs = tuple(f"true_{channel}" for channel in aircraft.inputs)
    units = {
        f"true_{channel}": unit
        for channel, unit in _selected(aircraft.units(), aircraft.inputs).items()
    }
    return record(
        t,
        u,
        jnp.stack([histories[channel] for channel in outputs], axis=-1),
        inputs=inputs,
        outputs=outputs,
        units=units | _selected(TRUTH_UNITS, outputs),
        name=name,
    )


@eqx.filter_jit
def _solution_and_signals(aircraft, t, u, initial_state, key, hold, stepper):
    """Return the flight, and the histories of all signals."""
    result = flight_solution(aircraft, t, u, initial_state, key, hold=hold, stepper=stepper)
    return result, jax.vmap(aircraft.signals)(t, result.solution.x, u)


def _inputs(
    aircraft: Aircraft, t: Array, inputs: Mapping[str, Numbers]
) -> Float[Array, "time input"]:
    """Return all inputs of the aircraft in their order; inputs that are not given are zero."""
    require_known("input", inputs, (*aircraft.inputs, *DISTURBANCES))
    for name, signal in inputs.items():
        require(
            np.shape(signal) == t.shape,
            f"The input {name!r} has shape {np.shape(signal)} for {t.size} sample times. Give one "
            "value for each.",
        )
        gaps = np.flatnonzero(~np.isfinite(np.asarray(signal, float)))
        require(
            gaps.size == 0,
            f"The input {name!r} is not a finite number at sample {gaps[0] if gaps.size else ''}. "
            "Fill the gap.",
        )
    columns = [inputs.get(name, jnp.zeros_like(t)) for name in aircraft.inputs]
    return jnp.stack([jnp.asarray(column, float) for column in columns], axis=-1)


def _require_inside(
    aircraft: Aircraft, solution: Solution, histories: Mapping[str, Array], name: str
) -> None:
    """Refuse a flight that has left tables without extrapolation; the error names the signal."""
    departures = []
    for signal, (low, high) in aircraft.airframe.aerodynamics.hard_limits.items():
        history = np.asarray(histories[signal])
        row, value = _departure(history, low, high)
        if row < history.size:
            departures.append((row, signal, value, low, high))
    if departures:
        row, signal, value, low, high = min(departures)
        unit, scale = (
            ("deg", 180.0 / np.pi)
            if TRUTH_UNITS.get(signal) == "rad"
            else (TRUTH_UNITS.get(signal, ""), 1.0)
        )
        raise InputError(
            f"Flight {name!r}: {signal} is {scale * value:.4g} {unit} at t = "
            f"{float(solution.t[row]):g} s, and a table of {aircraft.airframe.name} that refuses "
            f"to extrapolate covers {scale * low:.4g} to {scale * high:.4g} {unit}. Fly within it, "
            "or choose the extrapolation 'hold' or 'linear'."
        )


def _departure(history: np.ndarray, low: float, high: float) -> tuple[int, float]:
    """Return the first sample at which a signal is outside its range, and its value.

    If the signal is never outside, the sample is one beyond the last. Outside the tables all values
    are NaN from the first stage of the integration on, so the sample itself may be NaN. The signal
    is then extrapolated linearly from the two samples before; if the extrapolation is inside the
    range, the NaN has another cause.
    """
    outside = np.flatnonzero((history < low) | (history > high))
    if outside.size:
        return int(outside[0]), float(history[outside[0]])
    gaps = np.flatnonzero(np.isnan(history))
    if gaps.size and gaps[0] > 1:
        row = int(gaps[0])
        extrapolated = float(2.0 * history[row - 1] - history[row - 2])
        if not low <= extrapolated <= high:
            return row, extrapolated
    return history.size, np.nan


def _warn_outside(aircraft: Aircraft, histories: Mapping[str, Array], name: str) -> None:
    for signal, (low, high) in aircraft.airframe.trusted.items():
        history = np.asarray(histories[signal])
        share = np.mean((history < low) | (history > high))
        if share > 0:
            warnings.warn(
                f"Flight {name!r}: {signal} is outside {np.degrees(low):.4g} to "
                f"{np.degrees(high):.4g} deg, the range in which the data of "
                f"{aircraft.airframe.name} are to be trusted, in {100 * share:.0f} % of the "
                "samples (it reaches "
                f"{np.degrees(history.min()):.3g} to {np.degrees(history.max()):.3g} deg).",
                stacklevel=3,
            )


def _selected(units: Mapping[str, str], names: tuple[str, ...]) -> dict[str, str]:
    return {name: units[name] for name in names if name in units}
