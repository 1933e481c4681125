"""Correction of the air angles and accelerations of a flight record to the c.g. (App. D.2.5 to
D.2.7).
"""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require, require_known
from ..._foundation.types import Array, Float
from ...data.record import Record
from ..instruments.channels import AXES

Signal = Float[Array, "*case"]


def air_angles_at_cg(
    measured: Mapping[str, Signal], alpha_vane: Any, beta_vane: Any, airspeed: Signal
) -> tuple[Signal, Signal]:
    r"""Return the angle of attack and the sideslip at the c.g. from the readings of two vanes.

    With `(x, y, z)` the position of each vane, `a, b` their readings without scale error, and V the
    true airspeed

        alpha = a + asin( [cos(a)(q x - p y) + sin(a)(q z - r y)] / (V cos beta) )
        beta  = atan A + asin( B/sqrt(1 + A^2) ),    A = cos(alpha) tan(b)
                                                     B = [tan(b)(q z - r y) - r x + p z]/V

    This is exact except for cos(beta) in the first line, which is computed from `b` alone: an error
    of (rate x distance/V)^2 beta. To first order in distance and sideslip these are `alpha = a + q
    x/V cos(a)` and `beta = b cos(alpha) - r x/V`, as printed in D.2.5.2 and D.2.6.2. D.2.5.2 prints
    one more term, `x g/V^2 (a_n - cos phi cos theta)`: x/V times the rate of turn of the flight
    path. The velocity at a vane on a rigid body differs by `omega x l` only (D.2.5.1), so this term
    has no cause and is left out.

    Args:
        measured: alpha, beta, p, q, r [rad, rad/s].
        alpha_vane, beta_vane: position of each vane from the c.g. [m].
        airspeed: V, true [m/s].

    Returns:
        alpha, beta [rad].
    """
    a, b, p, q, r = (measured[name] for name in ("alpha", "beta", "p", "q", "r"))
    x, y, z = alpha_vane
    sideslip = jnp.arctan(jnp.cos(a) * jnp.tan(b))
    turning = jnp.cos(a) * (q * x - p * y) + jnp.sin(a) * (q * z - r * y)
    alpha = a + jnp.arcsin(turning / (airspeed * jnp.cos(sideslip)))
    x, y, z = beta_vane
    A = jnp.cos(alpha) * jnp.tan(b)
    B = (jnp.tan(b) * (q * z - r * y) - r * x + p * z) / airspeed
    return alpha, jnp.arctan(A) + jnp.arcsin(B / jnp.sqrt(1.0 + A**2))


def corrected_angles(
    record: Record,
    *,
    alpha_vane: Any,
    beta_vane: Any,
    upwash: Mapping[str, float] | None = None,
    airspeed: Any = None,
) -> Record:
    """Return a record with the additional outputs `alpha_corrected` and `beta_corrected` (D.2.5.2,
    D.2.6.2).

    They are `air_angles_at_cg` of the measured alpha, beta, V, p, q, r, and missing at samples at
    which one of these is missing. The flank angle of the lateral vane becomes the sideslip
    `asin(v/V)`.

    Args:
        record: with the outputs alpha, beta, V, p, q, r; one record or a stack.
        alpha_vane, beta_vane: position of each vane from the c.g., (x, y, z) in body axes, as well
            as known [m].
        upwash: known relative errors of scale of alpha and beta, which are divided out first.
        airspeed: true airspeed, a number or one per sample [m/s]; the default is the measured V,
            uncorrected, as in the report.

    Returns:
        The record with two more outputs [rad].

    Raises:
        InputError: when an output is missing or already present, or a position is not three
            numbers.
    """
    needed = ("alpha", "beta", "V", "p", "q", "r")
    _check(record, needed, {"alpha_vane": alpha_vane, "beta_vane": beta_vane})
    upwash = upwash or {}
    require_known("vane (in `upwash`)", upwash, ("alpha", "beta"))
    measured = _columns(record, needed)
    for name, factor in upwash.items():
        measured[name] = measured[name] / (1.0 + factor)
    mask = _all_valid(record, needed)
    # A lost sample is zero; a speed of one in its place keeps the quotients finite. The mask
    # excludes the result.
    V = jnp.where(mask, measured["V"] if airspeed is None else jnp.asarray(airspeed, float), 1.0)
    alpha, beta = air_angles_at_cg(measured, alpha_vane, beta_vane, V)
    return _with_outputs(record, {"alpha_corrected": alpha, "beta_corrected": beta}, mask, "rad")


