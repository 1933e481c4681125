"""Filter error of a linear model against the joint Gaussian of all samples, and statsmodels."""

import compiled_problem as compiled
import dense_gaussian as dense
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from statsmodels.tsa.statespace.kalman_filter import KalmanFilter

from jaxid.data import record
from jaxid.estimation import FilterError, OutputError
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.filter.backward_pass import smooth_filtered
from jaxid.estimation.filter.kalman import kalman_filter
from jaxid.estimation.problem import Problem
from jaxid.models import LinearModel, free
from jaxid.models.base import canonical
from jaxid.models.free import Parameters, initial_parameters
from jaxid.simulation.hold import Linear

A = np.array([[0.0, 1.0], [-2.0, -0.4]])
B = np.array([[0.0], [1.0]])
C = np.array([[1.0, 0.0], [0.3, 1.0]])
SAMPLES = 24
MODEL = LinearModel(A, B, C, [[0.0], [0.0]], states=("x", "v"), inputs=("f",), outputs=("a", "b"))
FREE = free(MODEL, "A[1,0]", "A[1,1]", "B[1,0]")
PARTS = {"process": {"x": 0.1, "v": 0.2}, "initial": {"x": 0.1, "v": 0.1}}
# A[1,0], A[1,1], B[1,0], then sensor.a, sensor.b, initial.x, .v, process.x, .v
NAMES = (
    *("A[1,0]", "A[1,1]", "B[1,0]", "sensor.a", "sensor.b"),
    *("initial.x", "initial.v", "process.x", "process.v"),
)
CASES = {
    "regular": {},
    "singular Q": {"process.x": 0.0},
    "no Q": {"process.x": 0.0, "process.v": 0.0},
    "no P0": {"initial.x": 0.0, "initial.v": 0.0},
    "nothing random but sensors": dict.fromkeys(NAMES[5:], 0.0),
}
THETA = dict(zip(NAMES, [-2.1, -0.3, 0.9, 0.05, 0.08, 0.2, 0.1, 0.07, 0.3], strict=True))


def data(uneven=False, gaps=False):
    rng = np.random.default_rng(3)
    h = rng.uniform(0.03, 0.09, SAMPLES) if uneven else np.full(SAMPLES, 0.06)
    t = np.cumsum(h)
    u = np.sin(3.0 * t)[:, None]
    z = np.stack([0.1 * np.cos(1.4 * t), -0.2 * np.sin(1.5 * t)], 1) + 0.1 * rng.normal(
        size=(SAMPLES, 2)
    )
    if gaps:
        z[rng.uniform(size=z.shape) < 0.3] = np.nan
        z[7], z[0, 1] = np.nan, np.nan
    return t, u, z


def problem_of(t, u, z, likelihood):
    records = as_stack(record(t, u, z, inputs=("f",), outputs=("a", "b")))
    model, chosen = likelihood.prepared(canonical(MODEL), canonical(FREE), records)
    return Problem.of(model, chosen, records, likelihood), chosen


@eqx.filter_jit
def evaluated(problem, theta):
    parameters = Parameters(theta, jnp.zeros((1, 0)))
    cost, linearised = problem.evaluate(parameters)
    slope = jax.jacfwd(lambda theta: problem.cost(Parameters(theta, jnp.zeros((1, 0)))))(theta)
    return cost, linearised.information, slope


def reference(t, u, z):

    def function(theta):
        a10, a11, b10, ra, rb, px, pv, qx, qv = theta
        own = np.array([[0.0, 1.0], [a10, a11]])
        steps = dense.discrete(own, np.array([[0.0], [b10]]), np.diag([qx**2, qv**2]), t, u)
        mean, covariance = dense.joint(steps, np.zeros(2), np.diag([px**2, pv**2]))
        residual, sigma, _ = dense.measured(mean, covariance, C, np.array([ra, rb]), z)
        return dense.innovations(residual, sigma, z)

    return function


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("gaps", [False, True])
def test_likelihood_gradient_and_information_equal_joint_gaussian(case, uneven, gaps):
    t, u, z = data(uneven, gaps)
    problem, chosen = problem_of(t, u, z, FilterError(**PARTS))
    assert chosen.shared == NAMES
    theta = np.array([(THETA | CASES[case])[name] for name in NAMES])
    cost, information, slope = evaluated(problem, jnp.asarray(theta))
    expected = dense.likelihood(reference(t, u, z), theta)
    np.testing.assert_allclose(cost, expected[0], rtol=1e-9)
    scale = np.sqrt(np.maximum(np.diag(expected[2]), 1e-12))
    shared, _ = information.gradient()
    np.testing.assert_allclose(shared / scale, expected[1] / scale, atol=1e-8)
    np.testing.assert_allclose(slope / scale, expected[1] / scale, atol=1e-8)
    M = information.triangle.T @ information.triangle
    np.testing.assert_allclose(
        M / np.outer(scale, scale), expected[2] / np.outer(scale, scale), atol=1e-9
    )


