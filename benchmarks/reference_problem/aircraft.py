"""The aircraft as a user of jaxid writes it: one class, plain `jax.numpy`."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxid
from benchmarks.reference_problem import problem
from benchmarks.reference_problem.equations import GRAVITY
from benchmarks.reference_problem.problem import ReferenceProblem

Ix, Iy, Iz, Ixz = problem.INERTIA.values()
INERTIA = np.array([[Ix, 0.0, -Ixz], [0.0, Iy, 0.0], [-Ixz, 0.0, Iz]])
INVERSE = np.linalg.inv(INERTIA)


class PolynomialAircraft(jaxid.AbstractModel):
    """Rigid aircraft with polynomial coefficients; the equations stand in `equations`.

    The coefficients of each polynomial are one array, in the order of `problem.TRUE`.
    """

    CX: jax.Array
    CY: jax.Array
    CZ: jax.Array
    Cl: jax.Array
    Cm: jax.Array
    Cn: jax.Array
    start: jax.Array
    thrust: jax.Array

    states, inputs, outputs = problem.STATES, problem.INPUTS, problem.OUTPUTS

    def initial_state(self, record):
        return self.start

    def coefficients(self, alpha, beta, rates, controls):
        """CX, CY, CZ, Cl, Cm, Cn."""
        (phat, qhat, rhat), (stabilator, aileron, rudder) = rates, controls
        one = jnp.ones(())
        CX = self.CX @ jnp.stack([one, stabilator, alpha**2])
        CY = self.CY @ jnp.stack([one, beta, rudder])
        CZ = self.CZ @ jnp.stack([one, alpha, alpha**2, qhat, stabilator])
        Cl = self.Cl @ jnp.stack([one, beta, phat, rhat, aileron, rudder])
        Cm = self.Cm @ jnp.stack([one, alpha, alpha**2, alpha**3, qhat, stabilator])
        Cn = self.Cn @ jnp.stack([one, beta, beta**3, phat, rhat, aileron, rudder])
        return CX, CY, CZ, Cl, Cm, Cn

    def loads(self, x, u):
        """Angles of the flow, specific force [m/s^2] and moment [N m]."""
        velocity, omega = x[:3], x[3:6]
        V = jnp.sqrt(velocity @ velocity)
        alpha, beta = jnp.arctan2(x[2], x[0]), jnp.arcsin(x[1] / V)
        lengths = jnp.array([problem.SPAN, problem.CHORD, problem.SPAN])
        CX, CY, CZ, Cl, Cm, Cn = self.coefficients(alpha, beta, omega * lengths / (2 * V), u)
        pressure = 0.5 * problem.DENSITY * V**2 * problem.AREA
        force = pressure * jnp.stack([CX, CY, CZ]) + jnp.array([1.0, 0.0, 0.0]) * self.thrust
        return alpha, beta, force / problem.MASS, pressure * lengths * jnp.stack([Cl, Cm, Cn])

    def rhs(self, t, x, u):
        velocity, omega, phi, pitch = x[:3], x[3:6], x[6], x[7]
        _, _, specific, moment = self.loads(x, u)
        down = jnp.stack(
            [-jnp.sin(pitch), jnp.cos(pitch) * jnp.sin(phi), jnp.cos(pitch) * jnp.cos(phi)]
        )
        vdot = specific + GRAVITY * down - jnp.cross(omega, velocity)
        omegadot = INVERSE @ (moment - jnp.cross(omega, INERTIA @ omega))
        p, q, r = omega
        psidot = (q * jnp.sin(phi) + r * jnp.cos(phi)) / jnp.cos(pitch)
        angles = jnp.stack(
            [p + jnp.sin(pitch) * psidot, q * jnp.cos(phi) - r * jnp.sin(phi), psidot]
        )
        return jnp.concatenate([vdot, omegadot, angles])

    def output(self, t, x, u):
        alpha, beta, specific, _ = self.loads(x, u)
        return jnp.concatenate([jnp.stack([alpha, beta]), x[3:6], specific, x[6:8]])


def user_model(given: ReferenceProblem, theta) -> PolynomialAircraft:
    """Return the user's model with coefficients `theta`, shape (30,)."""
    sizes = [len(terms) for terms in problem.TRUE.values()]
    theta = jnp.asarray(theta, float)
    parts = [theta[sum(sizes[:i]) : sum(sizes[: i + 1])] for i in range(len(sizes))]
    return PolynomialAircraft(*parts, jnp.asarray(given.x0), jnp.asarray(given.constants.thrust))


def user_free(model: PolynomialAircraft) -> jaxid.Free:
    """Return the selection of the 30 coefficients, in the order of `problem.NAMES`."""
    return jaxid.free(model, *problem.TRUE)


def reference_record(given: ReferenceProblem) -> jaxid.Record:
    """Return the record of the problem, with the constants from which a start is derived."""
    return jaxid.record(
        given.t,
        given.u,
        given.z,
        inputs=problem.INPUTS,
        outputs=problem.OUTPUTS,
        constants={"V": problem.SPEED},
    )
