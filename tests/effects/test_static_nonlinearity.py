"""Dead band, saturation and hinge: functions, initial shapes and placement."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.effects import Augmented, DeadBand, Hinge, Location, LocationKind, Placement, Saturation
from jaxid.effects.shape_initialisation import (
    centre_of,
    level_in,
    longest_record,
    max_deviation,
    rates_in,
    record_starts,
    time_scale_of,
)
from jaxid.models import LinearModel

AT = Placement.equation("x")
SHAPES = {
    # effect with its shape, and the function that it adds
    "dead band": (
        DeadBand(AT, "x", gain=jnp.array(2.0), width=jnp.array(0.5), centre=jnp.array(1.0)),
        lambda x: 2.0 * np.sign(x - 1) * np.maximum(np.abs(x - 1) - 0.5, 0),
    ),
    "saturation": (
        Saturation(AT, "x", gain=jnp.array(2.0), level=jnp.array(0.5), centre=jnp.array(1.0)),
        lambda x: 2.0 * np.sign(x - 1) * np.minimum(np.abs(x - 1), 0.5),
    ),
    "hinge": (
        Hinge(AT, "x", gain=jnp.array(2.0), level=jnp.array(0.5)),
        lambda x: 2.0 * np.maximum(x - 0.5, 0.0),
    ),
}
SHAPE = ("width", "level", "centre")
X = np.linspace(-2.0, 3.0, 23)


def still(states=("x",)):
    """Return a model with constant states."""
    n = len(states)
    return LinearModel(
        np.zeros((n, n)),
        np.zeros((n, 1)),
        np.eye(n),
        np.zeros((n, 1)),
        states=states,
        inputs=("u",),
        outputs=states,
    )


@pytest.mark.parametrize("kind", SHAPES)
def test_static_nonlinearity_adds_its_function(kind):
    effect, want = SHAPES[kind]
    model = Augmented(still(), (effect,))
    actual = jax.vmap(lambda x: model.rhs(jnp.zeros(()), x, jnp.zeros(1)))(jnp.asarray(X)[:, None])[
        :, 0
    ]
    np.testing.assert_allclose(actual, want(X), rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("kind", SHAPES)
def test_shape_is_set_from_training_records(kind):
    signal = 4.0 + np.linspace(-1.0, 1.0, 101)
    effect = SHAPES[kind][0].initialise_shape({"x": signal}, {}, 0.1)
    shape = {
        name: float(getattr(effect, name)) for name in effect.__dataclass_fields__ if name in SHAPE
    }
    # 0.4 of the distance of 1 from the median to the end, or half of the range.
    want = {"dead band": {"width": 0.4, "centre": 4.0}, "saturation": {"level": 0.4, "centre": 4.0}}
    assert shape == pytest.approx(want.get(kind, {"level": 4.0}))
    assert float(effect.gain) == 2.0  # a gain is not a shape


def test_level_of_hinge_is_bounded_to_identifiable_range():
    """Outside of the signal's range a hinge would be a straight line or zero."""
    signals = {"x": np.linspace(-1.0, 3.0, 50)}
    started = Hinge(Placement.equation("v"), "x", 0.3).initialise_shape(signals, {}, 0.1)
    np.testing.assert_allclose(
        (float(started.level), *started.card.bounds["level"]), (0.2, -0.6, 2.6), rtol=1e-12
    )


def test_bounds_of_hinge_exclude_samples_at_rest():
    rest = np.full(3000, 0.05) + 1e-4 * np.sin(np.arange(3000))
    rest[1000:1250] += 0.35 * np.sin(np.linspace(0.0, np.pi, 250))
    lowest, highest = (
        Hinge(Placement.equation("v"), "x", 0.3)
        .initialise_shape({"x": rest}, {}, 0.1)
        .card.bounds["level"]
    )
    assert 0.05 < lowest < 0.15
    assert 0.35 < highest < 0.4
    assert Hinge(Placement.equation("v"), "x").initialise_shape(
        {"x": np.full(9, 2.0)}, {}, 0.1
    ).card.bounds["level"] == (
        2.0,
        2.0,
    )


