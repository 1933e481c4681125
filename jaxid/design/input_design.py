"""Design of an input by direct optimisation through the simulation of a nonlinear model (C.3.1)."""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_float64, require_known
from .._foundation.types import Array, Float, Numbers
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel, as_float, canonical
from ..models.free import Free
from ..simulation.linearise import linearise
from .design import Comparison, Design
from .explanations import (
    Explanation,
    as_explanation,
    hypothesis_of,
    known_information,
    separating_task,
)
from .information import (
    planned_information,
    planned_record,
    require_known_noise,
    require_shown,
    start_of,
)
from .limits import Limits, ratios
from .measures import AbstractMeasure
from .objectives import InformationObjective, RobustObjective
from .optimisation import (
    OPTIMISED,
    Task,
    deviations_of,
    in_chunks,
    optimise,
    scaled_starts,
    scales_of,
    summaries,
    within_limits,
)
from .shapes import AbstractShape, default_shape
from .signals import InputSignal

DIVERGES = "The model diverges under all random inputs within the limits. Lower the amplitude."


def design_input(
    model: AbstractModel,
    free: Free,
    t: Float[Numbers, " time"],
    shape: AbstractShape | None,
    measure: AbstractMeasure,
    limits: Limits,
    likelihood: AbstractLikelihood,
    *,
    axes: Sequence[str] | None = None,
    trim_input: Float[Numbers, " input"] | None = None,
    initial_state: Float[Numbers, " state"] | None = None,
    earlier: Float[Numbers, "row parameter"] | None = None,
    rival: Explanation | tuple[AbstractModel, Free] | None = None,
    draws: Float[Numbers, "draw parameter"] | None = None,
    worst: bool = False,
    conventional: Sequence[InputSignal] = (),
    seed: int = 0,
) -> Design:
    """Return the input within its limits that shows the free parameters best.

        min_p measure( M(u(p)) )    with  |u - u_trim| <= amplitude, |du/dt| <= rate,
                                    integral |u - u_trim|^2 dt <= energy, envelope of the motion

    Random starts, and those nearest to the conventional inputs, are scaled to the limits and
    compared in one batch; sequential quadratic programming improves the best, with derivatives of
    costs and limits through the simulation.

    Args:
        model: the model with declared values, whose motion must stay in the envelope.
        free: the parameters of the later estimate, with priors.
        t: sample times, uniform [s].
        shape: parametrised input, such as `spline(t, 12)`; None for a spline of up to 20 knots.
        measure: the measure to be minimised; with a rival it is only reported.
        limits: the limits.
        likelihood: the likelihood of the later estimate, with known noise.
        axes: inputs that move; all by default.
        trim_input: inputs at trim; zero by default.
        initial_state: state at trim; states beyond the given ones are zero.
        earlier: factor of the information of records already flown, in place of the priors, which
            that of a fit contains (`fit.information.triangle`).
        rival: another model with its free parameters; the input then separates it from `model`: the
            wrong one of both loses as much chi-square as possible, whichever is true. The envelope
            holds for both, and for values drawn from the uncertainty that the information of the
            records already flown leaves.
        draws: values of the shared free parameters, drawn from their uncertainty: the cost is then
            its average over the draws, and the envelope holds for each of them.
        worst: minimise the largest cost of the draws instead.
        conventional: inputs to compare, from which the search also starts.
        seed: of the random starts.

    Raises:
        InputError: when the limits exclude the trim, an axis moves nothing, no input of these axes
            shows a parameter, the noise is unknown, or no start has a finite simulation.
    """
    require_float64()
    task, information = task_of(
        *(model, free, t, shape, measure, limits, likelihood),
        axes=axes,
        trim_input=trim_input,
        initial_state=initial_state,
        earlier=earlier,
        conventional=conventional,
    )
    task = _with_objective(task, information, rival, draws, worst)
    starts, costs = checked_starts(task, information, free, seed, conventional)
    order = np.argsort(costs)[:OPTIMISED]
    require(bool(np.isfinite(costs[order[0]])), DIVERGES)
    results = [optimise(task, starts[index]) for index in order if np.isfinite(costs[index])]
    reached = [cost for _, cost in results]
    best = [results[k][0] for k in np.argsort(reached)] + [starts[index] for index in order]
    result = design_of(task, information, free, best, reached, conventional)
    if rival is None:
        return result
    return dataclasses.replace(result, chi_square=2.0 * float(np.exp(-result.cost)))


def task_of(
    model: AbstractModel,
    free: Free,
    t: Float[Numbers, " time"],
    shape: AbstractShape | None,
    measure: AbstractMeasure,
    limits: Limits,
    likelihood: AbstractLikelihood,
    *,
    axes: Sequence[str] | None,
    trim_input: Float[Numbers, " input"] | None,
    initial_state: Float[Numbers, " state"] | None,
    earlier: Float[Numbers, "row parameter"] | None,
    conventional: Sequence[InputSignal],
) -> tuple[Task, InformationObjective]:
    """Return the task of a design by its information, and this objective; arguments as for
    `design_input`.
    """
    axes = tuple(model.inputs) if axes is None else tuple(axes)
    require_known("input", axes, model.inputs)
    require(bool(axes), "No input moves. Name at least one of the model's inputs in `axes`.")
    likelihood = canonical(likelihood)
    require_known_noise(likelihood)
    t = as_float(t)
    state = start_of(model, initial_state)
    trim = jnp.zeros(len(model.inputs)) if trim_input is None else as_float(trim_input)
    _require_same_samples(conventional, model, t)
    model = canonical(model)
    arrays = ratios(limits, model, axes, state, trim)
    _require_control(model, axes, state, trim)
    hypothesis = hypothesis_of(model, free, state)
    information = InformationObjective(
        hypothesis=hypothesis,
        measure=measure,
        earlier=known_information(free, earlier),
        likelihood=likelihood,
    )
    none = (jnp.zeros((0, hypothesis.flat.size)),)
    shape = shape or default_shape(t)
    return Task(information, (hypothesis,), shape, arrays, t, trim, none), information


