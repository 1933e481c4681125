"""Filter error from end to end: limits, records with gaps, batches, smoothed forces, refusals."""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gusty_lag import FORCE, SENSOR, TIME, B, GustyLag, P, as_record, flights
from reference_estimation import Lag, lag_rhs, rk4
from scipy import optimize

from jaxid import InputError
from jaxid.data import record
from jaxid.estimation import FilterError, FirstOrder, Fixed, OutputError, estimate, smooth_states
from jaxid.estimation import problem as problem_module
from jaxid.estimation.estimate import as_stack, checked_case
from jaxid.estimation.filter.noise_parameters import sensor_starts
from jaxid.models import FixedNoise, LinearModel, free

START = GustyLag(jnp.array(0.7), jnp.array(1.5))
FREE = free(START, "p", "b", per_record=("initial_state",))
FORCED = {"force": FirstOrder(0.3, 2.0)}
NAMES = ("p", "b", "sensor.y", "process.force", "correlation_time.force")
TRUTH = np.array([P, B, SENSOR, FORCE, TIME])


@pytest.fixture(scope="module")
def records():
    """Two records of different lengths, one with gaps."""
    t, u, z, _ = flights(2, 400, 11)
    z[0, np.random.default_rng(1).uniform(size=400) < 0.2] = np.nan
    return [as_record(t, u, z[0]), as_record(t[:250], u[:250], z[1, :250])]


@pytest.fixture(scope="module")
def fit(records):
    return estimate(START, FREE, records, FilterError(FORCED))


def test_estimate_recovers_physics_and_noises(fit):
    assert fit.names == NAMES
    assert not fit.noise_known
    assert bool(fit.successful)
    distance = (np.asarray(fit.values) - TRUTH) / np.asarray(fit.standard_errors)
    # 3.9 standard errors: 99.99 % for each of five normal estimates
    assert (np.abs(distance) < 3.9).all(), distance
    assert fit.own.shape == (2, 1)
    np.testing.assert_allclose(fit.noise, [[fit.value("sensor.y") ** 2]], rtol=1e-12)


def test_print_names_noises_with_units_and_their_errors(fit):
    text = str(fit)
    for word in ("correlation_time.force", "sensor.y", "R estimated", "converged"):
        assert word in text
    assert not fit.weak_directions
    interval = np.asarray(fit.interval())
    assert (interval[:, 0] < fit.values).all()
    assert (interval[:, 1] > fit.values).all()


def test_interval_of_noise_is_symmetric_in_logarithm(fit):
    """With the width of the interval of the value."""
    low, high = np.asarray(fit.interval()).T
    width = (high[0] - low[0]) / 2 / float(fit.standard_errors[0])
    relative = width * np.asarray(fit.standard_errors / fit.values)[2:]
    np.testing.assert_allclose(np.log(high / low)[2:] / 2, relative, rtol=1e-12)
    np.testing.assert_allclose(np.sqrt(low * high)[2:], fit.values[2:], rtol=1e-12)
    np.testing.assert_allclose((low + high)[:2] / 2, fit.values[:2], rtol=1e-12)


def test_record_with_padding_and_gaps_equals_its_valid_samples(fit, records):
    """The residuals are zero at missing samples, and padding adds nothing to the cost."""
    assert not np.any(np.asarray(fit.residuals)[1, 250:])
    missing = ~np.asarray(records[0].mask)
    assert not np.any(np.asarray(fit.residuals)[0][missing])


def test_batch_under_jit_equals_single_estimate(fit, records):
    """Two cases of two records: those of `fit`, and the same scaled by 0.9."""
    stack = as_stack(records)
    z = jnp.stack([stack.z, 0.9 * stack.z])

    def one(z):
        return estimate(START, FREE, eqx.tree_at(lambda r: r.z, stack, z), FilterError(FORCED))

    batch = eqx.filter_jit(eqx.filter_vmap(one))(z)
    np.testing.assert_array_equal(batch.successful, [True] * 2)
    # to the tolerance of the iteration, 1e-6 standard errors, and some
    distance = (batch.values[0] - fit.values) / fit.standard_errors
    np.testing.assert_allclose(distance, 0.0, atol=1e-4)
    np.testing.assert_allclose(batch.standard_errors[0], fit.standard_errors, rtol=1e-4)
    assert "2 cases, 2 successful" in str(batch)


