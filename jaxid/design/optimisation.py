"""Optimisation of a parametrised input through the simulation, within limits."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy

from .._foundation.checks import InputError
from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Float
from ..estimation.likelihoods import AbstractLikelihood
from ..simulation.hold import AbstractHold, Linear
from ..simulation.simulate import run
from ..simulation.steppers import RK4
from .limits import Ratios, exact_maximum, quantities, smooth_maxima
from .objectives import AbstractObjective, Hypothesis, InformationObjective
from .shapes import AbstractShape
from .signals import InputSignal

# Random starts that are compared, those of them that are optimised, and steps of the latter; number
# of steps that scale an input to its limits (all chosen).
RANDOM_INPUTS, OPTIMISED, SQP_STEPS, SCALINGS = 48, 2, 80, 6
CHUNK = 8  # inputs that one compiled program simulates at once (chosen)
MARGIN = 0.95  # of the limits at which an optimisation begins (chosen)
# Share of its limits to which an input is scaled, so that a finer simulation keeps them (chosen).
REACHED = 0.995
FINER = 4  # factor of the sample rate in the final check of the envelope (chosen)
CHECKS = 4  # rounds of the final check, each with limits tighter by the violation (chosen)


class Task(eqx.Module):
    """Everything that the compiled functions of a design need.

    Attributes:
        objective: cost of the samples of the input.
        hypotheses: models whose motion must stay in the envelope.
        shape: parametrised input.
        limits: the limits.
        t: sample times [s].
        trim_input: inputs at trim.
        draws: for each hypothesis, further values of all its parameters and the initial state, for
            which the motion must stay in the envelope too.
    """

    objective: AbstractObjective
    hypotheses: tuple[Hypothesis, ...]
    shape: AbstractShape
    limits: Ratios
    t: Float[Array, " time"]
    trim_input: Float[Array, " input"]
    draws: tuple[Float[Array, "draw flat"], ...]

    def deviation(self, p: Float[Array, "axis parameter"]) -> Float[Array, "time input"]:
        """Return the samples of the inputs, less their values at trim."""
        moved = jax.vmap(self.shape.samples)(p).T * self.limits.amplitude[None]
        zero = jnp.zeros((self.t.size, self.trim_input.size))
        return zero.at[:, np.array(self.limits.axes, int)].set(moved)

    def cost(self, deviation: Float[Array, "time input"]) -> Float[Array, ""]:
        """Return the cost of an input."""
        return self.objective.cost(self.t, deviation + self.trim_input[None])

    def ratios(self, t, deviation, largest) -> Float[Array, "hypothesis ratio"]:
        """Return the limited quantities over their limits, under each hypothesis.

        Args:
            t: sample times [s].
            deviation: inputs at these times, less their values at trim.
            largest: function that returns the maximum over time, or over parts of it.
        """
        hold, stepper = integration_of(self.objective.likelihood)
        u = deviation + self.trim_input[None]

        def of(hypothesis: Hypothesis):
            solution = run(hypothesis.model, t, u, hypothesis.initial_state, hold, stepper)
            values = quantities(hypothesis.model, self.limits.names, solution, u)
            return self.limits.of(t, deviation, values, largest)

        rows = [of(hypothesis)[None] for hypothesis in self.hypotheses]
        for hypothesis, draws in zip(self.hypotheses, self.draws, strict=True):
            if draws.shape[0]:  # an empty loop would still be compiled
                rows.append(jax.vmap(lambda flat, drawn=hypothesis: of(drawn.at(flat)))(draws))
        return jnp.concatenate(rows)

    def scale(self, deviation: Float[Array, "time input"]) -> Float[Array, ""]:
        """Return the factor with which an input reaches `REACHED` of its limits."""

        def worst(factor):
            return jnp.max(self.ratios(self.t, factor * deviation, exact_maximum)) / REACHED

        def step(_, factor):
            value = worst(factor)
            change = jnp.where(jnp.isfinite(value), 1.0 / jnp.maximum(value, 1e-3), 0.5)
            return factor * jnp.clip(change, 0.3, 10.0)

        factor = jax.lax.fori_loop(0, SCALINGS, step, jnp.ones(()))
        value = worst(factor)
        return factor / jnp.maximum(jnp.where(jnp.isfinite(value), value, 2.0), 1.0)


def integration_of(likelihood: AbstractLikelihood) -> tuple[AbstractHold, Any]:
    """Return the hold and the stepper of a likelihood, or the default ones."""
    return getattr(likelihood, "hold", Linear()), getattr(likelihood, "stepper", RK4())


def scaled_starts(
    task: Task, information: InformationObjective, seed: int, conventional: Sequence[InputSignal]
):
    """Return random starts and those nearest to conventional inputs, scaled to the limits, with
    their costs and their information.
    """
    rng = np.random.default_rng(seed)
    columns = [task.shape.starts(rng, RANDOM_INPUTS) for _ in task.limits.axes]
    p = jnp.asarray(np.concatenate([np.stack(columns, axis=1), *_nearest(task, conventional)]))
    deviations = deviations_of(task, p)
    factor = MARGIN * in_chunks(lambda chunk: scales_of(task, chunk), deviations)
    costs, factors = summaries(task, information, deviations * factor[:, None, None])
    p = np.stack([task.shape.scaled(*pair) for pair in zip(p, jnp.asarray(factor), strict=True)])
    return p, costs, factors


def _nearest(task: Task, conventional: Sequence[InputSignal]) -> list[np.ndarray]:
    """Return the parameters of the signals nearest to conventional inputs of peak 1."""
    starts = []
    for signal in conventional:
        u = np.asarray(signal.u)
        moved = u[:, list(task.limits.axes)] / np.asarray(task.limits.amplitude)
        start = nearest_input(task, u / max(np.max(np.abs(moved)), np.finfo(float).tiny))
        if start is not None:
            starts.append(start[None])
    return starts


def nearest_input(
    task: Task, deviation: Float[np.ndarray, "time input"]
) -> Float[np.ndarray, "axis parameter"] | None:
    """Return the parameters of the shape nearest to an input; None if the shape has no nearest one.

    Args:
        task: the task.
        deviation: samples of all inputs, less their values at trim.
    """
    moved = deviation[:, list(task.limits.axes)] / np.asarray(task.limits.amplitude)
    nearest = [task.shape.nearest(column) for column in moved.T]
    defined = [column for column in nearest if column is not None]
    return np.stack(defined) if len(defined) == len(nearest) else None


@fast_compile_jit
def deviations_of(task: Task, p):
    return jax.vmap(task.deviation)(p)


@fast_compile_jit
def scales_of(task: Task, deviations):
    return jax.vmap(task.scale)(deviations)


def summaries(task: Task, information: InformationObjective, deviations):
    """Return costs, infinite where not finite, and square-root information of inputs."""
    costs, factors = in_chunks(lambda chunk: _summary(task, information, chunk), deviations)
    return np.where(np.isfinite(costs), costs, np.inf), factors


@fast_compile_jit
def _summary(task: Task, information: InformationObjective, deviations):
    def at(deviation):
        u = deviation + task.trim_input[None]
        return task.cost(deviation), jnp.linalg.qr(information.factor(task.t, u), mode="r")

    return jax.vmap(at)(deviations)


def in_chunks(function, inputs, size: int = CHUNK):
    """Return the results of a function of a fixed number of inputs for all, in NumPy.

    Args:
        function: function of some inputs.
        inputs: a tree of arrays with all inputs along their first axes.
        size: number of inputs at once; the last ones are repeated to fill it.
    """
    leaves, structure = jax.tree.flatten(inputs)
    count = leaves[0].shape[0]
    rows = np.minimum(np.arange(count + -count % size), count - 1).reshape(-1, size)
    chunks = [[jnp.asarray(np.asarray(leaf)[row]) for leaf in leaves] for row in rows]
    results = [function(jax.tree.unflatten(structure, chunk)) for chunk in chunks]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *results)


def optimise(task: Task, start: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the parameters and the cost that sequential quadratic programming reaches.

    Its first step is as long as the gradient, so the parameters are divided by the size of the
    start. It often ends a little outside its limits. The best of its points inside counts, and its
    end scaled to the limits; scaling alone fails where the motion is unstable.
    """
    shape, size = start.shape, float(np.max(np.abs(start))) or 1.0
    memory: dict[bytes, tuple[np.ndarray, ...]] = {}
    inside: list[tuple[np.ndarray, float]] = []

    def evaluate(p):
        key = p.tobytes()
        if key not in memory:
            memory.clear()
            at = jnp.asarray(size * p.reshape(shape))
            memory[key] = tuple(map(np.asarray, _evaluate(task, at)))
            value, _, used, _ = memory[key]
            if np.all(used <= 1.0) and np.isfinite(value):
                inside.append((np.asarray(at), float(value)))
        return memory[key]

    def cost(p):
        value = float(evaluate(p)[0])
        return value if np.isfinite(value) else 1e6

    result = scipy.optimize.minimize(
        cost,
        start.ravel() / size,
        jac=lambda p: np.nan_to_num(size * evaluate(p)[1].ravel()),
        constraints={
            "type": "ineq",
            "fun": lambda p: np.nan_to_num(REACHED - evaluate(p)[2], nan=-1e3),
            "jac": lambda p: np.nan_to_num(-size * evaluate(p)[3].reshape(-1, p.size)),
        },
        method="SLSQP",
        options={"maxiter": SQP_STEPS, "ftol": 1e-6},
    )
    end = reaching_limits(task, size * result.x.reshape(shape), 1.0)
    ends = [(p, cost(p.ravel() / size)) for p in (start, end)]
    return min([*ends, *inside], key=lambda pair: pair[1])


