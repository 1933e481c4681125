"""Bands of histories: they cover as they say, and are what the parameters' covariance makes of
them.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import stdtr
from scipy.stats import binom

from jaxid._foundation.checks import InputError
from jaxid.data import Record
from jaxid.diagnosis import prediction_bands
from jaxid.estimation import OutputError, estimate
from jaxid.models import AbstractModel, free
from jaxid.simulation import simulate

DRAWS, WIDTH, SIGMA, ROWS = 2000, 1.959963984540054, 0.2, 200
AT = np.array([0, 20, 90, 199])  # the initial state, a rise, the middle, the end


class Lag(AbstractModel):
    """x' = -p x + b u, seen with an offset: states, outputs and signals have bands of their own."""

    p: jax.Array
    b: jax.Array
    offset: jax.Array
    states, inputs, outputs = ("x",), ("u",), ("z",)

    def rhs(self, t, x, u):
        return -self.p * x + self.b * u

    def output(self, t, x, u):
        return x + self.offset

    def signals(self, t, x, u):
        return super().signals(t, x, u) | {"pull": -self.p * x[0]}


TRUTH = Lag(p=1.0, b=2.0, offset=0.3)
CHOSEN = free(TRUTH, "p", "b", "offset", per_record=("initial_state",))
T = 0.1 * jnp.arange(ROWS)
U = (jnp.sign(jnp.sin(0.7 * T)) + 0.5 * jnp.sign(jnp.sin(1.9 * T)))[:, None]


def made(z):
    return Record(T, U, z, jnp.ones(z.shape, bool), {}, ("u",), ("z",), ("",), ("",), ("",))


@pytest.fixture(scope="module")
def truth():
    return simulate(TRUTH, T, U, jnp.array([0.5]))


@pytest.fixture(scope="module")
def drawn(truth):
    """Deviation from the truth over the band, at `AT`, of the state, the output, a signal and a
    repeated measurement.
    """

    def one(e):
        record = made(truth.y + SIGMA * e[0])
        fit = estimate(TRUTH, CHOSEN, record, OutputError())
        found = prediction_bands(fit, record, OutputError(), ("pull",))
        x, y = truth.x[AT, 0], truth.y[AT, 0]
        pairs = (
            (found.states["x"], x),
            (found.outputs["z"], y),
            (found.signals["pull"], -x),
            (found.measured["z"], y + SIGMA * e[1, AT, 0]),
        )
        return jnp.stack(
            [(band.value[0, AT] - true) / band.deviation[0, AT] for band, true in pairs]
        )

    e = jax.random.normal(jax.random.key(65), (DRAWS, 2, ROWS, 1))
    return np.asarray(eqx.filter_jit(jax.vmap(one))(e))


def first_order(e, correlation):
    """Noise of unit variance with a correlation of neighbouring samples."""
    after = np.sqrt(1.0 - correlation**2)

    def step(v, e):
        v = correlation * v + after * e
        return v, v

    e = jnp.moveaxis(e, 2, 0)
    return jnp.moveaxis(jax.lax.scan(step, e[0], e)[1], 0, 2)


def test_bands_cover_the_truth_and_a_repeated_measurement(drawn):
    """2,000 draws; the bounds are those that a right 95 % band meets with 99.9 % probability at all
    16 places.
    """
    shares = np.mean(np.abs(drawn) < WIDTH, axis=0)
    tail = 0.0005 / shares.size
    low, high = (binom.ppf(q, DRAWS, 0.95) / DRAWS for q in (tail, 1 - tail))
    assert np.all((shares >= low) & (shares <= high)), shares


def test_corrected_bands_cover_the_truth_under_coloured_noise():
    """500 draws from a known start. The corrected variances are estimates themselves: the normal
    quantile covers as much as of Student's t with nu degrees of freedom. The bounds belong to the
    smallest and the largest nu of the parameters, at all places with 99.9 % probability.
    """
    y = simulate(TRUTH, T, U, jnp.zeros(1)).y
    e = first_order(jax.random.normal(jax.random.key(66), (500, 1, ROWS, 1)), 0.8)[:, 0]
    chosen = free(TRUTH, "p", "b", "offset")

    def one(e):
        record = made(y + SIGMA * e)
        fit = estimate(TRUTH, chosen, record, OutputError())
        bands = [
            prediction_bands(fit, record, OutputError(), coloured=yes).outputs["z"]
            for yes in (False, True)
        ]
        apart = [
            (band.value[0, AT[1:]] - y[AT[1:], 0]) / band.deviation[0, AT[1:]] for band in bands
        ]
        return jnp.stack(apart), fit.corrected_dof

    apart, dof = map(np.asarray, eqx.filter_jit(jax.vmap(one))(e))
    plain, corrected = np.mean(np.abs(apart) < WIDTH, axis=0)
    nu = np.median(dof, axis=0)
    expected = 2.0 * stdtr(np.array([nu.min(), nu.max()]), WIDTH) - 1.0
    tail = 0.0005 / corrected.size
    low, high = binom.ppf([tail, 1.0 - tail], 500, expected) / 500
    assert np.all((corrected >= low) & (corrected <= high)), corrected
    assert np.all(plain < 0.6)


def test_a_band_of_one_parameter_has_its_corrected_error(truth):
    e = first_order(jax.random.normal(jax.random.key(67), (1, 1, ROWS, 1)), 0.8)[0, 0]
    record = made(truth.y + SIGMA * e)
    fit = estimate(TRUTH, free(TRUTH, "offset"), record, OutputError())
    for coloured, error in ((False, fit.standard_errors), (True, fit.corrected_errors)):
        band = prediction_bands(fit, record, OutputError(), coloured=coloured).outputs["z"]
        np.testing.assert_allclose(band.deviation[0], error[0], rtol=1e-12)


def test_deviations_belong_together(truth):
    """The output is the state and an offset: their deviations differ by no more than the offset's,
    and by something.
    """
    record = made(truth.y + SIGMA * jax.random.normal(jax.random.key(1), truth.y.shape))
    fit = estimate(TRUTH, CHOSEN, record, OutputError())
    found = prediction_bands(fit, record, OutputError())
    difference = np.abs(found.outputs["z"].deviation - found.states["x"].deviation)
    assert np.all(difference <= fit.standard_error("offset"))
    assert np.max(difference) > 0.05 * fit.standard_error("offset")
    added = found.measured["z"].deviation ** 2 - found.outputs["z"].deviation ** 2
    np.testing.assert_allclose(added, float(fit.noise[0, 0]), rtol=1e-12)
    np.testing.assert_allclose(found.t[0], T)


def test_a_signal_that_does_not_exist_is_refused(truth):
    record = made(truth.y + SIGMA * jax.random.normal(jax.random.key(2), truth.y.shape))
    fit = estimate(TRUTH, CHOSEN, record, OutputError())
    with pytest.raises(InputError, match="push"):
        prediction_bands(fit, record, OutputError(), ("push",))
