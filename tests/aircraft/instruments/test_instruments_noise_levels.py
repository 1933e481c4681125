"""Noise levels of Table 6.6, and random errors of a flight."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxid._foundation.checks import InputError
from jaxid.aircraft.instruments.channels import CHANNELS
from jaxid.aircraft.instruments.instruments import Instruments
from jaxid.aircraft.instruments.noise_levels import BASE, HIGH, NoiseLevel, draw, report_instruments
from jaxid.data.units import to_si
from jaxid.models.names import parameter_names

# scale; bias and noise; unit; for the base and the high level.
PRINTED = {
    "alpha": (0.02, 0.05, 0.02, 0.2, "deg"),
    "beta": (0.02, 0.05, 0.02, 0.05, "deg"),
    "ax": (0.005, 0.005, 0.005, 0.005, "g0"),
    "ay": (0.005, 0.005, 0.005, 0.01, "g0"),  # a digit more than printed: docs/errata.md
    "az": (0.005, 0.005, 0.005, 0.025, "g0"),
    "pdot": (0.005, 0.1, 0.005, 0.3, "deg/s^2"),
    "p": (0.005, 0.1, 0.005, 0.75, "deg/s"),
    "qdot": (0.005, 0.1, 0.005, 0.3, "deg/s^2"),
    "q": (0.005, 0.1, 0.005, 0.3, "deg/s"),
    "rdot": (0.005, 0.1, 0.005, 0.3, "deg/s^2"),
    "r": (0.005, 0.1, 0.005, 0.3, "deg/s"),
    "phi": (0.005, 0.5, 0.005, 0.9, "deg"),
    "pitch": (0.005, 0.15, 0.005, 0.45, "deg"),
    "psi": (0.005, 0.15, 0.005, 0.45, "deg"),
}
DRAWS = 2000
KINDS = ("scale", "bias", "position", "misalignment")


@pytest.fixture(scope="module")
def drawn():
    """Instruments of 2,000 flights, drawn about the report's at the high level."""
    keys = jax.random.split(jax.random.key(66), DRAWS)
    return jax.jit(jax.vmap(lambda key: draw(key, report_instruments(), HIGH)))(keys)


@pytest.mark.parametrize("channel", PRINTED)
@pytest.mark.parametrize(("level", "first"), [(BASE, 0), (HIGH, 2)], ids=["base", "high"])
def test_levels_equal_table_of_report(level, first, channel):
    *numbers, unit = PRINTED[channel]
    assert level.scale[channel] == numbers[first]
    size = to_si(numbers[first + 1], unit, channel)[0]
    np.testing.assert_allclose([level.bias[channel], level.noise[channel]], size, rtol=1e-14)


@pytest.mark.parametrize(("level", "printed"), [(BASE, 5.0), (HIGH, 6.25)], ids=["base", "high"])
def test_airspeed_errors_are_those_of_its_square(level, printed):
    """D.2.4: scale, bias and noise of V^2, in (ft/s)^2; by difference quotient at 280 ft/s."""
    V, foot = 280.0 * 0.3048, 0.3048
    for size in (level.bias["V"], level.noise["V"]):
        assert ((V + size) ** 2 - V**2) / foot**2 == pytest.approx(printed, rel=1e-4)
    assert (1.0 + level.scale["V"]) ** 2 - 1.0 == pytest.approx(0.01, rel=0.003)


