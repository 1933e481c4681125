"""A flight of the F-4-like aircraft in plain NumPy and SciPy, for comparison with `jaxid.aircraft`.

Written from the equations and for speed, one flight at a time: scalars are Python floats. It covers
the features of the report's lateral flight: a rigid body with one engine,
tables with monotone interpolation, stability augmentation, first-order actuators, the standard
atmosphere below 11 km, gusts, and instruments with errors of position, axis, scale and bias. Wind,
autopilot, buffet and sensor dynamics, which that flight leaves at zero, are left out.

    x = u v w  p q r  e0 e1 e2 e3  north east altitude  sas_pitch sas_yaw  stabilator aileron rudder
    u = the pilot's stabilator, aileron, rudder, and the gusts u v w p q r
"""

import itertools
from collections.abc import Mapping
from math import atan2, sqrt
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

GRAVITY = 9.80665  # m/s^2
BODY = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
SURFACES = ("stabilator", "aileron", "rudder")
GAINS = ("pitch_gain", "yaw_gain", "roll_gain", "pitch_washout", "yaw_washout", "acceleration_gain")
LIMITS = ("pitch_limit", "yaw_limit", "roll_limit")
# Axis of each instrument; ANGLES: the two small rotations that move each axis.
AXIS = {
    "p": 0,
    "q": 1,
    "r": 2,
    "pdot": 0,
    "qdot": 1,
    "rdot": 2,
    "ax": 0,
    "ay": 1,
    "az": 2,
    "az_pilot": 2,
}
ANGLES = (("psi", "theta"), ("psi", "phi"), ("theta", "phi"))


