"""Filter error with coloured noise of a sensor: the dense Gaussian, output error, and words."""

import dense_gaussian as dense
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from oscillator import OSCILLATOR
from scipy.signal import lfilter

import jaxid
from jaxid import AutoregressiveNoise, FilterError, FirstOrder, Fixed, InputError, OutputError
from jaxid.data import record
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.problem import Problem
from jaxid.models import LinearModel, free
from jaxid.models.base import canonical
from jaxid.models.free import Parameters

C = np.array([[1.0, 0.0, 0.0, 0.0], [0.3, 1.0, 1.0, 1.0]])  # with two parts of the noise of b
NOISE = {"a": 0.05, "b": (0.08, FirstOrder(0.2, 0.8), FirstOrder(0.1, 2.0))}
NAMES = (
    *("A[1,0]", "sensor.a", "sensor.b", "process.noise_b_1", "process.noise_b_2", "process.v"),
    *("correlation_time.noise_b_1", "correlation_time.noise_b_2"),
)
THETA = np.array([-2.1, 0.05, 0.08, 0.2, 0.1, 0.3, 0.8, 2.0])


def data(count=24):
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.03, 0.09, count))
    z = np.stack([0.1 * np.cos(1.4 * t), -0.2 * np.sin(1.5 * t)], 1)
    z += 0.1 * rng.normal(size=z.shape)
    z[rng.uniform(size=z.shape) < 0.3] = np.nan
    return t, np.sin(3.0 * t)[:, None], z


def test_likelihood_gradient_and_information_equal_joint_gaussian():
    t, u, z = data()
    likelihood = FilterError({"v": 0.3}, NOISE)
    records = as_stack(record(t, u, z, inputs=("f",), outputs=("a", "b")))
    model, chosen = likelihood.prepared(
        canonical(OSCILLATOR), canonical(free(OSCILLATOR, "A[1,0]")), records
    )
    assert sorted(chosen.shared) == sorted(NAMES)
    at = [NAMES.index(name) for name in chosen.shared]
    problem = Problem.of(model, chosen, records, likelihood)

    def reference(theta):
        a10, ra, rb, s1, s2, qv, T1, T2 = theta[np.argsort(at)]
        A = np.diag([0.0, -0.4, -1 / T1, -1 / T2]).astype(complex)
        A[0, 1], A[1, 0] = 1.0, a10
        GG = np.diag([0.0, qv**2, 2 * s1**2 / T1, 2 * s2**2 / T2])
        steps = dense.discrete(A, np.array([[0.0], [1.0], [0.0], [0.0]]), GG, t, u)
        start = np.diag([0.0, 0.0, s1**2, s2**2])
        mean, covariance = dense.joint(steps, np.zeros(4), start)
        residual, sigma, _ = dense.measured(mean, covariance, C, np.array([ra, rb]), z)
        return dense.innovations(residual, sigma, z)

    theta = THETA[at]
    expected = dense.likelihood(reference, theta)
    parameters = Parameters(jnp.asarray(theta), jnp.zeros((1, 0)))
    cost, linearised = eqx.filter_jit(Problem.evaluate)(problem, parameters)
    np.testing.assert_allclose(cost, expected[0], rtol=1e-9)
    scale = np.sqrt(np.diag(expected[2]))
    gradient, _ = linearised.information.gradient()
    np.testing.assert_allclose(gradient / scale, expected[1] / scale, atol=1e-8)
    M = linearised.information.triangle.T @ linearised.information.triangle
    np.testing.assert_allclose(
        M / np.outer(scale, scale), expected[2] / np.outer(scale, scale), atol=1e-9
    )


def test_without_process_noise_it_equals_output_error_with_autoregressive_noise():
    """A first-order noise sampled uniformly is an autoregression, `a = exp(-h/T)`."""
    rng, h, a, count = np.random.default_rng(11), 0.05, 0.8, 600
    t = h * np.arange(count)
    u = np.sign(np.sin(1.3 * t))
    clean = np.asarray(jaxid.simulate(OSCILLATOR, t, u[:, None], np.zeros(2)).y)[:, :1]
    e = lfilter([np.sqrt(1 - a**2)], [1.0, -a], rng.normal(size=count + 200))[200:]
    single = LinearModel(
        *(OSCILLATOR.A, OSCILLATOR.B, [[1.0, 0.0]], [[0.0]]),
        states=("x", "v"),
        inputs=("f",),
        outputs=("a",),
    )
    records = record(t, u, clean + 0.05 * e[:, None], inputs=("f",), outputs=("a",))
    chosen = free(single, "A[1,0]", "A[1,1]", "B[1,0]")
    noise = {"a": (Fixed(1e-6), FirstOrder(0.05, 0.2))}
    fit = jaxid.estimate(single, chosen, records, FilterError(noise=noise))
    other = jaxid.estimate(single, chosen, records, OutputError(AutoregressiveNoise(1)))
    assert bool(fit.successful), fit.status
    shift = (fit.values[:3] - other.values) / other.standard_errors
    np.testing.assert_allclose(shift, 0.0, atol=1e-3)
    np.testing.assert_allclose(fit.standard_errors[:3], other.standard_errors, rtol=1e-3)
    T, s = fit.value("correlation_time.noise_a"), fit.value("process.noise_a")
    coefficient = np.exp(-h / float(T))
    innovation = float(s) ** 2 * (1.0 - coefficient**2)
    np.testing.assert_allclose(innovation, float(other.noise[0, 0]), rtol=1e-3)
    smoothed, deviation = jaxid.smooth_states(fit, records, FilterError(noise=noise)).signal(
        "noise_a"
    )
    np.testing.assert_allclose(smoothed[0], records.z[:, 0] - fit_output(fit, t, u), atol=1e-4)
    assert float(deviation.max()) < 1e-5


def fit_output(fit, t, u):
    model = fit.model.model
    return np.asarray(jaxid.simulate(model, t, u[:, None], np.zeros(2)).y)[:, 0]


def test_faulty_noises_are_refused():
    with pytest.raises(InputError, match="sensor 'a' has 2 white parts"):
        FilterError(noise={"a": (0.1, 0.2)})
    for value in ("large", np.array([0.1, 0.2])):
        with pytest.raises(InputError, match="Give one number"):
            FilterError(noise={"a": value})
    with pytest.raises(InputError, match="sensor 'a' has no parts"):
        FilterError(noise={"a": ()})
    with pytest.raises(InputError, match="correlation time of the noise of sensor 'a' is -1"):
        FilterError(noise={"a": FirstOrder(0.1, -1.0)})
    t, u, z = data()
    records = record(t, u, z, inputs=("f",), outputs=("a", "b"))
    with pytest.raises(InputError, match="output \\(in `noise`\\)"):
        jaxid.estimate(
            OSCILLATOR,
            free(OSCILLATOR, "A[1,0]"),
            records,
            FilterError(noise={"c": FirstOrder(0.1, 1.0)}),
        )
