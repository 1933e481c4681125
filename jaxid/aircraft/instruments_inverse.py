"""From what instruments show back to the motion: the inverse of `Instruments.read`, as far as the errors are known."""

from collections.abc import Mapping

import jax.numpy as jnp

from .._foundation.types import Array, Float
from .atmosphere import AbstractAtmosphere, Air, true_airspeed
from .instrument_channels import ANGULAR, FORCE, RATES, TABLE
from .instrument_geometry import sensitive_axis, specific_force_at
from .instruments import Instruments
from .rigid_body import solve_3x3

Signals = Mapping[str, Float[Array, ""]]
SUBSTITUTIONS = (
    20  # of the true airspeed: an error of M^2/8 falls by more than M^2/4 in each, to rounding below Mach 0.9
)


def motion(
    instruments: Instruments, shown: Signals, known: Signals, atmosphere: AbstractAtmosphere, airspeed: str, beta: str
) -> dict[str, Float[Array, ""]]:
    """What is true at an instant, from readings and from what is known beside them.

    Scale and bias are taken out, rates and accelerations turned from the instruments' axes into body axes, and specific forces
    moved to the centre of gravity. Lag, delay, range and noise stay. A channel of which the instruments know nothing counts as
    faultless and at the centre of gravity.

    Args:
        instruments: with the errors that are known.
        shown: readings by channel, NaN where there is none [its unit]; what is computed from one is NaN too.
        known: true values by name, which go before readings [SI].
        atmosphere: for the airspeed.
        airspeed: "indicated" or "true": what V shows.
        beta: "vane" (flank angle) or "sideslip": what beta shows.

    Returns:
        What is known, and what follows from the readings: `u v w` where air data suffice, `ax ay az` where there are angular
        rates and accelerations, and all other channels [SI].
    """
    shown = {name: value for name, value in shown.items() if name in TABLE and name not in known}
    true = {name: _unscaled(instruments, name, value) for name, value in shown.items()} | dict(known)
    for triple in (RATES, ANGULAR):
        true |= _straightened(instruments, triple, true, shown, jnp.zeros(3))
    if {*RATES, *ANGULAR} <= set(true) and set(FORCE) & set(shown):
        true |= _at_cg(instruments, true, shown)
    found = _velocity(instruments, true, shown, atmosphere, airspeed, beta)
    for name in ("V", "alpha", "beta"):
        if name in shown:
            true.pop(name)
    return true | found


def air_of(atmosphere: AbstractAtmosphere, true: Signals) -> Air:
    """The air at an `altitude` [m], with the `density` [kg/m^3] where that is known by itself.

    Args:
        atmosphere: which says the rest.
        true: signals, with `altitude`.
    """
    air = atmosphere.air(true["altitude"])
    return air._replace(density=true["density"]) if "density" in true else air


def _unscaled(instruments: Instruments, name: str, value: Float[Array, ""]) -> Float[Array, ""]:
    if name not in instruments.channels:
        return value
    return (value - instruments.bias[name]) / (1.0 + instruments.scale[name])


def _straightened(instruments: Instruments, triple, true: Signals, shown: Signals, moved: Float[Array, "3"]):
    """Body components of a vector from its readings along axes that may point askew, what is known being so already."""
    if not set(triple) & set(shown):
        return {}
    unit = jnp.eye(3)
    rows, values = [], []
    for k, name in enumerate(triple):
        askew = name in shown and name in instruments.channels
        row = sensitive_axis("xyz"[k], instruments.misalignment[name]) if askew else unit[k]
        rows.append(row)
        values.append(true.get(name, jnp.zeros(())) - (moved[k] if name in shown else 0.0))
    vector = solve_3x3(jnp.stack(rows), jnp.stack(values))
    return {name: vector[k] for k, name in enumerate(triple) if name in shown}


def _at_cg(instruments: Instruments, true: Signals, shown: Signals):
    """Specific forces at the centre of gravity; what each accelerometer feels more where it stands is taken off."""
    omega, omegadot = (jnp.stack([true[name] for name in names]) for names in (RATES, ANGULAR))
    more = []
    for k, name in enumerate(FORCE):
        if name in instruments.channels:
            lever = specific_force_at(jnp.zeros(3), omega, omegadot, instruments.position[name])
            more.append(sensitive_axis("xyz"[k], instruments.misalignment[name]) @ lever)
        else:
            more.append(jnp.zeros(()))
    return _straightened(instruments, FORCE, true, shown, jnp.stack(more))


def _velocity(instruments: Instruments, true: Signals, shown: Signals, atmosphere, airspeed: str, beta: str):
    r"""Components of the velocity from speed and air angles, exact for vanes in any place.

    A vane at (x, y, z) that shows `a` says `w + p y - q x = tan(a) (u + q z - r y)`, and likewise the other, so that
    `w = A u + B`, `v = C u + D`; what is left is a quadratic equation for u > 0, `V^2 = u^2 + (A u + B)^2 + (C u + D)^2`.
    """
    if not (_says(true, "u", "V") and _says(true, "v", "beta") and _says(true, "w", "alpha")):
        return {}
    p, q, r = (true.get(name, jnp.zeros(())) for name in RATES)

    def vane(name):
        tangent = jnp.tan(true[name])
        placed = name in shown and name in instruments.channels
        x, y, z = instruments.position[name] if placed else jnp.zeros(3)
        return tangent, (x, y, z)

    V = true.get("V")
    if V is not None and "V" in shown and airspeed == "indicated":
        if "altitude" not in true:
            return {}
        V = true_airspeed(V, air_of(atmosphere, true), SUBSTITUTIONS)
    A, B = jnp.zeros(()), true.get("w", jnp.zeros(()))
    if "w" not in true:
        A, (x, y, z) = vane("alpha")
        B = A * (q * z - r * y) - (p * y - q * x)
    C, D = jnp.zeros(()), true.get("v", jnp.zeros(()))
    if "v" not in true and "beta" in shown:
        C, (x, y, z) = vane("beta")
        # The flank angle from the sideslip, by the angle of attack that the other vane shows.
        C = C * jnp.sqrt(1.0 + A**2) if beta == "sideslip" else C
        D = C * (q * z - r * y) - (r * x - p * z)
    elif "v" not in true:
        D = jnp.sin(true["beta"]) * V if V is not None else jnp.tan(true["beta"]) * jnp.hypot(true["u"], true["w"])
    u = true["u"] if V is None or "u" in true else _forward(V, (A, B), (C, D))
    return {"u": u, "v": C * u + D, "w": A * u + B} | ({} if V is None else {"V": V})


def _says(true: Signals, *names: str) -> bool:
    return any(name in true for name in names)


def _forward(V: Float[Array, ""], *lines: tuple[Float[Array, ""], Float[Array, ""]]) -> Float[Array, ""]:
    """The positive u of `V^2 = u^2 + sum (slope u + offset)^2`."""
    a = 1.0 + sum(slope**2 for slope, _ in lines)
    b = sum(slope * offset for slope, offset in lines)
    c = sum(offset**2 for _, offset in lines) - V**2
    return (jnp.sqrt(b**2 - a * c) - b) / a
