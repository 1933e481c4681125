"""`listing`: the complete print of an estimate (Tables 4.1 and 4.2 of the report)."""

from collections.abc import Iterator

import numpy as np

from .._foundation.checks import require
from ..models.names import flatten, parameter_names
from .result import Estimate

MOST_FIXED = 40  # fixed parameters in the print; chosen


def listing(estimate: Estimate) -> str:
    """Return an estimate with its channels, fixed parameters, noise and eigenvalues as text.

    It adds to `str(estimate)`: the states, marked where they are measured; inputs and outputs with
    their number of valid samples; the parameters of each record; the fixed parameters; R with its
    diagonal and upper half as in Table 4.2, and the correlations in the lower half; the eigenvalues
    of the scaled information (4.26), marked where the policy for weak directions changed them.

    Args:
        estimate: of one case.

    Raises:
        InputError: for a batch of cases.
    """
    require(
        np.ndim(estimate.values) == 1,
        "A listing is of one case, and this estimate has several. Select one of them.",
    )
    blocks = (
        _channels(estimate),
        [str(estimate)],
        _own(estimate),
        _fixed(estimate),
        _noise(estimate),
        _eigenvalues(estimate),
    )
    return "\n".join(line for block in blocks for line in block)


def _channels(estimate: Estimate) -> Iterator[str]:
    """Lines on states, inputs and outputs."""
    model = estimate.model
    marked = (f"{name} (measured)" if name in model.outputs else name for name in model.states)
    yield f"states:  {', '.join(marked) or '(none)'}"
    yield f"inputs:  {', '.join(model.inputs) or '(none)'}"
    counts = np.sum(np.asarray(estimate.mask), axis=(0, 1))
    outputs = (f"{name} ({count})" for name, count in zip(model.outputs, counts, strict=True))
    yield f"outputs: {', '.join(outputs)} valid samples, {estimate.mask.shape[0]} records"


def _own(estimate: Estimate) -> Iterator[str]:
    """Lines on the parameters of each record."""
    values, errors = np.asarray(estimate.own), np.asarray(estimate.own_errors)
    for column, name in enumerate(estimate.free.per_record):
        pairs = zip(values[:, column], errors[:, column], strict=True)
        words = ", ".join(f"{value:.4g} ({error:.2g})" for value, error in pairs)
        yield f"by record: {name} {words}"


def _fixed(estimate: Estimate) -> Iterator[str]:
    """Lines on the fixed parameters."""
    names, units = parameter_names(estimate.model), estimate.model.units()
    free = {*estimate.free.shared, *estimate.free.per_record}
    rows = zip(names, np.asarray(flatten(estimate.model)[0]), strict=True)
    fixed = [(name, value) for name, value in rows if name not in free]
    width = max([len(name) for name, _ in fixed[:MOST_FIXED]] + [9])
    for name, value in fixed[:MOST_FIXED]:
        yield f"{name:<{width}} {value:>13.6g} {'fixed':>11}  {units.get(name, '')}".rstrip()
    if len(fixed) > MOST_FIXED:
        yield f"and {len(fixed) - MOST_FIXED} more fixed parameters"


def _noise(estimate: Estimate) -> Iterator[str]:
    """Lines on R: the diagonal and upper half, and the correlations of the residuals below."""
    R, outputs = np.asarray(estimate.noise), estimate.model.outputs
    both = np.all(np.asarray(estimate.mask), axis=-1)
    v = np.asarray(estimate.residuals)[both]
    power = v.T @ v
    deviation = np.sqrt(np.diagonal(power))
    correlation = power / np.where(deviation > 0, deviation, 1.0)[:, None]
    correlation = correlation / np.where(deviation > 0, deviation, 1.0)[None]
    width = max([len(name) for name in outputs] + [10])
    known = "given" if estimate.noise_known else "estimated"
    yield f"R ({known}; below the diagonal the correlations of the residuals):"
    yield " " * width + "".join(f"{name:>{width + 2}}" for name in outputs)
    shown = np.where(np.tri(len(outputs), k=-1) > 0, correlation, R)
    for name, row in zip(outputs, shown, strict=True):
        yield f"{name:<{width}}" + "".join(f"{value:>{width + 2}.3g}" for value in row)


def _eigenvalues(estimate: Estimate) -> Iterator[str]:
    """Line on the eigenvalues of the scaled information."""
    eigenvalues = np.asarray(estimate.spectrum.eigenvalues)
    weak = np.asarray(estimate.spectrum.weak(estimate.threshold))
    words = (
        f"{value:.3g}{'*' if is_weak else ''}"
        for value, is_weak in zip(eigenvalues, weak, strict=True)
    )
    yield f"eigenvalues: {', '.join(words) or '(none)'}"
    if weak.any():
        yield (
            f"* below {estimate.threshold:g} of the largest: clipped or left out by the policy for "
            "weak directions"
        )