def test_records_at_once_follow_from_size_of_sensitivities(records, monkeypatch):
    """The rows of the covariances count: no more is kept than stated."""
    case = checked_case(START, FREE, records, FilterError(FORCED))
    _, S = jax.eval_shape(case.problem.sensitivities, case.begin)
    monkeypatch.setattr(problem_module, "default_device", lambda: SimpleNamespace(platform="cpu"))
    monkeypatch.setattr(problem_module, "KEPT_BYTES", 8 * S.size)
    assert case.problem.batch == 2
    monkeypatch.setattr(problem_module, "KEPT_BYTES", 8 * S.size - 1)
    monkeypatch.setattr(problem_module, "BLOCK_BYTES", 4 * S.size)
    assert case.problem.batch == 1


def test_no_process_noise_gives_estimate_and_errors_of_output_error(records):
    without = estimate(START, FREE, records, FilterError())
    output_error = estimate(START, FREE, records, OutputError())
    np.testing.assert_allclose(without.values[:2], output_error.values, rtol=1e-6)
    np.testing.assert_allclose(without.own, output_error.own, rtol=1e-5)
    np.testing.assert_allclose(without.standard_errors[:2], output_error.standard_errors, rtol=1e-5)
    np.testing.assert_allclose(without.noise, output_error.noise, rtol=1e-6)


def test_given_noises_are_known(records):
    given = estimate(START, FREE, records, FilterError(noise={"y": Fixed(SENSOR)}))
    output_error = estimate(START, FREE, records, OutputError(FixedNoise([SENSOR**2])))
    assert given.noise_known
    assert "R is known" in str(given)
    np.testing.assert_allclose(given.interval(), output_error.interval(), rtol=1e-5)


def test_start_of_sensor_noise_does_not_depend_on_level_of_record():
    """White noise of 0.01 on a signal of 3000 and a range of one."""
    t = 0.01 * np.arange(400)
    smooth = 0.5 * np.sin(t) + 0.01 * np.random.default_rng(3).normal(size=t.size)
    z = np.stack([3000.0 + smooth, np.full(t.size, 3000.0), 3000.0 + t], axis=1)
    channels = {"inputs": ("u",), "outputs": ("noisy", "constant", "line")}
    starts = sensor_starts(record(t, t[:, None], z, **channels))
    # second differences of 400 samples give the deviation to sqrt(1.94 / 800) = 5 %; four of them
    np.testing.assert_allclose(starts, [0.01, 1e-3, 1e-3 * t[-1]], rtol=0.2)


def test_measured_state_without_sensor_noise_gives_equation_error():
    """The one-step predictions from the measured state, fitted by SciPy (A.68, A.69)."""
    rng = np.random.default_rng(7)
    t = 0.1 * np.arange(300)
    u, x = np.sign(np.sin(0.9 * t)), np.zeros(300)
    for i in range(299):
        x[i + 1] = rk4(lag_rhs, t[:2], u[i : i + 2], x[i : i + 1], np.array([P, B]))[1, 0]
        x[i + 1] += 0.05 * rng.normal()

    def one_step(theta):
        a = 1 - theta[0] * 0.1 + theta[0] ** 2 / 200 - theta[0] ** 3 / 6e3 + theta[0] ** 4 / 24e4
        driven = [rk4(lag_rhs, t[:2], u[i : i + 2], np.zeros(1), theta)[1, 0] for i in range(299)]
        return x[1:] - a * x[:-1] - np.array(driven)

    reference = optimize.least_squares(one_step, [0.8, 1.5], xtol=1e-14)
    variance = np.mean(reference.fun**2)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(reference.jac.T @ reference.jac)))
    model = Lag(p=jnp.array(0.8), b=jnp.array(1.5))
    data = record(t, u[:, None], x[:, None], inputs=("u",), outputs=("x",))
    likelihood = FilterError({"x": 0.1}, {"x": Fixed(1e-6)})
    found = estimate(model, free(model, "p", "b"), data, likelihood)
    np.testing.assert_allclose(found.values[:2], reference.x, rtol=1e-5)
    # Q is known to 1/sqrt(2 N) and depends on p through the step
    np.testing.assert_allclose(found.standard_errors[:2], errors, rtol=1e-3)


