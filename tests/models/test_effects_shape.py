"""Dead band, saturation and hinge: what they add, where they start, and where they act."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.models import Acting, Augmented, DeadBand, Hinge, LinearModel, Saturating
from jaxid.models.starts import begins_in, centre_of, level_in, longest_in, rates_in, reach_of, time_scale_of

AT = Acting.equation("x")
SHAPES = {
    # effect with its shape, and what it adds at a signal d from the centre or level
    "dead band": (
        DeadBand(AT, "x", gain=jnp.array(2.0), width=jnp.array(0.5), centre=jnp.array(1.0)),
        lambda x: 2.0 * np.sign(x - 1) * np.maximum(np.abs(x - 1) - 0.5, 0),
    ),
    "saturation": (
        Saturating(AT, "x", gain=jnp.array(2.0), level=jnp.array(0.5), centre=jnp.array(1.0)),
        lambda x: 2.0 * np.sign(x - 1) * np.minimum(np.abs(x - 1), 0.5),
    ),
    "hinge": (Hinge(AT, "x", gain=jnp.array(2.0), level=jnp.array(0.5)), lambda x: 2.0 * np.maximum(x - 0.5, 0.0)),
}
SHAPE = ("width", "level", "centre")
X = np.linspace(-2.0, 3.0, 23)


def still(states=("x",)):
    """States that stand still."""
    n = len(states)
    return LinearModel(
        np.zeros((n, n)), np.zeros((n, 1)), np.eye(n), np.zeros((n, 1)), states=states, inputs=("u",), outputs=states
    )


@pytest.mark.parametrize("kind", SHAPES)
def test_what_is_added_has_the_shape(kind):
    effect, want = SHAPES[kind]
    model = Augmented(still(), (effect,))
    found = jax.vmap(lambda x: model.rhs(jnp.zeros(()), x, jnp.zeros(1)))(jnp.asarray(X)[:, None])[:, 0]
    np.testing.assert_allclose(found, want(X), rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("kind", SHAPES)
def test_a_shape_is_set_from_the_training_records(kind):
    signal = 4.0 + np.linspace(-1.0, 1.0, 101)
    effect = SHAPES[kind][0].start({"x": signal}, {}, 0.1)
    shape = {name: float(getattr(effect, name)) for name in effect.__dataclass_fields__ if name in SHAPE}
    # 0.4 of the way of 1 from the median to the end, or half of the range.
    want = {"dead band": {"width": 0.4, "centre": 4.0}, "saturation": {"level": 0.4, "centre": 4.0}}
    assert shape == pytest.approx(want.get(kind, {"level": 4.0}))
    assert float(effect.gain) == 2.0  # a gain is not a shape


def test_a_hinge_stays_where_it_can_be_told():
    """Outside of the signal's range it would be no bend, but a straight line or nothing."""
    signals = {"x": np.linspace(-1.0, 3.0, 50)}
    started = Hinge(Acting.equation("v"), "x", 0.3).start(signals, {}, 0.1)
    np.testing.assert_allclose((float(started.level), *started.bounds["level"]), (0.2, -0.6, 2.6), rtol=1e-12)


def test_a_bend_can_be_told_where_a_signal_that_rests_is_moved():
    rest = np.full(3000, 0.05) + 1e-4 * np.sin(np.arange(3000))
    rest[1000:1250] += 0.35 * np.sin(np.linspace(0.0, np.pi, 250))
    lowest, highest = Hinge(Acting.equation("v"), "x", 0.3).start({"x": rest}, {}, 0.1).bounds["level"]
    assert 0.05 < lowest < 0.15
    assert 0.35 < highest < 0.4
    assert Hinge(Acting.equation("v"), "x").start({"x": np.full(9, 2.0)}, {}, 0.1).bounds["level"] == (2.0, 2.0)


def test_a_dead_band_and_a_saturation_are_a_straight_line_together():
    band, flat = (
        eqx.tree_at(lambda e: e.gain, SHAPES[kind][0], jnp.array(3.0)) for kind in ("dead band", "saturation")
    )
    both = Augmented(still(), (band, flat))
    found = both.rhs(jnp.zeros(()), jnp.array([2.7]), jnp.zeros(1))
    np.testing.assert_allclose(found, [3.0 * 1.7], rtol=1e-14)


def test_a_coefficient_moves_several_states_by_its_multipliers():
    acting = Acting("Cm", (("q", "gamma"), ("w", "gamma delta")))
    model = Augmented(still(("q", "w", "gamma", "delta")), (Hinge(acting, "q", gain=jnp.array(2.0)),))
    found = model.rhs(jnp.zeros(()), jnp.array([1.5, 0.0, 3.0, -0.1]), jnp.zeros(1))
    np.testing.assert_allclose(found, [2 * 1.5 * 3.0, 2 * 1.5 * 3.0 * -0.1, 0.0, 0.0], rtol=1e-14, atol=0)


def test_places_and_words_say_where():
    assert (AT.place, AT.words) == ("equation of x", "in the equation of x")
    acting = Acting("Cm", (("q", "q_per_Cm"),))
    assert acting.place == Hinge(acting, "alpha").place == "coefficient Cm"
    assert Hinge(acting, "alpha").name == "hinge of alpha in Cm (from 50%)"
    assert Hinge(acting, "alpha", 0.25).family == Hinge(acting, "alpha", 0.75).family
    assert Acting.equation("x") == Acting("x", (("x", "1"),))


def test_a_centre_is_zero_where_a_signal_moves_about_zero():
    assert centre_of(np.array([-1.0, -0.5, 0.1, 0.5, 1.0])) == 0.0
    assert centre_of(np.array([-0.1, 0.9, 1.0, 1.1, 3.0])) == 1.0
    assert reach_of(np.array([-0.1, 0.9, 1.0, 1.1, 3.0])) == 2.0
    assert reach_of(np.full(4, 2.0)) == 1.0
    assert level_in(np.array([2.0, 4.0]), 0.25) == 2.5


def test_another_number_is_another_record_wherever_its_time_begins():
    signals = {"t": np.r_[0.0, 1.0, 2.0, 50.0, 51.0, 52.0], "number of the record": np.repeat([0.0, 1.0], 3)}
    assert list(begins_in(signals)) == [3]
    assert longest_in(signals) == 2.0
    assert list(rates_in(np.r_[0.0, 2.0, 4.0, 9.0, 12.0, 15.0], signals)) == [2.0, 2.0, 3.0, 3.0]
    assert list(begins_in({"t": signals["t"]})) == []
    assert longest_in({"t": signals["t"] % 50.0}) == 2.0


def test_rates_do_not_reach_from_one_record_into_the_next():
    signals = {"t": np.array([0.0, 0.5, 1.0, 0.0, 0.5])}
    signal = np.array([0.0, 1.0, 3.0, 100.0, 99.0])
    np.testing.assert_array_equal(rates_in(signal, signals), [2.0, 4.0, -2.0])
    assert time_scale_of(np.zeros(5), signals, 0.5) == 0.5
    t = np.linspace(0, 2 * np.pi, 1001)
    # A sine of frequency w has the time scale 1/w; differences of h see w sinc(w h/2) of it: 5e-5 short.
    assert time_scale_of(np.sin(5 * t), {"t": t}, 0.1) == pytest.approx(0.2, rel=1e-3)
