"""`summary`: the results of a batch in one table."""

from typing import TYPE_CHECKING

import numpy as np

from .results import SUCCESSFUL, UNFINISHED

if TYPE_CHECKING:
    import xarray as xr


def summary(results: "xr.Dataset", *, failures: int = 10) -> str:
    """Return a table of the estimates of a batch, and the reasons of its failures.

    For each parameter: mean and standard deviation over the successful cases, the root mean square
    of their finite standard errors (a parameter on its bound has none), the smallest and the
    largest estimate [unit of the parameter]. In a Monte Carlo the standard deviation and the
    standard error agree.

    Args:
        results: dataset of `estimate_many`.
        failures: largest number of failed cases that are listed.
    """
    status = results.status.values.astype(str)
    good = np.isin(status, SUCCESSFUL)
    names = [str(name) for name in results.parameter.values]
    left = max(map(len, (*names, "parameter")))
    titles = ("mean", "std. dev.", "std. error", "lowest", "highest")
    lines = [f"{'parameter':<{left}}" + "".join(f"{title:>13}" for title in titles) + "  unit"]
    for i, name in enumerate(names):
        figures = _figures(
            results["values"].values[good, i], results.standard_errors.values[good, i]
        )
        unit = str(results.unit.values[i])
        row = f"{name:<{left}}" + "".join(f"{figure:>13.5g}" for figure in figures)
        lines.append(f"{row}  {unit}".rstrip())
    counts = [f"{np.sum(status == name)} {name}" for name in dict.fromkeys([*SUCCESSFUL, *status])]
    present = [count for count in counts if not count.startswith("0 ")]
    lines.append(f"{status.size} cases: {', '.join(present)}")
    failed = np.flatnonzero(~good & (status != UNFINISHED))
    for case in failed[:failures]:
        lines.append(f"{results.name.values[case]}: {results.reason.values[case]}")
    if failed.size > failures:
        lines.append(f"... and {failed.size - failures} more")
    return "\n".join(lines)


def _figures(values: np.ndarray, errors: np.ndarray) -> tuple[float, ...]:
    """Return the columns of one parameter, NaN without a successful case."""
    if not values.size:
        return (np.nan,) * 5
    scatter = np.std(values, ddof=1) if values.size > 1 else np.nan
    finite = errors[np.isfinite(errors)]
    error = np.sqrt(np.mean(finite**2)) if finite.size else np.nan
    return float(np.mean(values)), float(scatter), float(error), values.min(), values.max()
