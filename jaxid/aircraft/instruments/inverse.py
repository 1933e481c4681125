"""Motion from readings: the inverse of `Instruments.read` for known errors."""

from collections.abc import Mapping

import jax.numpy as jnp

from ..._foundation.types import Array, Float
from ..air.atmosphere import AbstractAtmosphere, Air, true_airspeed
from ..physics.frames import CROSS
from ..physics.rigid_body import solve_3x3
from .channels import ANGULAR, CHANNEL_TABLE, FORCE, RATES
from .geometry import sensitive_axis
from .instruments import Instruments

Signals = Mapping[str, Float[Array, ""]]
Line = tuple[Float[Array, ""], Float[Array, ""]]  # slope and offset over u
VANES = ("alpha", "beta")
# Of the true airspeed. Derived: each substitution reduces the initial error of M^2/8 by more than a
# factor of M^2/4, so 20 reach rounding below Mach 0.9.
SUBSTITUTIONS = 20


def motion(
    instruments: Instruments,
    shown: Signals,
    known: Signals,
    atmosphere: AbstractAtmosphere,
    airspeed: str,
    beta: str,
) -> dict[str, Float[Array, ""]]:
    """Return the true signals at an instant, from readings and known values.

    Scale and bias are removed, rates and accelerations transformed from the instruments' axes into
    body axes, and specific forces transferred to the centre of gravity. Lag, delay, range and noise
    are not removed. A channel that is not in the instruments counts as ideal and at the centre of
    gravity.

    Args:
        instruments: instruments with the known errors.
        shown: readings by channel, NaN for a missing one [its unit]; values that depend on a
            missing reading are NaN too.
        known: true values by name, which replace readings [SI].
        atmosphere: for the airspeed.
        airspeed: "indicated" or "true": the quantity of channel V.
        beta: "vane" (flank angle) or "sideslip": the quantity of channel beta.

    Returns:
        The known values, and the signals that follow from the readings: `u v w` if the air data
        suffice, `ax ay az` if there are angular rates and accelerations, and all other channels
        [SI].
    """
    shown = {
        name: value for name, value in shown.items() if name in CHANNEL_TABLE and name not in known
    }
    true = {name: _unscaled(instruments, name, value) for name, value in shown.items()} | dict(
        known
    )
    for triple in (RATES, ANGULAR):
        true |= _straightened(instruments, triple, true, shown, jnp.zeros(3))
    if {*RATES, *ANGULAR} <= set(true) and set(FORCE) & set(shown):
        true |= _at_cg(instruments, true, shown)
    velocity = _velocity(instruments, true, shown, atmosphere, airspeed, beta)
    for name in ("V", "alpha", "beta"):
        if name in shown:
            true.pop(name)
    return true | velocity


def air_of(atmosphere: AbstractAtmosphere, true: Signals) -> Air:
    """Return the air at an `altitude` [m], with the known `density` [kg/m^3] and `sound_speed`
    [m/s] if there are any.

    Args:
        atmosphere: model of the other properties of the air.
        true: signals, with `altitude`.
    """
    known = {name: true[name] for name in ("density", "sound_speed") if name in true}
    return atmosphere.air(true["altitude"])._replace(**known)


def _unscaled(instruments: Instruments, name: str, value: Float[Array, ""]) -> Float[Array, ""]:
    if name not in instruments.channels:
        return value
    return (value - instruments.bias[name]) / (1.0 + instruments.scale[name])


def _straightened(
    instruments: Instruments, triple, true: Signals, shown: Signals, moved: Float[Array, "3"]
):
    """Return the body components of a vector from its readings along misaligned axes; known
    components are true values along the body axes.
    """
    if not set(triple) & set(shown):
        return {}
    unit = jnp.eye(3)
    rows, values = [], []
    for k, name in enumerate(triple):
        misaligned = name in shown and name in instruments.channels
        row = sensitive_axis("xyz"[k], instruments.misalignment[name]) if misaligned else unit[k]
        rows.append(row)
        values.append(true.get(name, jnp.zeros(())) - (moved[k] if name in shown else 0.0))
    matrix = jnp.stack(rows)
    inverse = jnp.stack([solve_3x3(matrix, column) for column in unit], axis=1)
    vector = _product(inverse, jnp.stack(values))
    return {name: vector[k] for k, name in enumerate(triple) if name in shown}


def _at_cg(instruments: Instruments, true: Signals, shown: Signals):
    """Return the specific forces at the centre of gravity: the readings less the specific force
    due to the position of each accelerometer, `omegadot x l + omega x (omega x l)`.
    """
    omega, omegadot = (jnp.stack([true[name] for name in names]) for names in (RATES, ANGULAR))
    more = []
    for k, name in enumerate(FORCE):
        if name in instruments.channels:
            position = instruments.position[name]
            moving = _cross(omega, position)
            force = _cross(omegadot, position) + _cross(omega, moving)
            axis = sensitive_axis("xyz"[k], instruments.misalignment[name])
            more.append(_dot(axis, force))
        else:
            more.append(jnp.zeros(()))
    return _straightened(instruments, FORCE, true, shown, jnp.stack(more))


