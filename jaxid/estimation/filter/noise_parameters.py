"""Noise parameters of a filter: from the user's options to a `StochasticModel` and its `Free`."""

from collections.abc import Collection, Mapping

from ..._foundation.checks import require, require_known
from ..._foundation.host import on_host
from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.base import AbstractModel
from ...models.free import INITIAL_STATE, Free
from ...models.stochastic import StochasticModel
from .noise_options import FirstOrder, Fixed, Number, check_number, check_option, value_of

# Chosen: bounds of an estimated deviation or correlation time, relative to its start.
LOWEST_SHARE, HIGHEST_SHARE = 1e-4, 1e4
# Chosen: start of a sensor's deviation where its record shows no noise, relative to its range.
LEAST_NOISE = 1e-3

NOISE_GROUPS = ("process", "correlation_time", "sensor", "initial")  # of the parameters of noises
Process = Mapping[str, Number | FirstOrder]
Coloured = Mapping[str, Mapping[str, FirstOrder]]


def with_noise_parameters(
    model: AbstractModel,
    free: Free,
    records: Record,
    process: Process,
    sensors: Mapping[str, Number],
    initial: Mapping[str, Number],
    coloured: Coloured,
) -> tuple[StochasticModel, Free]:
    """Return the model with its noises as parameters, and the free parameters with those of them
    that are estimated.

    Args:
        model: the model without noise.
        free: its free parameters.
        records: a stack, from which the sensors without an option take their start.
        process: noise by state or disturbance input.
        sensors: noise by output.
        initial: deviation of the initial state, by state.
        coloured: parts with memory of the noise of sensors, by output and name.
    """
    wide = model
    if any(name not in model.states for name in process):
        wide = model.with_disturbance_inputs()
    on_outputs = tuple((name, output) for output, parts in coloured.items() for name in parts)
    first = zip(model.outputs, _split(sensor_starts(records)), strict=True)
    options: dict[str, Number] = {f"sensor.{name}": start for name, start in first}
    options |= by_parameter(process, sensors, initial, coloured)

    def group(kind: str) -> dict[str, Array]:
        mark = f"{kind}."
        return {
            name.removeprefix(mark): value_of(option)
            for name, option in options.items()
            if name.startswith(mark)
        }

    stochastic = StochasticModel(  # pyright: ignore[reportCallIssue]
        wide,
        group("process"),
        group("correlation_time"),
        group("sensor"),
        group("initial"),
        model.inputs,
        on_outputs,
    )
    starts = {k: value_of(v) for k, v in options.items() if not isinstance(v, Fixed)}
    lower, upper = _bounds(starts)
    return stochastic, Free(
        (*free.shared, *starts),
        free.per_record,
        free.lower | lower,
        free.upper | upper,
        free.scale,
        free.prior,
    )


def by_parameter(
    process: Process,
    sensors: Mapping[str, Number],
    initial: Mapping[str, Number],
    coloured: Coloured,
) -> dict[str, Number]:
    """Return noises by the names of their parameters, as `process.v`."""
    driving = dict(process)
    for parts in coloured.values():
        driving |= parts
    options = {f"sensor.{name}": option for name, option in sensors.items()}
    options |= {f"initial.{name}": option for name, option in initial.items()}
    times = {}
    for name, option in driving.items():
        if isinstance(option, FirstOrder):
            times[f"correlation_time.{name}"] = option.correlation_time
            option = option.deviation
        options[f"process.{name}"] = option
    return options | times


@on_host
def _bounds(xp, starts):
    """Return the lower and the upper bounds of estimated noises, by name."""
    lower = {name: xp.asarray(LOWEST_SHARE * start) for name, start in starts.items()}
    return lower, {name: xp.asarray(HIGHEST_SHARE * start) for name, start in starts.items()}


@on_host
def _split(xp, vector):
    """Return the elements of a vector."""
    return [xp.asarray(vector[index]) for index in range(vector.shape[0])]


