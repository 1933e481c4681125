"""Functions of an estimated model: derivatives against NumPy, coverage, draws, curves."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import binom

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.data import Record, record
from jaxid.models import LinearModel
from jaxid.uncertainty import combine_curves, curve, propagate

DRAWS, ROWS, SIGMA = 2000, 48, 0.2
A = np.array([[-0.6, 1.0], [-4.0, -0.9]])
CHANNELS = {"states": ("alpha", "q"), "inputs": ("elevator",), "outputs": ("alpha", "q")}


def mode(model):
    frequency = jnp.sqrt(jnp.linalg.det(model.A))
    return {"damping": -jnp.trace(model.A) / (2 * frequency), "frequency": frequency}


@pytest.fixture(scope="module")
def short_period():
    """The estimate of a short period: two records, free initial states."""
    model = LinearModel(A, [[0.0], [-3.0]], np.eye(2), np.zeros((2, 1)), **CHANNELS)
    rng, records = np.random.default_rng(1974), []
    for start in ([0.1, 0.0], [-0.05, 0.1]):
        t = 0.05 * np.arange(120)
        u = 0.1 * (((t > 0.5) & (t < 1.5)) * 1.0 - ((t >= 1.5) & (t < 2.5)))
        y = jaxid.simulate(model, t, u[:, None], jnp.array(start)).y
        z = np.asarray(y) + [0.002, 0.005] * rng.normal(size=y.shape)
        records.append(record(t, u, z, inputs=("elevator",), outputs=("alpha", "q")))
    names = ("A[0,0]", "A[1,0]", "A[1,1]", "B[1,0]")
    chosen = jaxid.free(model, *names, per_record=("initial_state",))
    return jaxid.estimate(model, chosen, records, jaxid.OutputError())


def test_error_of_mode_equals_derivative_in_numpy(short_period):
    """The natural frequency is `sqrt(det A)`: its gradient by hand."""
    result = propagate(short_period, mode)
    a = np.asarray(short_period.model.A)
    det, trace = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0], a[0, 0] + a[1, 1]
    frequency = np.sqrt(det)
    of_det = np.array([a[1, 1], -a[0, 1], a[0, 0], 0.0])
    of_frequency = of_det / (2 * frequency)
    of_damping = -np.array([1.0, 0.0, 1.0, 0.0]) / (2 * frequency)
    of_damping = of_damping + trace / (2 * det) * of_frequency
    J = np.stack([of_damping, of_frequency])
    expected = J @ np.asarray(short_period.covariance) @ J.T
    np.testing.assert_allclose(result.covariance, expected, rtol=1e-9)
    np.testing.assert_allclose(
        result.standard_errors["frequency"], np.sqrt(expected[1, 1]), rtol=1e-9
    )
    assert result.names == ("damping", "frequency")
    assert "frequency" in str(result)


def test_draws_of_mode_agree_with_derivative(short_period):
    """20,000 draws give a standard deviation to 0.5 % (one sigma)."""
    result = jaxid.propagate(short_period, mode, draws=20_000, key=jax.random.key(1))
    assert result.draws is not None
    for name in ("frequency", "damping"):
        np.testing.assert_allclose(
            np.std(result.draws[name]), result.standard_errors[name], rtol=0.025
        )
        ends = propagate(short_period, mode).interval()[name]
        width = float(ends[1] - ends[0])
        np.testing.assert_allclose(result.interval()[name], ends, atol=0.05 * width)


def ratio(model):
    return model.D[0, 0] / model.D[0, 2] + model.D[0, 1] ** 2


@pytest.fixture(scope="module")
def static():
    """`y = D u` with three parameters, and the inputs of 48 samples."""
    names = ("a", "b", "c")
    model = LinearModel(
        [[-1.0]], [[0.0] * 3], [[0.0]], [[0.0] * 3], states=("x",), inputs=names, outputs=("y",)
    )
    u = np.random.default_rng(7).normal(size=(ROWS, 3))

    def estimated(z, u, model=model):
        t, units = jnp.arange(ROWS * 1.0), ("",) * 3
        mask = jnp.ones((ROWS, 1), bool)
        data = Record(t, u, z[:, None], mask, {}, names, ("y",), units, ("",), ("",))
        noise = jaxid.FixedNoise([SIGMA**2])
        return jaxid.estimate(model, jaxid.free(model, "D"), data, jaxid.OutputError(noise))

    return estimated, u


def test_interval_of_function_covers_nominal_share(static):
    """2,000 records under `vmap`; the band holds a right share with 99.9 %."""
    estimated, u = static
    truth = np.array([1.0, -2.0, 0.5])
    z = jnp.asarray(u @ truth)[None] + SIGMA * jax.random.normal(
        jax.random.key(1974), (DRAWS, ROWS)
    )
    run = eqx.filter_jit(
        eqx.filter_vmap(lambda z: propagate(estimated(z, jnp.asarray(u)), ratio).interval())
    )
    ends = np.asarray(run(z))
    expected = truth[0] / truth[2] + truth[1] ** 2
    covered = np.mean((ends[:, 0] <= expected) & (expected <= ends[:, 1]))
    low, high = binom.ppf([0.0005, 0.9995], DRAWS, 0.95) / DRAWS
    assert low <= covered <= high, covered


def test_sum_is_determined_where_terms_are_not(static):
    """Two equal inputs: only the sum of their coefficients has information."""
    estimated, u = static
    equal = u[:, [0, 0, 2]]
    fit = estimated(jnp.asarray(equal @ [1.0, 2.0, 0.5]), jnp.asarray(equal))
    result = propagate(fit, lambda model: {"both": model.D[0, 0] + model.D[0, 1], "D": model.D[0]})
    errors = np.append(result.standard_errors["both"], result.standard_errors["D"])
    assert np.isinf(errors[1:3]).all()
    gram = np.linalg.inv(equal[:, 1:].T @ equal[:, 1:])
    np.testing.assert_allclose(errors[[0, 3]], SIGMA * np.sqrt(np.diagonal(gram)), rtol=1e-9)


def test_curve_of_polynomial_and_weighted_mean_equal_closed_form(static):
    """Eq. 4.15 with inverse variances, each curve where it is valid."""
    estimated, u = static
    rng, points = np.random.default_rng(3), np.linspace(-1.0, 1.0, 9)
    powers = np.stack([np.ones(9), points, points**2], axis=-1)

    def polynomial(model, alpha):
        return model.D[0] @ jnp.stack([jnp.ones(()), alpha, alpha**2])

    curves, fits = [], []
    for scale, within in ((1.0, (-1.0, 0.5)), (2.0, (-0.5, 1.0))):
        inputs = scale * u
        z = inputs @ [1.0, -2.0, 0.5] + SIGMA * rng.normal(size=ROWS)
        fits.append(estimated(jnp.asarray(z), jnp.asarray(inputs)))
        curves.append(curve(fits[-1], polynomial, points, within=within))
    variances = [
        np.einsum("kp,pq,kq->k", powers, np.asarray(fit.covariance), powers) for fit in fits
    ]
    for one, fit, variance in zip(curves, fits, variances, strict=True):
        np.testing.assert_allclose(one.value, powers @ np.asarray(fit.values), rtol=1e-9)
        np.testing.assert_allclose(one.standard_errors, np.sqrt(variance), rtol=1e-9)
    mean = combine_curves(curves)
    inside = np.stack([points <= 0.5, points >= -0.5])
    w = inside / np.stack(variances)
    values = np.stack([np.asarray(one.value) for one in curves])
    np.testing.assert_allclose(mean.value, np.sum(w * values, axis=0) / np.sum(w, axis=0))
    np.testing.assert_allclose(mean.standard_errors, np.sum(w, axis=0) ** -0.5)
    np.testing.assert_allclose(mean.band(2.0)[:, 1] - mean.value, 2 * mean.standard_errors)
    alone = combine_curves([curves[0]])
    assert np.isnan(alone.value[-1])
    assert not bool(alone.valid[-1])


def test_faulty_calls_are_refused(short_period):
    with pytest.raises(InputError, match="random key"):
        propagate(short_period, mode, draws=10)
    with pytest.raises(InputError, match="no record 2 among 2"):
        propagate(short_period, mode, case=2)
    with pytest.raises(InputError, match="must return one number"):
        curve(short_period, lambda model, alpha: alpha * model.A[0], np.zeros(3))
