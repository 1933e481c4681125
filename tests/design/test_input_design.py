"""Designed inputs of a spring: derivative, limits, refusals, and gain over conventional inputs."""

import json
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from notebook_cells import assert_has_printed_lines
from scipy.integrate import solve_ivp
from scipy.optimize import minimize
from small_spring import SIGMA, Spring

from jaxid import AbstractModel, FixedNoise, OutputError, free
from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.design import (
    Explanation,
    InformationObjective,
    Limits,
    Trace,
    conventional_inputs,
    design_input,
    expected_chi_square,
    information_of,
    multisine,
    sample_times,
    spline,
    square_wave,
)
from jaxid.design.input_design import task_of
from jaxid.design.limits import PARTS, SHARPNESS, exact_maximum, ratios, smooth_maxima
from jaxid.design.objectives import Hypothesis
from jaxid.design.optimisation import optimise, within_limits

K, C = 1.5, 0.2
SPRING = Spring(jnp.array(K), jnp.array(C))
NOISE = OutputError(FixedNoise(jnp.array([SIGMA**2])))
T = sample_times(8.0, 0.1)
RELATIVE = Trace([1.0 / K**2, 1.0 / C**2])
LIMITS = Limits({"force": 1.0}, rate={"force": 8.0}, envelope={"x": (-0.8, 0.9)})
SHAPE = spline(T, 9)


class CubicSpring(AbstractModel):
    """The spring with a cubic force, and an input and a parameter without effect."""

    k: Array
    c: Array
    cubic: Array
    unused: Array
    states, inputs, outputs = ("x", "v"), ("force", "idle"), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1] - self.cubic * x[0] ** 3])

    def output(self, t, x, u):
        return x[:1] + 0.0 * self.unused


CUBIC = CubicSpring(*map(jnp.array, (K, C, 0.3, 1.0)))
CUBIC_LIMITS = Limits({"force": 1.0, "idle": 1.0}, envelope={"x": (-0.8, 0.9)})


@pytest.fixture(scope="module")
def conventional():
    inputs = conventional_inputs(T, 0.2, (0.12, 0.8), ("force",), start=0.3)
    return [inputs[name] for name in ("doublet", "3-2-1-1", "multisine")]


@pytest.fixture(scope="module")
def design(conventional):
    chosen = free(SPRING, "k", "c")
    return design_input(
        SPRING, chosen, T, SHAPE, RELATIVE, LIMITS, NOISE, conventional=conventional
    )


def test_derivative_of_objective_equals_finite_differences():
    """With the initial state free, whose elimination has a derivative of its own."""
    chosen = free(SPRING, "k", "c", per_record=("initial_state",))
    hypothesis = Hypothesis(SPRING, chosen.positions(SPRING), jnp.array([K, C, 0.2, -0.1]))
    objective = InformationObjective(hypothesis, RELATIVE, jnp.zeros((0, 2)), NOISE)
    t = T[:21]
    u = jnp.sin(1.3 * t)[:, None]
    evaluate = eqx.filter_jit(jax.value_and_grad(lambda u: objective.cost(t, u)))
    direction, h = jnp.cos(2.1 * t)[:, None], 1e-5
    ends = [evaluate(u + sign * h * direction)[0] for sign in (1, -1)]
    slope = jnp.sum(evaluate(u)[1] * direction)
    np.testing.assert_allclose(slope, (ends[0] - ends[1]) / (2 * h), rtol=1e-6)


def test_design_is_a_figure_and_a_dictionary_of_plain_numbers(design):
    force, x, _ = design.plot().axes
    np.testing.assert_array_equal(force.lines[0].get_ydata(), design.record.u[:, 0])
    assert x.get_title(loc="left") == "x"
    content = json.loads(json.dumps(design.to_dict()))
    assert content["inputs"]["force"] == np.asarray(design.record.u[:, 0]).tolist()
    assert set(content["standard_errors"]) == {"k", "c"}
    assert [row["name"] for row in content["comparisons"]] == ["doublet", "3-2-1-1", "multisine"]
    assert_has_printed_lines(design)


def test_design_beats_conventional_inputs_within_the_limits(design):
    """A logarithmic variance lower by 0.72 is a total standard error lower by 30 %."""
    best = min(comparison.within_limits for comparison in design.comparisons)
    assert design.cost < best - 0.72


def small_task():
    """The task of the spring's design."""
    task, _ = task_of(
        *(SPRING, free(SPRING, "k", "c"), T, SHAPE, RELATIVE, LIMITS, NOISE),
        axes=None,
        trim_input=None,
        initial_state=None,
        earlier=None,
        conventional=(),
    )
    return task