def checked_starts(
    task: Task,
    information: InformationObjective,
    free: Free,
    seed: int,
    conventional: Sequence[InputSignal],
) -> tuple[np.ndarray, np.ndarray]:
    """Return random starts and those nearest to conventional inputs, within the limits, with their
    costs; refuse free parameters that none of them shows.

    Args:
        task, information: the task, and the information on the free parameters.
        free: the free parameters.
        seed: of the random starts.
        conventional: inputs in the units of the inputs.
    """
    starts, costs, factors = scaled_starts(task, information, seed, conventional)
    finite = np.all(np.isfinite(factors), axis=(1, 2))
    require(bool(finite.any()), DIVERGES)
    model = information.hypothesis.model
    require_shown(model, free, factors[finite].reshape(-1, factors.shape[-1]))
    return starts, costs


def design_of(
    task: Task,
    information: InformationObjective,
    free: Free,
    inputs: Sequence[np.ndarray],
    starts: Sequence[float],
    conventional: Sequence[InputSignal],
) -> Design:
    """Return the design with the first of some inputs that can be scaled to the limits.

    Args:
        task: the task, whose objective is the cost of the design.
        information: the information on the free parameters.
        free: the free parameters.
        inputs: parameters of the shape, one row per axis, the best input first.
        starts: costs that the optimisation reached from its starts.
        conventional: inputs to compare.
    """
    hypothesis = information.hypothesis
    model, trim = hypothesis.model, task.trim_input
    p, used = within_limits(task, inputs)
    deviation = deviations_of(task, jnp.asarray(p)[None])[0]
    signal = InputSignal(task.t, deviation, model.inputs, "design")
    record = planned_record(
        *(model, signal, information.likelihood),
        trim_input=trim,
        initial_state=hypothesis.initial_state,
    )
    cost, factor = summaries(task, information, deviation[None])
    values = np.asarray(hypothesis.flat[hypothesis.positions.shared])
    return Design(
        signal,
        record,
        planned_information(model, free, values, factor[0], "design"),
        float(cost[0]),
        _comparisons(task, information, deviation, conventional),
        dict(zip(task.limits.labels(), used.tolist(), strict=True)),
        tuple(starts),
    )


def _with_objective(
    task: Task, information: InformationObjective, rival, draws, worst: bool
) -> Task:
    """Return the task with the objective that is requested."""
    require(
        rival is None or draws is None,
        "`rival` and `draws` together have no meaning here. Give one of them.",
    )
    if draws is not None:
        return _robust_task(task, information, draws, worst)
    return task if rival is None else separating_task(task, as_explanation(rival))


def _robust_task(task: Task, information: InformationObjective, draws, worst: bool) -> Task:
    """Return the task with the cost and the envelope over draws of the parameters."""
    values, hypothesis = as_float(draws), information.hypothesis
    positions = hypothesis.positions.shared
    require(
        values.ndim == 2 and values.shape[1] == positions.size and values.shape[0] > 0,
        f"The draws have shape {values.shape}, and there are {positions.size} free parameters. "
        "Give one row per draw.",
    )
    flat = jnp.tile(hypothesis.flat, (values.shape[0], 1)).at[:, positions].set(values)
    objective = RobustObjective(
        information=information,
        draws=flat,
        likelihood=information.likelihood,
        worst=jnp.asarray(worst),
    )
    return dataclasses.replace(task, objective=objective, draws=(flat,))


def _require_same_samples(conventional: Sequence[InputSignal], model: AbstractModel, t) -> None:
    for signal in conventional:
        require(
            signal.u.shape == (t.size, len(model.inputs)) and signal.inputs == model.inputs,
            f"The input {signal.name!r} has other samples or inputs than the design. Build it with "
            "the same times and the inputs of the model.",
        )


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


def _comparisons(
    task: Task,
    information: InformationObjective,
    deviation: Float[Array, "time input"],
    conventional: Sequence[InputSignal],
) -> tuple[Comparison, ...]:
    """Return the costs of conventional inputs at equal energy, at equal peak and at the limits."""
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
    limit = in_chunks(lambda chunk: scales_of(task, chunk), unit)[:, None, None]
    scaled = [np.sqrt(energy(design) / energy(u)) * u, peak(design) * unit, limit * unit]
    costs, _ = summaries(task, information, np.concatenate(scaled))
    return tuple(
        Comparison(signal.name, *map(float, row))
        for signal, row in zip(conventional, costs.reshape(3, -1).T, strict=True)
    )
