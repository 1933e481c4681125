"""Design of an input by direct optimisation through the simulation of a nonlinear model (C.3.1)."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_float64, require_known
from .._foundation.compiler import fast_compile_jit
from .._foundation.notebook import preformatted
from .._foundation.types import Array, Float, Numbers
from ..data.record import Record
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel, as_float, canonical
from ..models.free import Free
from ..models.names import flatten
from ..simulation.linearise import linearise
from .information import (
    PlannedInformation,
    planned_information,
    planned_record,
    prior_rows,
    require_known_noise,
)
from .limits import Limits, ratios
from .measures import AbstractMeasure
from .objectives import Discrimination, Hypothesis, InformationObjective
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
from .shapes import AbstractShape
from .signals import InputSignal


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

    def to_dict(self) -> dict[str, Any]:
        """Return the input, its limits and the expected standard errors as plain numbers."""
        errors = np.asarray(self.information.standard_errors).tolist()
        return {
            "t": np.asarray(self.signal.t).tolist(),
            "inputs": {
                name: values.tolist()
                for name, values in zip(
                    self.signal.inputs, np.asarray(self.record.u).T, strict=True
                )
            },
            "standard_errors": dict(zip(self.information.names, errors, strict=True)),
            "weak_directions": list(self.information.weak_directions),
            "cost": self.cost,
            "comparisons": [comparison._asdict() for comparison in self.comparisons],
            "limits_used": dict(self.limits_used),
        }

    def plot(self) -> Any:
        """Return a figure of the input and the motion that the model expects, by matplotlib
        (`jaxid[report]`).
        """
        from ..report.figures_signals import signals

        return signals(self.record)

    def _repr_html_(self) -> str:
        return preformatted(str(self))


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

    Random starts, and those nearest to the conventional inputs, are scaled to the limits and
    compared in one batch; sequential quadratic programming improves the best, with derivatives of
    costs and limits through the simulation.

    Args:
        model: the model with declared values, whose motion must stay in the envelope.
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
        conventional: inputs to compare, from which the search also starts.
        seed: of the random starts.

    Raises:
        InputError: when the limits exclude the trim, an axis moves nothing, no input of these axes
            shows a parameter, the noise is unknown, or no start has a finite simulation.
    """
    require_float64()
    axes = tuple(model.inputs) if axes is None else tuple(axes)
    require_known("input", axes, model.inputs)
    likelihood = canonical(likelihood)
    require_known_noise(likelihood)
    t = as_float(t)
    zero_state, zero_input = jnp.zeros(len(model.states)), jnp.zeros(len(model.inputs))
    state = zero_state if initial_state is None else as_float(initial_state)
    trim = zero_input if trim_input is None else as_float(trim_input)
    _require_same_samples(conventional, model, t)
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
    information = InformationObjective(
        hypothesis=hypothesis,
        measure=measure,
        earlier=jnp.asarray(known),
        likelihood=likelihood,
    )
    objective = information
    if rival is not None:
        other = _hypothesis(canonical(rival[0]), rival[1], state)
        objective = Discrimination(true=hypothesis, wrong=other, likelihood=likelihood)
    task = Task(objective, hypothesis, shape, arrays, t, trim)
    starts, costs, factors = scaled_starts(task, information, seed, conventional)
    _require_shown(model, free, factors)
    order = np.argsort(costs)[:OPTIMISED]
    require(
        bool(np.isfinite(costs[order[0]])),
        "The model diverges under all random inputs within the limits. Lower the amplitude.",
    )
    results = [optimise(task, starts[index]) for index in order if np.isfinite(costs[index])]
    p, _ = min(results, key=lambda result: result[1])
    p, used = within_limits(task, p)
    deviation = deviations_of(task, jnp.asarray(p)[None])[0]
    signal = InputSignal(t, deviation, model.inputs, "design")
    record = planned_record(model, signal, likelihood, trim_input=trim, initial_state=state)
    cost, factor = summaries(task, information, deviation[None])
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
        record: a single record with the input.
        likelihood: the likelihood with known noise.
        initial_state: state at the first sample, to which further states of a model are added as
            zero; by default each model reads it from the record.
    """
    first, second = (
        _hypothesis(
            canonical(model),
            free,
            as_float(model.initial_state(record) if initial_state is None else initial_state),
        )
        for model, free in (true, wrong)
    )
    objective = Discrimination(true=first, wrong=second, likelihood=canonical(likelihood))
    return float(_chi_square(objective, record.t, record.u))


def _hypothesis(model: AbstractModel, free: Free, state) -> Hypothesis:
    vector, _ = flatten(model)
    extra = jnp.zeros(len(model.states) - state.size)
    return Hypothesis(model, free.positions(model), jnp.concatenate([vector, state, extra]))


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


@fast_compile_jit
def _chi_square(objective: Discrimination, t, u):
    return objective.chi_square(t, u)
