"""`InnovationForm`: limits, an independent recursion, the Riccati equation's gain, coverage."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import linalg, optimize
from scipy.stats import binom

from jaxid import InputError
from jaxid.data import record
from jaxid.diagnosis import predict
from jaxid.estimation import FilterError, InnovationForm, OutputError, estimate
from jaxid.models import DiagonalNoise, FullNoise, LinearModel, free

STEP, SAMPLES, MANY = 0.1, 400, 1200
A, B = np.array([[0.0, 1.0], [-2.0, -0.4]]), np.array([[0.0], [1.5]])
FORCE, SENSOR = 0.4, 0.05  # random force per sqrt(s), noise of x
T = STEP * np.arange(MANY)
U = (np.sign(np.sin(0.7 * T)) + 0.5 * np.sign(np.sin(1.9 * T)))[:, None]


def transition():
    """Matrices of a step under a straight line of the input, and the covariance of its noise."""
    wide = np.zeros((4, 4))
    wide[:2, :2], wide[:2, 2:3], wide[2, 3] = A, B, 1.0
    Phi = linalg.expm(STEP * wide)
    power = np.diag([0.0, FORCE**2])
    van_loan = linalg.expm(STEP * np.block([[-A, power], [np.zeros((2, 2)), A.T]]))
    return Phi[:2, :2], Phi[:2, 2], Phi[:2, 3], van_loan[2:, 2:].T @ van_loan[:2, 2:]


def flights(draws, seed, samples=SAMPLES):
    """Measured positions of many flights from rest."""
    F, held, sloped, Q = transition()
    rng, L = np.random.default_rng(seed), np.linalg.cholesky(Q)
    x, z = np.zeros((draws, 2)), np.zeros((draws, samples, 1))
    slope = np.append(np.diff(U[:, 0]) / STEP, 0.0)
    for i in range(samples):
        z[:, i] = x[:, :1] + SENSOR * rng.normal(size=(draws, 1))
        x = x @ F.T + held * U[i, 0] + sloped * slope[i] + rng.normal(size=(draws, 2)) @ L.T
    return z


def model_at(stiffness=2.0, damping=0.4, force=1.5):
    return LinearModel(
        A=np.array([[0.0, 1.0], [-stiffness, -damping]]),
        B=np.array([[0.0], [force]]),
        C=np.array([[1.0, 0.0]]),
        D=np.zeros((1, 1)),
        states=("x", "v"),
        inputs=("u",),
        outputs=("x",),
    )


FREE = free(model_at(), "A[1,0]", "A[1,1]", "B[1,0]")


def as_record(z):
    return record(T[: len(z)], U[: len(z)], z, inputs=("u",), outputs=("x",))


@pytest.fixture(scope="module")
def measured():
    return flights(1, 1974)[0]


@pytest.fixture(scope="module")
def fit(measured):
    return estimate(model_at(1.5, 0.6, 1.0), FREE, as_record(measured), InnovationForm())


def steady_gain():
    F, _, _, Q = transition()
    C = np.array([[1.0, 0.0]])
    P = linalg.solve_discrete_are(F.T, C.T, Q, [[SENSOR**2]])
    return (P @ C.T / (C @ P @ C.T + SENSOR**2))[:, 0]


def test_gain_is_that_of_riccati_equation(fit):
    truth = np.concatenate([[-2.0, -0.4, 1.5], steady_gain()])
    assert fit.names == ("A[1,0]", "A[1,1]", "B[1,0]", "gain.x.x", "gain.v.x")
    assert bool(fit.successful)
    distance = (np.asarray(fit.values) - truth) / np.asarray(fit.standard_errors)
    # 3.9 standard errors: 99.99 % for each of five normal estimates
    assert (np.abs(distance) < 3.9).all(), distance


def test_estimate_equals_recursion_in_numpy_fitted_by_scipy(fit, measured):
    def innovations(theta):
        stiffness, damping, force, *gain = theta
        h = STEP * np.array([[0.0, 1.0, 0.0, 0.0], [stiffness, damping, force, 0.0]])
        wide = np.vstack([h, [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]]])
        # Runge-Kutta's step of a linear equation: four terms of the exponential
        step = sum(np.linalg.matrix_power(wide, k) / np.prod(range(1, k + 1)) for k in range(5))
        x, v = np.array([measured[0, 0], 0.0]), np.zeros(SAMPLES)
        for i in range(SAMPLES):
            v[i] = measured[i, 0] - x[0]
            rise = U[i + 1, 0] - U[i, 0]
            x = (step @ np.concatenate([x + np.array(gain) * v[i], [U[i, 0], rise]]))[:2]
        return v

    end = optimize.least_squares(innovations, [-1.5, -0.6, 1.0, 0.0, 0.0], xtol=1e-14, ftol=1e-14)
    np.testing.assert_allclose(fit.values, end.x, rtol=1e-5)
    variance = np.mean(end.fun**2)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(end.jac.T @ end.jac)))
    np.testing.assert_allclose(fit.standard_errors, errors, rtol=1e-4)
    np.testing.assert_allclose(fit.noise, [[variance]], rtol=1e-8)


def test_without_gain_it_is_output_error(measured):
    records, start = as_record(measured), model_at(1.5, 0.6, 1.0)
    none = estimate(start, FREE, records, InnovationForm({"x": ()}))
    output_error = estimate(start, FREE, records, OutputError(noise=FullNoise()))
    np.testing.assert_allclose(none.values, output_error.values, rtol=1e-6)
    np.testing.assert_allclose(none.cost, output_error.cost, rtol=1e-10)


def test_intervals_hold_the_truth():
    """300 flights in one program; the band holds for the three coefficients in 99.9 % of campaigns.

    The intervals of the gain are not claimed: on such records they are too narrow.
    """
    draws, one = 300, as_record(np.zeros((MANY, 1)))

    @eqx.filter_jit
    def many(z):
        def fit(z):
            measured = eqx.tree_at(lambda record: record.z, one, z)
            return estimate(model_at(), FREE, measured, InnovationForm())

        return eqx.filter_vmap(fit)(z)

    batch = many(jnp.asarray(flights(draws, 7, MANY)))
    assert np.all(batch.successful)
    distance = np.asarray(batch.values)[:, :3] - np.array([-2.0, -0.4, 1.5])
    inside = np.abs(distance) <= 1.959964 * np.asarray(batch.standard_errors)[:, :3]
    low, high = binom.ppf([0.001 / 6, 1 - 0.001 / 6], draws, 0.95)
    counts = np.sum(inside, axis=0)
    assert (low <= counts).all(), counts
    assert (counts <= high).all(), counts


def test_missing_samples_leave_the_state_alone(measured):
    """A missing sample has no residual, and corrects nothing."""
    z = measured.copy()
    z[50:60] = np.nan
    likelihood = InnovationForm({"v": {"x": 0.5}}, DiagonalNoise())
    fit = estimate(model_at(), FREE, as_record(z), likelihood)
    assert bool(fit.successful)
    assert not np.any(np.asarray(fit.residuals)[0, 50:60])
    assert fit.names[-1] == "gain.v.x"


@pytest.mark.parametrize(
    ("gains", "words"),
    [({"y": ("x",)}, r"'y'.*state \(in `gains`\)|state \(in `gains`\).*'y'"), ({"x": ("q",)}, "q")],
)
def test_unknown_names_are_refused(measured, gains, words):
    with pytest.raises(InputError, match=words):
        estimate(model_at(), FREE, as_record(measured), InnovationForm(gains))


def test_uneven_times_are_refused(measured):
    t = T[:SAMPLES] + 0.01 * np.sin(T[:SAMPLES])
    uneven = record(t, U[:SAMPLES], measured, inputs=("u",), outputs=("x",))
    with pytest.raises(InputError, match=r"uneven.*FilterError"):
        estimate(model_at(), FREE, uneven, InnovationForm())
    slow = record(2.0 * T[:SAMPLES], U[:SAMPLES], measured, inputs=("u",), outputs=("x",))
    with pytest.raises(InputError, match=r"steps of 0\.1 to 0\.2 s.*FilterError"):
        estimate(model_at(), FREE, [as_record(measured), slow], InnovationForm())


def test_model_without_noises_is_predicted_by_those_of_the_likelihood(measured):
    """In steady state the filter has the gain of Riccati's equation; without one it simulates."""
    given = dict(zip(("x", "v"), ({"x": gain} for gain in steady_gain()), strict=True))
    flight = as_record(measured)
    filters = (
        InnovationForm(given),
        FilterError({"v": FORCE}, {"x": SENSOR}, steady=True),
        InnovationForm({"x": ["x"]}),
        OutputError(),
    )
    by_gain, by_noises, without_gain, simulated = (
        np.asarray(predict(model_at(), flight, one).y) for one in filters
    )
    np.testing.assert_allclose(by_noises, by_gain, atol=1e-4)  # a step of Runge-Kutta, not exact
    np.testing.assert_allclose(without_gain, simulated, atol=1e-12)
    assert np.max(np.abs(by_gain - simulated)) > SENSOR
