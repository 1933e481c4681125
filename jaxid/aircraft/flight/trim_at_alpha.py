"""Stabilator and thrust for an angle of attack in horizontal flight."""

import jax.numpy as jnp

from ..._foundation.checks import require
from ..._foundation.types import Array
from ...simulation.trim import Trim, solve_equilibrium
from ..physics.frames import quaternion, velocity
from .aircraft import Aircraft


def trim_at_alpha(
    aircraft: Aircraft, alpha: float, altitude: float, V: Array | float | None = None
) -> Trim:
    """Return stabilator and thrust for an angle of attack in horizontal flight, and a free speed.

        udot = qdot = 0,  and wdot = 0 if V is None,    at pitch = alpha, beta = p = q = r = 0

    At a given speed and angle of attack the normal force may differ slightly from the weight; the
    flight path is then slightly curved.

    Args:
        aircraft: aircraft with engines of constant thrust.
        alpha: angle of attack [rad].
        altitude: altitude [m].
        V: speed [m/s]; None to trim the speed too.

    Raises:
        InputError: if the flight cannot be trimmed.
    """
    require(
        0 < alpha < 1.5,
        f"alpha is {alpha:g} rad; the weight is carried at angles between 0 and 1.5 rad.",
    )
    names, units = ("stabilator", "thrust", "V"), ("rad", "N", "m/s")
    scale, guess = (0.1, 5e4, 100.0), (-0.05, 4e4, 170.0)
    count = 2 if V is not None else 3
    return solve_equilibrium(
        _level_residual,
        jnp.array(guess[:count]),
        (
            aircraft,
            jnp.asarray(alpha),
            jnp.asarray(altitude),
            None if V is None else jnp.asarray(V),
        ),
        names=names[:count],
        units=units[:count],
        scale=jnp.array(scale[:count]),
        equations=("udot", "qdot", "wdot")[:count],
        equation_units=("m/s^2", "rad/s^2", "m/s^2")[:count],
    )


def _level_residual(values, args):
    aircraft, alpha, altitude, V = args
    V = values[2] if V is None else V
    surfaces = {"stabilator": values[0], "aileron": jnp.zeros(()), "rudder": jnp.zeros(())}
    e = quaternion(0.0, alpha, 0.0)
    rates = aircraft.steady_rates(
        velocity(V, alpha, 0.0), jnp.zeros(3), e, altitude, surfaces, values[1]
    )
    return rates[jnp.array([0, 4, 2])][: values.shape[0]]