def acceleration_at_cg(
    axis: str, measured: Mapping[str, Signal], shown: Signal, position: Any
) -> Signal:
    """Return the specific force at the c.g. along one axis, from an accelerometer elsewhere: `f -
    (omegadot x l + omega x (omega x l))`.

    All terms of the transfer are used; D.2.7.3 to D.2.7.5 keep only the angular accelerations (and
    print `jdot` for `qdot` in D.2.7.5).

    Args:
        axis: "x", "y" or "z".
        measured: p, q, r, pdot, qdot, rdot [rad/s, rad/s^2].
        shown: reading of the accelerometer [m/s^2].
        position: l, its position from the c.g. [m].

    Returns:
        The component at the c.g. [m/s^2].
    """
    p, q, r, pdot, qdot, rdot = (measured[name] for name in ("p", "q", "r", "pdot", "qdot", "rdot"))
    x, y, z = position
    if axis == "x":
        return shown - (qdot * z - rdot * y + p * (q * y + r * z) - (q**2 + r**2) * x)
    if axis == "y":
        return shown - (rdot * x - pdot * z + q * (p * x + r * z) - (p**2 + r**2) * y)
    return shown - (pdot * y - qdot * x + r * (p * x + q * y) - (p**2 + q**2) * z)


def corrected_accelerations(record: Record, positions: Mapping[str, Any]) -> Record:
    """Return a record with additional outputs such as `ax_corrected`, the specific forces at the
    c.g. (D.2.7.3 to D.2.7.5).

    They are missing at samples at which one of the channels used is missing. For a record without
    angular accelerations, differentiate its smoothed rates and add them as outputs.

    Args:
        record: with the outputs p, q, r, pdot, qdot, rdot and the accelerometers of `positions`;
            one record or a stack.
        positions: position of each accelerometer from the c.g., by channel (ax, ay, az) [m].

    Returns:
        The record with one more output for each accelerometer [m/s^2].

    Raises:
        InputError: when an output is missing or already present, or a position is not three
            numbers.
    """
    require_known("accelerometer (in `positions`)", positions, tuple(f"a{axis}" for axis in AXES))
    motion = ("p", "q", "r", "pdot", "qdot", "rdot")
    _check(record, (*motion, *positions), positions)
    measured = _columns(record, (*motion, *positions))
    for name, place in positions.items():
        value = acceleration_at_cg(name[1], measured, measured[name], place)
        mask = _all_valid(record, (*motion, name))
        record = _with_outputs(record, {f"{name}_corrected": value}, mask, "m/s^2")
    return record


def _check(record: Record, needed: tuple[str, ...], places: Mapping[str, Any]) -> None:
    """Raise an InputError if an output is missing or a position is not three numbers."""
    require_known("output (needed for the correction)", needed, record.outputs)
    for name, place in places.items():
        require(
            np.shape(place) == (3,),
            f"The place {name!r} has shape {np.shape(place)}. Give (x, y, z) in m.",
        )


def _columns(record: Record, names: tuple[str, ...]) -> dict[str, Signal]:
    """Return the outputs by name, zero at missing samples."""
    return {name: record.z[..., record.outputs.index(name)] for name in names}


def _all_valid(record: Record, names: tuple[str, ...]):
    """Return the mask of the samples at which all of these outputs are valid."""
    return jnp.all(
        record.mask[..., np.array([record.outputs.index(name) for name in names])], axis=-1
    )


def _with_outputs(record: Record, values: dict[str, Signal], mask, unit: str) -> Record:
    """Return the record with additional outputs of one unit and one mask of valid samples."""
    for name in values:
        require(
            name not in record.outputs,
            f"The record has an output {name!r} already. It is corrected twice.",
        )
    new = jnp.stack([jnp.where(mask, value, 0.0) for value in values.values()], axis=-1)
    return Record(
        t=record.t,
        u=record.u,
        z=jnp.concatenate([record.z, new], axis=-1),
        mask=jnp.concatenate([record.mask, jnp.stack([mask] * len(values), axis=-1)], axis=-1),
        constants=record.constants,
        inputs=record.inputs,
        outputs=(*record.outputs, *values),
        input_units=record.input_units,
        output_units=(*record.output_units, *(unit for _ in values)),
        names=record.names,
    )
