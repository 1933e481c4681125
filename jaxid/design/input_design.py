"""Design of an input by direct optimisation through the simulation of a nonlinear model (C.3.1)."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from .._foundation.checks import InputError, require, require_float64, require_known
from .._foundation.types import Array, Float, Numbers
from ..data.record import Record
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel, as_float, canonical
from ..models.free import Free
from ..models.names import flatten
from ..simulation.hold import AbstractHold, Linear
from ..simulation.linearise import linearise
from ..simulation.simulate import run
from ..simulation.steppers import RK4
from .information import (
    PlannedInformation,
    planned_information,
    planned_record,
    prior_rows,
)
from .limits import Limits, Ratios, exact_maximum, quantities, ratios, smooth_maximum
from .measures import AbstractMeasure
from .objectives import AbstractObjective, Discrimination, Hypothesis, InformationObjective
from .shapes import AbstractShape
from .signals import InputSignal

# Random starts that are compared, those of them that are optimised, and steps of the latter; number
# of steps that scale an input to its limits (all chosen).
STARTS, OPTIMISED, STEPS, SCALINGS = 48, 2, 80, 6
CHUNK = 8  # inputs that one compiled program simulates at once (chosen)
MARGIN = 0.95  # of the limits at which an optimisation begins (chosen)
FINER = 4  # factor of the sample rate in the final check of the envelope (chosen)
CHECKS = 4  # rounds of the final check, each with limits tighter by the violation (chosen)


class Comparison(NamedTuple):
    """Cost of a conventional input at the energy and at the peak of the design, and in its limits.

    A logarithmic cost: half the difference of two is the logarithm of a ratio of standard errors
    where the measure is a variance.
    """

    name: str
    equal_energy: float
    equal_peak: float
    within_limits: float


class Design(eqx.Module):
    """A designed input.

    Attributes:
        signal: deviations from trim.
        record: the noise-free record to fly.
        information: predicted standard errors.
        cost: cost of the objective; the logarithm of a measure that is a variance.
        comparisons: costs of conventional inputs.
        limits_used: share of each limit that the design uses, in a simulation at a sample rate four
            times higher; at most 1.
        starts: costs that the optimisation reached from its starts.
    """

    signal: InputSignal
    record: Record
    information: PlannedInformation
    cost: float = eqx.field(static=True)
    comparisons: tuple[Comparison, ...] = eqx.field(static=True)
    limits_used: dict[str, float] = eqx.field(static=True)
    starts: tuple[float, ...] = eqx.field(static=True)

    def __str__(self) -> str:
        width = max(len(name) for name in ("conventional", *(c.name for c in self.comparisons)))
        lines = [str(self.information), "", f"cost of the design {self.cost:.4g}"]
        lines.append(
            f"{'conventional':<{width}} {'equal energy':>13} {'equal peak':>11} {'limits':>9}"
        )
        for name, energy, peak, within in self.comparisons:
            lines.append(f"{name:<{width}} {energy:>13.4g} {peak:>11.4g} {within:>9.4g}")
        used = [f"{name} {100 * share:.0f} %" for name, share in self.limits_used.items()]
        return "\n".join([*lines, f"limits used: {', '.join(used)}"])


class Task(eqx.Module):
    """Everything that the compiled functions of a design need.

    Attributes:
        objective: cost of the samples of the input.
        hypothesis: model for the envelope.
        shape: parametrised input.
        limits: the limits.
        t: sample times [s].
        trim_input: inputs at trim.
    """

    objective: AbstractObjective
    hypothesis: Hypothesis
    shape: AbstractShape
    limits: Ratios
    t: Float[Array, " time"]
    trim_input: Float[Array, " input"]

    def deviation(self, p: Float[Array, "axis parameter"]) -> Float[Array, "time input"]:
        """Return the samples of the inputs, less their values at trim."""
        moved = jax.vmap(self.shape.samples)(p).T * self.limits.amplitude[None]
        zero = jnp.zeros((self.t.size, self.trim_input.size))
        return zero.at[:, np.array(self.limits.axes, int)].set(moved)

    def cost(self, deviation: Float[Array, "time input"]) -> Float[Array, ""]:
        """Return the cost of an input."""
        return self.objective.cost(self.t, deviation + self.trim_input[None])

    def ratios(self, deviation, largest) -> Float[Array, " ratio"]:
        """Return the limited quantities over their limits."""
        hold, stepper = _integration(self.objective.likelihood)
        u = deviation + self.trim_input[None]
        model = self.hypothesis.model
        solution = run(model, self.t, u, self.hypothesis.initial_state, hold, stepper)
        values = quantities(model, self.limits.names, solution, u)
        return self.limits.of(self.t, deviation, values, largest)

    def scale(self, deviation: Float[Array, "time input"]) -> Float[Array, ""]:
        """Return the factor with which an input reaches its limits."""

        def worst(factor):
            return jnp.max(self.ratios(factor * deviation, exact_maximum))

        def step(_, factor):
            value = worst(factor)
            change = jnp.where(jnp.isfinite(value), 1.0 / jnp.maximum(value, 1e-3), 0.5)
            return factor * jnp.clip(change, 0.3, 10.0)

        factor = jax.lax.fori_loop(0, SCALINGS, step, jnp.ones(()))
        value = worst(factor)
        return factor / jnp.maximum(jnp.where(jnp.isfinite(value), value, 2.0), 1.0)


def design_input(
    model: AbstractModel,
    free: Free,
    t: Float[Numbers, " time"],
    shape: AbstractShape,
    measure: AbstractMeasure,
    limits: Limits,
    likelihood: AbstractLikelihood,
    *,
    axes: Sequence[str] | None = None,
    trim_input: Float[Numbers, " input"] | None = None,
    initial_state: Float[Numbers, " state"] | None = None,
    earlier: Float[Numbers, "row parameter"] | None = None,
    rival: tuple[AbstractModel, Free] | None = None,
    conventional: Sequence[InputSignal] = (),
    seed: int = 0,
) -> Design:
    """Return the input within its limits that shows the free parameters best.

        min_p measure( M(u(p)) )    with  |u - u_trim| <= amplitude, |du/dt| <= rate,
                                    integral |u - u_trim|^2 dt <= energy, envelope of the motion

    Random starts are scaled to the limits and compared in one batch; sequential quadratic
    programming improves the best, with derivatives of costs and limits through the simulation.

    Args:
        model: the model with declared values, of which the envelope must hold.
        free: the parameters of the later estimate, with priors.
        t: sample times, uniform [s].
        shape: parametrised input, such as `spline(t, 12)`.
        measure: the measure to be minimised; with a rival it is only reported.
        limits: the limits.
        likelihood: the likelihood of the later estimate, with known noise.
        axes: inputs that move; all by default.
        trim_input: inputs at trim; zero by default.
        initial_state: state at trim; zero by default.
        earlier: factor of the information of records already flown.
        rival: another model with its free parameters; the input then separates it from `model`, in
            the sense that it loses as much chi-square as possible if `model` is true.
        conventional: inputs to compare.
        seed: of the random starts.

    Raises:
        InputError: when the limits exclude the trim, an axis moves nothing, no input of these axes
            shows a parameter, the noise is unknown, or no start has a finite simulation.
    """
    require_float64()
    axes = tuple(model.inputs) if axes is None else tuple(axes)
    require_known("input", axes, model.inputs)
    likelihood = canonical(likelihood)
    require(
        likelihood.noise.is_known,
        "The noise covariance is unknown. Give the instruments' noise: OutputError(FixedNoise(R)).",
    )
    t = as_float(t)
    zero_state, zero_input = jnp.zeros(len(model.states)), jnp.zeros(len(model.inputs))
    state = zero_state if initial_state is None else as_float(initial_state)
    trim = zero_input if trim_input is None else as_float(trim_input)
    model = canonical(model)
    arrays = ratios(limits, model, axes, state, trim)
    _require_control(model, axes, state, trim)
    hypothesis = _hypothesis(model, free, state)
    known = np.concatenate(
        [
            prior_rows(free),
            np.zeros((0, len(free.shared))) if earlier is None else np.array(earlier),
        ]
    )
    information = InformationObjective(hypothesis, measure, jnp.asarray(known), likelihood)
    objective = information
    if rival is not None:
        other = _hypothesis(canonical(rival[0]), rival[1], state)
        objective = Discrimination(hypothesis, other, likelihood)
    task = Task(objective, hypothesis, shape, arrays, t, trim)
    starts, costs, factors = _starts(task, information, seed)
    _require_shown(model, free, factors)
    order = np.argsort(costs)[:OPTIMISED]
    require(
        bool(np.isfinite(costs[order[0]])),
        "The model diverges under all random inputs within the limits. Lower the amplitude.",
    )
    results = [_optimise(task, starts[index]) for index in order if np.isfinite(costs[index])]
    p, _ = min(results, key=lambda result: result[1])
    p, used = _checked(task, p)
    deviation = _deviations(task, jnp.asarray(p)[None])[0]
    signal = InputSignal(t, deviation, model.inputs, "design")
    record = planned_record(model, signal, likelihood, trim_input=trim, initial_state=state)
    cost, factor = _summaries(task, information, deviation[None])
    values = np.asarray(hypothesis.flat[hypothesis.positions.shared])
    return Design(
        signal,
        record,
        planned_information(model, free, values, factor[0], "design"),
        float(cost[0]),
        _comparisons(task, information, deviation, conventional),
        dict(zip(arrays.labels(), used.tolist(), strict=True)),
        tuple(cost for _, cost in results),
    )


def expected_chi_square(
    true: tuple[AbstractModel, Free],
    wrong: tuple[AbstractModel, Free],
    record: Record,
    likelihood: AbstractLikelihood,
    *,
    initial_state: Float[Numbers, " state"] | None = None,
) -> float:
    """Return the chi-square by which a wrong hypothesis loses on an input, after its refit.

    Args:
        true: the hypothesis assumed to be true, and its free parameters.
        wrong: the rival, with the same inputs and outputs.
        record: a record with the input.
        likelihood: the likelihood with known noise.
        initial_state: state at the first sample; zero by default.
    """
    first, second = (
        _hypothesis(
            canonical(model),
            free,
            jnp.zeros(len(model.states)) if initial_state is None else as_float(initial_state),
        )
        for model, free in (true, wrong)
    )
    objective = Discrimination(first, second, canonical(likelihood))
    return float(_chi_square(objective, record.t, record.u))


def _hypothesis(model: AbstractModel, free: Free, state) -> Hypothesis:
    vector, _ = flatten(model)
    extra = jnp.zeros(len(model.states) - state.size)
    return Hypothesis(model, free.positions(model), jnp.concatenate([vector, state, extra]))


def _integration(likelihood: AbstractLikelihood) -> tuple[AbstractHold, Any]:
    return getattr(likelihood, "hold", Linear()), getattr(likelihood, "stepper", RK4())


def _require_control(model: AbstractModel, axes, state, trim) -> None:
    point = linearise(model, 0.0, state, trim)
    for axis in axes:
        column = model.inputs.index(axis)
        effect = np.concatenate([np.asarray(point.B)[:, column], np.asarray(point.D)[:, column]])
        require(
            bool(np.any(effect != 0)),
            f"The input {axis!r} has no effect on states or outputs at trim: an axis without "
            "control. Leave it out of `axes`.",
        )


def _require_shown(model: AbstractModel, free: Free, factors: np.ndarray) -> None:
    """Refuse parameters that no random input shows, even all of them together."""
    finite = np.all(np.isfinite(factors), axis=(1, 2))
    require(
        bool(finite.any()),
        "The model diverges under all random inputs within the limits. Lower the amplitude.",
    )
    together = factors[finite].reshape(-1, factors.shape[-1])
    values = np.zeros(len(free.shared))
    shown = planned_information(model, free, values, together, "random inputs")
    if shown.undetermined:
        weak = "; ".join(shown.weak_directions) or "their sensitivity is zero"
        raise InputError(
            f"No input of these axes shows {', '.join(shown.undetermined)}: {weak}. Fix a "
            "parameter, give a prior, or move another axis."
        )


def _starts(task: Task, information: InformationObjective, seed: int):
    """Return random starts scaled to the limits, their costs and their information."""
    rng = np.random.default_rng(seed)
    columns = [task.shape.starts(rng, STARTS) for _ in task.limits.axes]
    p = jnp.asarray(np.stack(columns, axis=1))
    deviations = _deviations(task, p)
    factor = MARGIN * _in_chunks(lambda chunk: _scales(task, chunk), deviations)
    costs, factors = _summaries(task, information, deviations * factor[:, None, None])
    p = np.stack([task.shape.scaled(*pair) for pair in zip(p, jnp.asarray(factor), strict=True)])
    return p, costs, factors


@eqx.filter_jit
def _deviations(task: Task, p):
    return jax.vmap(task.deviation)(p)


@eqx.filter_jit
def _scales(task: Task, deviations):
    return jax.vmap(task.scale)(deviations)


def _summaries(task: Task, information: InformationObjective, deviations):
    """Return costs, infinite where not finite, and square-root information of inputs."""
    costs, factors = _in_chunks(lambda chunk: _summary(task, information, chunk), deviations)
    return np.where(np.isfinite(costs), costs, np.inf), factors


@eqx.filter_jit
def _summary(task: Task, information: InformationObjective, deviations):
    def at(deviation):
        u = deviation + task.trim_input[None]
        return task.cost(deviation), jnp.linalg.qr(information.factor(task.t, u), mode="r")

    return jax.vmap(at)(deviations)


def _in_chunks(function, deviations):
    """Return the results of a function of a fixed number of inputs for all, in NumPy."""
    count = deviations.shape[0]
    padded = np.pad(np.asarray(deviations), ((0, -count % CHUNK), (0, 0), (0, 0)), mode="edge")
    chunks = np.split(padded, padded.shape[0] // CHUNK)
    results = [function(jnp.asarray(chunk)) for chunk in chunks]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *results)


def _optimise(task: Task, start: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the parameters and the cost that sequential quadratic programming reaches."""
    shape = start.shape
    memory: dict[bytes, tuple[np.ndarray, ...]] = {}

    def evaluate(p):
        key = p.tobytes()
        if key not in memory:
            memory.clear()
            memory[key] = tuple(map(np.asarray, _evaluate(task, jnp.asarray(p.reshape(shape)))))
        return memory[key]

    def cost(p):
        value = float(evaluate(p)[0])
        return value if np.isfinite(value) else 1e6

    result = minimize(
        cost,
        start.ravel(),
        jac=lambda p: np.nan_to_num(evaluate(p)[1].ravel()),
        constraints={
            "type": "ineq",
            "fun": lambda p: np.nan_to_num(1.0 - evaluate(p)[2], nan=-1e3),
            "jac": lambda p: np.nan_to_num(-evaluate(p)[3].reshape(-1, p.size)),
        },
        method="SLSQP",
        options={"maxiter": STEPS, "ftol": 1e-6},
    )
    feasible = np.all(1.0 - evaluate(result.x)[2] > -1e-3)
    if not (feasible and np.isfinite(result.fun) and cost(result.x) <= cost(start.ravel())):
        return start, cost(start.ravel())
    return result.x.reshape(shape), cost(result.x)