class Coefficients:
    """Six coefficients by monotone cubics, first along alpha, then along beta.

    Functions of alpha alone are added.

    Args:
        grids: by name of table, each with `knots` and `values`; those of the six over (alpha,
            beta), all others over alpha.
    """

    def __init__(self, grids: Mapping):
        self.alpha, beta = (np.array(line) for line in grids["CX"].knots)
        self.beta = beta.tolist()
        derivatives = {
            suffix: [name + suffix in grids for name in BODY]
            for suffix in ("p", "q", "r", "ds", "da", "dr")
        }
        self.parts = [
            (s, [i for i, known in enumerate(row) if known]) for s, row in derivatives.items()
        ]
        static = np.stack([grids[name].values for name in BODY], axis=-1).reshape(
            self.alpha.size, -1
        )
        names = [BODY[i] + suffix for suffix, rows in self.parts for i in rows]
        self.along_alpha = PchipInterpolator(
            self.alpha,
            np.concatenate(
                [static, np.stack([grids[name].values for name in names], axis=1)], axis=1
            ),
        )

    def __call__(self, alpha: float, beta: float, factors: tuple[float, ...]) -> list[float]:
        """The six at one instant, with the factors (phat, qhat, rhat, stabilator, aileron,
        rudder).
        """
        row = self.along_alpha(min(max(alpha, self.alpha[0]), self.alpha[-1]))
        static = len(self.beta) * len(BODY)
        total = self._along_beta(beta, row[:static].reshape(len(self.beta), len(BODY))).tolist()
        derivatives = iter(row[static:].tolist())
        for (_, rows), factor in zip(self.parts, factors, strict=True):
            for i in rows:
                total[i] += next(derivatives) * factor
        return total

    def _along_beta(self, beta: float, values: np.ndarray) -> np.ndarray:
        knots = self.beta
        beta = min(max(beta, knots[0]), knots[-1])
        cell = int(np.searchsorted(knots, beta, side="right")) - 1
        if not 0 < cell < len(knots) - 2:  # the last cells have one-sided slopes, which SciPy knows
            return PchipInterpolator(knots, values)(beta)
        h0, h1, h2 = (knots[cell + k] - knots[cell + k - 1] for k in (0, 1, 2))
        s0, s1, s2 = (values[cell : cell + 3] - values[cell - 1 : cell + 2]) / np.array(
            [[h0], [h1], [h2]]
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            d0 = np.where(
                s0 * s1 > 0, 3 * (h0 + h1) / ((2 * h1 + h0) / s0 + (h1 + 2 * h0) / s1), 0.0
            )
            d1 = np.where(
                s1 * s2 > 0, 3 * (h1 + h2) / ((2 * h2 + h1) / s1 + (h2 + 2 * h1) / s2), 0.0
            )
        t = beta - knots[cell]
        return values[cell] + t * (
            d0 + t * ((3 * s1 - 2 * d0 - d1) / h1 + t * (d0 + d1 - 2 * s1) / h1**2)
        )


class Flow(NamedTuple):
    """The motion relative to the air at an instant."""

    u: float
    v: float
    w: float
    p: float
    q: float
    r: float
    V: float
    alpha: float
    beta: float
    density: float
    sound_speed: float


class FlightInNumpy:
    """The aircraft as plain numbers, with its equations.

    Args:
        numbers: by the names that the parameters of `jaxid.aircraft.Aircraft` have.
        grids: the tables, see `Coefficients`.
        outputs: the channels of the instruments.
    """

    def __init__(self, numbers: Mapping[str, float], grids: Mapping, outputs: tuple[str, ...]):
        self.n, self.outputs, self.coefficients = dict(numbers), outputs, Coefficients(grids)
        mass = {k: self.n[k] for k in ("mass", "Ix", "Iy", "Iz", "Ixy", "Ixz", "Iyz")}
        products = (-mass["Ixy"], -mass["Ixz"], -mass["Iyz"])
        inertia = np.array(
            [
                [mass["Ix"], products[0], products[1]],
                [products[0], mass["Iy"], products[2]],
                [products[1], products[2], mass["Iz"]],
            ]
        )
        self.mass, self.inertia, self.inverse = (
            mass["mass"],
            inertia.tolist(),
            np.linalg.inv(inertia).tolist(),
        )
        self.S, self.b, self.cbar = (self.n[name] for name in ("S", "b", "cbar"))
        self.thrust = self.n["engines.0.share"] * self.n["engines.0.source.force"]
        self.trim = [self.n[f"controls.trim.{name}"] for name in SURFACES]
        self.gains = [self.n[f"controls.augmentation.{name}"] for name in GAINS]
        self.limits = [self.n[f"controls.augmentation.{name}"] for name in LIMITS]
        self.on, self.fade = (
            self.n[f"controls.augmentation.switch.{name}"] for name in ("on", "fade")
        )
        self.actuators = [
            [self.n[f"controls.actuators.{i}.{name}"] for name in ("lag", "rate", "lower", "upper")]
            for i in range(3)
        ]

    # The equations -------------------------------------------------------------------------------

    def flow(self, x, u) -> Flow:
        """Speed, angles and air; below the tropopause."""
        ua, va, wa, p, q, r = (x[k] - u[3 + k] for k in range(6))
        height = 6356766.0 * x[12] / (6356766.0 + x[12])
        warmth = (288.15 - 0.0065 * height) / 288.15
        temperature, pressure = (
            288.15 * warmth,
            101325.0 * warmth ** (GRAVITY / (287.05287 * 0.0065)),
        )
        V = sqrt(ua * ua + va * va + wa * wa)
        beta = atan2(va, sqrt(ua * ua + wa * wa))
        density, sound_speed = (
            pressure / (287.05287 * temperature),
            sqrt(1.4 * 287.05287 * temperature),
        )
        return Flow(ua, va, wa, p, q, r, V, atan2(wa, ua), beta, density, sound_speed)

    def rates(self, t: float, x: list[float], u) -> tuple[list[float], tuple[float, float, float]]:
        """The rate of the state, and the specific force at the centre of gravity."""
        vx, vy, vz, p, q, r, e0, e1, e2, e3 = x[:10]
        air = self.flow(x, u)
        hat = 0.5 / air.V
        factors = (air.p * self.b * hat, air.q * self.cbar * hat, air.r * self.b * hat, *x[15:18])
        CX, CY, CZ, Cl, Cm, Cn = self.coefficients(air.alpha, air.beta, factors)
        pressure_area = 0.5 * air.density * air.V**2 * self.S
        f = [
            (pressure_area * CX + self.thrust) / self.mass,
            pressure_area * CY / self.mass,
            pressure_area * CZ / self.mass,
        ]
        size = e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3
        down = (
            2 * (e1 * e3 - e0 * e2) / size,
            2 * (e2 * e3 + e0 * e1) / size,
            (e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3) / size,
        )
        vdot = [
            f[0] + GRAVITY * down[0] - q * vz + r * vy,
            f[1] + GRAVITY * down[1] - r * vx + p * vz,
            f[2] + GRAVITY * down[2] - p * vy + q * vx,
        ]
        hx, hy, hz = (row[0] * p + row[1] * q + row[2] * r for row in self.inertia)
        L = pressure_area * self.b * Cl - q * hz + r * hy
        M = pressure_area * self.cbar * Cm - r * hx + p * hz
        N = pressure_area * self.b * Cn - p * hy + q * hx
        turn = [row[0] * L + row[1] * M + row[2] * N for row in self.inverse]
        pull = 1.0 - size
        attitude = [
            0.5 * (-e1 * p - e2 * q - e3 * r) + pull * e0,
            0.5 * (e0 * p - e3 * q + e2 * r) + pull * e1,
            0.5 * (e3 * p + e0 * q - e1 * r) + pull * e2,
            0.5 * (-e2 * p + e1 * q + e0 * r) + pull * e3,
        ]
        a0, a1, a2, a3 = e0 * e0, e1 * e1, e2 * e2, e3 * e3
        north = (
            vx * (a0 + a1 - a2 - a3) + 2 * vy * (e1 * e2 - e0 * e3) + 2 * vz * (e1 * e3 + e0 * e2)
        )
        east = (
            2 * vx * (e1 * e2 + e0 * e3) + vy * (a0 - a1 + a2 - a3) + 2 * vz * (e2 * e3 - e0 * e1)
        )
        climb = -(vx * down[0] + vy * down[1] + vz * down[2])
        controls = self.control_rates(t, x, u, p, turn[1], turn[2], f[1])
        return [*vdot, *turn, *attitude, north / size, east / size, climb, *controls], tuple(f)

    def control_rates(self, t, x, u, p, qdot, rdot, ay) -> list[float]:
        """Augmentation and actuators."""
        pitch_gain, yaw_gain, roll_gain, pitch_washout, yaw_washout, acceleration_gain = self.gains
        closed = _clip((t - self.on) / self.fade, 0.0, 1.0)
        feedback = (x[13], roll_gain * p, x[14] + acceleration_gain * ay)
        pitch_limit, yaw_limit, roll_limit = self.limits
        rates = [
            closed * pitch_gain * qdot - pitch_washout * x[13],
            closed * yaw_gain * rdot - yaw_washout * x[14],
        ]
        for i, limit in enumerate((pitch_limit, roll_limit, yaw_limit)):
            lag, rate, lower, upper = self.actuators[i]
            command = self.trim[i] + u[i] + closed * _clip(feedback[i], -limit, limit)
            rates.append(_clip((_clip(command, lower, upper) - x[15 + i]) / lag, -rate, rate))
        return rates

    # Flights -------------------------------------------------------------------------------------

    def fly(self, t: np.ndarray, u: np.ndarray, initial_state: np.ndarray, substeps: int):
        """States and readings at the samples, by the classical Runge-Kutta method and straight
        lines between the inputs.
        """
        times, states = t.tolist(), [np.asarray(initial_state).tolist()]
        stages = np.linspace(u[:-1], u[1:], 2 * substeps + 1, axis=1).tolist()
        for i, (begin, end) in enumerate(itertools.pairwise(times)):
            h, x = (end - begin) / substeps, states[-1]
            for k in range(substeps):
                x = self._step(begin + k * h, h, x, stages[i][2 * k : 2 * k + 3])
            states.append(x)
        return np.array(states), self.readings(t, u, states)

    def _step(self, t, h, x, u):
        k1 = self.rates(t, x, u[0])[0]
        k2 = self.rates(t + h / 2, [a + h / 2 * b for a, b in zip(x, k1, strict=True)], u[1])[0]
        k3 = self.rates(t + h / 2, [a + h / 2 * b for a, b in zip(x, k2, strict=True)], u[1])[0]
        k4 = self.rates(t + h, [a + h * b for a, b in zip(x, k3, strict=True)], u[2])[0]
        return [
            a + h / 6 * (b + 2 * c + 2 * d + e)
            for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)
        ]

    def fly_adaptively(
        self, t: np.ndarray, u: np.ndarray, initial_state: np.ndarray, tolerance: float
    ):
        """The same by `solve_ivp` with its own steps, none longer than an interval between
        samples.
        """

        def rates(time, x):
            i = min(int(np.searchsorted(t, time, side="right")) - 1, t.size - 2)
            share = (time - t[i]) / (t[i + 1] - t[i])
            return self.rates(time, x.tolist(), (u[i] + share * (u[i + 1] - u[i])).tolist())[0]

        steps = {"max_step": float(np.max(np.diff(t))), "rtol": tolerance, "atol": tolerance}
        solution = solve_ivp(rates, (t[0], t[-1]), np.asarray(initial_state), t_eval=t, **steps)
        return solution.y.T, self.readings(t, u, solution.y.T.tolist())

    # Instruments ---------------------------------------------------------------------------------

    def readings(self, t, u, states) -> np.ndarray:
        """Return the readings of the instruments at the samples, without noise."""
        both = [
            self.rates(now, x, row)
            for now, x, row in zip(t.tolist(), states, u.tolist(), strict=True)
        ]
        air = Flow(
            *np.array([self.flow(x, row) for x, row in zip(states, u.tolist(), strict=True)]).T
        )
        x, turn = np.array(states), np.array([dx[3:6] for dx, _ in both])
        force, omega = np.array([f for _, f in both]), x[:, 3:6]
        e0, e1, e2, e3 = x[:, 6:10].T / np.linalg.norm(x[:, 6:10], axis=1)
        mach = air.V / air.sound_speed
        shown = {
            "phi": np.arctan2(2 * (e2 * e3 + e0 * e1), 1 - 2 * (e1**2 + e2**2)),
            "pitch": np.arcsin(2 * (e0 * e2 - e1 * e3)),
            "psi": np.arctan2(2 * (e1 * e2 + e0 * e3), 1 - 2 * (e2**2 + e3**2)),
            "V": air.V * np.sqrt(air.density / 1.225 * (1 + mach**2 / 4 + mach**4 / 40)),
            "altitude": x[:, 12],
            "thrust": np.full(t.size, self.thrust),
            **dict(zip(SURFACES, x[:, 15:18].T, strict=True)),
        }
        for name, at in (("alpha", 2), ("beta", 1)):
            local = np.stack([air.u, air.v, air.w], axis=1) + np.cross(omega, self._place(name))
            shown[name] = np.arctan2(local[:, at], local[:, 0])
        for name in self.outputs:
            if name in ("p", "q", "r"):
                shown[name] = omega @ self._axis(name)
            elif name in ("pdot", "qdot", "rdot"):
                shown[name] = turn @ self._axis(name)
            elif name in AXIS:
                place = self._place(name)
                local = force + np.cross(turn, place) + np.cross(omega, np.cross(omega, place))
                shown[name] = local @ self._axis(name)
        scale, bias = (
            np.array([self.n[f"instruments.{kind}.{o}"] for o in self.outputs])
            for kind in ("scale", "bias")
        )
        return (1 + scale) * np.stack([shown[name] for name in self.outputs], axis=1) + bias

    def _place(self, channel: str) -> np.ndarray:
        return np.array([self.n[f"instruments.position.{channel}.{axis}"] for axis in "xyz"])

    def _axis(self, channel: str) -> np.ndarray:
        """The unit vector along which an instrument points, from its two small turns."""
        names = ANGLES[AXIS[channel]]
        first, second = (self.n[f"instruments.misalignment.{channel}.{name}"] for name in names)
        c1, s1, c2, s2 = np.cos(first), np.sin(first), np.cos(second), np.sin(second)
        return np.array(
            [[c2 * c1, c2 * s1, -s2], [-c2 * s1, c2 * c1, s2], [c2 * s1, -s2, c2 * c1]][
                AXIS[channel]
            ]
        )


def _clip(value: float, lower: float, upper: float) -> float:
    return lower if value < lower else upper if value > upper else value
