"""Correction of air angles and accelerations from instruments off the c.g. to the c.g."""

import analytic_motion as motion
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.instruments.instruments import Instruments
from jaxid.aircraft.records.to_centre_of_gravity import corrected_accelerations, corrected_angles
from jaxid.data import record as make_record
from jaxid.data import stack

VANE = np.array([10.4, 0.3, -0.2])
PLACES = {"ax": (1.2, 0.7, -0.3), "ay": (-0.8, 0.2, 0.9), "az": (0.5, -1.1, 0.4)}
CHANNELS = ("alpha", "beta", "V", "p", "q", "r", "pdot", "qdot", "rdot", "ax", "ay", "az")


@pytest.fixture(scope="module")
def truth():
    return jax.jit(jax.vmap(motion.signals))(motion.TIMES)


@pytest.fixture(scope="module")
def show(truth):
    """A function that simulates a record with vanes at a multiple of their distance."""

    def read(vane, upwash):
        instruments = Instruments(
            CHANNELS,
            position={**PLACES, "alpha": vane, "beta": vane},
            scale={"alpha": upwash, "beta": 2.0 * upwash},
        )
        return jax.vmap(instruments.read)(truth)

    compiled = jax.jit(read)

    def record(distance=1.0, upwash=0.0, lost=None):
        z = np.array(compiled(jnp.asarray(distance * VANE), jnp.asarray(upwash)))
        if lost is not None:
            z[2, CHANNELS.index(lost)] = np.nan
        return make_record(motion.TIMES, None, z, inputs=(), outputs=CHANNELS)

    return record


def angles(record, truth, distance=1.0, **options):
    vane = distance * VANE
    corrected = corrected_angles(
        record, alpha_vane=vane, beta_vane=vane, airspeed=truth["V"], **options
    )
    names = ("alpha_corrected", "beta_corrected")
    alpha, beta = (np.array(corrected.channel(name)) for name in names)
    return alpha, beta


def test_flank_angle_at_cg_becomes_sideslip(truth, show):
    alpha, beta = angles(show(0.0), truth, 0.0)
    np.testing.assert_allclose(alpha, truth["alpha"], rtol=0, atol=1e-14)
    np.testing.assert_allclose(beta, truth["beta"], rtol=0, atol=1e-14)
    assert np.abs(np.array(show(0.0).channel("beta")) - beta).max() > 1e-3


def test_correction_inverts_reading_to_second_order_times_sideslip(truth, show):
    errors = []
    for distance in (1.0, 0.5):
        raw = show(distance)
        alpha, beta = angles(raw, truth, distance)
        errors.append([np.abs(alpha - truth["alpha"]).max(), np.abs(beta - truth["beta"]).max()])
        assert np.abs(np.array(raw.channel("alpha")) - truth["alpha"]).max() > 1e-2 * distance
    rate = np.max(np.linalg.norm([truth[name] for name in "pqr"], axis=0))
    epsilon = rate * np.linalg.norm(VANE) / np.min(truth["V"])
    assert errors[0][0] < epsilon**2 * (np.abs(truth["beta"]).max() + epsilon)
    assert errors[0][1] < epsilon**2 * (np.abs(truth["beta"]).max() + epsilon)
    for full, half in zip(*errors, strict=True):
        # Second order: about a quarter at half the distance. A first-order error would halve.
        assert half < 0.3 * full


def test_path_term_of_report_increases_error(truth, show):
    """With `x g/V^2 (a_n - cos phi cos theta)` of D.2.5.2 added, the error is first order in the
    distance.
    """
    alpha, _ = angles(show(), truth)
    normal = -truth["az"] - motion.G * np.cos(truth["phi"]) * np.cos(truth["pitch"])
    printed = alpha + VANE[0] * normal / truth["V"] ** 2
    assert np.abs(printed - truth["alpha"]).max() > 10 * np.abs(alpha - truth["alpha"]).max()


