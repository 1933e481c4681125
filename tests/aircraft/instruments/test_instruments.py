"""Readings of instruments at an instant: position, axis, scale, bias, names; errors on invalid
input.
"""

import analytic_motion as motion
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.air.atmosphere import StandardAtmosphere
from jaxid.aircraft.instruments.channels import CHANNELS
from jaxid.aircraft.instruments.geometry import sensitive_axis
from jaxid.aircraft.instruments.instruments import Instruments
from jaxid.models.names import flatten, parameter_names

PLACES = {
    "alpha": (10.4, 0.3, -0.2),
    "beta": (9.1, -0.4, 0.5),
    "ax": (1.2, 0.7, -0.3),
    "ay": (-0.8, 0.2, 0.9),
    "az": (0.5, -1.1, 0.4),
    "az_pilot": (5.5, 0.1, -1.0),
}
ANGLES = {
    "p": {"psi": 0.02, "theta": -0.03},
    "q": {"psi": 0.01, "phi": 0.04},
    "rdot": {"theta": 0.02, "phi": 0.01},
    "ay": {"psi": -0.02, "phi": 0.03},
    "az_pilot": {"theta": 0.05, "phi": -0.01},
}
ERRING = Instruments(
    position=PLACES,
    misalignment=ANGLES,
    scale={name: 0.01 + 0.002 * i for i, name in enumerate(CHANNELS)},
    bias={name: 0.003 * (i - 7) for i, name in enumerate(CHANNELS)},
)


@pytest.fixture(scope="module")
def truth():
    """The signals of the motion at all times, by name."""
    return jax.jit(jax.vmap(motion.signals))(motion.TIMES)


@pytest.fixture(scope="module")
def read():
    """Readings of all instants by channel; one compilation for each structure of instruments."""
    compiled = eqx.filter_jit(
        jax.vmap(lambda instruments, signals: instruments.read(signals), in_axes=(None, 0))
    )
    return lambda instruments, signals: dict(
        zip(instruments.channels, compiled(instruments, signals).T, strict=True)
    )


def at_point(function, position):
    return np.array(jax.vmap(function(jnp.asarray(position)))(motion.TIMES))


def test_perfect_instruments_at_cg_read_true_values(truth, read):
    readings = read(Instruments(), truth)
    assert tuple(readings) == CHANNELS
    direct = [name for name in CHANNELS if name not in ("beta", "V", "az_pilot")]
    for name in direct:
        np.testing.assert_allclose(readings[name], truth[name], rtol=1e-15, atol=1e-15)  # rounding
    np.testing.assert_array_equal(readings["az_pilot"], readings["az"])
    # A hinged vane shows the flank angle, and a pitot tube the indicated airspeed.
    np.testing.assert_allclose(
        np.tan(readings["beta"]), np.tan(truth["beta"]) / np.cos(truth["alpha"]), rtol=1e-13
    )
    impact = 0.5 * 0.9 * truth["V"] ** 2 * (1 + truth["mach"] ** 2 / 4 + truth["mach"] ** 4 / 40)
    np.testing.assert_allclose(0.5 * 1.225 * readings["V"] ** 2, impact, rtol=1e-14)


def test_indicated_airspeed_at_sea_level_and_low_speed_equals_true_airspeed(truth, read):
    still = truth | {"density": jnp.full(7, 1.225), "mach": jnp.full(7, 1e-4)}
    # f_c - 1 is M^2/4 = 2.5e-9, and the relative error of the root is half of it; the standard
    # density is rounded to four digits.
    np.testing.assert_allclose(read(Instruments(), still)["V"], truth["V"], rtol=2e-9)
    np.testing.assert_allclose(StandardAtmosphere().air(jnp.zeros(())).density, 1.225, rtol=2e-5)


