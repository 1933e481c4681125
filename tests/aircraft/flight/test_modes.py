"""Modes: frequency and damping of published matrices, names, linearisation in Euler angles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.flight.longitudinal_flight import LONGITUDINAL_SPEED, level_trim, true_aircraft
from jaxid.aircraft.flight.modes import CLASSICAL, linearise_euler, modes
from jaxid.aircraft.physics.frames import euler, quaternion, quaternion_rate
from jaxid.models import AbstractModel, with_values
from jaxid.simulation import Linearisation, linearise

# A light aircraft, feet and seconds; chosen numbers of the magnitude of a Navion.
LIGHT_LONGITUDINAL = np.array(
    [
        [-0.045, 0.036, 0.0, -32.2],
        [-0.369, -2.02, 176.0, 0.0],
        [0.0019, -0.0396, -2.948, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ]
)
LIGHT_LATERAL = np.array(
    [
        [-0.254, 0.0, -1.0, 0.182],
        [-16.02, -8.40, 2.19, 0.0],
        [4.488, -0.350, -0.760, 0.0],
        [0.0, 1.0, 0.0, 0.0],
    ]
)
# The jet transport (Boeing 747) at Mach 0.8 and 40,000 ft of The MathWorks, Control System Toolbox,
# example "Yaw Damper Design for a 747 Jet Aircraft"; states beta, r, p, phi. It prints the poles
# -7.28e-3, -5.63e-1 and -3.29e-2 +- 9.47e-1i.
JET_LATERAL = np.array(
    [
        [-0.0558, -0.9968, 0.0802, 0.0415],
        [0.598, -0.115, -0.0318, 0.0],
        [-3.05, 0.388, -0.4650, 0.0],
        [0.0, 0.0805, 1.0, 0.0],
    ]
)


def linear_model(A, states):
    n = len(states)
    empty = jnp.zeros((n, 0)), jnp.zeros((0, n)), jnp.zeros((0, 0))
    return Linearisation(
        jnp.asarray(A), *empty, states=tuple(map(str, states)), inputs=(), outputs=()
    )


def test_modes_of_a_jet_transport_match_the_published_poles():
    """To the three printed digits."""
    result = modes(linear_model(JET_LATERAL, ("beta", "r", "p", "phi")))
    dutch = result.named("dutch roll")
    np.testing.assert_allclose(
        [dutch.eigenvalue.real, dutch.eigenvalue.imag], [-3.29e-2, 9.47e-1], rtol=2e-3
    )
    np.testing.assert_allclose(
        [dutch.damping, dutch.natural_frequency], [3.48e-2, 9.47e-1], rtol=2e-3
    )
    np.testing.assert_allclose(result.named("roll").eigenvalue, -5.63e-1, rtol=1e-3)
    np.testing.assert_allclose(result.named("spiral").eigenvalue, -7.28e-3, rtol=1e-3)
    assert len(result) == 3


def test_modes_of_a_light_aircraft_have_the_classical_names():
    short, long = modes(linear_model(LIGHT_LONGITUDINAL, ("u", "w", "q", "pitch")))
    assert (short.name, long.name) == ("short period", "phugoid")
    assert short.participation["w"] + short.participation["q"] > 0.9
    assert long.participation["u"] + long.participation["pitch"] > 0.9
    assert [
        mode.name for mode in modes(linear_model(LIGHT_LATERAL, ("beta", "p", "r", "phi")))
    ] == [
        "roll",
        "dutch roll",
        "spiral",
    ]


def test_mode_properties_follow_from_the_eigenvalue():
    """Natural frequency 5, damping 0.6: the roots -3 +- 4i; and a root at 0.5."""
    result = modes(
        linear_model([[0.0, 1.0, 0.0], [-25.0, -6.0, 0.0], [0.0, 0.0, 0.5]], ("w", "q", "phi"))
    )
    short, spiral = result
    assert (short.name, spiral.name) == ("short period", "spiral")
    np.testing.assert_allclose([short.natural_frequency, short.damping], [5.0, 0.6], rtol=1e-12)
    np.testing.assert_allclose(
        [short.period, short.time_to_half], [np.pi / 2, np.log(2) / 3], rtol=1e-12
    )
    assert short.time_to_double == np.inf
    np.testing.assert_allclose(spiral.time_to_double, np.log(2) / 0.5, rtol=1e-12)
    assert (spiral.damping, spiral.period, spiral.time_to_half) == (-1.0, np.inf, np.inf)
    np.testing.assert_allclose(sum(short.participation.values()), 1.0)


def test_names_do_not_depend_on_order_units_or_speed(seed):
    """Both motions in a matrix, with shuffled states in other units, and with a faster or slower
    dutch roll.
    """
    random = np.random.default_rng(seed)
    A = np.zeros((8, 8))
    A[:4, :4], A[4:, 4:] = LIGHT_LONGITUDINAL, LIGHT_LATERAL
    states = np.array(("u", "w", "q", "pitch", "beta", "p", "r", "phi"))
    expected = {mode.name: mode.eigenvalue for mode in modes(linear_model(A, states))}
    assert set(expected) == {"short period", "phugoid", "dutch roll", "roll", "spiral"}
    order, unit = random.permutation(8), 10.0 ** random.uniform(-3, 3, 8)
    shuffled = (unit[:, None] * A / unit)[np.ix_(order, order)]
    for mode in modes(linear_model(shuffled, states[order])):
        np.testing.assert_allclose(mode.eigenvalue, expected[mode.name], rtol=1e-8)
    A[6, 4] *= 100.0  # directionally stiff: the dutch roll becomes the fastest mode
    assert modes(linear_model(A, states))[0].name == "dutch roll"


def test_coupled_roll_and_spiral_are_a_lateral_phugoid():
    """Roll and bank oscillate, phi'' = -0.1 phi' - 0.04 phi, in addition to a dutch roll."""
    A = np.zeros((4, 4))
    A[:2, :2] = [[-0.1, -1.0], [4.0, -0.2]]
    A[2:, 2:] = [[-0.1, -0.04], [1.0, 0.0]]
    result = modes(linear_model(A, ("v", "r", "p", "phi")))
    assert [mode.name for mode in result] == ["dutch roll", "lateral phugoid"]


