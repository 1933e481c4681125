"""Pseudo-measurements: coefficients from accelerations and rates (Table 3.2), and their equations
in weak form.
"""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require
from ..._foundation.host import on_host
from ..._foundation.types import Bool, Numbers
from ...data.record import Record
from ...models.pseudo_measurements import PseudoMeasurements, WeakMeasurements
from ..instruments.channels import ANGULAR, FORCE, RATES
from ..vehicle.controls import SURFACES
from ..vehicle.force_axes import FORCES
from .motion import RigidMotion, Signals
from .rate_signals import needed_rates
from .readings import AIR_DATA, Readings
from .records import Histories, histories, missing

REGRESSION_SIGNALS = (  # factors of the terms of a regression
    *("alpha", "beta", "V", "mach", "qbar", "density", "phat", "qhat", "rhat", "u", "v", "w"),
    *(*RATES, *SURFACES, "thrust", "altitude"),
)


def pseudo_measurements(
    motion: RigidMotion,
    readings: Readings,
    record: Record,
    candidates: Mapping[str, tuple[str, ...]],
) -> PseudoMeasurements:
    """Return the coefficients and the signals of their terms.

    This implements `IdentificationModel.pseudo_measurements`.

    Args:
        motion: equations of the model.
        readings: instruments and channels of the model.
        record: a single record.
        candidates: terms by coefficient.

    Raises:
        InputError: if a channel is missing.
    """
    measured, known = histories(readings, record)
    _require_needed(motion, (*_needed(motion), *ANGULAR), record, (*measured, *known))
    coefficients, tables, signals = _coefficients(motion, readings, measured, known)
    responses = {name: coefficients[name] for name in motion.channels.responses}
    signals = _factors(motion, record, _rates(motion, candidates), signals)
    valid = _finite(responses, signals)
    return PseudoMeasurements(
        t=record.t,
        responses={name: jnp.where(valid, value, 0.0) for name, value in responses.items()},
        signals={name: jnp.where(valid, value, 0.0) for name, value in signals.items()},
        valid=valid,
        candidates=tuple((name, candidates.get(name, ())) for name in responses),
        centred=("alpha", "beta"),
        known={name: jnp.where(valid, tables[name], 0.0) for name in responses if name in tables},
    )


def weak_measurements(
    motion: RigidMotion,
    readings: Readings,
    record: Record,
    candidates: Mapping[str, tuple[str, ...]],
) -> WeakMeasurements:
    """Return the coefficients' equations without angular accelerations.

    This implements `IdentificationModel.weak_measurements`.

    Args:
        motion: equations of the model.
        readings: instruments and channels of the model.
        record: a single record.
        candidates: terms by coefficient.

    Raises:
        InputError: if a channel is missing.
    """
    measured, known = map(_without_angular, histories(readings, record))
    _require_needed(motion, _needed(motion), record, (*measured, *known))
    rates = _rates(motion, candidates)
    _require_at_cg(motion, readings, rates)
    *equations, signals = _weak_parts(motion, readings, measured, known)
    signals = _factors(motion, record, rates, signals)
    responses = motion.channels.responses
    multipliers, *parts = ({name: each[name] for name in responses} for each in equations)
    valid = _finite(signals, multipliers, *parts)
    return WeakMeasurements(
        t=record.t,
        multipliers=multipliers,
        parts={name: tuple(part[name] for part in parts) for name in responses},
        signals={name: jnp.where(valid, value, 0.0) for name, value in signals.items()},
        valid=valid,
        candidates=tuple((name, candidates.get(name, ())) for name in responses),
        centred=("alpha", "beta"),
    )


