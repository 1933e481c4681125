"""Linear model under disturbances, adaptive stepper: against derivatives of simulations."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxid import AbstractModel, Adaptive, simulate
from jaxid._foundation.types import Array
from jaxid.sensitivity.disturbances import disturbed_motion
from jaxid.simulation.hold import Linear

START = jnp.array([1.2, -0.5])
U = jnp.array([[0.3, 0.0], [0.1, 0.0]])


class Duffing(AbstractModel):
    """A spring with a cubic force; the second input acts on the equation of v alone."""

    k: Array
    states, inputs, outputs = ("x", "v"), ("force", "push"), ("x", "a")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] * x[0] - self.k * x[0] ** 3 + u[1]])

    def output_given(self, t, x, u, dx):
        return jnp.stack([x[0], dx[1] + 0.5 * u[0]])

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))


MODEL, STEPPER = Duffing(jnp.array(2.0)), Adaptive(rtol=1e-11, atol=1e-12)


@jax.jit
def motion_and_derivatives(t):
    """Motion of one interval, and derivatives of its end by its start and by the inputs."""

    def after(x, ends):
        return simulate(MODEL, t, U + ends, x, hold=Linear(), stepper=STEPPER).x[-1]

    motion = disturbed_motion(MODEL, START, t, U, Linear(), STEPPER)
    return motion, *jax.jacfwd(after, argnums=(0, 1))(START, jnp.zeros((2, 2)))


def errors(h):
    """Largest errors of the matrices of one interval of length h."""
    motion, Phi, ends = motion_and_derivatives(jnp.array([0.0, h]))
    # the pushes: equations of x and v, inputs force and push, which is the equation of v again
    found = motion.Phi[0], motion.P[0][:, 2:], motion.Q[0][:, 2:]
    np.testing.assert_allclose(motion.P[0][:, 1], motion.P[0][:, 3], atol=1e-14)
    true = Phi, ends[:, 0], ends[:, 1]
    return np.array([np.max(np.abs(a - b)) for a, b in zip(found, true, strict=True)])


def test_error_of_an_interval_falls_with_the_cube_of_its_length():
    long, short = errors(0.2), errors(0.1)
    assert np.all(long < 0.02)
    assert np.all(long / short > 5.0)


def test_outputs_are_differentiated_by_state_and_disturbance():
    motion, *_ = motion_and_derivatives(jnp.array([0.0, 0.1]))
    derivatives = jax.jit(jax.jacfwd(MODEL.output, argnums=(1, 2)))
    C, by_input = derivatives(jnp.zeros(()), START, U[0])
    np.testing.assert_allclose(motion.C[0], C, atol=1e-14)
    of_equations = np.array([[0.0, 0.0], [0.0, 1.0]])  # the acceleration is an output
    expected = np.concatenate([of_equations, by_input], axis=1)
    np.testing.assert_allclose(motion.D[0], expected, atol=1e-14)