def test_dead_band_plus_saturation_is_linear():
    band, flat = (
        eqx.tree_at(lambda e: e.gain, SHAPES[kind][0], jnp.array(3.0))
        for kind in ("dead band", "saturation")
    )
    both = Augmented(still(), (band, flat))
    actual = both.rhs(jnp.zeros(()), jnp.array([2.7]), jnp.zeros(1))
    np.testing.assert_allclose(actual, [3.0 * 1.7], rtol=1e-14)


def test_coefficient_acts_on_states_by_its_multipliers():
    placement = Placement("Cm", (("q", "gamma"), ("w", "gamma delta")))
    model = Augmented(
        still(("q", "w", "gamma", "delta")), (Hinge(placement, "q", gain=jnp.array(2.0)),)
    )
    actual = model.rhs(jnp.zeros(()), jnp.array([1.5, 0.0, 3.0, -0.1]), jnp.zeros(1))
    np.testing.assert_allclose(
        actual, [2 * 1.5 * 3.0, 2 * 1.5 * 3.0 * -0.1, 0.0, 0.0], rtol=1e-14, atol=0
    )


def test_placement_has_location_and_words():
    assert (str(AT.location), AT.words) == ("equation of x", "in the equation of x")
    placement = Placement("Cm", (("q", "q_per_Cm"),))
    assert (
        placement.location
        == Hinge(placement, "alpha").card.location
        == Location(LocationKind.COEFFICIENT, "Cm")
    )
    assert Hinge(placement, "alpha").name == "hinge of alpha in Cm (from 50%)"
    assert (
        Hinge(placement, "alpha", 0.25).card.family == Hinge(placement, "alpha", 0.75).card.family
    )
    assert Placement.equation("x") == Placement("x", (("x", "1"),))


def test_centre_is_zero_if_quartiles_enclose_zero():
    assert centre_of(np.array([-1.0, -0.5, 0.1, 0.5, 1.0])) == 0.0
    assert centre_of(np.array([-0.1, 0.9, 1.0, 1.1, 3.0])) == 1.0
    assert max_deviation(np.array([-0.1, 0.9, 1.0, 1.1, 3.0])) == 2.0
    assert max_deviation(np.full(4, 2.0)) == 1.0
    assert level_in(np.array([2.0, 4.0]), 0.25) == 2.5


def test_new_record_number_starts_record_at_any_time():
    signals = {
        "t": np.r_[0.0, 1.0, 2.0, 50.0, 51.0, 52.0],
        "number of the record": np.repeat([0.0, 1.0], 3),
    }
    assert list(record_starts(signals)) == [3]
    assert longest_record(signals) == 2.0
    assert list(rates_in(np.r_[0.0, 2.0, 4.0, 9.0, 12.0, 15.0], signals)) == [2.0, 2.0, 3.0, 3.0]
    assert list(record_starts({"t": signals["t"]})) == []
    assert longest_record({"t": signals["t"] % 50.0}) == 2.0


def test_rates_do_not_cross_records():
    signals = {"t": np.array([0.0, 0.5, 1.0, 0.0, 0.5])}
    signal = np.array([0.0, 1.0, 3.0, 100.0, 99.0])
    np.testing.assert_array_equal(rates_in(signal, signals), [2.0, 4.0, -2.0])
    assert time_scale_of(np.zeros(5), signals, 0.5) == 0.5
    t = np.linspace(0, 2 * np.pi, 1001)
    # A sine of frequency w has the time scale 1/w; differences over h yield w sinc(w h/2), smaller
    # by 5e-5.
    assert time_scale_of(np.sin(5 * t), {"t": t}, 0.1) == pytest.approx(0.2, rel=1e-3)
