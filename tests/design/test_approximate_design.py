"""Inputs by way of the equation error: Eq. C.40 against regressions, nearness to the direct design,
limits, refusals.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxid import AbstractModel, FixedNoise, OutputError, free, simulate
from jaxid._foundation.checks import InputError
from jaxid.design import (
    InputSignal,
    Limits,
    Trace,
    approximate_design,
    design_input,
    equation_error_information,
    information_of,
    sample_times,
    square_wave,
)

K, C, CUBIC = 1.5, 0.4, 1.0
A, B = 0.8, 2.0
T = sample_times(10.0, 0.1)
RATE, STATES = {"v": 0.05}, {"x": 0.02, "v": 0.02}


class Spring(AbstractModel):
    """A spring with a cubic part; position, velocity and acceleration are measured."""

    k: jnp.ndarray
    c: jnp.ndarray
    cubic: jnp.ndarray
    unused: jnp.ndarray
    states, inputs, outputs = ("x", "v"), ("force",), ("x", "v", "a")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1] - self.cubic * x[0] ** 3])

    def output(self, t, x, u):
        return jnp.stack([x[0], x[1], self.rhs(t, x, u)[1] + 0.0 * self.unused])


class Lag(AbstractModel):
    """A first-order lag; the state and its rate are measured."""

    a: jnp.ndarray
    b: jnp.ndarray
    states, inputs, outputs = ("x",), ("u",), ("x", "rate")

    def rhs(self, t, x, u):
        return self.b * u - self.a * x

    def output(self, t, x, u):
        return jnp.concatenate([x, self.rhs(t, x, u)])


def spring(cubic=0.0):
    return Spring(*map(jnp.array, (K, C, cubic, 1.0)))


LAG = Lag(jnp.array(A), jnp.array(B))
NOISE = OutputError(FixedNoise(jnp.array([0.02, 0.02, 0.05]) ** 2))
LAG_NOISE = OutputError(FixedNoise(jnp.array([0.02, 0.05]) ** 2))
LIMITS = Limits({"force": 1.0}, envelope={"x": (-0.8, 0.8), "v": (-1.0, 1.0)})
LAG_LIMITS = Limits({"u": 1.0}, envelope={"x": (-1.5, 1.5)})
RELATIVE = Trace([1.0 / K**2, 1.0 / C**2])
SPRING_CASE = (spring(), ("k", "c"), RELATIVE, LIMITS, NOISE, RATE, STATES)
CUBIC_CASE = (
    spring(CUBIC),
    ("k", "c", "cubic"),
    Trace([1.0 / K**2, 1.0 / C**2, 1.0 / CUBIC**2]),
    *(LIMITS, NOISE, RATE, STATES),
)
LAG_CASE = (
    LAG,
    ("a", "b"),
    Trace([1.0 / A**2, 1.0 / B**2]),
    *(LAG_LIMITS, LAG_NOISE, {"x": 0.05}, {"x": 0.02}),
)


def designed(case, **options):
    model, names, measure, limits, likelihood, rates, states = case
    chosen = free(model, *names)
    return approximate_design(
        model, chosen, T, None, measure, limits, likelihood, rates, states, **options
    )


def directly(case, **options):
    model, names, measure, limits, likelihood, *_ = case
    return design_input(model, free(model, *names), T, None, measure, limits, likelihood, **options)


@pytest.fixture(scope="module")
def near():
    return designed(SPRING_CASE)


def test_information_of_exact_states_is_that_of_a_regression(seed):
    """Eq. C.40 against the normal equations of a on x, v and x^3, written out in NumPy."""
    rng = np.random.default_rng(seed)
    x, u = rng.normal(size=(T.size, 2)), rng.normal(size=(T.size, 1))
    model = spring(CUBIC)
    chosen = free(model, "k", "c", "cubic")
    shown = equation_error_information(model, chosen, T, x, u, {"v": 0.05})
    columns = np.stack([-x[:, 0], -x[:, 1], -(x[:, 0] ** 3)], axis=1)
    M = columns.T @ columns / 0.05**2
    np.testing.assert_allclose(shown.factor.T @ shown.factor, M, rtol=1e-9)
    errors = np.sqrt(np.diagonal(np.linalg.inv(M)))
    np.testing.assert_allclose(shown.standard_errors, errors, rtol=1e-8)


def test_predicted_errors_are_the_scatter_of_regressions_with_noisy_states(seed):
    """g R g' of Eq. C.39: estimates of k and c by weighted least squares from many records."""
    rng = np.random.default_rng(seed)
    model, u = spring(), np.sin(1.1 * np.asarray(T))[:, None]
    x = np.asarray(simulate(model, T, u, jnp.zeros(2)).x)
    noise = {"x": 0.002, "v": 0.003}  # small: errors of the regressors bias by their square
    shown = equation_error_information(model, free(model, "k", "c"), T, x, u, {"v": 0.004}, noise)
    count = 4000
    exact = u[:, 0] - K * x[:, 0] - C * x[:, 1]
    rates = exact + 0.004 * rng.normal(size=(count, T.size))
    states = x + np.array([0.002, 0.003]) * rng.normal(size=(count, T.size, 2))
    estimates = np.stack(
        [np.linalg.lstsq(-states[row], rates[row] - u[:, 0], rcond=None)[0] for row in range(count)]
    )
    # four standard deviations of a standard deviation from 4000 samples: 4.5 %
    np.testing.assert_allclose(np.std(estimates, axis=0), shown.standard_errors, rtol=0.045)


