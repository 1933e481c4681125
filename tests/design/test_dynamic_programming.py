"""Square waves by dynamic programming: against the enumeration of all sequences, whose motions and
sensitivities are superposed from exact ones; carried information, envelope, refusals.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim
from small_spring import SIGMA, Spring

from jaxid import AbstractModel, FixedNoise, OutputError, free
from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.design import (
    Determinant,
    InputSignal,
    Limits,
    Trace,
    information_of,
    planned_record,
    sample_times,
    square_wave_design,
)
from jaxid.design.dynamic_programming import WEAK, _after_stage, _start
from jaxid.design.input_design import task_of
from jaxid.design.optimisation import REACHED
from jaxid.design.shapes import stages
from jaxid.effects import Augmented, InputDelay
from jaxid.simulation.hold import Cubic, ZeroOrder
from jaxid.simulation.steppers import RK4

K, C = 1.5, 0.2
SPRING = Spring(jnp.array(K), jnp.array(C))
NOISE = OutputError(FixedNoise(jnp.array([SIGMA**2])))
STAGE, T = 8, sample_times(5.6, 0.1)
RELATIVE = Trace([1.0 / K**2, 1.0 / C**2])
EARLIER = np.array([[30.0, 5.0], [0.0, 8.0]])
NO_MERGING = {"cells": 10**9, "width": 10**6}
RUNGE_KUTTA = 1e-4  # of the logarithmic variance, against exact motions
ENVELOPE = {"x": (-0.6, 0.7)}


class TwoForces(AbstractModel):
    """The spring with a second input, which drives its position."""

    k: Array
    c: Array
    states, inputs, outputs = ("x", "v"), ("force", "drive"), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1] + 0.4 * u[1], u[0] - self.k * x[0] - self.c * x[1]])


class Coupled(AbstractModel):
    """Two states and inputs, nonlinear, with direct feedthrough and a bias per record."""

    a: Array
    b: Array
    c: Array
    bias: Array
    states, inputs, outputs = ("x", "v"), ("first", "second"), ("x", "load")

    def rhs(self, t, x, u):
        force = u[0] - self.a * x[0] - self.b * x[1] - 0.3 * x[0] ** 3 + 0.1 * jnp.sin(t)
        return jnp.stack([x[1] + self.c * u[1], force])

    def output(self, t, x, u):
        return jnp.stack([x[0] + self.bias, self.b * x[1] ** 2 + self.c * u[1]])


class Enumeration:
    """All sequences of three levels of a spring: information and motion of each.

    Args:
        B: effect of the inputs on position and velocity.
        stage: samples of a stage.
        ramp: samples from one level to the next.
    """

    def __init__(self, B, stage, ramp=1):
        basis = np.asarray(stages(T, stage, ramp).basis)
        count, axes = basis.shape[1], B.shape[1]
        levels = itertools.product((-1.0, 0.0, 1.0), repeat=count * axes)
        self.levels = np.array(list(levels)).reshape(-1, count, axes)
        units = np.einsum("tk,ab->kabt", basis, np.eye(axes)).reshape(-1, axes, T.size)
        unit = np.stack([self.response(B, u.T, [0.0, 0.0]) for u in units])
        motion = np.einsum("su,utc->stc", self.levels.reshape(len(self.levels), -1), unit)
        self.states = motion[:, :, :2]
        still = np.zeros((T.size, axes))
        free = [self.response(B, still, start)[:, 0] for start in np.eye(2)]
        Q = np.linalg.qr(np.stack(free, axis=1))[0]  # the initial state is free, and eliminated
        S = motion[:, :, 2:] / SIGMA
        S = S - np.einsum("ta,ua,sup->stp", Q, Q, S)
        self.M = np.einsum("stp,stq->spq", S, S)
        u = np.einsum("tk,ska->sta", basis, self.levels)
        self.energy = 0.1 * np.sum(u**2, axis=(1, 2))
        self.rate = np.max(np.abs(np.diff(u, axis=1)), axis=(1, 2)) / 0.1

    @staticmethod
    def response(B, u, start):
        """Return x, v, dx/dk and dx/dc exactly, with a linear hold."""
        A = np.array([[0.0, 1.0], [-K, -C]])
        wide = np.kron(np.eye(3), A)
        wide[3, 0], wide[5, 1] = -1.0, -1.0  # the derivatives of A by k and c
        wide_B = np.concatenate([B, np.zeros((4, B.shape[1]))])
        system = wide, wide_B, np.eye(6), np.zeros((6, B.shape[1]))
        return lsim(system, u, np.asarray(T), [*start, 0, 0, 0, 0])[2][:, [0, 1, 2, 4]]

    def costs(self, earlier=None):
        """Return the logarithmic sum of squared relative errors of all sequences."""
        M = self.M if earlier is None else self.M + earlier.T @ earlier
        determinant = M[:, 0, 0] * M[:, 1, 1] - M[:, 0, 1] ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            cost = np.log((M[:, 1, 1] / K**2 + M[:, 0, 0] / C**2) / determinant)
        return np.where(np.isfinite(cost), cost, np.inf)

    def inside(self, limits):
        """Return which sequences keep the limits, with the margin of the search."""
        inside = self.energy <= (np.inf if limits.energy is None else limits.energy)
        inside &= self.rate <= min(limits.rate.values(), default=np.inf)
        for name, (low, high) in limits.envelope.items():
            values = self.states[:, :, ("x", "v").index(name)]
            inside &= (values.min(axis=1) >= REACHED * low) & (values.max(axis=1) <= REACHED * high)
        return inside


@pytest.fixture(scope="module")
def enumeration():
    return Enumeration(np.array([[0.0], [1.0]]), STAGE)


def chosen(model):
    return free(model, "k", "c", per_record=("initial_state",))


def spring_design(limits, **options):
    return square_wave_design(SPRING, chosen(SPRING), T, STAGE, RELATIVE, limits, NOISE, **options)


@pytest.mark.parametrize(
    ("options", "earlier"),
    [
        ({"envelope": ENVELOPE}, None),
        ({"envelope": {"x": (-0.4, 0.5)}}, None),
        ({"envelope": ENVELOPE}, EARLIER),
        ({"energy": 2.5}, None),
        ({"envelope": {"v": (-0.9, 1.2)}}, None),
    ],
    ids=["envelope", "narrow envelope", "earlier flight", "energy", "velocity"],
)
def test_search_without_merging_returns_the_best_of_all_sequences(enumeration, options, earlier):
    limits = Limits({"force": 1.0}, **options)
    result = spring_design(limits, earlier=earlier, **NO_MERGING)
    best = np.min(enumeration.costs(earlier)[enumeration.inside(limits)])
    np.testing.assert_allclose(result.cost, best, atol=RUNGE_KUTTA)
    assert max(result.limits_used.values()) <= 1.0
    levels = np.asarray(result.signal.u[:, 0])
    assert levels[0] == 0.0
    assert np.all(levels[1:].reshape(-1, STAGE) == levels[1::STAGE, None])
    assert set(levels) <= {-1.0, 0.0, 1.0}


def test_ramps_keep_the_limit_of_the_rate():
    """From -1 to 1 in two sample times: all steps are as long."""
    limits = Limits({"force": 1.0}, rate={"force": 15.0}, energy=3.0, envelope=ENVELOPE)
    every = Enumeration(np.array([[0.0], [1.0]]), STAGE, ramp=2)
    result = spring_design(limits, **NO_MERGING)
    best = np.min(every.costs()[every.inside(limits)])
    np.testing.assert_allclose(result.cost, best, atol=RUNGE_KUTTA)
    assert max(result.limits_used.values()) <= 1.0
    held = np.asarray(result.signal.u[1:, 0]).reshape(-1, STAGE)[:, 1:]
    assert np.all(held == held[:, :1])
    exact = spring_design(Limits({"force": 1.0}, rate={"force": 20.0}, envelope=ENVELOPE))
    assert exact.limits_used["force, amplitude"] == 1.0  # a rate that a step just keeps


def test_loss_by_merging(enumeration):
    """Measured in the logarithmic variance: 0.38, 0.32, 0.18, 0.09 and 0.22 with 2 to 6 cells (21 %
    in standard error at most, not steadily less with more cells), none with 8 and with 12.
    """
    limits = Limits({"force": 1.0}, envelope=ENVELOPE)
    costs = enumeration.costs()[enumeration.inside(limits)]
    coarse = np.array([spring_design(limits, cells=cells).cost for cells in range(2, 7)])
    loss = coarse - costs.min()
    assert np.all(loss > -RUNGE_KUTTA)
    assert np.all(coarse < np.quantile(costs, 0.1))
    assert np.max(loss) < 2.0 * np.log(1.25)
    fine = [spring_design(limits, cells=cells).cost for cells in (8, 12)]
    np.testing.assert_allclose(fine, costs.min(), atol=RUNGE_KUTTA)
    narrow = spring_design(limits, width=3)
    assert narrow.cost - costs.min() > 0.1


def test_two_axes_move_independently():
    """All 6561 sequences of four stages."""
    model, stage = TwoForces(jnp.array(K), jnp.array(C)), 14
    limits = Limits({"force": 1.0, "drive": 1.0}, envelope={"x": (-0.9, 0.8), "v": (-1.2, 1.2)})
    every = Enumeration(np.array([[0.0, 0.4], [1.0, 0.0]]), stage)
    best = np.min(every.costs()[every.inside(limits)])
    design = square_wave_design(
        model, chosen(model), T, stage, RELATIVE, limits, NOISE, **NO_MERGING
    )
    np.testing.assert_allclose(design.cost, best, atol=RUNGE_KUTTA)
    # the second axis adds information that the first alone does not have
    alone = square_wave_design(
        *(model, chosen(model), T, stage, RELATIVE, limits, NOISE), axes=("force",), **NO_MERGING
    )
    one = every.inside(limits) & np.all(every.levels[:, :, 1] == 0.0, axis=1)
    np.testing.assert_allclose(alone.cost, np.min(every.costs()[one]), atol=RUNGE_KUTTA)
    assert design.cost < alone.cost - 0.1


@pytest.mark.parametrize(
    "options", [{}, {"hold": ZeroOrder()}, {"stepper": RK4(2)}], ids=["linear", "zero", "fine"]
)
def test_carried_information_equals_that_of_the_final_signal(options):
    """With an initial state and a bias of the record, feedthrough, and correlated noise."""
    model = Coupled(*map(jnp.array, (1.2, 0.4, 0.5, 0.1)))
    likelihood = OutputError(FixedNoise(jnp.array([[4e-4, 1e-4], [1e-4, 9e-4]])), **options)
    parameters = free(model, "a", "b", "c", per_record=("initial_state", "bias"))
    t, stage, state = sample_times(4.0, 0.1), 10, jnp.array([0.1, -0.2])
    limits = Limits({"first": 0.8, "second": 0.5}, energy=9.0, envelope={"load": (-3.0, 4.0)})
    earlier = np.diag([3.0, 4.0, 5.0])
    task, information = task_of(
        *(model, parameters, t, stages(t, stage), Determinant(), limits, likelihood),
        axes=None,
        trim_input=np.array([0.1, -0.1]),
        initial_state=state,
        earlier=earlier,
        conventional=(),
    )
    levels = np.random.default_rng(3).choice([-1.0, 0.0, 0.5, 1.0], size=(4, 2))
    deviation = task.deviation(jnp.asarray(levels.T))

    @jax.jit
    def start(deviation):
        sequence = _start(task, information, deviation)
        return jax.tree.map(lambda leaf: leaf[None], sequence)

    @jax.jit
    def after_stage(times, sequence, level):
        return _after_stage(task, information, times, sequence, level[None])

    sequence = start(deviation)
    for number, level in enumerate(levels):
        times = t[number * stage : (number + 1) * stage + 1]
        sequence = after_stage(times, sequence, level)
    sequence = jax.tree.map(lambda leaf: leaf[0], sequence)

    u = deviation + task.trim_input[None]
    sensitivities = jax.jit(lambda u: information.hypothesis.sensitivities(t, u, likelihood))
    S = np.concatenate(sensitivities(u), axis=1)
    length = np.linalg.norm(S, axis=0)
    known = np.diag((WEAK * length) ** 2)
    known[3:, 3:] += earlier.T @ earlier
    carried = np.asarray(sequence.factor).T @ np.asarray(sequence.factor)
    scale = np.outer(length, length)
    np.testing.assert_allclose(carried / scale, (S.T @ S + known) / scale, atol=1e-12)

    signal = InputSignal(t, deviation, model.inputs)
    trim = {"trim_input": task.trim_input, "initial_state": state}
    record = planned_record(model, signal, likelihood, **trim)
    shown = information_of(
        *(model, parameters, record, likelihood), initial_state=state, earlier=earlier
    )
    pure = carried - np.diag((WEAK * length) ** 2)
    left = pure[3:, 3:] - pure[3:, :3] @ np.linalg.solve(pure[:3, :3], pure[:3, 3:])
    np.testing.assert_allclose(left, shown.factor.T @ shown.factor, rtol=1e-9)

    @jax.jit
    def largest_ratios(deviation):
        return task.ratios(t, deviation, lambda values: jnp.max(values, axis=0))[0]

    np.testing.assert_allclose(sequence.used, largest_ratios(deviation), rtol=1e-10, atol=1e-12)


def test_envelope_holds_in_an_independent_simulation_and_costs_information():
    """With the default cells, 20 s long: 3^20 sequences."""
    t, costs = sample_times(20.0, 0.1), []
    for high in (0.9, 0.6, 0.4):
        limits = Limits({"force": 1.0}, envelope={"x": (-high, high), "v": (-1.0, 1.0)})
        design = square_wave_design(SPRING, chosen(SPRING), t, 10, RELATIVE, limits, NOISE)
        times, u = np.asarray(t), np.asarray(design.signal.u[:, 0])
        motion = solve_ivp(
            lambda time, x, times=times, u=u: [
                x[1],
                np.interp(time, times, u) - K * x[0] - C * x[1],
            ],
            (0.0, 20.0),
            [0.0, 0.0],
            t_eval=np.linspace(0.0, 20.0, 2001),
            max_step=0.05,
            rtol=1e-8,
        )
        assert np.max(np.abs(motion.y[0])) <= high
        assert np.max(np.abs(motion.y[1])) <= 1.0
        assert max(design.limits_used.values()) <= 1.0
        costs.append(design.cost)
    assert costs[0] < costs[1] < costs[2]


def test_impossible_designs_are_refused():
    def refuse(match, limits=None, *, stage=STAGE, likelihood=NOISE, model=SPRING, **options):
        limits = limits or Limits({"force": 1.0}, envelope=ENVELOPE)
        with pytest.raises(InputError, match=match):
            square_wave_design(
                model, free(model, "k", "c"), T, stage, RELATIVE, limits, likelihood, **options
            )

    refuse("No input moves", axes=())
    refuse("Stages of 9 samples do not divide the 56 samples after the first", stage=9)
    refuse("Stages of 0 samples", stage=0)
    refuse(r"levels \(-1.0, 2.0\)", levels=(-1.0, 2.0))
    refuse("`width` is 0", width=0)
    excluded = Limits({"force": 1.0}, envelope={"x": (0.1, 0.5)})
    refuse("limits of 'x', 0.1 to 0.5, exclude the trim", excluded)
    one_side = Limits({"force": 1.0}, envelope={"x": (-0.2, 5.0)})
    refuse("until 0.8 s. The limit 'x, lower' excludes most", one_side, levels=(-1.0, -0.9))
    slow = Limits({"force": 1.0}, rate={"force": 2.4}, envelope=ENVELOPE)
    refuse("largest step lasts 9 samples, and a stage has 8", slow)
    narrow = Limits({"force": 1.0}, envelope={"x": (-0.25, 0.25)})
    refuse("inside the limits shows k, c. The limit 'x, lower' excludes most", narrow)
    smooth = OutputError(NOISE.noise, hold=Cubic())
    refuse("needs OutputError with the hold Linear", likelihood=smooth)
    delayed = Augmented(SPRING, (InputDelay(channel="force", gain=jnp.array(0.1)),))
    refuse("a delay, a sensor's lag", model=delayed)
