"""Drift, quantisation and cross-talk of sensors."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.effects import (
    Augmented,
    SensorBias,
    SensorCrossTalk,
    SensorDrift,
    SensorQuantisation,
    general_effects,
)
from jaxid.effects.sensor_quantisation import grid_of
from jaxid.models import LinearModel
from jaxid.simulation import simulate

T = 2.0 + 0.1 * np.arange(40)
U = np.stack([np.sin(T), np.cos(2 * T), 0.1 * T], axis=1)
DIRECT = LinearModel(
    [[0.0]],
    np.zeros((1, 3)),
    np.zeros((3, 1)),
    np.eye(3),
    states=("x",),
    inputs=("a", "b", "c"),
    outputs=("p", "q", "r"),
)


def shown(*effects):
    return np.asarray(simulate(Augmented(DIRECT, effects), T, U, np.zeros(1)).y)


def test_sensor_drift_starts_at_zero_in_record():
    actual = shown(SensorDrift("q", jnp.array(0.3)))
    np.testing.assert_allclose(
        actual, U + np.outer(0.3 * (T - 2.0), [0, 1, 0]), rtol=1e-14, atol=1e-15
    )


def test_sensors_of_one_kind_have_their_own_plain_numbers():
    sensors = tuple(
        eqx.tree_at(lambda sensor: sensor.gain, SensorBias(name), gain)
        for name, gain in (("p", 0.1), ("q", 0.5), ("r", 2))
    )
    actual = Augmented(DIRECT, sensors).observe(jnp.asarray(T), jnp.asarray(U))
    np.testing.assert_array_equal(actual, U + np.array([0.1, 0.5, 2.0]))


def test_cross_talk_adds_share_of_source():
    actual = shown(SensorCrossTalk("q", "p", jnp.array(0.2)))
    np.testing.assert_allclose(
        actual, U + np.outer(0.2 * U[:, 0], [0, 1, 0]), rtol=1e-14, atol=1e-15
    )


@pytest.mark.parametrize("gain", [0.0, 0.4, 1.0])
def test_quantisation_rounds_to_measured_grid(gain):
    step = 0.25
    measured = {"p": 0.05 + step * np.round((U[:, 0] - 0.05) / step)}
    effect = SensorQuantisation("p", jnp.array(gain)).initialise_shape({}, measured, 0.1)
    np.testing.assert_allclose(effect.grid, step, rtol=1e-12)
    want = U[:, 0] + gain * (measured["p"] - U[:, 0])
    np.testing.assert_allclose(shown(effect)[:, 0], want, rtol=0, atol=1e-14)


def test_quantisation_has_unit_derivative():
    effect = SensorQuantisation("p", jnp.array(1.0), jnp.array(0.25))
    slope = jax.vmap(jax.grad(lambda y: effect.reading(jnp.zeros(1), y[None])[0]))(
        jnp.asarray(U[:, 0])
    )
    np.testing.assert_allclose(slope, 1.0, rtol=1e-15)


def test_grid_is_detected_in_quantised_signal_only(seed):
    signal = np.random.default_rng(seed).normal(size=400)
    assert grid_of(signal) == 0.0
    assert grid_of(np.full(9, 2.0)) == 0.0
    coarse = 0.013 * np.round(signal / 0.013)
    assert grid_of(coarse) == pytest.approx(0.013, rel=1e-9)
    assert grid_of(np.round(coarse, 4)) == pytest.approx(0.013, rel=1e-9)
    fine = 1e-9 * np.round(signal / 1e-9)
    assert grid_of(fine) == 0.0


def test_quantisation_is_scored_blind_if_signal_is_stepped():
    effect, slow = SensorQuantisation("p"), np.sin(0.02 * np.arange(300))
    assert effect.score_blind({"p": np.round(slow, 1)})
    # on a grid, but neighbouring samples are rarely equal
    assert not effect.score_blind({"p": np.round(slow, 4)})
    assert not effect.score_blind({"p": slow})
    untouched = effect.initialise_shape({}, {"p": slow}, 0.1)
    np.testing.assert_array_equal(untouched.reading(jnp.asarray(T), jnp.asarray(U[:, 0])), U[:, 0])


class Gyros(LinearModel):
    def units(self):
        return {"p": "rad/s", "q": "rad/s", "r": "rad"}


def test_cross_talk_is_candidate_between_few_channels_of_one_unit():
    model = Gyros(
        DIRECT.A,
        DIRECT.B,
        DIRECT.C,
        DIRECT.D,
        states=("x",),
        inputs=DIRECT.inputs,
        outputs=DIRECT.outputs,
    )
    actual = {
        effect.name for effect in general_effects(model, ()) if isinstance(effect, SensorCrossTalk)
    }
    assert actual == {"cross-talk of p into q", "cross-talk of q into p"}
    assert not any(isinstance(effect, SensorCrossTalk) for effect in general_effects(DIRECT, ()))