def parts_of(theta):
    own = np.array([[0.0, 1.0], [theta["A[1,0]"], theta["A[1,1]"]]])
    GG = np.diag([theta["process.x"] ** 2, theta["process.v"] ** 2])
    P0 = np.diag([theta["initial.x"] ** 2, theta["initial.v"] ** 2])
    R = np.array([theta["sensor.a"], theta["sensor.b"]])
    return own, np.array([[0.0], [theta["B[1,0]"]]]), GG, P0, R


@eqx.filter_jit
def filter_of(problem, theta, **options):
    model, x0 = problem.model_of(Parameters(theta, jnp.zeros((1, 0))), 0)
    one = jax.tree.map(lambda leaf: leaf[0], problem.records)
    return kalman_filter(model, one, x0, Linear(), 1, **options)


@pytest.mark.parametrize("gaps", [False, True])
def test_likelihood_equals_statsmodels(gaps):
    t, u, z = data(True, gaps)
    problem, _ = problem_of(t, u, z, FilterError(**PARTS))
    theta = np.array([THETA[name] for name in NAMES])
    cost, *_ = evaluated(problem, jnp.asarray(theta))
    own, input_matrix, GG, P0, r = parts_of(THETA)
    steps = dense.discrete(own, input_matrix, GG, t, u)
    other = KalmanFilter(k_endog=2, k_states=2, k_posdef=2)
    other.bind(z)
    other.design, other.obs_cov = C, np.diag(r**2)
    other.selection = np.eye(2)
    last = (np.eye(2), np.zeros((2, 2)), np.zeros(2))
    stacked = [np.stack([*part, end], -1) for part, end in zip(steps, last, strict=True)]
    other.transition, other.state_cov, other.state_intercept = stacked
    other.initialize_known(np.zeros(2), P0)
    expected = -other.loglike() - 0.5 * np.log(2 * np.pi) * np.sum(~np.isnan(z))
    np.testing.assert_allclose(cost, expected, rtol=1e-9)


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_likelihood_equals_cuthbertlib(case, gaps):
    """A second reference, itself in square-root form: `pip install cuthbertlib`."""
    kalman = pytest.importorskip("cuthbertlib.kalman")
    t, u, z = data(True, gaps)
    problem, _ = problem_of(t, u, z, FilterError(**PARTS))
    values = THETA | CASES[case]
    cost, *_ = evaluated(problem, jnp.array([values[name] for name in NAMES]))
    own, input_matrix, GG, P0, r = parts_of(values)
    steps = dense.discrete(own, input_matrix, GG, t, u)
    x, root, log_likelihood = np.zeros(2), np.sqrt(P0), 0.0
    for i in range(SAMPLES):
        (x, root), more = kalman.filter_update(x, root, C, np.zeros(2), np.diag(r), z[i])
        log_likelihood += more
        if i < SAMPLES - 1:
            w, V = np.linalg.eigh(steps.Q[i])  # Q may be singular
            Q_root = V * np.sqrt(np.maximum(w, 0.0))
            x, root = kalman.predict(x, root, steps.Phi[i], steps.b[i], Q_root)
    expected = -log_likelihood - 0.5 * np.log(2 * np.pi) * np.sum(~np.isnan(z))
    np.testing.assert_allclose(cost, expected, rtol=1e-9)


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("case", ["regular", "singular Q", "no P0"])
def test_filter_and_smoother_equal_posterior(case, gaps):
    t, u, z = data(True, gaps)
    problem, _ = problem_of(t, u, z, FilterError(**PARTS))
    values = THETA | CASES[case]
    filtered = filter_of(problem, jnp.array([values[name] for name in NAMES]))
    x, factor = map(np.asarray, eqx.filter_jit(smooth_filtered)(filtered))
    P = factor @ np.swapaxes(factor, 1, 2)
    own, input_matrix, GG, P0, r = parts_of(values)
    mean, covariance = dense.joint(dense.discrete(own, input_matrix, GG, t, u), np.zeros(2), P0)
    residual, sigma, H = dense.measured(mean, covariance, C, r, z)
    flat = covariance.reshape(2 * SAMPLES, 2 * SAMPLES).real
    gain = np.linalg.solve(sigma.real, H @ flat).T
    posterior = flat - gain @ H @ flat
    np.testing.assert_allclose(np.ravel(x), mean.ravel().real + gain @ residual.real, atol=1e-9)
    blocks = posterior.reshape(SAMPLES, 2, SAMPLES, 2)
    np.testing.assert_allclose(P, np.stack([blocks[i, :, i] for i in range(SAMPLES)]), atol=1e-9)
    np.testing.assert_allclose(filtered.x[-1], x[-1], rtol=1e-12)