def reaching_limits(task: Task, p: np.ndarray, largest: float = np.inf) -> np.ndarray:
    """Return the parameters of the input times the factor with which it reaches its limits.

    Args:
        task: the task.
        p: parameters of the shape, one row per axis.
        largest: limit of the factor; 1 only shrinks the input of a search that ended a little
            outside, as quadratic programming often does.
    """
    deviation = deviations_of(task, jnp.asarray(p)[None])
    factor = min(float(in_chunks(lambda chunk: scales_of(task, chunk), deviation)[0]), largest)
    return np.asarray(task.shape.scaled(jnp.asarray(p), jnp.asarray(factor)))


@fast_compile_jit
def _evaluate(task: Task, p):
    """Return cost and limits with their derivatives. Limits that are never reached are constant."""

    def limited(p):
        ratios = task.ratios(task.t, task.deviation(p), smooth_maxima)
        return jnp.minimum(ratios.ravel(), 1e3)

    value, slope = jax.value_and_grad(lambda p: task.cost(task.deviation(p)))(p)
    return value, slope, limited(p), jax.jacfwd(limited)(p)


def within_limits(task: Task, inputs: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return parameters of the first input that, scaled, keeps the limits in a finer simulation,
    and its ratios there.

    Args:
        task: the task.
        inputs: parameters of inputs, the best first.

    Raises:
        InputError: when the limits hold for none of them after several scalings.
    """
    for p in inputs:
        for _ in range(CHECKS):
            used = np.asarray(_fine_ratios(task, jnp.asarray(p)))
            if np.all(used <= 1.0):
                return p, used
            p = np.asarray(task.shape.scaled(jnp.asarray(p), jnp.asarray(REACHED / np.max(used))))
    raise InputError(
        f"In a simulation at {FINER} times the sample rate the design does not keep its limits. "
        "Shorten the sample time."
    )


@fast_compile_jit
def _fine_ratios(task: Task, p):
    """Return the ratios of a simulation at a higher rate, with the input as the hold gives it."""
    hold, _ = integration_of(task.objective.likelihood)
    deviation = task.deviation(p)
    path = hold.path(task.t, deviation)
    count = FINER * (task.t.size - 1)
    fine = task.t[0] + (task.t[-1] - task.t[0]) * jnp.arange(count + 1) / count
    exact = jnp.max(task.ratios(fine, jax.vmap(path)(fine), exact_maximum), axis=0)
    # A rate is limited from sample to sample: a zero-order hold jumps in between.
    coarse = jnp.max(task.ratios(task.t, deviation, exact_maximum), axis=0)
    n_axes = len(task.limits.axes)
    return exact.at[n_axes : 2 * n_axes].set(coarse[n_axes : 2 * n_axes])