def _velocity(
    instruments: Instruments, true: Signals, shown: Signals, atmosphere, airspeed: str, beta: str
):
    r"""Return the components of the velocity from speed and air angles, exact for vanes at any
    position, and for a sideslip at the centre of gravity.

    For a vane at (x, y, z) with the reading `a`, `w + p y - q x = tan(a) (u + q z - r y)`. The
    equation of the other vane has the same form, so that `w = A u + B`, `v = C u + D`. The speed
    then gives a quadratic equation for u > 0, `V^2 = u^2 + (A u + B)^2 + (C u + D)^2`.
    """
    indicated = "V" in shown and airspeed == "indicated"
    if not _suffices(true) or (indicated and "altitude" not in true):
        return {}
    V = true.get("V")
    if indicated:
        V = true_airspeed(true["V"], air_of(atmosphere, true), SUBSTITUTIONS)
    placed = _vane_positions(instruments, shown)
    A, B = _downward_line(true, placed)
    C, D = _sideward_line(true, placed, (A, B), V, beta == "sideslip" or "beta" not in shown)
    u = true["u"] if V is None or "u" in true else _forward(V, (A, B), (C, D))
    return {"u": u, "v": C * u + D, "w": A * u + B} | ({} if V is None else {"V": V})


def _vane_positions(instruments: Instruments, shown: Signals) -> dict[str, Float[Array, "3"]]:
    """Return the positions of the vanes with a reading, from the centre of gravity [m]."""
    read = [name for name in VANES if name in shown and name in instruments.channels]
    return {name: instruments.position[name] for name in read}


def _downward_line(true: Signals, placed: Mapping[str, Float[Array, "3"]]) -> Line:
    """Return A and B of `w = A u + B`: from w if known, otherwise from the vane of alpha."""
    if "w" in true:
        return jnp.zeros(()), true["w"]
    A = jnp.tan(true["alpha"])
    along, _, down = _at_vane(true, placed, "alpha")
    return A, A * along - down


def _sideward_line(
    true: Signals,
    placed: Mapping[str, Float[Array, "3"]],
    downward: Line,
    V: Float[Array, ""] | None,
    sideslip: bool,
) -> Line:
    """Return C and D of `v = C u + D`: from v if known, otherwise from the angle beta.

    Args:
        true: signals.
        placed: positions of the vanes.
        downward: A and B of `w = A u + B`.
        V: true airspeed; None if u is known.
        sideslip: True if beta is the sideslip, False for the flank angle of a vane.
    """
    if "v" in true:
        return jnp.zeros(()), true["v"]
    (A, B), C = downward, jnp.tan(true["beta"])
    along, across, down = _at_vane(true, placed, "beta")
    if sideslip and "u" in true:
        u = true["u"]
        return jnp.zeros(()), C * jnp.hypot(u + along, A * u + B + down) - across
    if sideslip and V is not None and ("w" in true or "beta" not in placed):
        return jnp.zeros(()), jnp.sin(true["beta"]) * V - across
    # The flank angle follows from the sideslip and the angle of attack of the other vane.
    C = C * jnp.sqrt(1.0 + A**2) if sideslip else C
    return C, C * along - across


def _at_vane(
    true: Signals, placed: Mapping[str, Float[Array, "3"]], name: str
) -> Float[Array, "3"]:
    """Return the velocity of a vane relative to the centre of gravity, `omega x l` [m/s]."""
    rates = jnp.stack([true.get(rate, jnp.zeros(())) for rate in RATES])
    return _cross(rates, placed.get(name, jnp.zeros(3)))


def _cross(omega: Float[Array, "3"], arm: Float[Array, "3"]) -> Float[Array, "3"]:
    """Return `omega x arm`; a missing rate counts only where its arm is not zero."""
    return _product(jnp.asarray(CROSS) @ arm, omega)


def _product(A: Float[Array, "3 3"], b: Float[Array, "3"]) -> Float[Array, "3"]:
    """Return `A b`; a missing element of b counts only where its coefficient is not zero."""
    return jnp.stack([_dot(row, b) for row in A])


def _dot(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, ""]:
    """Return `a b`; a missing element of b counts only where its coefficient is not zero."""
    return jnp.sum(a * jnp.where((a == 0.0) & jnp.isnan(b), 0.0, b))


def _suffices(true: Signals) -> bool:
    """True if speed and both air angles, or the velocity components in their place, are known."""
    return all(
        either in true or other in true
        for either, other in (("u", "V"), ("v", "beta"), ("w", "alpha"))
    )


def _forward(
    V: Float[Array, ""], *lines: tuple[Float[Array, ""], Float[Array, ""]]
) -> Float[Array, ""]:
    """Return the positive u of `V^2 = u^2 + sum (slope u + offset)^2`."""
    a = 1.0 + sum(slope**2 for slope, _ in lines)
    b = sum(slope * offset for slope, offset in lines)
    c = sum(offset**2 for _, offset in lines) - V**2
    return (jnp.sqrt(b**2 - a * c) - b) / a
