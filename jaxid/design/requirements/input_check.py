"""Checks of a planned or measured record against requirements, before any fit (section 5.1).

Each check is a function from a plan to criteria: numbers with the limits that are given for them.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy

from ..._foundation.checks import require, require_float64, require_known
from ..._foundation.compiler import fast_compile_jit
from ..._foundation.types import Float, Numbers
from ...data.excitation import INFLATION, share_above, variance_inflation
from ...data.record import Record
from ...data.stack import require_single
from ...estimation.estimate import as_stack, check_channels
from ...estimation.likelihoods import AbstractLikelihood
from ...estimation.spectrum_policy import SPREAD
from ...models.base import AbstractModel, as_float, canonical
from ...models.free import Free, first_state
from ...sensitivity.spectrum import spectrum
from ...simulation.simulate import explain_divergence
from ..information import (
    ROUGHLY,
    PlannedInformation,
    information_of,
    require_known_noise,
    start_of,
)
from ..limits import (
    Limits,
    Ratios,
    exact_maximum,
    quantities,
    quantity_names,
    ratios,
    require_positive,
    trim_values,
)
from .requirements import Check, Criterion, InputCheck, Range, Requirements

# Chosen: last share of the record, in which the motion must be near trim; least movement of an
# input, as a share of its range, that counts as a reversal.
END, REVERSAL = 0.1, 0.05


class _Plan(NamedTuple):
    """A record with all that the checks compare.

    Attributes:
        model, requirements, information: the model, the requirements, the predicted errors.
        t, u, deviation: sample times [s], inputs, and inputs less their values at trim.
        motion: quantities over time, by name: outputs as recorded, else by the declared model.
        trim: their values at trim.
        response: outputs of the declared model, without noise.
        noise: standard deviation of the noise of each output.
        limits: the limits of inputs and envelope.
    """

    model: AbstractModel
    requirements: Requirements
    information: PlannedInformation
    t: np.ndarray
    u: np.ndarray
    deviation: np.ndarray
    motion: dict[str, np.ndarray]
    trim: dict[str, float]
    response: np.ndarray
    noise: np.ndarray
    limits: Ratios | None


def check_input(
    model: AbstractModel,
    free: Free,
    record: Record,
    likelihood: AbstractLikelihood,
    requirements: Requirements,
    *,
    trim_input: Float[Numbers, " input"] | None = None,
    initial_state: Float[Numbers, " state"] | None = None,
    earlier: Float[Numbers, "row parameter"] | None = None,
) -> InputCheck:
    """Return the seven checks of the input of a planned or measured record (section 5.1).

    Outputs are taken as recorded, and by the declared model where a sample is missing. States and
    signals are those of the declared model under the record's inputs, and so are the noise-free
    outputs whose size and frequencies are compared with noise and sample rate.

    Source: the report, sections 5.1 and 5.3.2.

    Args:
        model: the model with declared values.
        free: the parameters of the later estimate, with priors.
        record: one record, planned by `planned_record` or measured.
        likelihood: the likelihood of the later estimate, with known noise.
        requirements: the requirements.
        trim_input: inputs at trim; zero by default.
        initial_state: state at trim and at the first sample; by default the model's, from the
            record.
        earlier: factor of the information of records already flown, in place of the priors.

    Raises:
        InputError: for an unknown channel, quantity or parameter, an empty range, limits that
            exclude the trim, or unknown noise.
    """
    require_float64()
    require_single(record, "checked")
    model = canonical(model)
    check_channels(model, as_stack(record))
    require_known_noise(likelihood)
    given = first_state(model, record) if initial_state is None else initial_state
    state = start_of(model, given)
    trim = jnp.zeros(len(model.inputs)) if trim_input is None else as_float(trim_input)
    _require_names(requirements, model, free)
    _require_numbers(requirements)
    names = _motion_names(requirements, model, state, trim)
    limits = _limits(requirements.limits, model, state, trim)
    information = information_of(
        model, free, record, likelihood, initial_state=state, earlier=earlier
    )
    solution, values, R = _simulated(model, canonical(likelihood), record.anonymous(), state, names)
    if not bool(solution.finite):
        raise explain_divergence(solution, model, f"the record {record.names[0]!r}")
    u, response = np.asarray(record.u), np.asarray(solution.y)
    recorded = np.where(np.asarray(record.mask), np.asarray(record.z), response)
    outputs = dict(zip(record.outputs, recorded.T, strict=True))
    motion = {n: outputs.get(n, v) for n, v in zip(names, np.asarray(values).T, strict=True)}
    at_trim = map(float, trim_values(model, names, state, trim))
    plan = _Plan(
        *(model, requirements, information, np.asarray(record.t), u, u - np.asarray(trim)[None]),
        *(motion, dict(zip(names, at_trim, strict=True)), response),
        *(np.sqrt(np.diagonal(np.asarray(R))), limits),
    )
    checks = {name: Check(tuple(criteria(plan))) for name, criteria in CRITERIA.items()}
    return InputCheck(information=information, **checks)


@fast_compile_jit
def _simulated(model, likelihood: AbstractLikelihood, record: Record, state, names):
    """Return the declared motion, the named quantities and the covariance of the noise."""
    solution = likelihood.solve(model, record, state)
    v, mask = jnp.zeros((1, *record.z.shape)), record.mask[None]
    R = likelihood.measurement_covariance(model, v, mask)
    return solution, quantities(model, names, solution, record.u), R


def _require_names(requirements: Requirements, model: AbstractModel, free: Free) -> None:
    """Refuse outputs and parameters that do not exist."""
    for option in (requirements.ranges, requirements.signal_to_noise, requirements.quantum):
        require_known("output", option, model.outputs)
    errors = requirements.standard_errors, requirements.relative_errors, requirements.parameters
    for option in errors:
        require_known("free parameter", option, free.shared, "Free it, or take it out.")


def _require_numbers(requirements: Requirements) -> None:
    """Refuse limits that are not positive."""
    numbers = ("pilot_frequency", "pilot_share", "reversals", "fast_share", "time_inside")
    for name in (*numbers, "covered", "inflation"):
        require_positive({name: getattr(requirements, name)})
    by_name = ("trim_distance", "signal_to_noise", "quantum", "standard_errors", "relative_errors")
    for name in by_name:
        require_positive(getattr(requirements, name))


def _motion_names(requirements: Requirements, model: AbstractModel, state, trim) -> tuple[str, ...]:
    """Return the quantities that the checks need; refuse unknown ones and empty ranges."""
    ranges = (
        *(requirements.ranges, requirements.valid, requirements.interest, requirements.integrity),
    )
    for name, (low, high) in ((name, ends) for option in ranges for name, ends in option.items()):
        require(
            low is None or high is None or low < high,
            f"The range of {name!r}, {low} to {high}, is empty. Give its lower end first.",
        )
    for name, ends in requirements.interest.items():
        require(None not in ends, f"The range of interest of {name!r} has no bound. Give both.")
    envelope = requirements.limits.envelope if requirements.limits else {}
    options = (envelope, requirements.trim_distance, *ranges)
    names = tuple(dict.fromkeys(name for option in options for name in option))
    require_known("state, output or signal", names, quantity_names(model, state, trim))
    return names


def _limits(limits: Limits | None, model: AbstractModel, state, trim) -> Ratios | None:
    """Return the limits at a trim; a limit of the energy holds for all inputs together."""
    if limits is None:
        return None
    total = () if limits.energy is None else model.inputs
    axes = tuple(dict.fromkeys((*limits.amplitude, *limits.rate, *total)))
    return ratios(limits, model, axes, state, trim)


def _pilot(plan: _Plan) -> Iterator[Criterion]:
    requirements, t, inputs = plan.requirements, plan.t, plan.model.inputs
    if plan.limits is not None:
        yield from _limits_used(plan, plan.limits)
    moving = [(n, u) for n, u in zip(inputs, plan.u.T, strict=True) if np.ptp(u) > 0]
    for name, u in moving:
        if (frequency := requirements.pilot_frequency) is not None:
            label = f"{name}, power above {frequency:g} Hz"
            remedy = f"Move {name} by longer pulses or slower sines."
            above = share_above(t, u, 2.0 * np.pi * frequency)
            yield Criterion(label, above, remedy, high=requirements.pilot_share)
        if requirements.reversals is not None:
            remedy = f"Move {name} by fewer or longer pulses."
            rate = _reversals(u) / float(t[-1] - t[0])
            yield Criterion(f"{name}, reversals/s", rate, remedy, high=requirements.reversals)
    tail = t >= t[-1] - END * (t[-1] - t[0])
    for name, distance in requirements.trim_distance.items():
        away = float(np.max(np.abs(plan.motion[name][tail] - plan.trim[name])))
        remedy = "Add a pulse of the opposite sign (a doublet), or end the input earlier."
        yield Criterion(f"{name}, distance from trim at the end", away, remedy, high=distance)


def _limits_used(plan: _Plan, limits: Ratios) -> Iterator[Criterion]:
    """Criteria of the share of each limit that the manoeuvre uses."""
    values = [plan.motion[name] for name in limits.names]
    motion = jnp.asarray(np.reshape(values, (len(values), plan.t.size)).T)
    used = limits.of(jnp.asarray(plan.t), jnp.asarray(plan.deviation), motion, exact_maximum)
    remedy = "Scale the input down, or design it by `design_input` within these limits."
    for label, share, given in zip(limits.labels(), used, limits.is_given(), strict=True):
        if given:
            yield Criterion(f"{label} over its limit", float(share), remedy, high=1.0)


def _reversals(u: np.ndarray) -> int:
    """Return the number of turning points of an input."""
    least = REVERSAL * np.ptp(u)
    return sum(len(scipy.signal.find_peaks(values, prominence=least)[0]) for values in (u, -u))


def _instruments(plan: _Plan) -> Iterator[Criterion]:
    requirements, columns = plan.requirements, plan.model.outputs
    remedy = "Lower the amplitude, or take an instrument of larger range."
    yield from _within(plan, requirements.ranges, remedy)
    for name, response, noise in zip(columns, plan.response.T, plan.noise, strict=True):
        if name in requirements.signal_to_noise:
            remedy = f"Raise the amplitude near the modes, or measure {name} with less noise."
            ratio, least = float(np.std(response) / noise), requirements.signal_to_noise[name]
            yield Criterion(f"{name}, signal to noise", ratio, remedy, low=least)
        if name in requirements.quantum:
            remedy = f"Record {name} with more digits, or state its noise with the rounding."
            ratio = requirements.quantum[name] / float(noise)
            yield Criterion(f"{name}, quantum over noise", ratio, remedy, high=1.0)
        if requirements.fast_share is not None and np.ptp(response) > noise:
            half = 0.5 * np.pi / float(np.median(np.diff(plan.t)))
            label = f"{name}, power above half of the Nyquist frequency"
            fast, remedy = share_above(plan.t, response, half), "Sample at twice the rate."
            yield Criterion(label, fast, remedy, high=requirements.fast_share)


def _procedure(plan: _Plan) -> Iterator[Criterion]:
    missing = plan.information.undetermined
    weak = "; ".join(plan.information.weak_directions)
    remedy = f"{weak}: fix a parameter, give a prior, or move another input."
    yield Criterion("undetermined parameters", float(len(missing)), remedy, high=0.0)
    moving = np.flatnonzero(np.ptp(plan.u, axis=0) > 0)
    if moving.size < 2:
        return
    remedy = "Move the inputs one after the other."
    for k, factor in zip(moving, variance_inflation(plan.u[:, moving]), strict=True):
        label = f"{plan.model.inputs[k]}, variance inflation"
        yield Criterion(label, float(factor), remedy, high=INFLATION)


def _modelling(plan: _Plan) -> Iterator[Criterion]:
    requirements = plan.requirements
    remedy = "Lower the amplitude, or take a model that is valid there."
    yield from _within(plan, requirements.valid, remedy)
    for name, (low, high) in requirements.interest.items():
        assert low is not None
        assert high is not None
        values = plan.motion[name]
        inside = float(np.mean((values >= low) & (values <= high)))
        remedy = "Begin at a trim inside the range of interest, with a smaller amplitude."
        label, least = f"{name}, time in the range of interest", requirements.time_inside
        yield Criterion(label, inside, remedy, low=least)
        length = min(high, float(np.max(values))) - max(low, float(np.min(values)))
        remedy = "Raise the amplitude, or add records at other trims."
        label, share = f"{name}, range of interest covered", max(length, 0.0) / (high - low)
        yield Criterion(label, share, remedy, low=requirements.covered)


def _objective(plan: _Plan) -> Iterator[Criterion]:
    information, requirements = plan.information, plan.requirements
    remedy = "Take a longer record, several records, or an input by `design_input`."
    if requirements.goal is not None:
        measure, largest = requirements.goal
        yield Criterion("cost of the measure", information.measure(measure), remedy, high=largest)
    errors = (
        ("standard error", requirements.standard_errors, information.standard_errors),
        ("relative error", requirements.relative_errors, information.relative_errors),
    )
    for label, required, predicted in errors:
        for name, largest in required.items():
            error = float(predicted[information.names.index(name)])
            yield Criterion(f"{name}, {label}", error, remedy, high=largest)


def _integrity(plan: _Plan) -> Iterator[Criterion]:
    remedy = "Lower the amplitude, or design the input with this range in its envelope."
    yield from _within(plan, plan.requirements.integrity, remedy)


def _sensitivity(plan: _Plan) -> Iterator[Criterion]:
    information, requirements = plan.information, plan.requirements
    alone = np.linalg.norm(information.factor, axis=0)  # inverse error with the others known
    for name in requirements.parameters:
        k = information.names.index(name)
        if information.values[k] != 0.0:
            remedy = f"Raise the amplitude at frequencies at which the outputs depend on {name}."
            relative = float(information.relative_errors[k])
            yield Criterion(f"{name}, relative error", relative, remedy, high=ROUGHLY)
        if alone[k] > 0.0:
            inflation, remedy = information.standard_errors[k] * alone[k], _separation(plan, k)
        else:
            inflation, remedy = np.inf, f"No output depends on {name}: move another input."
        label, limit = f"{name}, error inflation", requirements.inflation
        yield Criterion(label, float(inflation), remedy, high=limit)


def _separation(plan: _Plan, k: int) -> str:
    """Return the remedy for a confounded parameter, with its largest correlation."""
    information = plan.information
    root = spectrum(information.factor, np.zeros(len(information.names))).square_root(SPREAD)
    covariance = np.asarray(root @ root.T)  # over the strong directions
    deviations = np.sqrt(np.maximum(np.diagonal(covariance), np.finfo(float).tiny))
    correlation = np.abs(covariance[k] / deviations[k] / deviations)
    correlation[k] = 0.0
    other = int(np.argmax(correlation))
    name, confounder = information.names[k], information.names[other]
    return (
        f"{name} is confounded with {confounder} (correlation of size {correlation[other]:.3g}): "
        f"add frequencies or inputs that separate them, give a prior, or fix {confounder}."
    )


def _within(plan: _Plan, ranges: Mapping[str, Range], remedy: str) -> Iterator[Criterion]:
    """Criteria of the lowest and the highest value of quantities."""
    for name, (low, high) in ranges.items():
        values = plan.motion[name]
        if low is not None:
            yield Criterion(f"{name}, lowest", float(np.min(values)), remedy, low=low)
        if high is not None:
            yield Criterion(f"{name}, highest", float(np.max(values)), remedy, high=high)


# The criteria of each field of `InputCheck`, in the order of section 5.1.
CRITERIA = {
    "pilot": _pilot,
    "instruments": _instruments,
    "procedure": _procedure,
    "modelling": _modelling,
    "objective": _objective,
    "integrity": _integrity,
    "sensitivity": _sensitivity,
}