def test_input_that_cannot_be_scaled_to_the_limits_leaves_its_place_to_the_next():
    task = small_task()
    infinite, large = np.full((1, 9), np.nan), np.ones((1, 9))
    p, used = within_limits(task, [infinite, large])
    np.testing.assert_allclose(p / p[0, 0], large)
    assert 0.9 < np.max(used) <= 1.0
    with pytest.raises(InputError, match="does not keep its limits"):
        within_limits(task, [infinite])


def test_search_can_begin_at_trim():
    """The parameters are divided by the size of the start, which is zero there."""
    p, cost = optimise(small_task(), np.zeros((1, 9)))
    assert np.all(np.isfinite(p))
    assert np.isfinite(cost)


def test_maxima_of_parts_are_bounds_from_above():
    values = np.random.default_rng(1).normal(size=(77, 2))
    maxima = np.asarray(smooth_maxima(jnp.asarray(values))).reshape(PARTS, 2)
    length = -(-77 // PARTS)
    for part, bound in enumerate(maxima):
        block = values[part * length : (part + 1) * length]
        exact = np.max(block if len(block) else values[-1:], axis=0)
        assert np.all(bound >= exact)
        assert np.all(bound <= exact + np.log(length) / SHARPNESS)


def test_design_without_an_envelope():
    """A smooth maximum of no quantity has no value."""
    limits = Limits({"force": 1.0}, rate={"force": 8.0})
    free_motion = design_input(SPRING, free(SPRING, "k", "c"), T, SHAPE, RELATIVE, limits, NOISE)
    assert 0.9 < max(free_motion.limits_used.values()) <= 1.0
    assert set(free_motion.limits_used) == {"force, amplitude", "force, rate", "energy"}


def test_search_that_ends_outside_its_limits_is_scaled_to_them(design, conventional, monkeypatch):
    """Its end counts: 5 % outside, scaled back, the standard errors are those of the design."""

    def beyond(*arguments, **options):
        result = minimize(*arguments, **options)
        return SimpleNamespace(x=1.05 * result.x)

    monkeypatch.setattr("scipy.optimize.minimize", beyond)
    other = design_input(
        SPRING, free(SPRING, "k", "c"), T, SHAPE, RELATIVE, LIMITS, NOISE, conventional=conventional
    )
    assert max(other.limits_used.values()) <= 1.0
    np.testing.assert_allclose(other.cost, design.cost, atol=0.05)


def test_envelope_holds_in_an_independent_simulation(design):
    t, u = np.asarray(T), np.asarray(design.signal.u[:, 0])
    motion = solve_ivp(
        lambda time, x: [x[1], np.interp(time, t, u) - K * x[0] - C * x[1]],
        (t[0], t[-1]),
        [0.0, 0.0],
        t_eval=np.linspace(t[0], t[-1], 4 * t.size),
        max_step=0.05,
        rtol=1e-8,
    )
    assert motion.y[0].max() < 0.9 * (1 + 1e-4)
    assert motion.y[0].min() > -0.8 * (1 + 1e-4)
    assert np.max(np.abs(u)) <= 1.0
    assert np.max(np.abs(np.diff(u))) / 0.1 <= 8.0 + 1e-9
    assert max(design.limits_used.values()) > 0.9


def test_predicted_errors_are_those_of_the_record_to_fly(design):
    flown = information_of(SPRING, free(SPRING, "k", "c"), design.record, NOISE)
    np.testing.assert_allclose(design.information.standard_errors, flown.standard_errors, rtol=1e-8)
    variance = np.sum((flown.standard_errors / flown.values) ** 2)
    np.testing.assert_allclose(design.cost, np.log(variance), rtol=1e-8)
    assert "limits used: force, amplitude" in str(design)


def test_next_design_adds_more_than_the_first_flown_again(design, conventional):
    """Sequential design: at better values, with the information of the first flight."""
    better = Spring(jnp.array(2.4), jnp.array(0.3))
    chosen = free(better, "k", "c")
    flown = information_of(better, chosen, design.record, NOISE, initial_state=jnp.zeros(2))
    second = design_input(
        *(better, chosen, T, SHAPE, RELATIVE, LIMITS, NOISE),
        earlier=flown.factor,
        conventional=conventional,
    )
    repeated = np.concatenate([flown.factor, flown.factor])
    assert second.cost < np.log(RELATIVE.cost(repeated)) - 0.1
    variance = np.sum((second.information.standard_errors / np.array([K, C])) ** 2)
    np.testing.assert_allclose(second.cost, np.log(variance), rtol=1e-8)


def test_expected_chi_square_equals_least_squares_by_differences(design):
    """The linear spring against the cubic one: its refit from differences of SciPy's solutions."""
    cubic = CubicSpring(*map(jnp.array, (K, C, 0.3, 1.0)))
    record = design.record
    two = eqx.tree_at(lambda r: r.u, record, jnp.pad(record.u, ((0, 0), (0, 1))))

    def positions(k, c, third):
        t, u = np.asarray(T), np.asarray(record.u[:, 0])
        return solve_ivp(
            lambda s, x: [x[1], np.interp(s, t, u) - k * x[0] - c * x[1] - third * x[0] ** 3],
            (t[0], t[-1]),
            [0.0, 0.0],
            t_eval=t,
            max_step=0.05,
            rtol=1e-12,
            atol=1e-14,
        ).y[0]

    h = 1e-3  # of 1e-4, SciPy's own error of 1e-10 would be 0.1 % of the result
    S = [(positions(K + h, C, 0) - positions(K - h, C, 0)) / (2 * h)]
    S.append((positions(K, C + h, 0) - positions(K, C - h, 0)) / (2 * h))
    difference = (positions(K, C, 0.3) - positions(K, C, 0.0)) / SIGMA
    residual = np.linalg.lstsq(np.stack(S, 1) / SIGMA, difference, rcond=None)[1][0]
    linear = eqx.tree_at(lambda m: m.cubic, cubic, jnp.array(0.0))
    rival = linear, free(linear, "k", "c")
    expected = expected_chi_square((cubic, free(cubic, "k")), rival, two, NOISE)
    np.testing.assert_allclose(expected, residual, rtol=1e-3)
    # Records already flown hold the rival at its values.
    flown = np.array([[30.0, -2.0], [0.0, 20.0]])
    rows = np.concatenate([np.stack(S, 1) / SIGMA, flown])
    held = np.linalg.lstsq(rows, np.pad(difference, (0, 2)), rcond=None)[1][0]
    expected = expected_chi_square(
        (cubic, free(cubic, "k")), Explanation(*rival, flown), two, NOISE
    )
    np.testing.assert_allclose(expected, held, rtol=1e-3)
    assert held > 1.05 * residual


def test_impossible_designs_are_refused():
    def refuse(match, limits=CUBIC_LIMITS, names=("k", "c"), **options):
        with pytest.raises(InputError, match=match):
            design_input(CUBIC, free(CUBIC, *names), T, SHAPE, RELATIVE, limits, NOISE, **options)

    excluded = Limits({"force": 1.0, "idle": 1.0}, envelope={"x": (0.1, 0.5)})
    refuse("limits of 'x', 0.1 to 0.5, exclude the trim", excluded)
    refuse("'idle' has no effect on states or outputs")
    refuse("No input of these axes shows unused", names=("k", "unused"), axes=("force",))
    refuse("amplitude of the input 'force' has no limit", Limits({"idle": 1.0}))
    refuse("no input 'thrust'", axes=("thrust",))


@pytest.mark.parametrize("shape", [SHAPE, multisine(T, 0.1, 0.7)], ids=["spline", "multisine"])
def test_nearest_signal_of_shape(shape):
    p = np.random.default_rng(4).normal(size=shape.count)
    np.testing.assert_allclose(shape.nearest(np.asarray(shape.samples(p))), p, rtol=1e-8)
    assert square_wave(T, 3).nearest(np.ones(T.size)) is None


def test_rate_and_energy_are_of_the_times_of_the_samples():
    """A pulse of one sample in uneven times, against the sums by hand."""
    t = np.array([0.0, 0.2, 0.25, 0.3, 0.35])
    u = np.array([0.0, 0.0, 1.0, 1.0, 0.0])
    limits = Limits({"force": 1.0}, rate={"force": 10.0}, energy=0.5)
    model = Spring(jnp.array(1.0), jnp.array(0.1))
    given = ratios(limits, model, ("force",), jnp.zeros(2), jnp.zeros(1))
    used = dict(
        zip(
            given.labels(),
            given.of(jnp.asarray(t), jnp.asarray(u)[:, None], jnp.zeros((5, 0)), exact_maximum),
            strict=True,
        )
    )
    np.testing.assert_allclose(used["force, rate"], 1.0 / 0.05 / 10.0)
    np.testing.assert_allclose(used["energy"], 2 * 0.05 / 0.5)
