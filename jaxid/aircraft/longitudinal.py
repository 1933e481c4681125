"""`Longitudinal`: an aircraft in its plane of symmetry, as the first identification model."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require_known
from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.polynomial import Polynomial, factors
from .atmosphere import GRAVITY
from .effects import CoefficientTerm

GUSTS = ("gust_u", "gust_w")
MOVED = {"CX": ("u",), "CZ": ("w",), "Cm": ("q",)}  # the states whose rates a coefficient moves
LACKING = (
    *("1", "alpha", "qhat", "elevator"),
    *("alpha^2", "alpha qhat", "alpha elevator", "qhat^2", "qhat elevator", "elevator^2"),
    *("alpha^3", "alpha^2 qhat", "alpha^2 elevator", "|qhat| qhat", "alphadot_hat"),
)


class Longitudinal(AbstractModel):
    r"""Rigid-body motion in the plane of symmetry, at constant thrust, wings level and without wind (App. D.1, E.2).

        udot = -q w + qbar S/m CX + T/m - g sin(pitch)        alpha = atan2(w, u),   V = sqrt(u^2 + w^2)
        wdot =  q u + qbar S/m CZ       + g cos(pitch)        qbar = density V^2/2,  qhat = q cbar/2V
        qdot = qbar S cbar/Iy Cm,       pitchdot = q

    CX, CZ and Cm are polynomials in `alpha`, `qhat` and `elevator`; their coefficients are called `Cm.alpha^2` and so
    on. The accelerometers stand at the centre of gravity and show the specific force in body axes, from the rate of the
    state, so that they feel whatever acts on it:

        ax = udot + q w + g sin(pitch),    az = wdot - q u - g cos(pitch)

    Args:
        CX, CZ, Cm: aerodynamic coefficients of forward force, downward force and pitching moment.
        mass: m [kg].
        Iy: moment of inertia about the y axis [kg m^2].
        S: reference area [m^2].
        cbar: mean chord [m].
        thrust: T, along the x axis [N].
        density: of the air [kg/m^3].
        gusts: which of `gust_u` and `gust_w` [m/s] are inputs: velocities of the air, which alpha, V, and the coefficients
            feel. None by default: nobody records them.

    Raises:
        InputError: for another gust.
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
        require_known("gust", gusts, GUSTS)
        self.CX, self.CZ, self.Cm = CX, CZ, Cm
        self.mass, self.Iy, self.S = jnp.asarray(mass, float), jnp.asarray(Iy, float), jnp.asarray(S, float)
        self.cbar, self.thrust = jnp.asarray(cbar, float), jnp.asarray(thrust, float)
        self.density, self.gusts = jnp.asarray(density, float), tuple(gusts)

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("elevator", *self.gusts)

    def rhs(self, t, x, u):
        forward, down, q, pitch = x
        flow = self._flow(x, u)
        force, moment = flow["w_per_CZ"], flow["q_per_Cm"]
        udot = -q * down + force * self.CX(flow) + self.thrust / self.mass - GRAVITY * jnp.sin(pitch)
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
        """The state from the first valid samples of V, alpha, q and pitch: `u = V cos(alpha)`, `w = V sin(alpha)`.

        Where an angle or a rate has no valid sample it is zero; where V has none it is the speed at which a force
        coefficient of one carries the weight, which is of the right size.

        Args:
            record: with this model's outputs.
        """
        row = jnp.argmax(record.mask, axis=0)
        seen = jnp.any(record.mask, axis=0)
        first = jnp.take_along_axis(record.z, row[None], axis=0)[0]
        alpha, q, pitch, _, _, V = jnp.where(seen, first, 0.0)
        V = jnp.where(seen[-1], V, jnp.sqrt(2.0 * self.mass * GRAVITY / (self.density * self.S)))
        return jnp.stack([V * jnp.cos(alpha), V * jnp.sin(alpha), q, pitch])

    def signals(self, t, x, u):
        """States, elevator, and what coefficients may depend on.

        Returns:
            Beside states and inputs: `alpha` [rad], `V` [m/s], `qhat` [rad], `alphadot_hat`, the rate of alpha by the
            declared equations times `cbar/2V`, gusts taken as steady [rad], `u_per_CX` and `w_per_CZ`, `qbar S/m` [m/s^2],
            and `q_per_Cm`, `qbar S cbar/Iy` [rad/s^2].
        """
        return self.rhs_and_signals(t, x, u)[1]

    def immediate_signals(self, t, x, u):
        """The same without `alphadot_hat`."""
        return self._flow(x, u)

    def rhs_and_signals(self, t, x, u):
        flow, rates = self._flow(x, u), self.rhs(t, x, u)
        alphadot = (jnp.cos(flow["alpha"]) * rates[1] - jnp.sin(flow["alpha"]) * rates[0]) / flow["V"]
        return rates, flow | {"alphadot_hat": alphadot * self.cbar / (2.0 * flow["V"])}

    def effects(self):
        """Terms that the coefficients may lack: `alpha^3 in Cm` and so on, those that the model has left out."""
        own = {"CX": self.CX, "CZ": self.CZ, "Cm": self.Cm}
        return tuple(
            CoefficientTerm(coefficient=coefficient, product=term, moved=MOVED[coefficient])
            for coefficient, polynomial in own.items()
            for term in LACKING
            if term not in polynomial.terms
        )

    def gusty(self):
        """The same aircraft with both velocities of the air among its inputs."""
        parts = {
            name: getattr(self, name) for name in ("CX", "CZ", "Cm", "mass", "Iy", "S", "cbar", "thrust", "density")
        }
        return Longitudinal(**parts, gusts=(*self.gusts, *(gust for gust in GUSTS if gust not in self.gusts)))

    def equations_with_terms(self):
        """No equation takes general terms: what an equation of motion may lack stands in its coefficient."""
        return ()

    def units(self):
        channels = {"u": "m/s", "w": "m/s", "q": "rad/s", "pitch": "rad", "elevator": "rad"}
        channels |= dict.fromkeys(self.gusts, "m/s")
        channels |= {"alpha": "rad", "ax": "m/s^2", "az": "m/s^2", "V": "m/s"}
        constants = {"mass": "kg", "Iy": "kg*m^2", "S": "m^2", "cbar": "m", "thrust": "N", "density": "kg/m^3"}
        coefficients = {
            f"{name}.{term}": _per_radian(term)
            for name, polynomial in (("CX", self.CX), ("CZ", self.CZ), ("Cm", self.Cm))
            for term in polynomial.terms
        }
        return channels | constants | coefficients

    def _flow(self, x, u):
        """What the coefficients depend on at an instant, and what turns them into accelerations."""
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
    """The unit of a coefficient: every factor of its term is an angle or a dimensionless rate in radians."""
    power = sum(power for _, power in factors(term))
    return "" if power == 0 else "1/rad" if power == 1 else f"1/rad^{power}"
