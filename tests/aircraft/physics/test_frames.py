"""Axes and attitude against SciPy's rotations, and the quaternion's rate against finite
rotation.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxid.aircraft.physics.frames import (
    air_angle_rates,
    air_angles,
    euler,
    quaternion,
    quaternion_rate,
    rotation,
    velocity,
)

ANGLES = np.random.default_rng(3).uniform([-np.pi, -1.5, -np.pi], [np.pi, 1.5, np.pi], (20, 3))


@pytest.mark.parametrize("angles", ANGLES[:5])
def test_rotation_equals_scipy(angles):
    phi, pitch, psi = angles
    body_to_earth = Rotation.from_euler("ZYX", [psi, pitch, phi]).as_matrix()
    # Rounding of a product of a few sines and cosines.
    np.testing.assert_allclose(rotation(quaternion(phi, pitch, psi)), body_to_earth.T, atol=1e-15)


def test_euler_inverts_quaternion():
    back = jax.vmap(lambda a: jnp.stack(euler(quaternion(*a))))(jnp.asarray(ANGLES))
    # a pitch of 1.5 loses a digit to its cosine
    np.testing.assert_allclose(back, ANGLES, atol=1e-13)


def test_third_column_of_rotation_equals_gravity():
    phi, pitch = 0.3, -0.7
    down = rotation(quaternion(phi, pitch, 1.1))[:, 2]
    expected = [-np.sin(pitch), np.sin(phi) * np.cos(pitch), np.cos(phi) * np.cos(pitch)]
    np.testing.assert_allclose(down, expected, atol=1e-15)


def test_quaternion_rate_equals_derivative_of_rotation_about_fixed_axis():
    omega = jnp.array([0.3, -0.8, 0.5])

    def attitude(t):  # of a body that turns at omega from an attitude
        angle = t * jnp.linalg.norm(omega)
        turn = jnp.concatenate(
            [jnp.cos(angle / 2)[None], jnp.sin(angle / 2) * omega / jnp.linalg.norm(omega)]
        )
        return product(quaternion(0.4, 0.2, -1.0), turn)

    e, edot = jax.jvp(attitude, (jnp.array(0.7),), (jnp.array(1.0),))
    np.testing.assert_allclose(quaternion_rate(e, omega), edot, atol=1e-15)


def product(a, b):
    """Hamilton's product: first the attitude `a`, then `b` in the axes that `a` has turned."""
    real = a[0] * b[0] - jnp.dot(a[1:], b[1:])
    return jnp.concatenate([real[None], a[0] * b[1:] + b[0] * a[1:] + jnp.cross(a[1:], b[1:])])


def test_quaternion_rate_restores_unit_length():
    e = 1.1 * quaternion(0.1, 0.2, 0.3)
    assert float(jnp.dot(e, quaternion_rate(e, jnp.zeros(3)))) < 0
    np.testing.assert_allclose(rotation(e), rotation(e / 1.1), atol=1e-15)


@pytest.mark.parametrize(
    ("V", "alpha", "beta"), [(150.0, 0.3, -0.2), (80.0, 2.5, 0.5), (300.0, -0.1, np.pi / 2 - 0.01)]
)
def test_air_angles_invert_velocity(V, alpha, beta):
    v = velocity(V, alpha, beta)
    np.testing.assert_allclose(jnp.stack(air_angles(v)), [V, alpha, beta], rtol=1e-13)
    np.testing.assert_allclose(jnp.sin(air_angles(v).beta), v[1] / V, rtol=1e-13)


def test_air_angle_rates_equal_derivatives():
    v, vdot = jnp.array([90.0, -20.0, 35.0]), jnp.array([-3.0, 5.0, 11.0])
    _, (_, *rates) = jax.jvp(air_angles, (v,), (vdot,))
    # rounding of a few products
    np.testing.assert_allclose(air_angle_rates(v, vdot), rates, rtol=1e-14)


def test_sideslip_at_ninety_degrees_has_derivative():
    slope = jax.grad(lambda v: air_angles(v).beta)(jnp.array([1e-3, 100.0, 0.0]))
    assert np.all(np.isfinite(slope))