def _rates(motion: RigidMotion, candidates: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return the rates of the air angles on which candidates depend."""
    own = {name: candidates.get(name, ()) for name in motion.channels.responses}
    return needed_rates(own, motion.channels)


def _factors(
    motion: RigidMotion, record: Record, rates: tuple[str, ...], signals: Histories
) -> Histories:
    """Return the factors of terms, with the rates of the air angles."""
    for name in ("phi", "pitch") if rates else ():
        if name not in signals:
            raise missing(record, motion.channels, (name,), "for the rates of the air angles")
    return {name: signals[name] for name in (*REGRESSION_SIGNALS, *rates)}


def _require_at_cg(motion: RigidMotion, readings: Readings, rates: tuple[str, ...]) -> None:
    """Refuse the weak form of lift and drag, and of terms with the rates of the air angles, from
    accelerometers off the centre of gravity.

    The share of the angular accelerations in lift and drag then varies with the angles, and the
    rates of the air angles cannot be computed without angular accelerations.
    """
    position = readings.instruments.position
    off = [name for name in FORCE if name in position.channels and np.any(position[name])]
    require(
        not off or (motion.channels.axes == "body" and not rates),
        "The weak form of lift and drag, or with rates of the air angles, needs accelerometers at "
        "the centre of gravity. Correct them first (`corrected_accelerations`), or take the "
        "regression on samples.",
    )


def _without_angular(histories: Histories) -> Histories:
    """Return the histories without angular accelerations."""
    return {name: value for name, value in histories.items() if name not in ANGULAR}


@on_host
def _finite(xp, *histories: dict) -> Bool[Numbers, " time"]:
    """Return True for each sample with finite values of all histories."""
    values = [value for each in histories for value in each.values()]
    return xp.all(xp.isfinite(xp.stack(values)), axis=0)


def _require_needed(
    motion: RigidMotion, needed: tuple[str, ...], record: Record, measured: tuple[str, ...]
) -> None:
    """Refuse a record without a channel that the coefficients need."""
    has = {*measured, *motion.held}
    lacking = tuple(name for name in needed if name not in has)
    lacking += tuple(name for name in ("u", "v", "w") if not {name, AIR_DATA[name]} & has)
    if lacking:
        raise missing(record, motion.channels, lacking, "for the coefficients")


def _needed(motion: RigidMotion) -> tuple[str, ...]:
    """Return the channels that the coefficients need, without angular accelerations."""
    channels = motion.channels
    body = {force for name in channels.responses for force in channels.force.body.get(name, ())}
    forces = zip(FORCES, FORCE, strict=True)
    accelerometers = tuple(name for force, name in forces if force in body)
    if bool(np.any(np.asarray(motion.airframe.reference) != 0.0)):  # every force makes a moment
        accelerometers = FORCE
    measured = tuple(name for name in channels.measured if name not in ANGULAR)
    altitude = ("altitude",) if "altitude" in channels.states else ()
    return (*RATES, *accelerometers, *SURFACES, *measured, *altitude)


@eqx.filter_jit
def _coefficients(
    motion: RigidMotion, readings: Readings, measured: Histories, known: Histories
) -> tuple[Histories, Histories, Histories]:
    """Return the six coefficients, their known parts, and all signals at each sample."""

    def at(measured: Signals, known: Signals) -> tuple[Signals, Signals, Signals]:
        coefficients, signals = motion.coefficients(readings.motion(measured, known))
        return coefficients, motion.known_coefficients(signals), signals

    return jax.vmap(at)(measured, known)


@eqx.filter_jit
def _weak_parts(
    motion: RigidMotion, readings: Readings, measured: Histories, known: Histories
) -> tuple[Histories, Histories, Histories, Histories]:
    """Return multipliers, parts of order zero and one, and signals at each sample.

    The forces and moments are linear in the angular acceleration with constant slopes:
    `N(omegadot) = N(0) + A omegadot`. The part of order one is `A omega = N(omega) - N(0)`.
    """

    def at(measured: Signals, known: Signals) -> tuple[Signals, Signals, Signals, Signals]:
        at_rest = readings.motion(measured, known | dict.fromkeys(ANGULAR, jnp.zeros(())))
        coefficients, signals = motion.coefficients(at_rest)
        tables = motion.known_coefficients(signals)
        rates = {dot: at_rest[rate] for dot, rate in zip(ANGULAR, RATES, strict=True)}
        moving, _ = motion.coefficients(readings.motion(measured, known | rates))
        lengths = (1.0, 1.0, 1.0, *motion.airframe.lengths)
        pressure_area = signals["qbar"] * motion.airframe.S
        names = motion.channels.force.coefficients
        multipliers = {
            name: pressure_area * length for name, length in zip(names, lengths, strict=True)
        }
        static = {name: multipliers[name] * coefficients[name] for name in names}
        momenta = {name: multipliers[name] * moving[name] - static[name] for name in names}
        unknown = {name: static[name] - multipliers[name] * tables.get(name, 0.0) for name in names}
        return multipliers, unknown, momenta, signals

    return jax.vmap(at)(measured, known)
