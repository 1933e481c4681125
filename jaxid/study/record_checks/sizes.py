"""Comparison of the size of responses between records: units that differ from record to record."""

from collections.abc import Iterator, Sequence

import numpy as np

from .channels import Measured
from .findings import Finding, FindingKind
from .regression import lags_for, regression
from .relations import block_means, impulse_response, steps_in_a_block
from .response import Response
from .thresholds import GAIN_ERRORS, JITTER, SIZE_TOLERANCE

# Ratio of two units that are confused, by the words for them.
CONFUSED = {
    "degrees for radians": 180.0 / np.pi,
    "rpm for rad/s": 30.0 / np.pi,
    "thousandths of the unit": 1000.0,
}


def units_between_records(records: Sequence[tuple[Measured, Response]]) -> Iterator[Finding]:
    """Findings on outputs that respond to an input more strongly than in another record by the
    ratio of two units.

    The size of a response is the root sum of squares of the impulse response of a regression on the
    past, which needs no parameter of the model. It is compared with the record of median size (of
    two, the smaller one).

    Args:
        records: records with the response of the model, whose fastest mode sets the step.
    """
    arrays = [record for record, _ in records]
    steps = np.array([record.step for record in arrays])
    if len(arrays) < 2 or np.ptp(steps) > JITTER * steps[0]:
        return
    factor = min(steps_in_a_block(record, model) for record, model in records)
    sizes = np.array([_sizes(record, factor) for record in arrays])
    for output, channel in np.ndindex(sizes.shape[1:]):
        names = arrays[0].outputs[output], arrays[0].inputs[channel]
        for at, middle, ratio in _ratios(sizes[:, output, channel]):
            if words := _confused(ratio):
                others, numbers = (words, arrays[middle].name), {"ratio": ratio}
                yield Finding(FindingKind.OTHER_UNIT, arrays[at].name, names, numbers, others)


def _ratios(sizes: np.ndarray) -> list[tuple[int, int, float]]:
    """Return each known size over the median one, with the positions of both."""
    known = np.flatnonzero(sizes > 0)
    if known.size < 2:
        return []
    middle = known[np.argsort(sizes[known])[(known.size - 1) // 2]]
    return [(int(at), int(middle), float(sizes[at] / sizes[middle])) for at in known]


def _sizes(record: Measured, factor: int) -> np.ndarray:
    """Return the size of the response of each output to each input, zero where it is not known."""
    u, z = block_means(record.u, factor), block_means(record.z, factor)
    sizes = np.zeros((z.shape[1], u.shape[1]))
    lags = lags_for(len(u), u.shape[1]) if record.is_uniform else 0
    for output in range(z.shape[1] if lags else 0):
        fit = regression(z[:, output], u, lags)
        if fit is None:
            continue
        for channel in np.flatnonzero(np.ptp(u, axis=0) > 0).tolist():
            g, covariance = impulse_response(fit, channel)
            if g @ g > GAIN_ERRORS**2 * np.trace(covariance):
                sizes[output, channel] = np.linalg.norm(g)
    return sizes


def _confused(ratio: float) -> str:
    """Return the units whose ratio a ratio of sizes is, in words; empty for any other ratio."""
    size = abs(np.log(ratio))
    near = (words for words, f in CONFUSED.items() if abs(size - np.log(f)) < SIZE_TOLERANCE)
    return next(near, "")