def test_iterated_update_changes_nothing_in_linear_model():
    t, u, z = data()
    problem, _ = problem_of(t, u, z, FilterError(**PARTS))
    theta = jnp.array([THETA[name] for name in NAMES])
    once, thrice = filter_of(problem, theta), filter_of(problem, theta, updates=3)
    np.testing.assert_allclose(once.v, thrice.v, atol=1e-12)
    np.testing.assert_allclose(once.P, thrice.P, atol=1e-14)
    iterated, _ = problem_of(t, u, z, FilterError(**PARTS, updates=2))
    _, one, _ = evaluated(problem, theta)
    _, two, _ = evaluated(iterated, theta)
    np.testing.assert_allclose(two.factor, one.factor, rtol=1e-9, atol=1e-9)


def test_steady_covariance_equals_riccati_equation():
    t, u, z = data()
    problem, _ = problem_of(t, u, z, FilterError(**PARTS))
    theta = jnp.array([THETA[name] for name in NAMES])
    steady = filter_of(problem, theta, steady=True)
    own, _, GG, _, r = parts_of(THETA)
    Phi, Q = dense.van_loan(own, GG, 0.06)
    P = solve_discrete_are(Phi.T, C.T, Q, np.diag(r**2))
    for row in (0, SAMPLES - 1):
        np.testing.assert_allclose(steady.P_predicted[row], P, atol=1e-11)


def test_deleted_samples_equal_missing_samples():
    t, u, z = data()
    gap = z.copy()
    gap[[5, 11]] = np.nan
    keep = ~np.isnan(gap[:, 0])
    u = u * 0.0  # the input between its samples depends on the samples
    theta = jnp.asarray([THETA[name] for name in NAMES])
    with_gaps, *_ = evaluated(problem_of(t, u, gap, FilterError(**PARTS))[0], theta)
    without, *_ = evaluated(problem_of(t[keep], u[keep], z[keep], FilterError(**PARTS))[0], theta)
    # two steps of half the length in place of one: the difference is that of the integration
    np.testing.assert_allclose(with_gaps, without, rtol=1e-5)


def test_no_process_noise_equals_output_error():
    """Value and gradient of output error with the same R, with initial states per record."""
    t, u, z = data(gaps=True)
    records = as_stack(record(t, u, z, inputs=("f",), outputs=("a", "b")))
    chosen = free(MODEL, "A[1,0]", "A[1,1]", "B[1,0]", per_record=("initial_state",))
    filter_error = FilterError(noise={"a": 0.05, "b": 0.08})
    own, own_free = filter_error.prepared(canonical(MODEL), canonical(chosen), records)
    problem = Problem.of(own, own_free, records, filter_error)
    from jaxid.models import FixedNoise

    other = Problem.of(MODEL, chosen, records, OutputError(FixedNoise([0.05**2, 0.08**2])))
    begin, plain = (
        initial_parameters(one.model, one.positions, records) for one in (problem, other)
    )
    cost, linearised = compiled.evaluate(problem, begin)
    expected, reference_linearised = compiled.evaluate(other, plain)
    np.testing.assert_allclose(cost, expected, rtol=1e-12)
    (g, g_own), (e, e_own) = (
        one.information.gradient() for one in (linearised, reference_linearised)
    )
    np.testing.assert_allclose(g[:3], e, rtol=1e-9)
    np.testing.assert_allclose(g_own, e_own, rtol=1e-9)