def test_accelerometers_off_cg_read_second_derivative_of_their_position(truth, read):
    readings = read(Instruments(position=PLACES), truth)
    for axis, name in enumerate(("ax", "ay", "az")):
        want = at_point(motion.specific_force, PLACES[name])[:, axis]
        # rounding of 3 km differentiated twice
        np.testing.assert_allclose(readings[name], want, rtol=0, atol=1e-11)
        assert np.abs(want - truth[name]).max() > 0.1  # the position matters
    want = at_point(motion.specific_force, PLACES["az_pilot"])[:, 2]
    np.testing.assert_allclose(readings["az_pilot"], want, rtol=0, atol=1e-11)


def test_accelerometers_agree_with_differences_of_positions(truth, read):
    """An independent derivative: fourth-order central differences of the position."""
    h, weights = 1e-2, np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0
    along = jax.vmap(jax.vmap(motion.point(jnp.asarray(PLACES["az"]))))
    path = np.array(along(motion.TIMES[:, None] + h * jnp.arange(-2, 3)[None]))
    acceleration = np.einsum("k,tkx->tx", weights, path) / h**2 - np.array([0.0, 0.0, motion.G])
    want = np.einsum("txy,tx->ty", np.array(jax.vmap(motion.to_earth)(motion.TIMES)), acceleration)[
        :, 2
    ]
    # Truncation h^4/90 of the sixth derivative, of order 10 m/s^6: 1e-9; rounding 64/12 * 1e-16 * 3
    # km/h^2: 2e-8.
    np.testing.assert_allclose(
        read(Instruments(position=PLACES), truth)["az"], want, rtol=0, atol=5e-8
    )


def test_vanes_off_cg_read_flow_at_their_position(truth, read):
    readings = read(Instruments(position=PLACES), truth)
    u, _, w = at_point(motion.air_velocity, PLACES["alpha"]).T
    np.testing.assert_allclose(readings["alpha"], np.arctan2(w, u), rtol=0, atol=1e-13)
    u, v, _ = at_point(motion.air_velocity, PLACES["beta"]).T
    np.testing.assert_allclose(readings["beta"], np.arctan2(v, u), rtol=0, atol=1e-13)


def test_small_misalignments_equal_equations_of_report(truth, read):
    p, q, r = (np.array(truth[name]) for name in ("p", "q", "r"))
    angles = {
        "p": {"psi": 2e-4, "theta": 3e-4},
        "q": {"psi": 1e-4, "phi": -3e-4},
        "r": {"theta": 2e-4, "phi": 1e-4},
    }
    readings = read(Instruments(misalignment=angles), truth)
    want = {  # D.2.2.1, with + r phi_q, the sign of a rotation
        "p": p + q * 2e-4 - r * 3e-4,
        "q": -p * 1e-4 + q + r * -3e-4,
        "r": p * 2e-4 - q * 1e-4 + r,
    }
    for name, value in want.items():
        np.testing.assert_allclose(
            readings[name], value, rtol=0, atol=1e-7
        )  # squares of the angles, 9e-8, times rates below 1
        assert np.abs(value - truth[name]).max() > 1e-5


@pytest.mark.parametrize(("name", "row"), [("x", 0), ("y", 1), ("z", 2)])
def test_misaligned_axis_equals_row_of_euler_matrix(name, row):
    euler = {"phi": 0.3, "theta": -0.4, "psi": 0.5}
    axis_angles = {"x": ("psi", "theta"), "y": ("psi", "phi"), "z": ("theta", "phi")}[name]
    f, h, s = (euler[angle] if angle in axis_angles else 0.0 for angle in ("phi", "theta", "psi"))
    roll = np.array([[1, 0, 0], [0, np.cos(f), np.sin(f)], [0, -np.sin(f), np.cos(f)]])
    pitch = np.array([[np.cos(h), 0, -np.sin(h)], [0, 1, 0], [np.sin(h), 0, np.cos(h)]])
    yaw = np.array([[np.cos(s), np.sin(s), 0], [-np.sin(s), np.cos(s), 0], [0, 0, 1]])
    axis = sensitive_axis(name, jnp.array([euler[angle] for angle in axis_angles]))
    np.testing.assert_allclose(axis, (roll @ pitch @ yaw)[row], rtol=0, atol=1e-15)


