"""A body that turns, accelerates and flies through wind, by formula: its signals are exact
derivatives of place and attitude.
"""

import jax
import jax.numpy as jnp
import numpy as np

G = 9.80665
WIND = np.array([6.0, -4.0, 1.5])  # over ground, earth axes: north, east, down [m/s]
TIMES = jnp.linspace(0.3, 9.7, 7)


def place(t):
    """Of the c.g., north, east, down [m]."""
    return jnp.stack(
        [
            130.0 * t + 9.0 * jnp.sin(0.8 * t),
            14.0 * jnp.cos(0.6 * t),
            -3000.0 + 12.0 * jnp.sin(0.9 * t + 0.4),
        ]
    )


def attitude(t):
    """phi, pitch, psi [rad]."""
    return jnp.stack(
        [0.7 * jnp.sin(0.9 * t), 0.25 + 0.3 * jnp.sin(1.1 * t + 1.0), 0.2 + 0.25 * jnp.cos(t)]
    )


def to_earth(t):
    """Matrix from body to earth axes."""
    (cf, ct, cs), (sf, st, ss) = jnp.cos(attitude(t)), jnp.sin(attitude(t))
    roll = jnp.array([[1.0, 0, 0], [0, cf, -sf], [0, sf, cf]])
    pitch = jnp.array([[ct, 0, st], [0, 1.0, 0], [-st, 0, ct]])
    yaw = jnp.array([[cs, -ss, 0], [ss, cs, 0], [0, 0, 1.0]])
    return yaw @ pitch @ roll


def rate(function):
    """The derivative with respect to time."""
    return lambda t: jax.jvp(function, (t,), (jnp.ones(()),))[1]


def omega(t):
    """Angular rate in body axes, from the turning of the axes themselves."""
    skew = to_earth(t).T @ rate(to_earth)(t)
    return jnp.stack([skew[2, 1], skew[0, 2], skew[1, 0]])


def point(position):
    """Where a point of the body is in earth axes."""
    return lambda t: place(t) + to_earth(t) @ position


def air_velocity(position):
    """Velocity of a point of the body through the air, body axes."""
    return lambda t: to_earth(t).T @ (rate(point(position))(t) - WIND)


def specific_force(position):
    """Specific force at a point: its acceleration minus gravity, in body axes [m/s^2]."""
    return lambda t: to_earth(t).T @ (rate(rate(point(position)))(t) - jnp.array([0.0, 0.0, G]))


def signals(t):
    """The motion by name."""
    centre = jnp.zeros(3)
    u, v, w = air_velocity(centre)(t)
    V = jnp.sqrt(u**2 + v**2 + w**2)
    named = {
        "u_air": u,
        "v_air": v,
        "w_air": w,
        "V": V,
        "alpha": jnp.arctan2(w, u),
        "beta": jnp.arcsin(v / V),
    }
    named |= dict(zip(("p", "q", "r"), omega(t), strict=True))
    named |= dict(zip(("pdot", "qdot", "rdot"), rate(omega)(t), strict=True))
    named |= dict(zip(("ax", "ay", "az"), specific_force(centre)(t), strict=True))
    named |= dict(zip(("phi", "pitch", "psi"), attitude(t), strict=True))
    named |= {"altitude": -place(t)[2], "density": jnp.asarray(0.9), "mach": V / 328.0}
    held = {"stabilator": -0.03, "aileron": 0.01, "rudder": 0.02, "thrust": 4e4}
    return named | {name: jnp.asarray(value) for name, value in held.items()}