@eqx.filter_jit
def _evaluate(task: Task, p):
    """Return cost and limits with their derivatives. Limits that are never reached are constant."""

    def limited(p):
        return jnp.minimum(task.ratios(task.deviation(p), smooth_maximum), 1e3)

    value, slope = jax.value_and_grad(lambda p: task.cost(task.deviation(p)))(p)
    return value, slope, limited(p), jax.jacfwd(limited)(p)


def _checked(task: Task, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters scaled so that the limits hold in a finer simulation.

    Raises:
        InputError: when the limits do not hold after several scalings.
    """
    for _ in range(CHECKS):
        used = np.asarray(_fine_ratios(task, jnp.asarray(p)))
        if np.all(used <= 1.0):
            return p, used
        p = np.asarray(task.shape.scaled(jnp.asarray(p), jnp.asarray(0.995 / np.max(used))))
    raise InputError(
        f"In a simulation at {FINER} times the sample rate the design does not keep its limits. "
        "Shorten the sample time."
    )


@eqx.filter_jit
def _fine_ratios(task: Task, p):
    """Return the ratios of a simulation at a higher rate, with the input as the hold gives it."""
    hold, stepper = _integration(task.objective.likelihood)
    deviation = task.deviation(p)
    path = hold.path(task.t, deviation)
    count = FINER * (task.t.size - 1)
    fine = task.t[0] + (task.t[-1] - task.t[0]) * jnp.arange(count + 1) / count
    between = jax.vmap(path)(fine)
    u = between + task.trim_input[None]
    model = task.hypothesis.model
    solution = run(model, fine, u, task.hypothesis.initial_state, hold, stepper)
    values = quantities(model, task.limits.names, solution, u)
    exact = task.limits.of(fine, between, values, exact_maximum)
    # A rate is limited from sample to sample: a zero-order hold jumps in between.
    coarse = task.limits.of(task.t, deviation, values[::FINER], exact_maximum)
    n_axes = len(task.limits.axes)
    return exact.at[n_axes : 2 * n_axes].set(coarse[n_axes : 2 * n_axes])


def _comparisons(
    task: Task,
    information: InformationObjective,
    deviation: Float[Array, "time input"],
    conventional: Sequence[InputSignal],
) -> tuple[Comparison, ...]:
    """Return the costs of conventional inputs at equal energy, at equal peak and at the limits."""
    for signal in conventional:
        require(
            signal.u.shape == deviation.shape and signal.inputs == task.hypothesis.model.inputs,
            f"The input {signal.name!r} has other samples or inputs than the design. Build it with "
            "the same times and the inputs of the model.",
        )
    if not conventional:
        return ()
    axes = list(task.limits.axes)
    amplitude = np.asarray(task.limits.amplitude)
    design = np.asarray(deviation)
    u = np.stack([np.asarray(signal.u) for signal in conventional])

    def peak(u):
        return np.max(np.abs(u[..., axes]) / amplitude, axis=(-2, -1))[..., None, None]

    def energy(u):
        return np.sum(u**2, axis=(-2, -1))[..., None, None]

    unit = u / peak(u)
    limit = _in_chunks(lambda chunk: _scales(task, chunk), unit)[:, None, None]
    scaled = [np.sqrt(energy(design) / energy(u)) * u, peak(design) * unit, limit * unit]
    costs, _ = _summaries(task, information, np.concatenate(scaled))
    return tuple(
        Comparison(signal.name, *map(float, row))
        for signal, row in zip(conventional, costs.reshape(3, -1).T, strict=True)
    )


@eqx.filter_jit
def _chi_square(objective: Discrimination, t, u):
    return objective.chi_square(t, u)