def test_scale_and_bias_act_on_each_channel(truth, read):
    plain = read(Instruments(position=PLACES, misalignment=ANGLES), truth)
    for i, (name, value) in enumerate(read(ERRING, truth).items()):
        np.testing.assert_allclose(
            value, (1.01 + 0.002 * i) * plain[name] + 0.003 * (i - 7), rtol=1e-14, atol=1e-15
        )


def test_derivatives_by_all_parameters_equal_differences(truth):
    signals = {name: value[3] for name, value in truth.items()}
    vector, unflatten = flatten(ERRING)
    readings = jax.jit(lambda theta: unflatten(theta).read(signals))
    S = np.array(jax.jit(jax.jacfwd(readings))(vector))
    h = 1e-5
    differences = [
        (readings(vector + h * e) - readings(vector - h * e)) / (2 * h) for e in np.eye(vector.size)
    ]
    # Rounding 1e-16/h of each reading (altitude 3 km, thrust 40 kN), and h^2 = 1e-10 of the third
    # derivative.
    size = np.maximum(1.0, np.abs(np.array(readings(vector))))
    np.testing.assert_allclose(
        S / size[:, None], np.array(differences).T / size[:, None], rtol=0, atol=1e-9
    )
    assert np.all(np.abs(S).max(axis=0) > 0)  # every number is felt


def test_parameters_have_names():
    small = Instruments(
        ("alpha", "q"), position={"alpha": (10.0, 0.0, 0.0)}, lag={"q": 0.02}, noise={"q": 1e-3}
    )
    assert parameter_names(small) == (
        *(
            "position.alpha.x",
            "position.alpha.y",
            "position.alpha.z",
            "misalignment.q.psi",
            "misalignment.q.phi",
        ),
        *("scale.alpha", "scale.q", "bias.alpha", "bias.q", "lag.q", "noise.q"),
    )
    assert small.units() == {"alpha": "rad", "q": "rad/s"}
    assert set(small.parameter_units()) == set(parameter_names(small))
    assert small.parameter_units()["lag.q"] == "s"
    assert small.parameter_units()["noise.q"] == "rad/s"
    np.testing.assert_array_equal(small.position["alpha"], [10.0, 0.0, 0.0])
    assert float(small.lag["q"]) == 0.02


def test_selected_channels_need_only_their_signals(truth):
    small = Instruments(("q", "altitude"))
    assert small.signals_needed == {"p", "q", "r", "altitude"}
    signals = {name: truth[name][0] for name in small.signals_needed}
    np.testing.assert_array_equal(small.read(signals), [truth["q"][0], truth["altitude"][0]])
    with pytest.raises(InputError, match=r"There is no signal .* 'altitude'"):
        small.read({name: signals[name] for name in "pqr"})


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Instruments(("alfa", "q")), "no instrument channel 'alfa'. Did you mean 'alpha'"),
        (lambda: Instruments(("q", "q")), "'q' occurs twice"),
        (lambda: Instruments(()), "`channels` is empty"),
        (lambda: Instruments("alpha"), "is the string 'alpha'"),
        (lambda: Instruments(("q",), bias={"p": 0.1}), r"no channel \(in `bias`\) 'p'"),
        (lambda: Instruments(("q",), bias={"q": [0.1, 0.2]}), "shape .2,.*Give one number"),
        (
            lambda: Instruments(("q",), position={"q": (1.0, 0.0, 0.0)}),
            "no channel with a position 'q'",
        ),
        (lambda: Instruments(("ax",), position={"ax": 1.0}), r"Give \(x, y, z\)"),
        (
            lambda: Instruments(("phi",), misalignment={"phi": {"psi": 0.1}}),
            "no channel with an axis 'phi'",
        ),
        (
            lambda: Instruments(("q",), misalignment={"q": {"theta": 0.1}}),
            "no misalignment angle of 'q' 'theta'",
        ),
        (lambda: Instruments(("q",), coloured_noise={"q": 0.1}), "Give both for the same channels"),
        (lambda: Instruments(("q",)).lag["q"], "no value for the channel 'q'"),
    ],
)
def test_invalid_input_raises_error(make, words):
    with pytest.raises(InputError, match=words):
        make()
