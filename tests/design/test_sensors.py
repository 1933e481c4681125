"""Sets of sensors: against all subsets, at a static model with a closed form."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import AbstractModel, FixedNoise, FullNoise, OutputError, free
from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.design import Trace, combine, planned_record, sample_times, sensor_sets

T = sample_times(3.0, 0.1)
DEVIATIONS = np.array([0.1, 0.02, 0.3, 0.1])
NAMES = ("good", "best", "poor", "other")


class Beam(AbstractModel):
    """Two gains, seen by four sensors at different places."""

    a: Array
    b: Array
    states, inputs, outputs = (), ("load",), NAMES

    def rhs(self, t, x, u):
        return jnp.zeros(0)

    def output(self, t, x, u):
        a, b, s = self.a, self.b, u[0]
        return jnp.stack([a * s, a * s, a * s + b * s**2, b * s**2])


BEAM = Beam(jnp.array(1.0), jnp.array(0.5))
CHOSEN = free(BEAM, "a", "b")
NOISE = OutputError(FixedNoise(jnp.asarray(DEVIATIONS**2)))
MEASURE = Trace([1.0, 1.0])


@pytest.fixture(scope="module")
def record():
    return planned_record(BEAM, combine(T, {"load": jnp.sin(T)}, ("load",)), NOISE)


def closed_form(names):
    s = np.sin(np.asarray(T))
    columns = {
        "good": [s, 0 * s],
        "best": [s, 0 * s],
        "poor": [s, s**2],
        "other": [0 * s, s**2],
    }
    rows = [np.stack(columns[n], 1) / DEVIATIONS[NAMES.index(n)] for n in names]
    M = sum(r.T @ r for r in rows)
    return np.trace(np.linalg.inv(M)) if np.linalg.matrix_rank(M) == 2 else np.inf


def test_measures_equal_the_closed_form(record):
    for each in sensor_sets(BEAM, CHOSEN, record, NOISE, MEASURE):
        np.testing.assert_allclose(each.measure, closed_form(each.sensors), rtol=1e-9)


def test_sets_are_the_best_of_their_size(record):
    for each in sensor_sets(BEAM, CHOSEN, record, NOISE, MEASURE):
        subsets = itertools.combinations(NAMES, len(each.sensors))
        assert each.measure <= min(map(closed_form, subsets)) * (1 + 1e-9)


def test_cost_decides_between_sensors_of_similar_information(record):
    equal = sensor_sets(BEAM, CHOSEN, record, NOISE, MEASURE)
    assert [each.removed for each in equal[1:]] == ["good", "poor"]
    dear = sensor_sets(BEAM, CHOSEN, record, NOISE, MEASURE, costs={"best": 1e4})
    assert dear[1].removed == "best"
    np.testing.assert_allclose(dear[0].cost, 1e4 + 3.0)


def test_impossible_choices_are_refused(record):
    with pytest.raises(InputError, match="no output 'vane'"):
        sensor_sets(BEAM, CHOSEN, record, NOISE, MEASURE, costs={"vane": 1.0})
    with pytest.raises(InputError, match="must be positive"):
        sensor_sets(BEAM, CHOSEN, record, NOISE, MEASURE, costs={"best": 0.0})
    correlated = np.diag(DEVIATIONS**2)
    correlated[0, 1] = correlated[1, 0] = 1e-3
    with pytest.raises(InputError, match="correlated between sensors"):
        sensor_sets(BEAM, CHOSEN, record, OutputError(FixedNoise(correlated)), MEASURE)
    with pytest.raises(InputError, match="noise covariance is unknown"):
        sensor_sets(BEAM, CHOSEN, record, OutputError(FullNoise()), MEASURE)