def test_statically_unstable_aircraft_has_a_third_oscillatory_mode():
    """The centre of gravity of the light aircraft moves aft: Mw increases through zero.

    The short period splits into two real modes. One of them and a real mode of the phugoid combine
    to a new oscillation.
    """
    names = []
    for Mw in (-0.0396, 0.02, 0.04):
        A = LIGHT_LONGITUDINAL.copy()
        A[2, 1] = Mw
        names.append(
            [
                mode.name
                for mode in modes(linear_model(A, ("u", "w", "q", "pitch")))
                if mode.oscillatory
            ]
        )
    assert names[0] == ["short period", "phugoid"]
    assert names[-1] in (["third oscillatory"], ["phugoid"])


def test_modes_of_the_longitudinal_aircraft_are_short_period_and_phugoid():
    model = true_aircraft()
    state, elevator, thrust = level_trim(model, LONGITUDINAL_SPEED)
    trimmed = with_values(model, ("thrust",), thrust[None])
    result = modes(linearise(trimmed, 0.0, state, elevator[None]))
    assert [mode.name for mode in result] == ["short period", "phugoid"]
    # Lanchester: frequency of a phugoid of constant energy; drag has a small influence
    lanchester = np.sqrt(2.0) * 9.80665 / LONGITUDINAL_SPEED
    np.testing.assert_allclose(result.named("phugoid").natural_frequency, lanchester, rtol=0.25)
    assert 0.0 < result.named("phugoid").damping < 0.3
    text = str(result)
    assert len(text.splitlines()) == 3
    assert repr(result) == text
    assert "short period" in text


class Spinning(AbstractModel):
    """A body with restoring moments in bank and pitch, and damping about all axes."""

    states, inputs, outputs = ("p", "q", "r", "e0", "e1", "e2", "e3"), (), ("p",)

    def rhs(self, t, x, u):
        phi, pitch, _ = euler(x[3:])
        moments = -jnp.stack([4.0 * phi, 9.0 * pitch, jnp.zeros(())]) - 0.2 * x[:3]
        return jnp.concatenate([moments, quaternion_rate(x[3:], x[:3])])

    def output(self, t, x, u):
        return x[:1]


def test_linearisation_in_euler_angles_at_rest_matches_closed_form():
    """At rest, pitched up, at any heading: phidot = p + r tan(pitch), pitchdot = q, psidot =
    r/cos(pitch).
    """
    pitch = 0.3
    x = jnp.concatenate([jnp.zeros(3), quaternion(0.0, pitch, 1.0)])
    result = jax.jit(lambda x: linearise_euler(Spinning(), 0.0, x, jnp.zeros(0)))(x)
    assert result.states == ("p", "q", "r", "phi", "pitch", "psi")
    expected = np.zeros((6, 6))
    expected[:3, :3] = -0.2 * np.eye(3)
    expected[0, 3], expected[1, 4] = -4.0, -9.0
    expected[3, [0, 2]], expected[4, 1], expected[5, 2] = (
        [1.0, np.tan(pitch)],
        1.0,
        1.0 / np.cos(pitch),
    )
    np.testing.assert_allclose(result.A, expected, atol=1e-13)
    assert "psi" not in modes(result)[0].participation  # no rate depends on the heading


def test_linearisation_in_euler_angles_of_a_rotating_body_matches_closed_form():
    """Rates of the angles depend on the angles: d(phidot)/d(pitch) = r/cos^2(pitch) and so on."""
    p, q, r, phi, pitch = 0.1, 0.2, 0.3, 0.4, 0.5
    x = jnp.concatenate([jnp.array([p, q, r]), quaternion(phi, pitch, 1.0)])
    A = np.asarray(
        linearise_euler(Spinning(), 0.0, x, jnp.zeros(0)).reduced(states=("phi", "pitch", "psi")).A
    )
    s, c = np.sin(phi), np.cos(phi)
    bank, turn = (q * c - r * s), (q * s + r * c)
    expected = [
        [bank * np.tan(pitch), turn / np.cos(pitch) ** 2, 0.0],
        [-turn, 0.0, 0.0],
        [bank / np.cos(pitch), turn * np.tan(pitch) / np.cos(pitch), 0.0],
    ]
    np.testing.assert_allclose(A, expected, atol=1e-13)


def test_unsuitable_linearisations_are_refused():
    with pytest.raises(InputError, match="Linearise with `linearise_euler`"):
        modes(linear_model(-np.eye(4), ("e0", "e1", "e2", "e3")))
    with pytest.raises(InputError, match="no quaternion"):
        linearise_euler(true_aircraft(), 0.0, jnp.zeros(4), jnp.zeros(1))
    with pytest.raises(InputError, match="no full set of eigenvectors"):
        modes(linear_model([[-1.0, 1.0], [0.0, -1.0]], ("w", "q")))
    with pytest.raises(InputError, match="not finite"):
        modes(linear_model([[np.nan]], ("p",)))
    with pytest.raises(InputError, match=r"no mode 'dutchroll'\. Did you mean 'dutch roll'"):
        modes(linear_model(LIGHT_LATERAL, ("beta", "p", "r", "phi"))).named("dutchroll")
    assert set(CLASSICAL) == {"u", "w", "q", "pitch", "v", "p", "r", "phi"}
