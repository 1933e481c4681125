"""An estimate as a complete print (Tables 4.1 and 4.2 of the report), dictionary and dataset.

`Estimate` has methods that call these functions, so its file imports this one.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from .._foundation.checks import require
from .._foundation.notebook import Table
from ..models.errors import EstimateErrors
from ..models.names import flatten, parameter_names

# Attributes with one value for each shared parameter.
PARAMETER_COLUMNS = (
    "start",
    "values",
    "standard_errors",
    "corrected_errors",
    "F",
    "on_bound",
    "near_bound",
)
SIGNIFICANT = 2.0  # chosen
MOST_FIXED = 40  # fixed parameters in the print; chosen
NEAR_BOUND = 2.0  # standard errors; derived: a normal estimate lies beyond with 2.3 %
POOR_FIT = 50.0  # percent; chosen
CORRELATED = 5.0  # standard deviations of the correlation of neighbours in white noise; chosen
POOR = (
    "The iteration may have ended in a minimum far from the best one, or the model lacks an "
    "effect. Try many starting values between bounds (`jaxid.multi_start`), or multiple shooting "
    "(`jaxid.OutputError(shooting=20)`); if they agree, `jaxid.close_loop`. "
    "`jaxid.advice(records, model)` looks for wrong units."
)


def listing(estimate: Any) -> str:
    """Return an estimate with its channels, fixed parameters, noise and eigenvalues as text.

    It adds to `str(estimate)`: the states, marked where they are measured; inputs and outputs with
    their number of valid samples; the parameters of each record; the fixed parameters; R with its
    diagonal and upper half as in Table 4.2, and the correlations in the lower half; the eigenvalues
    of the scaled information (4.26), marked where the policy for weak directions changed them.

    Args:
        estimate: an `Estimate` of one case.

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


def parameter_table(estimate: Any) -> Table:
    """Return the shared parameters of an estimate of one case, in words.

    Args:
        estimate: an `Estimate` of one case.
    """
    formats = {
        "start": ".4g",
        "values": ".6g",
        "standard_errors": ".3g",
        "corrected_errors": ".3g",
        "F": ".4g",
    }
    columns = (
        [f"{value:{shape}}" for value in np.asarray(getattr(estimate, name))]
        for name, shape in formats.items()
    )
    return Table(
        ("parameter", "start", "value", "std. error", "coloured", "F", "unit"),
        (9, 11, 13, 11, 11, 10),
        tuple(zip(estimate.names, *columns, estimate.units, strict=True)),
    )


def sign_remarks(estimate: Any) -> list[str]:
    """Return a remark on each shared parameter whose sign differs from its start, such as a
    negative stiffness or damping.

    Only values that differ from zero by more than `SIGNIFICANT` standard errors are remarked.

    Args:
        estimate: an `Estimate` of one case.
    """
    start, values = np.asarray(estimate.start), np.asarray(estimate.values)
    against = (start * values < 0) & (
        np.abs(values) > SIGNIFICANT * np.asarray(estimate.standard_errors)
    )
    return [
        f"sign: {name} is {values[at]:.4g}, against the sign of its start {start[at]:.4g}. If this "
        "is not physical, an effect may be missing, or the search ended at another minimum."
        for at, name in enumerate(estimate.names)
        if against[at]
    ]


def notes(estimate: Any) -> list[str]:
    """Return fit, weak directions, bounds, signs, kind of the errors and status, in words.

    Args:
        estimate: an `Estimate` of one case.
    """
    shares = zip(estimate.model.outputs, np.asarray(estimate.fit), strict=True)
    return [
        f"fit: {', '.join(f'{name} {share:.4g} %' for name, share in shares)}",
        *_poor_fit(estimate),
        *(f"weak: {sentence}" for sentence in estimate.weak_directions),
        *_bounds(estimate),
        *sign_remarks(estimate),
        f"errors: {_errors(estimate)}",
        f"status: {estimate.status} ({int(estimate.iterations)} iterations, cost "
        f"{float(estimate.cost):.6g})",
    ]


def _poor_fit(estimate: Any) -> list[str]:
    """Return a caution on outputs that are hardly explained, though their residual is no noise."""
    v, mask = np.asarray(estimate.residuals), np.asarray(estimate.mask)
    both = mask[:, 1:] & mask[:, :-1]
    with np.errstate(all="ignore"):
        products = np.sum(np.where(both, v[:, 1:] * v[:, :-1], 0.0), axis=(0, 1))
        correlation = products / np.sum(np.where(mask, v, 0.0) ** 2, axis=(0, 1))
    count = np.maximum(np.sum(both, axis=(0, 1)), 1)
    poor = (np.asarray(estimate.fit) < POOR_FIT) & (correlation * np.sqrt(count) > CORRELATED)
    names = [name for name, bad in zip(estimate.model.outputs, poor, strict=True) if bad]
    if not names:
        return []
    return [f"poor fit: the residual of {', '.join(names)} is large and no noise. {POOR}"]


def _errors(estimate: Any) -> str:
    """Return the quantiles that belong to the standard errors, in words."""
    if estimate.noise_known:
        return "R is known; intervals use normal quantiles."
    freedom = float(estimate.degrees_of_freedom)
    if freedom <= 0:
        return "none: there are no more valid measurements than free parameters. Add samples."
    return (
        "asymptotic, R estimated; `interval()` uses Student's t with "
        f"{int(freedom)} degrees of freedom."
    )


