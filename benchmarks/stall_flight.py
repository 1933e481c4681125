"""Simulated stalls of a jet transport: slow approaches at idle, some time at the stall, and
recovery.

The truth is written in plain NumPy, its separation state among the others, and integrated by
SciPy's DOP853. Mass, size and coefficients are our choice, of a short-range jet's magnitude; 25 Hz
and angles of attack up to 16 deg are those of a flight test of this kind (Fischenberg &
Jategaonkar, Identification of Aircraft Stall Behavior from Flight Test Data, RTO-MP-11, 1999).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy.optimize

from benchmarks.missing_effects.truth import Plant, fly
from jaxid.aircraft.air.atmosphere import GRAVITY
from jaxid.aircraft.flight.longitudinal import Longitudinal
from jaxid.data import Record, record
from jaxid.models import Polynomial

# kg, kg m^2, m^2, m, kg/m^3 (3 km)
MASS, IY, AREA, CHORD, DENSITY = 17000.0, 450000.0, 64.0, 3.16, 0.91
CX = {"1": -0.035, "alpha": 0.15, "alpha^2": 2.6}
CZ = {"1": -0.25, "alpha": -4.8, "qhat": -6.0, "elevator": -0.4}
CM = {"1": 0.06, "alpha": -0.9, "qhat": -18.0, "elevator": -1.2}
GAIN, ALPHA_STAR, STEEPNESS = -4.8, np.radians(15.0), 25.0
LAG, LATE = 0.5, 0.2  # s, some 10 and 4 chord lengths of flight
FORWARD, PITCHING = -0.15, -0.05  # of the lost CZ, into CX and Cm
SPEED, IDLE = 85.0, 0.55  # m/s at the start, and the share of the thrust for level flight there
SAMPLE_TIME, SAMPLES = 0.04, 1001  # s
# rad, rad/s, m/s^2, m/s
NOISE = {"alpha": 9e-4, "q": 1.7e-3, "pitch": 9e-4, "ax": 0.03, "az": 0.08, "V": 0.3}
STARTS_OFF = 0.1  # relative error of the declared coefficients, with alternating sign; chosen
# Of each stall: time until the stick is back [s], its deflection [deg], and the pilot's sines
# there: amplitudes [deg] and periods [s].
STALLS = {
    "stall 1": (24.0, -7.0, ((1.2, 4.0),)),
    "stall 2": (20.0, -6.9, ((0.6, 2.5), (0.6, 6.0))),
    "stall 3": (27.0, -6.5, ((1.2, 5.0),)),
    "check": (22.0, -6.9, ((1.0, 3.2),)),
    "test": (25.0, -7.1, ((1.0, 4.5), (0.6, 2.0))),
}
TRAIN = 3


class Stalls(NamedTuple):
    """Model and records of a flight test, and the truth.

    Attributes:
        model: declared model of attached flow.
        records: records by name, as in `STALLS`.
        clean: outputs without noise by name, shape (time, output).
        thrust: thrust in all records [N].
    """

    model: Longitudinal
    records: dict[str, Record]
    clean: dict[str, np.ndarray]
    thrust: float


def polynomial(terms, signals):
    """A coefficient of attached flow from its signals."""
    known = {"1": 1.0, "alpha^2": signals["alpha"] ** 2, **signals}
    return sum(value * known[name] for name, value in terms.items())


def static(alpha):
    """Where the flow separates at an angle that stays: from 1, at the trailing edge, to 0."""
    return 0.5 * (1.0 - np.tanh(STEEPNESS * (alpha - ALPHA_STAR)))


def coefficients(state, elevator, x):
    """CX, CZ, Cm with the flow separated as far as x."""
    V = np.hypot(state["u"], state["w"])
    alpha = np.arctan2(state["w"], state["u"])
    signals = {"alpha": alpha, "qhat": state["q"] * CHORD / (2.0 * V), "elevator": elevator}
    attached = (polynomial(terms, signals) for terms in (CX, CZ, CM))
    loss = GAIN * alpha * ((0.5 * (1.0 + np.sqrt(np.clip(x, 1e-4, 1.0)))) ** 2 - 1.0)
    return [
        one + share * loss for one, share in zip(attached, (FORWARD, 1.0, PITCHING), strict=True)
    ]


def plant(thrust):
    """The equations of motion in the plane of symmetry, and of the place of separation."""

    def rates(s):
        u, w, q, pitch = (s[name] for name in ("u", "w", "q", "pitch"))
        force = 0.5 * DENSITY * (u**2 + w**2) * AREA
        forward, down, moment = coefficients(s, s["elevator"], s["x"])
        udot = -q * w + (force * forward + thrust) / MASS - GRAVITY * np.sin(pitch)
        wdot = q * u + force * down / MASS + GRAVITY * np.cos(pitch)
        alphadot = (u * wdot - w * udot) / (u**2 + w**2)
        aim = static(np.arctan2(w, u) - LATE * alphadot)
        return {
            "u": udot,
            "w": wdot,
            "q": force * CHORD * moment / IY,
            "pitch": q,
            "x": (aim - s["x"]) / LAG,
        }

    def shown(s, dx):
        ax = dx["u"] + s["q"] * s["w"] + GRAVITY * np.sin(s["pitch"])
        az = dx["w"] - s["q"] * s["u"] - GRAVITY * np.cos(s["pitch"])
        V, alpha = np.hypot(s["u"], s["w"]), np.arctan2(s["w"], s["u"])
        return {"alpha": alpha, "q": s["q"], "pitch": s["pitch"], "ax": ax, "az": az, "V": V}

    return Plant(("u", "w", "q", "pitch", "x"), ("elevator",), Longitudinal.outputs, rates, shown)


def trimmed():
    """Angle of attack, elevator and thrust of level flight."""

    def residual(unknown):
        alpha, elevator, thrust = unknown[0], unknown[1], 1e5 * unknown[2]
        state = {"u": SPEED * np.cos(alpha), "w": SPEED * np.sin(alpha), "q": 0.0, "pitch": alpha}
        rates = plant(thrust).rates(state | {"elevator": elevator, "x": static(alpha)})
        return [rates["u"], rates["w"], rates["q"]]

    alpha, elevator, thrust = scipy.optimize.fsolve(residual, [0.1, 0.0, 0.2], xtol=1e-12)
    return alpha, elevator, 1e5 * thrust


def stick(t, back, far, waves, elevator, size):
    """The elevator of one stall: slowly back, movements at the stall from there on, and forward for
    the recovery [rad].
    """
    recovery = back + 10.0
    shape = [0.0, 1.0, back, recovery, recovery + 1.5, t[-1]]
    slow = np.interp(t, shape, [0.0, 0.0, far, 1.15 * far, 0.2 * far, 0.3 * far])
    inside = np.clip((t - back + 6.0) / 2.0, 0.0, 1.0) * np.clip((recovery - t) / 1.0, 0.0, 1.0)
    moved = sum(amplitude * np.sin(2 * np.pi * (t - back) / period) for amplitude, period in waves)
    return elevator + np.radians(size * slow + inside * moved)


def fly_stalls(seed: int, samples: int = SAMPLES) -> Stalls:
    """Fly them all.

    Args:
        seed: of the noise and of how far the stick is pulled (within 3 %).
        samples: length of the records.
    """
    generator = np.random.default_rng([seed, 25])
    alpha, elevator, level = trimmed()
    thrust, t = IDLE * level, SAMPLE_TIME * np.arange(samples)
    sizes = generator.uniform(0.97, 1.03, len(STALLS))
    u = np.stack(
        [stick(t, *one, elevator, size) for one, size in zip(STALLS.values(), sizes, strict=True)]
    )
    begin = {
        "u": SPEED * np.cos(alpha),
        "w": SPEED * np.sin(alpha),
        "q": 0.0,
        "pitch": alpha,
        "x": static(alpha),
    }
    start = {name: np.full(len(STALLS), value) for name, value in begin.items()}
    y = fly(plant(thrust), (), t, {"elevator": u}, start)
    z = y + np.array(list(NOISE.values())) * generator.normal(size=y.shape)
    model = declared(thrust)
    named = {name: model.units()[name] for name in (*model.inputs, *model.outputs)}
    records = {
        name: record(
            t,
            u[i, :, None],
            z[i],
            inputs=model.inputs,
            outputs=model.outputs,
            units=named,
            name=name,
        )
        for i, name in enumerate(STALLS)
    }
    return Stalls(model, records, dict(zip(STALLS, y, strict=True)), thrust)


def declared(thrust: float, wrong: float = STARTS_OFF) -> Longitudinal:
    """The aircraft with attached flow, its coefficients wrong by a tenth, in turn too large and too
    small.
    """
    off = iter(1.0 + wrong * (-1.0) ** np.arange(len(CX) + len(CZ) + len(CM)))
    polynomials = {
        name: Polynomial({term: float(value * next(off)) for term, value in terms.items()})
        for name, terms in (("CX", CX), ("CZ", CZ), ("Cm", CM))
    }
    return Longitudinal(
        **polynomials,
        mass=MASS,
        Iy=IY,
        S=AREA,
        cbar=CHORD,
        thrust=jnp.asarray(thrust),
        density=DENSITY,
    )


def lift(y: np.ndarray, thrust: float) -> np.ndarray:
    """Return the lift coefficient computed from outputs, shape (time,).

        CL = CX sin(alpha) - CZ cos(alpha),    qbar S (CX, CZ) = m (ax, az) - (T, 0)

    Args:
        y: outputs, shape (time, output).
        thrust: T [N].
    """
    at = {name: y[..., i] for i, name in enumerate(Longitudinal.outputs)}
    force = 0.5 * DENSITY * at["V"] ** 2 * AREA
    forward, down = (MASS * at["ax"] - thrust) / force, MASS * at["az"] / force
    return forward * np.sin(at["alpha"]) - down * np.cos(at["alpha"])
