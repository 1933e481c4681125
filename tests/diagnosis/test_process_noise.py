"""Process noise: the filter equals generalised least squares, planted forces are found with their
size and time, and a force that follows a signal is told from one that nothing predicts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxid.diagnosis.driven import driven, under
from jaxid.diagnosis.innovations import Noise, filtered, most_probable
from jaxid.diagnosis.process_noise import process_noise
from jaxid.diagnosis.scores import scores_of, sensitivities

import jaxid
from jaxid.data import stack
from jaxid.diagnosis.autoregression import autoregressive_r2, chance_level
from jaxid.diagnosis.free_form import Linear, answer, linear_model
from jaxid.effects import LocationKind
from jaxid.estimation import estimate
from jaxid.estimation.problem import Problem

ROWS, STEP, SIGMA = 300, 0.1, 0.02
FORCE, TIME = 0.3, 0.5  # planted: standard deviation [1/s^2] and correlation time [s]
T = STEP * np.arange(ROWS)
CHANCE = 16.1  # chi-square that 162 probes, of which none acts, exceed once in a hundred times


class Spring(jaxid.AbstractModel):
    k: jax.Array
    c: jax.Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return x[:1]


class Hardening(Spring):
    """The same with a cubic spring beside the other."""

    def rhs(self, t, x, u):
        return super().rhs(t, x, u) - jnp.stack([jnp.zeros(()), 0.6 * x[0] ** 3])


def some_linear(key, rows=12, states=2, outputs=2, places=2):
    """A time-varying linear model of arbitrary numbers."""
    shapes = (
        (rows, states), (rows, outputs), (rows - 1, states, states), (rows - 1, states, places),
        (rows - 1, states, places), (rows, outputs, states), (rows, outputs, places),
    )  # fmt: skip
    keys = jax.random.split(key, len(shapes))
    return Linear(
        *(0.6 * jax.random.normal(one, shape) for one, shape in zip(keys, shapes, strict=True))
    )


def dense(linear: Linear, t, noise: Noise):
    """The covariance of all outputs, by the impulse response of each of the forces' independent
    parts.
    """
    h, (rows, places) = np.diff(t), (len(t), linear.P.shape[2])
    a = np.broadcast_to(np.exp(-h[:, None] / np.exp(noise.time)), (rows - 1, places))
    answers = []
    for k in range(rows):
        for p in range(places):
            d = np.zeros((rows, places))
            d[k, p] = np.exp(noise.force[p]) * (1.0 if k == 0 else np.sqrt(1 - a[k - 1, p] ** 2))
            for i in range(k, rows - 1):
                d[i + 1] = a[i] * d[i]
            x, y = np.zeros(linear.x.shape[1]), []
            for i in range(rows):
                y.append(linear.C[i] @ x + linear.D[i] @ d[i])
                if i < rows - 1:
                    x = linear.Phi[i] @ x + linear.P[i] @ d[i] + linear.Q[i] @ d[i + 1]
            answers.append(np.concatenate(y))
    A = np.array(answers).T
    return A @ A.T + np.diag(np.tile(np.exp(noise.instruments), rows))


@pytest.mark.parametrize(
    "memories", [jnp.array([0.3]), jnp.array([0.3, 0.1])], ids=["one", "each its own"]
)
def test_the_filter_is_generalised_least_squares(key, memories):
    first, second = jax.random.split(key)
    linear = some_linear(first)
    t = np.cumsum(0.1 + 0.1 * np.arange(12) % 0.3)
    noise = Noise(*map(jnp.log, (jnp.array([0.7, 1.4]), memories, jnp.array([0.5, 2.0]))))
    columns = jax.random.normal(second, (12, 2, 3))
    seen = jnp.ones((12, 2), bool).at[4, 1].set(False)  # one sample is missing
    keep = np.asarray(seen).reshape(-1)
    Sigma = dense(jax.tree.map(np.asarray, linear), t, noise)[np.ix_(keep, keep)]
    rows = np.asarray(columns).reshape(-1, 3)[keep]
    # A missing sample has a row of zeros as `Problem.whiten` leaves it.
    blank = linear._replace(C=linear.C.at[4, 1].set(0.0), D=linear.D.at[4, 1].set(0.0))
    white, log_det, _ = filtered(blank, jnp.asarray(t), seen, columns.at[4, 1].set(0.0), noise)
    found = np.einsum("tok,tol->kl", white, white)
    np.testing.assert_allclose(found, rows.T @ np.linalg.solve(Sigma, rows), rtol=1e-9)
    np.testing.assert_allclose(jnp.sum(log_det), np.linalg.slogdet(Sigma)[1], rtol=1e-9)


def test_the_most_probable_forces_are_the_conditional_mean(key):
    """Sigma H' (H Sigma H' + R)^-1 v, with all covariances written out."""
    first, second = jax.random.split(key)
    linear, t = some_linear(first), np.cumsum(0.1 + 0.1 * np.arange(12) % 0.3)
    noise = Noise(
        *map(jnp.log, (jnp.array([0.7, 1.4]), jnp.array([0.3, 0.1]), jnp.array([0.5, 2.0])))
    )
    v = jax.random.normal(second, (12, 2))
    H = jax.jacfwd(lambda d: answer(linear, d.reshape(12, 2)).reshape(-1))(jnp.zeros(24))
    apart, Sigma = np.abs(t[:, None] - t[None]), np.zeros((24, 24))
    for place, (deviation, time) in enumerate(((0.7, 0.3), (1.4, 0.1))):
        Sigma[place::2, place::2] = deviation**2 * np.exp(-apart / time)
    expected = (
        Sigma
        @ H.T
        @ np.linalg.solve(H @ Sigma @ H.T + np.diag(np.tile([0.5, 2.0], 12)), v.reshape(-1))
    )
    found = most_probable(linear, jnp.asarray(t), jnp.ones((12, 2), bool), v, noise)
    np.testing.assert_allclose(found.reshape(-1), expected, rtol=1e-9)


def flown(seed, random=0.0, cubic=0.0, magnets=0.0, **constants):
    """A spring shaken by a known force and by one that nothing predicts, with twenty steps between
    samples.
    """
    rng = np.random.default_rng(seed)
    u = np.convolve(rng.normal(size=ROWS), np.ones(8) / 2.5, "same")
    h = STEP / 20
    keep, d, x, y = np.exp(-h / TIME), random * rng.normal(), np.zeros(2), []
    for i in range(ROWS):
        y.append(x[0])
        for part in range(20):
            force = u[i] + part / 20 * (u[min(i + 1, ROWS - 1)] - u[i])
            d = keep * d + np.sqrt(1 - keep**2) * random * rng.normal()
            x = x + h * np.array(
                [
                    x[1],
                    force
                    - 1.5 * x[0]
                    - 0.2 * x[1]
                    - cubic * x[0] ** 3
                    + magnets * np.sin(8 * x[0])
                    + d,
                ]
            )
    z = np.array(y)[:, None] + SIGMA * rng.normal(size=(ROWS, 1))
    named = {"name": f"record {seed}", "constants": constants}
    return jaxid.record(T, u[:, None], z, inputs=("force",), outputs=("x",), **named)


def asked(**what):
    problem, parameters = problem_of(
        Spring(jnp.array(1.0), jnp.array(0.1)), stack([flown(seed, **what) for seed in (1, 2, 3)])
    )
    found = process_noise(
        problem, parameters, jnp.array([0.1]), ((LocationKind.EQUATION, ("v",)),), False
    )
    return found, scored(problem, found)


def scored(problem, found):
    """Scores of what follows a signal, `k` and `c` free."""
    S = found.of(problem, sensitivities(problem, found.parameters)[1])
    columns = jnp.concatenate([S, found.probes], axis=-1)
    return scores_of(
        found.v, columns, problem.records.mask, jnp.arange(2 + found.probes.shape[-1]) < 2
    )


def problem_of(model, records, likelihood=None):
    """A problem with `k` and `c` free, and its solution."""
    free, likelihood = (
        jaxid.free(model, "k", "c", per_record=("initial_state",)),
        likelihood or jaxid.OutputError(),
    )
    fit = estimate(model, free, records, likelihood)
    return Problem.of(fit.model, free, records, likelihood), fit.parameters


def test_a_driven_problem_answers_to_its_forces_as_the_linear_model_says():
    """Also where the input is held: the forces run in straight lines all the same."""
    likelihood = jaxid.OutputError(hold=jaxid.hold.ZeroOrder())
    problem, parameters = problem_of(
        Hardening(jnp.array(1.4), jnp.array(0.2)), stack([flown(1, cubic=0.6)]), likelihood
    )
    pushed, places = driven(problem, ((LocationKind.EQUATION, ("v",)),))
    # Two compiled programs of one recursion: equal but for the rounding of its steps.
    rounding = T.size * np.finfo(float).eps
    np.testing.assert_allclose(
        pushed.residuals(parameters), problem.residuals(parameters), rtol=0.0, atol=rounding
    )
    force = 0.3 * jnp.sin(3.0 * T)[None, :, None]
    at, direction = under(pushed, places, force), jnp.cos(T)[None, :, None]
    _, moved = jax.jvp(
        lambda d: under(pushed, places, d).residuals(parameters), (force,), (direction,)
    )
    case = jax.tree.map(lambda leaf: leaf[0], at.cases())
    linear = linear_model(at, parameters.rows[0], parameters.shared, case, places)
    np.testing.assert_allclose(answer(linear, direction[0]), -moved[0], rtol=1e-9, atol=1e-12)


def test_a_driven_problem_takes_the_constants_of_its_records():
    records = stack([flown(seed, c=c) for seed, c in ((1, 0.1), (2, 0.4))])
    free = jaxid.free(Spring(jnp.array(1.5), jnp.array(0.2)), "k", per_record=("initial_state",))
    problem = Problem.of(Spring(jnp.array(1.5), jnp.array(0.2)), free, records, jaxid.OutputError())
    pushed, _ = driven(problem, ((LocationKind.EQUATION, ("v",)),))
    np.testing.assert_array_equal(pushed.cases()[0], problem.cases()[0])
    assert set(np.asarray(problem.cases()[0])[:, 1]) == {0.1, 0.4}


@pytest.mark.parametrize(
    "limits", [{"bounds": {"c": (0.25, None)}}, {"prior": {"c": (0.25, 1e-6)}}]
)
def test_bounds_and_priors_hold_beside_forces_too(limits):
    """The truth, 0.2, lies outside of both."""
    model = Spring(jnp.array(1.0), jnp.array(0.3))
    free = jaxid.free(model, "k", "c", per_record=("initial_state",), **limits)
    records = stack([flown(seed, random=FORCE) for seed in (1, 2, 3)])
    fit = estimate(model, free, records, jaxid.OutputError())
    problem = Problem.of(fit.model, free, records, jaxid.OutputError())
    found = process_noise(
        problem, fit.parameters, jnp.array([0.3]), ((LocationKind.EQUATION, ("v",)),), False
    )
    assert float(found.parameters.shared[1]) == pytest.approx(0.25, rel=1e-4)


def test_what_the_past_predicts_is_a_share_and_a_smooth_transient_is_not_noise():
    """Also where the record is short: 60 samples of decays and swings, with one per cent of
    noise.
    """
    rng, t = np.random.default_rng(0), np.linspace(0.0, 1.0, 60)
    v = [
        np.exp(-a * t) * np.sin(w * t + p) + 0.01 * rng.normal(size=60)
        for a, w, p in zip(*rng.uniform([[0], [0], [0]], [[5], [20], [6]], (3, 500)), strict=True)
    ]
    share = np.array(
        [
            float(autoregressive_r2(jnp.asarray(one)[None, :, None], jnp.ones((1, 60, 1), bool))[0])
            for one in v
        ]
    )
    assert np.all((share > 0.5) & (share <= 1.0))


def test_planted_forces_are_found_with_their_size_and_time():
    """90 s hold 90 correlation times of 1 s: the deviation is known to about 1/sqrt(2 * 90) = 8 %,
    the time to about twice that and more, as only the slow part stands out of the noise; three and
    a half of these."""
    found, scores = asked(random=FORCE)
    assert float(found.force[0]) == pytest.approx(FORCE, rel=0.27)
    assert float(found.time[0]) == pytest.approx(TIME, rel=0.6)
    assert float(found.gain) > 1000.0
    assert float(jnp.max(scores.significance)) < CHANCE


def test_forces_are_found_that_lead_where_the_motion_without_them_is_another():
    """On a hardening spring, forces larger than the input: the linear model along the motion
    without them says little.
    """
    records = stack([flown(seed, random=3 * FORCE, cubic=0.6) for seed in (1, 2, 3)])
    problem, parameters = problem_of(Hardening(jnp.array(1.0), jnp.array(0.1)), records)
    found = process_noise(
        problem, parameters, jnp.array([0.3]), ((LocationKind.EQUATION, ("v",)),), False
    )
    assert float(found.force[0]) == pytest.approx(3 * FORCE, rel=0.27)
    assert float(found.time[0]) == pytest.approx(TIME, rel=0.6)
    assert float(jnp.max(autoregressive_r2(found.v, records.mask))) < 0.02 + chance_level(3 * ROWS)
    assert float(jnp.max(scored(problem, found).significance)) < CHANCE


def test_noise_of_sensors_with_a_memory_is_found_with_its_size_and_time(seed):
    clean, rng = [flown(one) for one in (1, 2, 3)], np.random.default_rng(seed)
    keep, errors = np.exp(-STEP / TIME), rng.normal(size=(3, ROWS))
    for i in range(1, ROWS):
        errors[:, i] = keep * errors[:, i - 1] + np.sqrt(1 - keep**2) * errors[:, i]
    records = stack(clean)
    records = eqx.tree_at(lambda one: one.z, records, records.z + 3 * SIGMA * errors[..., None])
    problem, parameters = problem_of(Spring(jnp.array(1.0), jnp.array(0.1)), records)
    found = process_noise(
        problem, parameters, jnp.array([0.01]), ((LocationKind.SENSOR, ("x",)),), False
    )
    # As the forces above: 90 correlation times of 1 s.
    assert float(found.force[0]) == pytest.approx(3 * SIGMA, rel=0.27)
    assert float(found.time[0]) == pytest.approx(TIME, rel=0.6)
    assert float(jnp.max(autoregressive_r2(found.v, records.mask))) < 0.02 + chance_level(3 * ROWS)


def test_a_force_that_follows_a_signal_is_told_from_a_random_one():
    found, scores = asked(cubic=0.6)
    assert float(jnp.max(scores.significance)) > 5 * CHANCE
    # random forces would explain it as well: the gain alone tells nothing
    assert float(found.gain) > 1000.0


def test_a_force_that_follows_a_state_in_any_way_is_told_from_a_random_one():
    """The magnets of a motor, of which no power of a signal says anything, and a motion far from
    that without them.
    """
    found, scores = asked(magnets=0.8)
    assert float(jnp.max(scores.significance)) > 2 * CHANCE
    few = 2 + 34  # the parameters, and the probes along the motion without forces
    assert float(jnp.max(scores.significance[:few])) < CHANCE
    assert float(found.gain) > 1000.0


def test_no_force_is_found_where_there_is_none():
    found, scores = asked()
    assert float(found.gain) < 12.0  # chi-square with two degrees of freedom exceeds it once in 400
    assert float(jnp.max(scores.significance)) < CHANCE
    assert found.instruments == pytest.approx(1.0, abs=0.02)