def _bounds(estimate: Any) -> list[str]:
    """Return the parameters on or near bounds and the effect on the intervals, in words."""

    def named(which) -> str:
        return ", ".join(
            name for name, yes in zip(estimate.names, np.asarray(which), strict=True) if yes
        )

    lines = []
    if on := named(estimate.on_bound):
        lines.append(
            f"bounds: {on} on the bound, without a standard error. The standard errors of the "
            "other parameters take this value as known; their intervals can cover less than they "
            "state."
        )
    if near := named(estimate.near_bound):
        lines.append(
            f"bounds: {near} within {NEAR_BOUND:g} standard errors of the bound. The intervals of "
            "all parameters correlated with it can cover less than they state."
        )
    return lines


def _require_single(estimate: Any, what: str, otherwise: str = "") -> None:
    """Refuse a batch of estimates."""
    require(
        np.ndim(estimate.values) == 1,
        f"{what} of one estimate, and this is a batch of them. Select one of them{otherwise}.",
    )


def estimate_errors(estimate: Any) -> EstimateErrors:
    """Return values and errors of an estimate of one case as plain numbers.

    Args:
        estimate: an `Estimate`.

    Raises:
        InputError: for a batch of cases.
    """
    _require_single(estimate, "Errors are")
    arrays = {name: np.asarray(getattr(estimate, name)) for name in EstimateErrors.arrays()}
    return EstimateErrors(
        **arrays,
        names=estimate.names,
        own_names=estimate.free.per_record,
        outputs=estimate.model.outputs,
        noise_known=estimate.noise_known,
        successful=bool(estimate.successful),
        status=estimate.status,
    )


def estimate_to_dict(estimate: Any) -> dict[str, Any]:
    """Return an estimate of one case as plain numbers and words.

    Args:
        estimate: an `Estimate`.

    Raises:
        InputError: for a batch of cases.
    """
    _require_single(estimate, "A dictionary is", ", or take `to_xarray`")
    columns = {name: np.asarray(getattr(estimate, name)).tolist() for name in PARAMETER_COLUMNS}
    rows = zip(*columns.values(), strict=True)
    keys = ("start", "value", "standard_error", "corrected_error", "F", "on_bound", "near_bound")
    named = zip(estimate.names, estimate.units, rows, strict=True)
    own = zip(np.asarray(estimate.own), np.asarray(estimate.own_errors), strict=True)
    return {
        "model": type(estimate.model).__name__,
        "parameters": {
            name: {**dict(zip(keys, row, strict=True)), "unit": unit} for name, unit, row in named
        },
        "per_record": [
            {
                name: {"value": float(value), "standard_error": float(error)}
                for name, value, error in zip(estimate.free.per_record, values, errors, strict=True)
            }
            for values, errors in own
        ],
        "outputs": list(estimate.model.outputs),
        "fit": np.asarray(estimate.fit).tolist(),
        "covariance": np.asarray(estimate.covariance).tolist(),
        "noise": np.asarray(estimate.noise).tolist(),
        "noise_known": estimate.noise_known,
        "weak_directions": list(estimate.weak_directions),
        "successful": bool(estimate.successful),
        "status": estimate.status,
        "iterations": int(estimate.iterations),
        "cost": float(estimate.cost),
    }


def estimate_to_xarray(estimate: Any):
    """Return an estimate as a dataset: one variable for each column, with labelled axes.

    Args:
        estimate: an `Estimate`, of one case or of several.
    """
    import xarray as xr  # imported here because it is slow to import

    batch = tuple(f"batch_{axis}" for axis in range(np.ndim(estimate.values) - 1))
    parameters = {name: ("parameter",) for name in PARAMETER_COLUMNS}
    axes = parameters | {
        "covariance": ("parameter", "parameter_2"),
        "noise": ("output", "output_2"),
        "own": ("case", "own_parameter"),
        "own_errors": ("case", "own_parameter"),
        "residuals": ("case", "row", "output"),
        "mask": ("case", "row", "output"),
        "fit": ("output",),
        "cost": (),
        "iterations": (),
        "successful": (),
    }
    outputs = list(estimate.model.outputs)
    return xr.Dataset(
        {
            name: ((*batch, *dimensions), np.asarray(getattr(estimate, name)))
            for name, dimensions in axes.items()
        },
        coords={
            "parameter": list(estimate.names),
            "parameter_2": list(estimate.names),
            "unit": ("parameter", list(estimate.units)),
            "output": outputs,
            "output_2": outputs,
            "own_parameter": list(estimate.free.per_record),
        },
        attrs={"model": type(estimate.model).__name__},
    )


def _channels(estimate: Any) -> Iterator[str]:
    """Lines on states, inputs and outputs."""
    model = estimate.model
    marked = (f"{name} (measured)" if name in model.outputs else name for name in model.states)
    yield f"states:  {', '.join(marked) or '(none)'}"
    yield f"inputs:  {', '.join(model.inputs) or '(none)'}"
    counts = np.sum(np.asarray(estimate.mask), axis=(0, 1))
    outputs = (f"{name} ({count})" for name, count in zip(model.outputs, counts, strict=True))
    yield f"outputs: {', '.join(outputs)} valid samples, {estimate.mask.shape[0]} records"


def _own(estimate: Any) -> Iterator[str]:
    """Lines on the parameters of each record."""
    values, errors = np.asarray(estimate.own), np.asarray(estimate.own_errors)
    for column, name in enumerate(estimate.free.per_record):
        pairs = zip(values[:, column], errors[:, column], strict=True)
        words = ", ".join(f"{value:.4g} ({error:.2g})" for value, error in pairs)
        yield f"by record: {name} {words}"


def _fixed(estimate: Any) -> Iterator[str]:
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


def _noise(estimate: Any) -> Iterator[str]:
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


def _eigenvalues(estimate: Any) -> Iterator[str]:
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
