"""Process noise: the filter equals generalised least squares, planted forces are found with their size and time, and a force
that follows a signal is told from one that nothing predicts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxid
from jaxid.data import stack
from jaxid.diagnosis.free_form import Linear
from jaxid.diagnosis.process_noise import Noise, _filtered, process_noise
from jaxid.diagnosis.scores import scores_of
from jaxid.estimation import estimate
from jaxid.estimation.problem import Problem

ROWS, STEP, SIGMA = 300, 0.1, 0.02
FORCE, TIME = 0.3, 0.5  # planted: standard deviation [1/s^2] and correlation time [s]
T = STEP * np.arange(ROWS)
CHANCE = 13.6  # chi-square that 34 probes, of which none acts, exceed once in a hundred times


class Spring(jaxid.AbstractModel):
    k: jax.Array
    c: jax.Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return x[:1]


def some_linear(key, rows=12, states=2, outputs=2, places=2):
    """A time-varying linear model of arbitrary numbers."""
    shapes = (
        (rows, states), (rows, outputs), (rows - 1, states, states), (rows - 1, states, places),
        (rows - 1, states, places), (rows, outputs, states), (rows, outputs, places),
    )  # fmt: skip
    keys = jax.random.split(key, len(shapes))
    return Linear(*(0.6 * jax.random.normal(one, shape) for one, shape in zip(keys, shapes, strict=True)))


def dense(linear: Linear, t, noise: Noise):
    """The covariance of all outputs, by the impulse response of each of the forces' independent parts."""
    h, (rows, places) = np.diff(t), (len(t), linear.P.shape[2])
    a = np.exp(-h / np.exp(noise.time))
    answers = []
    for k in range(rows):
        for p in range(places):
            d = np.zeros((rows, places))
            d[k, p] = np.exp(noise.force[p]) * (1.0 if k == 0 else np.sqrt(1 - a[k - 1] ** 2))
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


def test_the_filter_is_generalised_least_squares(key):
    first, second = jax.random.split(key)
    linear = some_linear(first)
    t = np.cumsum(0.1 + 0.1 * np.arange(12) % 0.3)
    noise = Noise(jnp.log(jnp.array([0.7, 1.4])), jnp.log(jnp.array(0.3)), jnp.log(jnp.array([0.5, 2.0])))
    columns = jax.random.normal(second, (12, 2, 3))
    seen = jnp.ones((12, 2), bool).at[4, 1].set(False)  # one sample is missing
    keep = np.asarray(seen).reshape(-1)
    Sigma = dense(jax.tree.map(np.asarray, linear), t, noise)[np.ix_(keep, keep)]
    rows = np.asarray(columns).reshape(-1, 3)[keep]
    # A missing sample has a row of zeros as `Problem.whiten` leaves it.
    blank = linear._replace(C=linear.C.at[4, 1].set(0.0), D=linear.D.at[4, 1].set(0.0))
    white, log_det = _filtered(blank, jnp.asarray(t), seen, columns.at[4, 1].set(0.0), noise)
    found = np.einsum("tok,tol->kl", white, white)
    np.testing.assert_allclose(found, rows.T @ np.linalg.solve(Sigma, rows), rtol=1e-9)
    np.testing.assert_allclose(jnp.sum(log_det), np.linalg.slogdet(Sigma)[1], rtol=1e-9)


def flown(seed, random=0.0, cubic=0.0):
    """A spring shaken by a known force and by one that nothing predicts, with twenty steps between samples."""
    rng = np.random.default_rng(seed)
    u = np.convolve(rng.normal(size=ROWS), np.ones(8) / 2.5, "same")
    h = STEP / 20
    keep, d, x, y = np.exp(-h / TIME), random * rng.normal(), np.zeros(2), []
    for i in range(ROWS):
        y.append(x[0])
        for part in range(20):
            force = u[i] + part / 20 * (u[min(i + 1, ROWS - 1)] - u[i])
            d = keep * d + np.sqrt(1 - keep**2) * random * rng.normal()
            x = x + h * np.array([x[1], force - 1.5 * x[0] - 0.2 * x[1] - cubic * x[0] ** 3 + d])
    z = np.array(y)[:, None] + SIGMA * rng.normal(size=(ROWS, 1))
    return jaxid.record(T, u[:, None], z, inputs=("force",), outputs=("x",), name=f"record {seed}")


def filtered(**what):
    records = stack([flown(seed, **what) for seed in (1, 2, 3)])
    model = Spring(jnp.array(1.0), jnp.array(0.1))
    free = jaxid.free(model, "k", "c", per_record=("initial_state",))
    fit = estimate(model, free, records, jaxid.OutputError())
    problem = Problem.of(fit.model, free, records, jaxid.OutputError())
    is_free = jnp.ones(2, bool)
    found = process_noise(problem, fit.parameters, is_free, jnp.array([0.1]), ("v",), False)
    columns = jnp.concatenate([found.S, found.probes], axis=-1)
    return found, scores_of(found.v, columns, jnp.pad(is_free, (0, found.probes.shape[-1])))


def test_planted_forces_are_found_with_their_size_and_time():
    """90 s hold 90 correlation times of 1 s: the deviation is known to about 1/sqrt(2 * 90) = 8 %, the time to about twice
    that and more, as only the slow part stands out of the noise; three and a half of these."""
    found, scores = filtered(random=FORCE)
    assert float(found.force[0]) == pytest.approx(FORCE, rel=0.27)
    assert float(found.time) == pytest.approx(TIME, rel=0.6)
    assert float(found.gain) > 1000.0
    assert float(jnp.max(scores.significance)) < CHANCE


def test_a_force_that_follows_a_signal_is_told_from_a_random_one():
    found, scores = filtered(cubic=0.6)
    assert float(jnp.max(scores.significance)) > 5 * CHANCE
    assert float(found.gain) > 1000.0  # random forces would explain it as well: the gain alone tells nothing


def test_no_force_is_found_where_there_is_none():
    found, scores = filtered()
    assert float(found.gain) < 12.0  # chi-square with two degrees of freedom exceeds it once in 400
    assert float(jnp.max(scores.significance)) < CHANCE
    assert found.instruments == pytest.approx(1.0, abs=0.02)
