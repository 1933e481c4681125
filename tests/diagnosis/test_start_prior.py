"""Initial values fitted in a window under a prior equal the Bayesian estimate of a linear model."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import AbstractModel, OutputError, record
from jaxid._foundation.types import Array
from jaxid.diagnosis.validation import Predictor
from jaxid.effects import Augmented, SensorLag
from jaxid.estimation.estimate import as_stack
from jaxid.models import FixedNoise
from jaxid.models.base import canonical

SIGMA, WINDOW, STEP = 0.3, 5, 0.1


class Levels(AbstractModel):
    """Two levels at rest: one is measured, the other acts on nothing."""

    drain: Array
    states, inputs, outputs = ("measured", "hidden"), (), ("z",)

    def rhs(self, t, x, u):
        return -self.drain * x

    def output(self, t, x, u):
        return x[:1]


LEVELS = Levels(jnp.array(0.0))
STARTS = tuple(f"initial_state.{name}" for name in Levels.states)


def predicted(prior, model=LEVELS, starts=STARTS):
    t = STEP * np.arange(20)
    z = 2.0 + SIGMA * np.random.default_rng(3).normal(size=(20, 1))
    stack = as_stack(record(t, np.zeros((20, 0)), z, inputs=(), outputs=("z",))).anonymous()
    likelihood = canonical(OutputError(FixedNoise(jnp.array([[SIGMA**2]]))))
    predictor = Predictor(likelihood, WINDOW, starts, 1, prior)
    return predictor.predict(canonical(model), stack), z


def test_start_is_weighted_with_its_prior():
    mean, deviation = np.array([1.0, 7.0]), np.array([0.2, 4.0])
    prediction, z = predicted(jnp.asarray(np.stack([mean, deviation])))
    weight, own = WINDOW / SIGMA**2, 1.0 / deviation[0] ** 2
    expected = (weight * np.mean(z[:WINDOW]) + own * mean[0]) / (weight + own)
    start = np.asarray(prediction.initial_state)[0]
    assert start == pytest.approx([expected, 7.0], rel=1e-6)


def test_start_without_prior_is_the_mean_of_the_window():
    prediction, z = predicted(None)
    start = np.asarray(prediction.initial_state)[0]
    assert start[0] == pytest.approx(np.mean(z[:WINDOW]), rel=1e-9)


def test_initial_state_has_all_states_if_some_are_fitted():
    prediction, z = predicted(None, starts=STARTS[:1])
    expected = [np.mean(z[:WINDOW]), 0.0]
    assert np.asarray(prediction.initial_state)[0] == pytest.approx(expected, rel=1e-9)


def test_initial_state_has_no_memory_of_an_effect():
    """The memory of a lag stands before the initial states, as between those of two effects."""
    model = Augmented(LEVELS, (SensorLag("z"),))
    prediction, z = predicted(None, model, ("lag of z.start", *STARTS))
    start = np.asarray(prediction.initial_state)
    assert start[0] == pytest.approx([np.mean(z[:WINDOW]), 0.0], rel=1e-9)
