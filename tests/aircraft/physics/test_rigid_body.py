"""Equations of motion against NumPy and the report's explicit inverse of the inertia tensor."""

import jax.numpy as jnp
import numpy as np

from jaxid.aircraft.physics.rigid_body import accelerations, solve_3x3, specific_force

INERTIA = np.array([[33.0, -1.5, -4.0], [-1.5, 165.0, 2.5], [-4.0, 2.5, 190.0]])


def test_cofactor_solution_equals_numpy():
    b = np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(
        solve_3x3(jnp.asarray(INERTIA), jnp.asarray(b)), np.linalg.solve(INERTIA, b), rtol=1e-14
    )


def test_accelerations_with_products_of_inertia_and_rotor_equal_numpy():
    rng = np.random.default_rng(5)
    velocity, omega, force, moment, momentum = rng.normal(size=(5, 3))
    vdot, omegadot = accelerations(
        jnp.array(2.0), *map(jnp.asarray, (INERTIA, velocity, omega, force, moment, momentum))
    )
    np.testing.assert_allclose(vdot, force / 2.0 - np.cross(omega, velocity), rtol=1e-13)
    left = INERTIA @ np.asarray(omegadot) + np.cross(omega, INERTIA @ omega + momentum)
    np.testing.assert_allclose(left, moment, rtol=1e-12)


def test_accelerations_of_symmetric_body_equal_report():
    # D.1.2 with Ixy = Iyz = 0: Ix pdot - Ixz rdot = qr (Iy - Iz) + pq Ixz.
    inertia = np.diag([25.0, 122.0, 140.0])
    inertia[0, 2] = inertia[2, 0] = -1.2
    p, q, r = omega = np.array([0.4, -0.2, 0.3])
    zero = jnp.zeros(3)
    _, (pdot, qdot, rdot) = accelerations(
        jnp.array(1.0), jnp.asarray(inertia), zero, jnp.asarray(omega), zero, zero, zero
    )
    np.testing.assert_allclose(
        25.0 * pdot - 1.2 * rdot, q * r * (122.0 - 140.0) + p * q * 1.2, rtol=1e-13
    )
    np.testing.assert_allclose(
        122.0 * qdot, p * r * (140.0 - 25.0) + 1.2 * (r**2 - p**2), rtol=1e-13
    )


def test_specific_force_in_free_fall_is_zero():
    omega, velocity, gravity = (
        jnp.array([0.3, 0.1, -0.2]),
        jnp.array([50.0, 2.0, 4.0]),
        jnp.array([1.0, 2.0, 9.0]),
    )
    vdot = gravity - jnp.cross(omega, velocity)
    np.testing.assert_allclose(
        specific_force(vdot, velocity, omega, gravity), jnp.zeros(3), atol=1e-14
    )