def test_standard_errors_are_near_those_of_the_direct_design(near):
    """The margins cover three seeds. A doublet in the limits has 1.4 and 1.7 times the errors."""
    pairs = ((near, SPRING_CASE, 1.10), (designed(LAG_CASE), LAG_CASE, 1.15))
    for design, case, largest in pairs:
        assert np.exp((design.cost - directly(case).cost) / 2) < largest


def test_histories_without_the_equations_of_motion_are_no_motion(near):
    """The report's step (c) as printed: its histories are followed badly."""
    apart = designed(SPRING_CASE, compatibility=(0.0,))
    assert np.exp((apart.cost - near.cost) / 2) > 1.3


def test_direct_design_begins_with_the_result(near):
    direct = directly(SPRING_CASE, conventional=[near.signal])
    assert direct.cost <= near.cost + 1e-6


def test_motion_stays_within_the_limits_in_a_finer_simulation():
    """The cubic spring by SciPy, with the force linear between its samples."""
    design = designed(CUBIC_CASE)
    t, u = np.asarray(T), np.asarray(design.signal.u[:, 0])
    motion = solve_ivp(
        lambda s, x: [x[1], np.interp(s, t, u) - K * x[0] - C * x[1] - CUBIC * x[0] ** 3],
        (t[0], t[-1]),
        [0.0, 0.0],
        t_eval=np.linspace(t[0], t[-1], 8 * t.size),
        max_step=0.05,
        rtol=1e-8,
    )
    share = np.abs(motion.y).max(axis=1) / np.array([0.8, 1.0])
    assert np.all(share <= 1.0 + 1e-3)  # between samples of the check at four times the rate
    assert np.max(np.abs(u)) <= 1.0
    assert max(*share, np.max(np.abs(u))) > 0.9
    assert max(design.limits_used.values()) <= 1.0


def test_rate_and_energy_are_limited():
    limits = Limits({"force": 1.0}, {"force": 2.0}, 1.5, LIMITS.envelope)
    design = designed((*SPRING_CASE[:3], limits, *SPRING_CASE[4:]))
    u = np.asarray(design.signal.u[:, 0])
    assert np.max(np.abs(np.diff(u))) / 0.1 <= 2.0 + 1e-9
    assert 0.7 < np.sum(u**2) * 0.1 <= 1.5 + 1e-9


def test_predicted_errors_are_those_of_the_record_to_fly(near):
    chosen = free(spring(), "k", "c")
    flown = information_of(spring(), chosen, near.record, NOISE, initial_state=jnp.zeros(2))
    np.testing.assert_allclose(near.information.standard_errors, flown.standard_errors, rtol=1e-8)
    np.testing.assert_allclose(near.cost, np.log(flown.measure(RELATIVE)), rtol=1e-8)


def test_start_and_trim_are_those_given():
    """A design about x = 0.2, held by the force 0.3."""
    design = designed(SPRING_CASE, trim_input=jnp.array([0.3]), initial_state=jnp.array([0.2, 0.0]))
    np.testing.assert_allclose(design.record.z[0, :2], [0.2, 0.0], atol=1e-12)
    np.testing.assert_allclose(design.record.u, design.signal.u + 0.3, rtol=1e-12)
    assert np.max(design.record.z[:, 0]) <= 0.8 + 1e-9
    assert isinstance(design.signal, InputSignal)


def test_meaningless_designs_are_refused():
    def refuse(match, limits=LIMITS, names=("k", "c"), rates=RATE, states=STATES, **options):
        case = (spring(), names, Trace(np.ones(len(names))), limits, NOISE, rates, states)
        with pytest.raises(InputError, match=match):
            designed(case, **options)

    refuse(r"unused: in no equation whose rate is measured \(v\)", names=("k", "unused"))
    refuse(r"c: in no equation whose rate is measured \(x\)", names=("c",), rates={"x": 0.1})
    refuse("equations of v have no noise", rates={"v": 0.0}, states={})
    refuse("'a'", rates={"a": 0.1})
    refuse("No rate is measured", rates={})
    refuse("standard deviation of 'v' is -1", rates={"v": -1.0})
    refuse(
        "limits of 'x', 0.1 to 0.5, exclude the trim",
        Limits({"force": 1.0}, envelope={"x": (0.1, 0.5), "v": (-1.0, 1.0)}),
    )
    refuse(
        "states v have no limits on both sides",
        Limits({"force": 1.0}, envelope={"x": (-0.8, 0.8), "v": (None, 1.0)}),
    )
    refuse("1 knots for 101 samples", knots=1)
    with pytest.raises(InputError, match="No signal of this shape"):
        approximate_design(
            *(spring(), free(spring(), "k"), T, square_wave(T, 3), Trace([1.0]), LIMITS, NOISE),
            *(RATE, STATES),
        )


def test_combinations_without_noise_are_refused():
    """Two exact rates that depend on one noisy state: their difference has no noise."""

    class Twice(AbstractModel):
        a: jnp.ndarray
        states, inputs, outputs = ("x", "y"), ("u",), ("x", "y")

        def rhs(self, t, x, u):
            return jnp.stack([u[0] - self.a * x[0], u[0] - self.a * x[0]])

    model = Twice(jnp.array(1.0))
    t, one = T[:3], jnp.ones((3, 2))
    arguments = model, free(model, "a"), t, one, one[:, :1]
    exact = {"x": 0.0, "y": 0.0}
    with pytest.raises(InputError, match="equations of x, y have no noise"):
        equation_error_information(*arguments, exact, {"x": 0.1})
    with pytest.raises(InputError, match=r"x has shape \(3, 1\).*\(3, 2\)"):
        equation_error_information(*arguments[:3], one[:, :1], one[:, :1], {"x": 0.1})
