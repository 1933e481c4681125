"""Choice of sensors: those that add most information on the parameters for a cost (7.2.5)."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_float64, require_known
from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Float, Numbers
from ..data.record import Record
from ..estimation.estimate import check_channels
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel, canonical
from ..models.free import Free
from .information import (
    flat_vector_of,
    prior_rows,
    require_known_noise,
    stack_of_one,
    whitened_sensitivities,
)
from .measures import AbstractMeasure


class SensorSet(NamedTuple):
    """A set of sensors.

    Attributes:
        sensors: names of the outputs, in the order of the model.
        cost: sum of their costs.
        measure: the measure of their information.
        removed: the sensor whose removal led to this set; empty for all sensors.
    """

    sensors: tuple[str, ...]
    cost: float
    measure: float
    removed: str


def sensor_sets(
    model: AbstractModel,
    free: Free,
    record: Record,
    likelihood: AbstractLikelihood,
    measure: AbstractMeasure,
    *,
    costs: Mapping[str, float] | None = None,
    initial_state: Float[Numbers, " state"] | None = None,
) -> tuple[SensorSet, ...]:
    """Return a row of smaller and smaller sets of sensors, each the best to be had from the last.

    The sensor is removed that raises the measure least per unit of its cost, until no set has a
    finite measure. This greedy rule need not find the best set of each size.

        M = sum over sensors of S_i' S_i / sigma_i^2,    own parameters of the record eliminated

    Args:
        model: a model with all sensors as outputs; places are outputs of their own.
        free: the parameters of the later estimate, with priors.
        record: a planned record (`planned_record`) or a flown one.
        likelihood: the likelihood with known noise, independent between the sensors.
        measure: the measure.
        costs: cost by output; 1 by default.
        initial_state: state at the first sample; by default the model's, from the record.

    Returns:
        The sets, all sensors first.

    Raises:
        InputError: when the noise is unknown or correlated between sensors, an output is unknown, a
            cost is not positive, or all sensors together do not determine the parameters.
    """
    require_float64()
    records = stack_of_one(record)
    check_channels(model, records)
    require_known_noise(likelihood)
    require_known("output", costs or {}, model.outputs)
    prices = _prices(model.outputs, costs or {})
    triangles = _triangles(model, free, records, likelihood, initial_state)
    known = prior_rows(free)

    def measured(sensors: tuple[str, ...]) -> float:
        rows = np.concatenate([triangles[name] for name in sensors])
        count = rows.shape[1] - known.shape[1]
        padded = np.pad(rows, ((0, rows.shape[1]), (0, 0)))
        shared = np.asarray(np.linalg.qr(padded, mode="r"))[count:, count:]
        value = float(measure.cost(np.concatenate([shared, known])))
        return value if np.isfinite(value) else np.inf

    sensors = tuple(model.outputs)
    sets = [SensorSet(sensors, sum(prices.values()), measured(sensors), "")]
    require(
        bool(np.isfinite(sets[0].measure)),
        "All sensors together do not determine the parameters. Fix a parameter, give a prior, or "
        "plan another record.",
    )
    while len(sets[-1].sensors) > 1:
        best = _next_set(sets[-1], prices, measured)
        if not np.isfinite(best.measure):
            break
        sets.append(best)
    return tuple(sets)


def _prices(outputs: tuple[str, ...], costs: Mapping[str, float]) -> dict[str, float]:
    """Return the cost of every sensor, 1 by default."""
    prices = {name: float(costs.get(name, 1.0)) for name in outputs}
    for name, price in prices.items():
        require(price > 0.0, f"The cost of {name!r} is {price:g}; it must be positive.")
    return prices


def _next_set(
    last: SensorSet, prices: Mapping[str, float], measured: Callable[[tuple[str, ...]], float]
) -> SensorSet:
    """Return the set without the sensor that carries least for its cost."""

    def without(name: str) -> SensorSet:
        kept = tuple(other for other in last.sensors if other != name)
        return SensorSet(kept, last.cost - prices[name], measured(kept), name)

    smaller = map(without, last.sensors)
    return min(smaller, key=lambda each: (each.measure - last.measure) / prices[each.removed])


def _triangles(model, free, records, likelihood, initial_state) -> dict[str, np.ndarray]:
    """Return the triangle of own and shared parameters of each sensor."""
    model, free, likelihood = canonical(model), canonical(free), canonical(likelihood)
    likelihood.check(model, records)
    R = np.asarray(likelihood.noise.cholesky(jnp.zeros(records.z.shape), records.mask))
    require(
        bool(np.all(np.diag(np.diagonal(R)) == R)),
        "The noise is correlated between sensors, so that they have no information of their own. "
        "Give a diagonal R.",
    )
    flat = flat_vector_of(model, records, initial_state)
    rows = np.concatenate(
        _sensitivities(model, free.positions(model), flat, records.anonymous(), likelihood), -1
    )[0]
    return {
        name: np.asarray(np.linalg.qr(rows[:, index], mode="r"))
        for index, name in enumerate(model.outputs)
    }


@fast_compile_jit
def _sensitivities(model, positions, flat, records, likelihood):
    return whitened_sensitivities(model, positions, flat, records, likelihood)
