"""Pseudo-measurements: coefficients from accelerations and rates, for regression (Table 3.2)."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...data.record import Record
from ...models.pseudo_measurements import PseudoMeasurements
from ..instruments.channels import ANGULAR, FORCE, RATES
from ..vehicle.controls import SURFACES
from .motion import RigidMotion
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
    _require_needed(motion, record, (*measured, *known, *motion.held))
    coefficients, signals = _coefficients(motion, readings, measured, known)
    responses = {name: coefficients[name] for name in motion.channels.responses}
    signals = {name: signals[name] for name in REGRESSION_SIGNALS}
    valid = jnp.all(jnp.isfinite(jnp.stack([*responses.values(), *signals.values()])), axis=0)
    return PseudoMeasurements(
        t=record.t,
        responses={name: jnp.where(valid, value, 0.0) for name, value in responses.items()},
        signals={name: jnp.where(valid, value, 0.0) for name, value in signals.items()},
        valid=valid,
        candidates=tuple((name, candidates.get(name, ())) for name in responses),
        centred=("alpha", "beta"),
    )


def _require_needed(motion: RigidMotion, record: Record, available: tuple[str, ...]) -> None:
    """Refuse a record without a channel that the coefficients need."""
    for name in _needed(motion):
        if name not in available:
            raise missing(record, name, "for the coefficients")
    for name in ("u", "v", "w"):
        if name not in available and AIR_DATA[name] not in available:
            raise missing(record, name, "for the coefficients")


def _needed(motion: RigidMotion) -> tuple[str, ...]:
    """Return the channels that the coefficients of the propagated equations need."""
    channels = motion.channels
    forces = zip(("CX", "CY", "CZ"), FORCE, strict=True)
    accelerometers = tuple(name for force, name in forces if force in channels.responses)
    if bool(np.any(np.asarray(motion.airframe.reference) != 0.0)):  # every force makes a moment
        accelerometers = FORCE
    measured = tuple(name for name in channels.measured if name not in ANGULAR)
    altitude = ("altitude",) if "altitude" in channels.states else ()
    return (*RATES, *ANGULAR, *accelerometers, *SURFACES, *measured, *altitude)


@eqx.filter_jit
def _coefficients(
    motion: RigidMotion, readings: Readings, measured: Histories, known: Histories
) -> tuple[Histories, Histories]:
    """Return the six coefficients and all signals at each sample."""
    return jax.vmap(lambda measured, known: motion.coefficients(readings.motion(measured, known)))(
        measured, known
    )