def test_positions_and_angles_equal_table_of_report():
    for level, feet, degrees in ((BASE, 0.5, 0.6), (HIGH, 1.0, 0.9)):
        assert set(level.position) == {"alpha", "beta", "ax", "ay", "az", "az_pilot"}
        np.testing.assert_allclose(
            list(level.position.values()), to_si(feet, "ft", "")[0], rtol=1e-14
        )
        moved = {"p", "q", "r", "pdot", "qdot", "rdot", "ax", "ay", "az", "az_pilot"}
        assert set(level.misalignment) == moved
        np.testing.assert_allclose(
            list(level.misalignment.values()), np.deg2rad(degrees), rtol=1e-14
        )
        for sizes in (level.scale, level.bias, level.noise):
            assert sizes["az_pilot"] == sizes["az"]
            assert not {"altitude", "stabilator", "aileron", "rudder", "thrust"} & set(sizes)
    vanes = report_instruments().position
    for vane in ("alpha", "beta"):
        np.testing.assert_allclose(vanes[vane], to_si([34.0, 0.5, 0.2], "ft", "")[0], rtol=1e-14)
    np.testing.assert_array_equal(vanes["ax"], 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_drawn_errors_have_standard_deviation_of_level(drawn, kind):
    nominal, values, sizes = (
        getattr(report_instruments(), kind),
        np.array(getattr(drawn, kind).values),
        getattr(HIGH, kind),
    )
    sigma = np.array([sizes.get(name, 0.0) for name in nominal.channels])
    sigma = sigma.reshape(-1, *[1] * (values.ndim - 2))
    error = values - np.array(nominal.values)
    assert np.all(error[:, sigma.reshape(len(sigma)) == 0] == 0)
    standard = (error / np.where(sigma > 0, sigma, 1.0))[:, sigma.reshape(len(sigma)) > 0].reshape(
        DRAWS, -1
    )
    count = standard.shape[1]  # bands hold for all elements of one kind together
    low, high = stats.chi2.interval(1 - 1e-3 / count, DRAWS) / np.array(DRAWS)
    assert np.all((low < np.mean(standard**2, axis=0)) & (np.mean(standard**2, axis=0) < high))
    assert np.all(np.abs(standard.mean(axis=0)) < stats.norm.isf(0.5e-3 / count) / np.sqrt(DRAWS))
    correlation = np.corrcoef(standard.T)[np.triu_indices(count, 1)]
    bound = stats.norm.isf(0.5e-3 / max(correlation.size, 1)) / np.sqrt(DRAWS - 3)
    assert np.all(np.abs(np.arctanh(correlation)) < bound)


def test_draw_depends_on_key_and_adds_noise_of_level(key):
    start = report_instruments(("q", "alpha", "altitude"))
    one, again = draw(key, start, BASE), draw(key, start, BASE)
    np.testing.assert_array_equal(one.bias.values, again.bias.values)
    other = draw(jax.random.key(7), start, BASE)
    for kind in KINDS:
        changed = getattr(other, kind).values != getattr(one, kind).values
        assert np.all(changed[:2])  # q and alpha; the altitude has no error
    assert one.noise.channels == ("q", "alpha")
    assert float(one.noise["alpha"]) == BASE.noise["alpha"]
    alone = draw(key, report_instruments(("alpha",)), BASE)
    for kind in ("scale", "bias", "position"):
        np.testing.assert_array_equal(getattr(alone, kind)["alpha"], getattr(one, kind)["alpha"])


def test_draw_keeps_channels_without_level(key):
    own = Instruments(("q", "altitude"), noise={"altitude": 2.0}, lag={"q": 0.02}, scale={"q": 0.5})
    level = NoiseLevel(
        scale={"q": 0.0}, bias={"q": 1e-3}, noise={"q": 3e-3}, position={}, misalignment={}
    )
    drawn = draw(key, own, level)
    assert parameter_names(drawn)[-3:] == ("lag.q", "noise.q", "noise.altitude")
    np.testing.assert_array_equal(drawn.noise.values, [3e-3, 2.0])
    np.testing.assert_array_equal(drawn.scale.values, [0.5, 0.0])
    assert float(drawn.bias["q"]) != 0.0
    assert float(drawn.bias["altitude"]) == 0.0


def test_batch_of_flights_measures_with_individual_errors(drawn):
    t = 0.1 * jnp.arange(20)
    y = jnp.ones((20, len(CHANNELS)))
    few = jax.tree.map(lambda leaf: leaf[:3], drawn)
    z, mask = jax.jit(jax.vmap(lambda i, key: i.measure(key, t, i.observe(t, y))))(
        few, jax.random.split(jax.random.key(1), 3)
    )
    assert z.shape == mask.shape == (3, 20, len(CHANNELS))
    assert np.all(np.abs(z[0, :, 0] - z[1, :, 0]) > 0)


def test_unknown_channel_raises_error():
    with pytest.raises(InputError, match="no instrument channel 'roll'"):
        report_instruments(("roll",))
