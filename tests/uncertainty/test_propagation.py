"""Functions of an estimated model and errors of fixed constants: against closed forms and refits,
and their coverage.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom
from static_line import Line

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.data import record
from jaxid.models import LinearModel
from jaxid.uncertainty import combine_curves, consider, curve, propagate

DRAWS, ROWS, SIGMA, WIDTH = 2000, 48, 0.2, 1.959963984540054
NOISE = np.array([0.002, 0.005])
KNOWN = jaxid.OutputError(jaxid.FixedNoise(NOISE**2))
KNOWN_SIGMA = jaxid.FixedNoise([SIGMA**2])
A = np.array([[-0.6, 1.0], [-4.0, -0.9]])
CHANNELS = {"states": ("alpha", "q"), "inputs": ("elevator",), "outputs": ("alpha", "q")}


def mode(model):
    frequency = jnp.sqrt(jnp.linalg.det(model.A))
    return {"damping": -jnp.trace(model.A) / (2 * frequency), "frequency": frequency}


def linear_model(upper_right=1.0):
    matrix = np.add(A, [[0.0, upper_right - 1.0], [0.0, 0.0]])
    return LinearModel(matrix, [[0.0], [-3.0]], np.eye(2), np.zeros((2, 1)), **CHANNELS)


def manoeuvres(noise=1.0):
    """Two records of a short period."""
    rng, records = np.random.default_rng(1974), []
    for start in ([0.1, 0.0], [-0.05, 0.1]):
        t = 0.05 * np.arange(120)
        u = 0.1 * (((t > 0.5) & (t < 1.5)) * 1.0 - ((t >= 1.5) & (t < 2.5)))
        y = jaxid.simulate(linear_model(), t, u[:, None], jnp.array(start)).y
        z = np.asarray(y) + noise * NOISE * rng.normal(size=y.shape)
        records.append(record(t, u, z, inputs=("elevator",), outputs=("alpha", "q")))
    return records


def short_period_of(records, upper_right=1.0):
    """The estimate of a short period with free initial states."""
    model = linear_model(upper_right)
    names = ("A[0,0]", "A[1,0]", "A[1,1]", "B[1,0]")
    chosen = jaxid.free(model, *names, per_record=("initial_state",))
    return jaxid.estimate(model, chosen, records, KNOWN)


@pytest.fixture(scope="module")
def short_period():
    return short_period_of(manoeuvres())


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


def regression(fixed=0.0):
    """`y = D u` of which the last coefficient is fixed: a function that estimates the others."""
    names = ("a", "b", "c", "fixed")
    D = [[0.0, 0.0, 0.0, fixed]]
    model = LinearModel(
        [[-1.0]], [[0.0] * 4], [[0.0]], D, states=("x",), inputs=names, outputs=("y",)
    )
    likelihood = jaxid.OutputError(KNOWN_SIGMA)

    def estimated(z, u):
        data = record(np.arange(ROWS * 1.0), u, z, inputs=names, outputs=("y",))
        chosen = jaxid.free(model, "D[0,0]", "D[0,1]", "D[0,2]")
        return jaxid.estimate(model, chosen, data, likelihood), data, likelihood

    return estimated


def inputs(last=0.0):
    u = np.random.default_rng(7).normal(size=(ROWS, 4))
    u[:, 3] = last * (u[:, 3] + 0.7 * u[:, 0])
    return u


def band():
    """Shares that a right 95 % interval meets with 99.9 % probability."""
    return binom.ppf([0.0005, 0.9995], DRAWS, 0.95) / DRAWS


def test_interval_of_function_covers_nominal_share():
    """2,000 estimates: of a linear model they are least squares, and their covariance is one."""
    u, truth = inputs(), np.array([1.0, -2.0, 0.5])
    free, rng = u[:, :3], np.random.default_rng(1974)
    z = (free @ truth)[:, None] + SIGMA * rng.normal(size=(ROWS, DRAWS))
    values = np.linalg.solve(free.T @ free, free.T @ z).T
    fit, _, _ = regression()(z[:, 0], u)
    np.testing.assert_allclose(fit.values, values[0], rtol=1e-8)

    def ends_of(values):
        return propagate(eqx.tree_at(lambda e: e.values, fit, values), ratio).interval()

    ends = np.asarray(jax.jit(jax.vmap(ends_of))(jnp.asarray(values)))
    expected = truth[0] / truth[2] + truth[1] ** 2
    covered = np.mean((ends[:, 0] <= expected) & (expected <= ends[:, 1]))
    low, high = band()
    assert low <= covered <= high, covered


def test_covariance_widened_by_constant_equals_closed_form_and_covers():
    """2,000 draws in NumPy, each with its own true constant and noise."""
    u, deviation = inputs(last=1.0), 0.1
    truth, rng = np.array([1.0, -2.0, 0.5, 0.8]), np.random.default_rng(1974)
    estimated = regression(fixed=truth[3])
    fit, data, likelihood = estimated(u @ truth + SIGMA * rng.normal(size=ROWS), u)
    result = consider(fit, data, likelihood, {"D[0,3]": deviation})
    free, fixed = u[:, :3], u[:, 3]
    inverse = np.linalg.inv(free.T @ free)
    K = -inverse @ free.T @ fixed
    P = SIGMA**2 * inverse + deviation**2 * np.outer(K, K)
    np.testing.assert_allclose(result.gain[:, 0], K, rtol=1e-9)
    np.testing.assert_allclose(result.covariance, P, rtol=1e-9)
    error = deviation * rng.normal(size=DRAWS)
    noise = SIGMA * rng.normal(size=(ROWS, DRAWS))
    errors = inverse @ free.T @ (fixed[:, None] * error + noise)
    low, high = band()

    def covered(deviation):
        return np.mean(np.abs(errors) < WIDTH * np.asarray(deviation)[:, None], axis=1)

    together = covered(result.standard_errors)
    assert (low <= together).all(), together
    assert (together <= high).all(), together
    assert covered(fit.standard_errors)[0] < 0.75  # without the constant
    # A function of parameter and constant: their errors are correlated.
    total = propagate(fit, lambda model: model.D[0, 0] + model.D[0, 3], considered=result)
    variance = SIGMA**2 * inverse[0, 0] + (deviation * (K[0] + 1)) ** 2
    np.testing.assert_allclose(total.standard_errors, np.sqrt(variance), rtol=1e-9)
    assert "by D[0,3]" in str(result)
    with pytest.raises(InputError, match="is free"):
        consider(fit, data, likelihood, {"D[0,0]": 0.1})
    with pytest.raises(InputError, match="must be positive"):
        consider(fit, data, likelihood, {"D[0,3]": 0.0})
    with pytest.raises(InputError, match="no fixed constant 'mass'"):
        consider(fit, data, likelihood, {"mass": 1.0})


def test_gain_of_constant_equals_difference_of_refits():
    """Without noise; the initial states of both records are free. Step 1e-4: the difference is
    right to 1e-7 of the curvature.
    """
    step, records = 1e-4, manoeuvres(noise=1e-6)
    fit = short_period_of(records)
    result = consider(fit, records, KNOWN, {"A[0,1]": 0.05})
    high, low = (short_period_of(records, 1.0 + change) for change in (step, -step))
    by_refit = np.asarray(high.values - low.values) / (2 * step)
    np.testing.assert_allclose(result.gain[:, 0], by_refit, rtol=1e-4, atol=1e-5)
    own = fit.information.own
    reaction = -np.asarray(own.inverse) @ np.asarray(own.coupling)
    total = np.asarray(result.own_gain[..., 0]) + reaction @ np.asarray(result.gain[:, 0])
    by_refit = np.asarray(high.own - low.own) / (2 * step)
    np.testing.assert_allclose(total, by_refit, rtol=1e-4, atol=1e-5)


def test_sum_is_determined_where_terms_are_not():
    """Two equal inputs: only the sum of their coefficients has information."""
    u = inputs()
    u[:, 1] = u[:, 0]
    fit, _, _ = regression()(u @ [1.0, 2.0, 0.5, 0.0], u)
    result = propagate(fit, lambda model: {"both": model.D[0, 0] + model.D[0, 1], "D": model.D[0]})
    errors = np.append(result.standard_errors["both"], result.standard_errors["D"])
    assert np.isinf(errors[1:3]).all()
    gram = np.linalg.inv(u[:, 1:3].T @ u[:, 1:3])
    np.testing.assert_allclose(errors[[0, 3]], SIGMA * np.sqrt(np.diagonal(gram)), rtol=1e-9)
    assert errors[4] == 0.0  # the fixed coefficient


def line_of_each_record(levels, rho=0.0, **options):
    """Estimate of a slope in common and a level of each record; noise AR(1) with `rho`."""
    rng, records = np.random.default_rng(5), []
    for level in levels:
        u = 1.0 + np.sin(0.3 * np.arange(ROWS))
        e = lfilter([np.sqrt(1 - rho**2)], [1.0, -rho], rng.normal(size=ROWS + 100))[100:]
        z = 2.0 * u + level + SIGMA * e
        records.append(record(0.1 * np.arange(ROWS), u, z, inputs=("u",), outputs=("y",)))
    model, known = Line(jnp.array(1.0), jnp.array(0.5)), jaxid.OutputError(KNOWN_SIGMA)
    chosen = jaxid.free(model, "slope", per_record=("level",), **options)
    return jaxid.estimate(model, chosen, records, known)


def line(model):
    return {"both": model.slope + model.level, "level": model.level, "slope": model.slope}


def test_coloured_errors_of_record_equal_corrected_covariances():
    """Of its own level, of the slope, and of their sum."""
    fit = line_of_each_record([1.0, 2.0, 3.0], rho=0.8)
    assert (fit.corrected_own_errors > 1.5 * fit.own_errors).all()
    for case in range(3):
        level, cross = np.asarray(fit.corrected_own[case, 0])
        slope = float(fit.corrected_errors[0]) ** 2
        result = propagate(fit, line, case=case, coloured=True)
        expected = {"both": slope + 2 * cross + level, "level": level, "slope": slope}
        for name, variance in expected.items():
            np.testing.assert_allclose(result.standard_errors[name], np.sqrt(variance), rtol=1e-9)


def test_own_parameter_on_its_bound_is_held():
    """The level of record 0 is below its bound; the sum has the error of the slope alone."""
    fit = line_of_each_record([-1.0, 2.0, 3.0], bounds={"level": (0.0, None)})
    assert np.isnan(fit.own_errors[0, 0])
    result = propagate(fit, line, case=0)
    np.testing.assert_allclose(result.standard_errors["both"], fit.standard_errors[0], rtol=1e-9)
    assert float(result.standard_errors["level"]) == 0.0


def test_curve_of_polynomial_and_weighted_mean_equal_closed_form():
    """Eq. 4.15 with inverse variances, each curve where it is valid."""
    estimated, u = regression(), inputs()
    rng, points = np.random.default_rng(3), np.linspace(-1.0, 1.0, 9)
    powers = np.stack([np.ones(9), points, points**2], axis=-1)

    def polynomial(model, alpha):
        return model.D[0, :3] @ jnp.stack([jnp.ones(()), alpha, alpha**2])

    curves, fits = [], []
    for scale, within in ((1.0, (-1.0, 0.5)), (2.0, (-0.5, 1.0))):
        z = scale * u @ [1.0, -2.0, 0.5, 0.0] + SIGMA * rng.normal(size=ROWS)
        fits.append(estimated(z, scale * u)[0])
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


def test_value_without_error_is_combined():
    """`a alpha` is zero at `alpha = 0` whatever a is; elsewhere its error counts."""
    fits = [regression()(inputs() @ [scale, -2.0, 0.5, 0.0], inputs())[0] for scale in (1.0, 1.1)]
    points = np.array([0.0, 1.0])
    curves = [curve(fit, lambda model, alpha: model.D[0, 0] * alpha, points) for fit in fits]
    mean = combine_curves(curves)
    np.testing.assert_allclose(mean.value, [0.0, 1.05], atol=1e-8)
    error = float(fits[0].standard_errors[0]) / np.sqrt(2.0)
    np.testing.assert_allclose(mean.standard_errors, [0.0, error], rtol=1e-9)
    assert bool(mean.valid.all())
    # A curve without errors, as of a coefficient on its bound, does not outweigh the others.
    held = eqx.tree_at(lambda one: one.standard_errors, curves[1], jnp.zeros(2))
    mean = combine_curves([curves[0], held])
    np.testing.assert_array_equal(mean.value, curves[0].value)
    np.testing.assert_array_equal(mean.standard_errors, curves[0].standard_errors)


def test_faulty_calls_are_refused(short_period):
    with pytest.raises(InputError, match="random key"):
        propagate(short_period, mode, draws=10)
    with pytest.raises(InputError, match="no record 2 among 2"):
        propagate(short_period, mode, case=2)
    with pytest.raises(InputError, match="must return one number"):
        curve(short_period, lambda model, alpha: alpha * model.A[0], np.zeros(3))