def sensor_starts(records: Record) -> Float[Array, " output"]:
    """Return the start of each sensor's deviation from the second differences of its record.

        sigma^2 = mean( (z_(i-1) - 2 z_i + z_(i+1))^2 ) / 6

    exact for white noise on a straight line. At least 0.001 of the range of the records, and 0.001
    where they are constant.
    """
    return _sensor_starts(records.z, records.mask)


@on_host
def _sensor_starts(xp, z, mask):
    valid = mask[..., 2:, :] & mask[..., 1:-1, :] & mask[..., :-2, :]
    second = xp.where(valid, z[..., 2:, :] - 2.0 * z[..., 1:-1, :] + z[..., :-2, :], 0.0)
    axes = tuple(range(z.ndim - 1))
    count = xp.maximum(xp.sum(valid, axis=axes), 1)
    deviation = xp.sqrt(xp.sum(second**2, axis=axes) / (6.0 * count))
    highest = xp.max(xp.where(mask, z, -xp.inf), axis=axes)
    extent = highest - xp.min(xp.where(mask, z, xp.inf), axis=axes)
    return xp.maximum(deviation, LEAST_NOISE * xp.where(extent > 0, extent, 1.0))


def check_values(
    process: Process,
    sensors: Mapping[str, Number],
    initial: Mapping[str, Number],
    coloured: Coloured,
) -> None:
    """Refuse options that are no deviations or times."""
    for name, option in process.items():
        check_option(option, f"The process noise of {name!r}", (Array, Fixed, FirstOrder))
        if isinstance(option, FirstOrder):
            _check_memory(option, repr(name))
        else:
            check_number(option, f"The process noise of {name!r}", zero=True)
    for name, option in sensors.items():
        check_number(option, f"The noise of sensor {name!r}", zero=False)
    for output, parts in coloured.items():
        for option in parts.values():
            _check_memory(option, f"the noise of sensor {output!r}")
    for name, option in initial.items():
        check_number(option, f"The deviation of the initial state {name!r}", zero=True)


def _check_memory(option: FirstOrder, name: str) -> None:
    check_number(option.deviation, f"The deviation of {name}", zero=True)
    check_number(option.correlation_time, f"The correlation time of {name}", zero=False)


def check_kept(model: StochasticModel, free: Free, given: Mapping[str, Number]) -> None:
    """Refuse noises for a model that has its own, from an earlier estimate, and would keep them.

    Args:
        model: the model with its noises.
        free: its free parameters.
        given: noises by the names of their parameters (`by_parameter`).
    """
    own = [f"{kind}.{name}" for kind in NOISE_GROUPS for name in getattr(model, kind)]
    remedy = "Give the model without noises, `fit.model.model`, or the parameters of the fit, "
    unknown = ", ".join(name for name in given if name not in own)
    require(
        not unknown,
        f"The model has its own noises, from an earlier estimate, and {unknown} is none of them. "
        f"{remedy}`fit.free`, with its likelihood.",
    )
    estimated = ", ".join(name for name, option in given.items() if not isinstance(option, Fixed))
    require(
        not (estimated and free.shared) or any(name in own for name in free.shared),
        f"The model has its own noises, from an earlier estimate, and none of them is free: the "
        f"starting values of {estimated} would be ignored. {remedy}`fit.free`.",
    )


def check_names(
    model: AbstractModel,
    free: Free,
    process: Process,
    sensors: Collection[str],
    initial: Mapping[str, Number],
) -> None:
    """Refuse noises of states, disturbances and sensors that do not exist."""
    require(
        bool(model.states),
        f"{type(model).__name__} has no states, so that no noise can drive them. "
        "Use OutputError().",
    )
    disturbances = model.with_disturbance_inputs().inputs[len(model.inputs) :]
    require_known("state or disturbance (in `process`)", process, (*model.states, *disturbances))
    require_known("output (in `noise`)", sensors, model.outputs)
    require_known("state (in `initial`)", initial, model.states)
    for name in initial:
        require(
            f"{INITIAL_STATE}.{name}" not in (*free.shared, *free.per_record),
            f"The initial state {name!r} is free and has a deviation in `initial`. Either "
            "estimate it (leave it out of `initial`) or describe its spread (leave it out of "
            "the free parameters).",
        )
