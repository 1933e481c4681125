"""A longitudinal flight with lift and drag, integrated by SciPy without the package's equations.

States are speed, angle of attack, pitch and pitch rate, in SI units and radians.
"""

import numpy as np
from scipy.integrate import solve_ivp

from jaxid.aircraft import model_of

G0, DENSITY, THRUST = 9.80665, 0.8, 9000.0
MASS, IY, S, B, CBAR = 7500.0, 91000.0, 30.0, 14.5, 2.4
STEP = 0.04  # s
HELD = {
    **{"aileron": 0.0, "rudder": 0.0, "thrust": THRUST},
    **{"density": DENSITY, "altitude": 4000.0},
}


def accelerations(V, alpha, CD, CL):
    """Return ax and az at the centre of gravity [m/s^2]."""
    force = 0.5 * DENSITY * V**2 * S / MASS
    ax = force * (CL * np.sin(alpha) - CD * np.cos(alpha)) + THRUST / MASS
    return ax, -force * (CL * np.cos(alpha) + CD * np.sin(alpha))


def flown(rates, samples, levels):
    """Return times, stabilator and states of a flight with random levels of the stabilator.

    Args:
        rates: function of states and stabilator that returns the rates of the states.
        samples: number of samples.
        levels: number of levels.
    """
    t = STEP * np.arange(samples)
    signs = np.random.default_rng(5).choice([-1.0, 1.0], size=levels)
    knots = np.linspace(0.0, t[-1], levels + 1)
    stabilator = np.interp(t, knots, np.concatenate([[0.0], 0.02 * signs]))
    solution = solve_ivp(
        lambda now, x: rates(x, np.interp(now, t, stabilator)),
        (0.0, t[-1]),
        [105.0, 0.105, 0.10, 0.0],
        t_eval=t,
        max_step=STEP,
        rtol=1e-10,
        atol=1e-12,
    )
    return t, stabilator, solution.y


def declared(record, terms, **setting):
    """Return the model of a flight in stability axes, with the true terms as candidates."""
    return model_of(
        record,
        mass=MASS,
        Iy=IY,
        S=S,
        b=B,
        cbar=CBAR,
        states="longitudinal",
        frame="air path",
        force_axes="stability",
        held=HELD,
        candidates={name: tuple(each)[1:] for name, each in terms.items()},
        **setting,
    )
