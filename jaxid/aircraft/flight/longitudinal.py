"""`Longitudinal`: identification model of an aircraft in its plane of symmetry."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.checks import require_known
from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.base import AbstractModel
from ...models.polynomial import Polynomial, factors
from ..air.atmosphere import GRAVITY
from ..effects.coefficient_term import CoefficientTerm

LONGITUDINAL_GUSTS = ("gust_u", "gust_w")
LONGITUDINAL_AFFECTED_STATES = {
    "CX": ("u",),
    "CZ": ("w",),
    "Cm": ("q",),
}  # the states whose rates a coefficient changes
CANDIDATE_TERMS = (
    *("1", "alpha", "qhat", "elevator"),
    *("alpha^2", "alpha qhat", "alpha elevator", "qhat^2", "qhat elevator", "elevator^2"),
    *("alpha^3", "alpha^2 qhat", "alpha^2 elevator", "|qhat| qhat", "alphadot_hat"),
)


class Longitudinal(AbstractModel):
    r"""Rigid-body motion in the plane of symmetry at constant thrust (App. D.1, E.2).

        udot = -q w + qbar S/m CX + T/m - g sin(pitch)    alpha = atan2(w, u),  V = sqrt(u^2 + w^2)
        wdot =  q u + qbar S/m CZ       + g cos(pitch)    qbar = density V^2/2, qhat = q cbar/2V
        qdot = qbar S cbar/Iy Cm,       pitchdot = q

    The wings are level and there is no wind. CX, CZ and Cm are polynomials in `alpha`, `qhat` and
    `elevator`; their coefficients are called `Cm.alpha^2` and so on. The accelerometers are at the
    centre of gravity. Their readings, the specific force in body axes, are computed from the rate
    of the state and therefore include all effects:

        ax = udot + q w + g sin(pitch),    az = wdot - q u - g cos(pitch)

    Args:
        CX, CZ, Cm: aerodynamic coefficients of forward force, downward force and pitching moment.
        mass: m [kg].
        Iy: moment of inertia about the y axis [kg m^2].
        S: reference area [m^2].
        cbar: mean chord [m].
        thrust: T, along the x axis [N].
        density: density of the air [kg/m^3].
        gusts: inputs among `gust_u` and `gust_w` [m/s], velocities of the air, on which alpha, V
            and the coefficients depend. None by default, because gusts are not recorded.

    Raises:
        InputError: for an unknown gust.
    """

    CX: Polynomial
    CZ: Polynomial
    Cm: Polynomial
    mass: Float[Array, ""]
    Iy: Float[Array, ""]
    S: Float[Array, ""]
    cbar: Float[Array, ""]
    thrust: Float[Array, ""]
    density: Float[Array, ""]
    gusts: tuple[str, ...] = eqx.field(static=True)

    states, outputs = ("u", "w", "q", "pitch"), ("alpha", "q", "pitch", "ax", "az", "V")

    def __init__(
        self,
        *,
        CX: Polynomial,
        CZ: Polynomial,
        Cm: Polynomial,
        mass,
        Iy,
        S,
        cbar,
        thrust,
        density,
        gusts: Sequence[str] = (),
    ):
        require_known("gust", gusts, LONGITUDINAL_GUSTS)
        self.CX, self.CZ, self.Cm = CX, CZ, Cm
        self.mass, self.Iy, self.S = (
            jnp.asarray(mass, float),
            jnp.asarray(Iy, float),
            jnp.asarray(S, float),
        )
        self.cbar, self.thrust = jnp.asarray(cbar, float), jnp.asarray(thrust, float)
        self.density, self.gusts = jnp.asarray(density, float), tuple(gusts)

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("elevator", *self.gusts)

    def rhs(self, t, x, u):
        forward, down, q, pitch = x
        flow = self._flow(x, u)
        force, moment = flow["w_per_CZ"], flow["q_per_Cm"]
        udot = (
            -q * down + force * self.CX(flow) + self.thrust / self.mass - GRAVITY * jnp.sin(pitch)
        )
        wdot = q * forward + force * self.CZ(flow) + GRAVITY * jnp.cos(pitch)
        qdot = moment * self.Cm(flow)
        return jnp.stack([udot, wdot, qdot, q])

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        forward, down, q, pitch = x
        udot, wdot = dx[0], dx[1]
        ax = udot + q * down + GRAVITY * jnp.sin(pitch)
        az = wdot - q * forward - GRAVITY * jnp.cos(pitch)
        flow = self._flow(x, u)
        return jnp.stack([flow["alpha"], q, pitch, ax, az, flow["V"]])

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        """Return the state from the first valid samples of V, alpha, q and pitch.

        `u = V cos(alpha)`, `w = V sin(alpha)`. An angle or a rate without a valid sample is zero;
        without a valid V the speed is the one at which a force coefficient of one carries the
        weight, which has the right order of magnitude.

        Args:
            record: record with this model's outputs.
        """
        row = jnp.argmax(record.mask, axis=0)
        valid = jnp.any(record.mask, axis=0)
        first = jnp.take_along_axis(record.z, row[None], axis=0)[0]
        alpha, q, pitch, _, _, V = jnp.where(valid, first, 0.0)
        V = jnp.where(valid[-1], V, jnp.sqrt(2.0 * self.mass * GRAVITY / (self.density * self.S)))
        return jnp.stack([V * jnp.cos(alpha), V * jnp.sin(alpha), q, pitch])

    def signals(self, t, x, u):
        """Return states, inputs, and the signals on which coefficients may depend.

        Returns:
            States and inputs; `alpha` [rad], `V` [m/s], `qhat` [rad]; `alphadot_hat`, the rate of
            alpha by the declared equations times `cbar/2V`, with constant gusts [rad]; `u_per_CX`
            and `w_per_CZ`, `qbar S/m` [m/s^2]; and `q_per_Cm`, `qbar S cbar/Iy` [rad/s^2].
        """
        return self.rhs_and_signals(t, x, u)[1]

    def immediate_signals(self, t, x, u):
        """Return the signals without `alphadot_hat`."""
        return self._flow(x, u)

    def rhs_and_signals(self, t, x, u):
        flow, rates = self._flow(x, u), self.rhs(t, x, u)
        alphadot = (jnp.cos(flow["alpha"]) * rates[1] - jnp.sin(flow["alpha"]) * rates[0]) / flow[
            "V"
        ]
        return rates, flow | {"alphadot_hat": alphadot * self.cbar / (2.0 * flow["V"])}

    def effects(self):
        """Return candidate terms that the coefficients lack, `alpha^3 in Cm` and so on."""
        polynomials = {"CX": self.CX, "CZ": self.CZ, "Cm": self.Cm}
        return tuple(
            CoefficientTerm(
                coefficient=coefficient,
                product=term,
                affected_states=LONGITUDINAL_AFFECTED_STATES[coefficient],
            )
            for coefficient, polynomial in polynomials.items()
            for term in CANDIDATE_TERMS
            if term not in polynomial.terms
        )

    def with_disturbance_inputs(self):
        """Return the aircraft with both velocities of the air among its inputs."""
        parts = {
            name: getattr(self, name)
            for name in ("CX", "CZ", "Cm", "mass", "Iy", "S", "cbar", "thrust", "density")
        }
        added = tuple(gust for gust in LONGITUDINAL_GUSTS if gust not in self.gusts)
        return Longitudinal(**parts, gusts=(*self.gusts, *added))

    def equations_with_terms(self):
        """Return no equations: terms that an equation of motion lacks belong to a coefficient."""
        return ()

    def units(self):
        channels = {"u": "m/s", "w": "m/s", "q": "rad/s", "pitch": "rad", "elevator": "rad"}
        channels |= dict.fromkeys(self.gusts, "m/s")
        channels |= {"alpha": "rad", "ax": "m/s^2", "az": "m/s^2", "V": "m/s"}
        constants = {
            "mass": "kg",
            "Iy": "kg*m^2",
            "S": "m^2",
            "cbar": "m",
            "thrust": "N",
            "density": "kg/m^3",
        }
        coefficients = {
            f"{name}.{term}": _per_radian(term)
            for name, polynomial in (("CX", self.CX), ("CZ", self.CZ), ("Cm", self.Cm))
            for term in polynomial.terms
        }
        return channels | constants | coefficients

    def _flow(self, x, u):
        """Return the signals of the coefficients, and the factors from coefficients to rates."""
        known = dict(zip(self.states + self.inputs, jnp.concatenate([x, u]), strict=True))
        forward, down = (known[axis] - known.get(f"gust_{axis}", 0.0) for axis in "uw")
        V = jnp.sqrt(forward**2 + down**2)
        acceleration = 0.5 * self.density * V**2 * self.S / self.mass
        return known | {
            "alpha": jnp.arctan2(down, forward),
            "V": V,
            "qhat": x[2] * self.cbar / (2.0 * V),
            **{"u_per_CX": acceleration, "w_per_CZ": acceleration},
            "q_per_Cm": acceleration * self.mass * self.cbar / self.Iy,
        }


def _per_radian(term: str) -> str:
    """Return the unit of a coefficient; all factors of its term are in radians."""
    power = sum(power for _, power in factors(term))
    return "" if power == 0 else "1/rad" if power == 1 else f"1/rad^{power}"