def test_smoothed_force_and_its_deviation_agree_with_truth():
    """At known parameters the normalised error has unit variance: 4,000 samples, about one in
    ten of them independent.
    """
    t, u, z, states = flights(10, 400, 21)
    truth = GustyLag(jnp.array(P), jnp.array(B))
    likelihood = FilterError(
        {"force": FirstOrder(Fixed(FORCE), Fixed(TIME))}, {"y": Fixed(SENSOR)}, {"x": Fixed(0.0)}
    )
    z[:, 0] = 0.0  # the start of the state is known, and read from the record
    stack = [as_record(t, u, z[i]) for i in range(10)]
    smoothed = smooth_states(truth, stack, likelihood)
    assert smoothed.names == ("x", "force")
    force, deviation = smoothed.signal("force")
    normalised = (np.asarray(force) - states[..., 1]) / np.asarray(deviation)
    assert 0.85 < np.mean(normalised[:, 5:] ** 2) < 1.15
    # with all samples the force is known better than from its variance alone
    assert float(jnp.max(deviation)) < FORCE
    with pytest.raises(InputError, match=r"'forces'.*force"):
        smoothed.signal("forces")


def test_smoother_of_estimate_takes_its_initial_states(fit, records):
    smoothed = smooth_states(fit, records, FilterError(FORCED))
    assert smoothed.values.shape == (2, 400, 2)
    assert bool(jnp.all(jnp.isfinite(smoothed.values)))
    # a free initial state is known: the smoother leaves it where it is
    np.testing.assert_allclose(smoothed.values[:, 0, 0], fit.own[:, 0], rtol=1e-9)
    with pytest.raises(InputError, match="each of 2 records, and there are 1"):
        smooth_states(fit, records[0], FilterError(FORCED))


UNSEEN = LinearModel(
    [[-1.0, 0.0], [0.5, -1.0]],
    [[1.0], [0.0]],
    [[1.0, 0.0]],
    [[0.0]],
    states=("x", "hidden"),
    inputs=("u",),
    outputs=("y",),
)
REFUSED = {
    "unknown state": (START, {"v": 0.1}, "no state or disturbance .*'v'"),
    "white on a sensor": (
        START,
        {"drift": 0.1},
        "'drift' has no memory and acts directly on .*'y'",
    ),
    "unseen state": (UNSEEN, {"hidden": 0.1}, "No output responds to the noise 'process.hidden'"),
    "two forces in one place": (
        START,
        {"push": 0.1, "x": 0.2},
        "cannot tell the noises process.push, process.x apart",
    ),
    "Q and R alike": (
        START,
        {"drift": FirstOrder(0.1, Fixed(1e-3))},
        "cannot tell the noises sensor.y, process.drift apart",
    ),
    "negative": (START, {"x": -0.1}, "process noise of 'x' is -0.1"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_noise_that_records_cannot_show_is_refused_in_words(case, records):
    model, process, message = REFUSED[case]
    chosen = free(model, "b") if model is START else free(model, "B[0,0]")
    with pytest.raises(InputError, match=message):
        estimate(model, chosen, records, FilterError(process))


def test_noises_that_differ_in_law_are_accepted(records):
    process = {"force": FirstOrder(0.3, 2.0), "drift": FirstOrder(0.1, 5.0), "x": 0.1}
    model, chosen = FilterError(process).prepared(START, FREE, as_stack(records[:1]))
    assert chosen.shared[2:] == (
        *("sensor.y", "process.force", "process.drift", "process.x"),
        *("correlation_time.force", "correlation_time.drift"),
    )
    assert model.states == ("x", "drift", "force")


def test_one_of_two_forces_in_one_place_may_be_given(records):
    process = {"push": Fixed(0.1), "x": 0.2}
    FilterError(process).prepared(START, FREE, as_stack(records[:1]))


def test_memory_of_equation_equals_memory_of_input_that_acts_in_it(records, fit):
    """The input `force` is added to the rate of x."""
    other = estimate(START, FREE, records, FilterError({"x": FirstOrder(0.3, 2.0)}))
    assert other.names[3:] == ("process.x", "correlation_time.x")
    np.testing.assert_allclose(other.cost, fit.cost, rtol=1e-12)
    np.testing.assert_allclose(other.values, fit.values, rtol=1e-6)
    np.testing.assert_allclose(other.standard_errors, fit.standard_errors, rtol=1e-6)
    assert other.model.states == ("x", "force_x")


def test_noises_are_examined_on_a_record_that_has_samples(records):
    silent = eqx.tree_at(lambda r: r.mask, records[1], jnp.zeros_like(records[1].mask))
    silent = eqx.tree_at(lambda r: r.z, silent, jnp.zeros_like(silent.z))
    case = checked_case(START, FREE, [silent, *records], FilterError(FORCED))
    assert set(NAMES) <= set(case.free.shared)


def test_spread_of_free_initial_state_is_refused(records):
    with pytest.raises(InputError, match="initial state 'x' is free and has a deviation"):
        estimate(START, FREE, records, FilterError(FORCED, initial={"x": 0.1}))
