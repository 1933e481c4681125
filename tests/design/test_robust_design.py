"""Inputs for uncertain parameters: average and worst case over draws, and the envelope for each."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import SIGMA, Spring

from jaxid import FixedNoise, OutputError, free, simulate
from jaxid._foundation.checks import InputError
from jaxid.design import Limits, Trace, design_input, information_of, sample_times, spline

T = sample_times(8.0, 0.1)
NOISE = OutputError(FixedNoise(jnp.array([SIGMA**2]))).compact()
SPRING = Spring(jnp.array(3.0), jnp.array(0.15))
CHOSEN = free(SPRING, "k", "c")
DRAWS = np.array([[1.5, 0.15], [3.0, 0.15], [5.0, 0.15]])  # the frequency is uncertain by 35 %
MEASURE = Trace([1.0, 4.0])
LIMITS = Limits({"force": 1.0}, envelope={"x": (-0.5, 0.5)})


def design(**options):
    return design_input(SPRING, CHOSEN, T, spline(T, 9), MEASURE, LIMITS, NOISE, **options)


def costs(record):
    """Return the logarithm of the measure at each draw, from the record's input."""
    known = []
    for k, c in DRAWS:
        model = Spring(jnp.array(k), jnp.array(c))
        shown = information_of(model, CHOSEN, record, NOISE, initial_state=jnp.zeros(2))
        known.append(np.log(shown.measure(MEASURE)))
    return np.array(known)


@pytest.fixture(scope="module")
def average():
    return design(draws=DRAWS)


@pytest.fixture(scope="module")
def worst():
    return design(draws=DRAWS, worst=True)


def test_costs_are_average_and_largest_over_the_draws(average, worst):
    np.testing.assert_allclose(average.cost, np.mean(costs(average.record)), rtol=1e-8)
    np.testing.assert_allclose(worst.cost, np.max(costs(worst.record)), rtol=1e-8)


def test_each_design_is_best_by_its_own_measure(average, worst):
    """Up to the accuracy of the search, 0.05: 2.5 % of a standard error."""
    assert np.mean(costs(average.record)) < np.mean(costs(worst.record)) + 0.05
    assert np.max(costs(worst.record)) < np.max(costs(average.record)) + 0.05


def test_envelope_holds_for_each_draw(average):
    largest = []
    for k, c in DRAWS:
        model = Spring(jnp.array(k), jnp.array(c))
        x = simulate(model, T, average.record.u, jnp.zeros(2)).x[:, 0]
        largest.append(float(jnp.max(jnp.abs(x))))
    assert 0.45 < max(largest) <= 0.5 * (1 + 1e-4)


def test_draws_of_other_parameters_are_refused():
    with pytest.raises(InputError, match="one row per draw"):
        design(draws=np.ones((3, 4)))
    with pytest.raises(InputError, match="Give one of them"):
        design(draws=DRAWS, rival=(SPRING, CHOSEN))