def test_correction_to_first_order_equals_report():
    """D.2.5.2 without its path term, D.2.6.2: vanes straight ahead, small sideslip."""
    alpha, beta, V, p, q, r, x = 0.3, 2e-3, 136.0, 0.4, 0.2, -0.1, 10.4
    raw = make_record(
        [0.0, 0.1], None, [[alpha, beta, V, p, q, r]] * 2, inputs=(), outputs=CHANNELS[:6]
    )
    corrected = corrected_angles(raw, alpha_vane=(x, 0.0, 0.0), beta_vane=(x, 0.0, 0.0)).z[0, -2:]
    reported = alpha + q * x / V * np.cos(alpha)
    # (q x/V)^3/6 = 6e-7 of the arcsine, and the sideslip's square.
    np.testing.assert_allclose(corrected[0], reported, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        corrected[1], beta * np.cos(reported) - r * x / V * np.cos(beta), rtol=0, atol=1e-6
    )


def test_known_upwash_is_removed(truth, show):
    alpha, beta = angles(show(upwash=0.1), truth, upwash={"alpha": 0.1, "beta": 0.2})
    plain = angles(show(), truth)
    np.testing.assert_allclose([alpha, beta], plain, rtol=0, atol=1e-15)


def test_measured_airspeed_is_used_by_default(truth, show):
    raw = show()
    corrected = corrected_angles(raw, alpha_vane=VANE, beta_vane=VANE)
    same = corrected_angles(raw, alpha_vane=VANE, beta_vane=VANE, airspeed=raw.channel("V"))
    np.testing.assert_array_equal(corrected.z, same.z)


def test_accelerations_at_cg_are_exact(truth, show):
    corrected = corrected_accelerations(show(), PLACES)
    for name in PLACES:
        np.testing.assert_allclose(
            corrected.channel(f"{name}_corrected"), truth[name], rtol=0, atol=1e-13
        )
        assert np.abs(np.array(corrected.channel(name)) - truth[name]).max() > 0.1
    assert corrected.output_units[-3:] == ("m/s^2",) * 3


@pytest.mark.parametrize("lost", ["alpha", "V", "r"])
def test_missing_sample_changes_mask_only(truth, show, lost):
    complete, gapped = show(), show(lost=lost)
    a = corrected_angles(complete, alpha_vane=VANE, beta_vane=VANE)
    b = corrected_angles(gapped, alpha_vane=VANE, beta_vane=VANE)
    assert b.outputs[-2:] == ("alpha_corrected", "beta_corrected")
    want = np.ones((7, 2), bool)
    want[2] = False
    np.testing.assert_array_equal(b.mask[:, -2:], want)
    np.testing.assert_array_equal(b.z[:, -2:], np.where(want, a.z[:, -2:], 0.0))
    forces = corrected_accelerations(gapped, {"ay": PLACES["ay"]})
    assert bool(forces.mask[2, -1]) == (lost not in "pqr")


def test_stack_is_corrected_case_by_case(show):
    first, second = show(), show(0.5)
    corrected = corrected_angles(stack([first, second]), alpha_vane=VANE, beta_vane=VANE)
    for case, raw in zip(corrected, (first, second), strict=True):
        np.testing.assert_array_equal(
            case.z, corrected_angles(raw, alpha_vane=VANE, beta_vane=VANE).z
        )


def test_invalid_input_raises_error(show):
    raw = show()
    once = corrected_angles(raw, alpha_vane=VANE, beta_vane=VANE)
    lacking = make_record(motion.TIMES, None, np.zeros((7, 1)), inputs=(), outputs=("alpha",))
    for call, words in [
        (
            lambda: corrected_angles(lacking, alpha_vane=VANE, beta_vane=VANE),
            r"no output \(needed "
            r".*\) 'beta'",
        ),
        (
            lambda: corrected_angles(raw, alpha_vane=(1.0, 2.0), beta_vane=VANE),
            "'alpha_vane' has shape",
        ),
        (lambda: corrected_angles(once, alpha_vane=VANE, beta_vane=VANE), "already"),
        (
            lambda: corrected_angles(raw, alpha_vane=VANE, beta_vane=VANE, upwash={"q": 0.1}),
            "no vane",
        ),
        (lambda: corrected_accelerations(raw, {"q": (0.0, 0.0, 0.0)}), "no accelerometer"),
    ]:
        with pytest.raises(InputError, match=words):
            call()
