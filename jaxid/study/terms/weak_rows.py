"""Rows of a regression in weak form, with the constant as a column of ones."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..._foundation.checks import require
from ...models.pseudo_measurements import WeakMeasurements
from ...structure import Regression, weak_form

# Share of a part's mean square that its noise variance has at least, so that parts free of noise
# have weights (chosen).
MIN_VARIANCE_SHARE = 1e-12


class WeakRecords(NamedTuple):
    """One response of several records in weak form.

    Attributes:
        measured: equations of each record.
        response: name of the response.
        radius: half of the length of a test function [s].
    """

    measured: Sequence[WeakMeasurements]
    response: str
    radius: float

    @property
    def parts(self) -> list[list[np.ndarray]]:
        """Parts of each record by order of the derivative."""
        return [list(map(np.asarray, one.parts[self.response])) for one in self.measured]


def weak_rows(
    records: WeakRecords, table: Mapping[str, np.ndarray], regression: Regression | None
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the column of each term and the response, as whitened integrals over test functions.

        sum_d (-1)^d int psi_j^(d) part_d dt = sum_k theta_k int psi_j multiplier phi_k dt

    Each run of valid samples has rows of its own. The noise of the parts is taken as white, with
    the covariance of their third differences; at the values of a regression the part of order zero
    is less all terms, whose noise it then contains. The rows are reflected such that the integrals
    of the constant are equal, and divided by their value, so that a constant is fitted as
    elsewhere. A reflection leaves the rows white.

    Args:
        records: response of all records.
        table: column of each term over the valid samples of all records, shape (sample,).
        regression: values at which the noise is taken; None for the noise of the parts alone.

    Raises:
        InputError: if no run is as long as a test function, or there are fewer rows than terms.
    """
    terms = np.stack(list(table.values()), axis=1)
    runs = list(_runs(records, terms))
    longest = max((float(run.t[-1] - run.t[0]) for run in runs), default=0.0)
    require(
        longest >= 2 * records.radius,
        f"The longest run of valid samples has {longest:.4g} s, and a test function "
        f"{2 * records.radius:.4g} s. Reduce `weak_radius`, or fill gaps of the records.",
    )
    runs = [run for run in runs if run.holds(records.radius)]
    noise = _noise(runs, _values(table, regression))
    blocks = [_block(run, records.radius, noise) for run in runs]
    rows = _with_equal_constants(np.concatenate(blocks))
    require(
        len(rows) > len(table) + 1,
        f"A test function of {2 * records.radius:.4g} s leaves {len(rows)} rows, and "
        f"{records.response} has {len(table)} terms and a constant. Reduce `weak_radius`, or give "
        "fewer terms or longer records.",
    )
    return dict(zip(table, rows[:, 1:-1].T, strict=True)), rows[:, -1]


class _Run(NamedTuple):
    """Samples without a gap.

    Attributes:
        t: sample times [s].
        columns: multiplier times constant and terms, shape (time, 1 + term).
        parts: parts of the equation by order of the derivative.
    """

    t: np.ndarray
    columns: np.ndarray
    parts: list[np.ndarray]

    def holds(self, radius: float) -> bool:
        """Return True if the run is as long as a test function."""
        return float(self.t[-1] - self.t[0]) >= 2 * radius


def _runs(records: WeakRecords, terms: np.ndarray) -> Iterator[_Run]:
    """Yield the runs of valid samples of all records."""
    first = 0
    for one, parts in zip(records.measured, records.parts, strict=True):
        valid = np.flatnonzero(np.asarray(one.valid))
        multiplier = np.asarray(one.multipliers[records.response])
        own = np.column_stack([np.ones(valid.size), terms[first : first + valid.size]])
        first += valid.size
        for at in np.split(np.arange(valid.size), np.flatnonzero(np.diff(valid) > 1) + 1):
            if at.size > 1:
                samples = valid[at]
                scaled = multiplier[samples, None] * own[at]
                yield _Run(np.asarray(one.t)[samples], scaled, [part[samples] for part in parts])


def _block(run: _Run, radius: float, noise: np.ndarray) -> np.ndarray:
    """Return the whitened rows of a run: constant, terms, response."""
    form = weak_form(run.t, radius, noise.tolist())
    y = sum(form(part, order) for order, part in enumerate(run.parts))
    return np.column_stack([form(run.columns), y])


def _noise(runs: Sequence[_Run], values: np.ndarray) -> np.ndarray:
    """Return the coefficients of independent noises by order of the derivative, shape (noise,
    order).

        covariance of the parts = third differences' products / (1 + 9 + 9 + 1) = C' C

    Args:
        runs: runs of valid samples.
        values: constant and values of the terms, shape (1 + term,).
    """
    parts = [np.column_stack([one.parts[0] - one.columns @ values, *one.parts[1:]]) for one in runs]
    third = np.concatenate([np.diff(one, 3, axis=0) for one in parts])
    power = np.mean(np.square(np.concatenate(parts)), axis=0)
    covariance = third.T @ third / (20.0 * len(third)) + MIN_VARIANCE_SHARE * np.diag(power)
    eigenvalues, vectors = np.linalg.eigh(covariance)
    coefficients = np.sqrt(np.maximum(eigenvalues, 0.0))[:, None] * vectors.T
    return coefficients[np.any(coefficients != 0.0, axis=1)]


def _values(table: Mapping[str, np.ndarray], regression: Regression | None) -> np.ndarray:
    """Return the constant and the value of each term of the table, zero without a regression."""
    if regression is None:
        return np.zeros(1 + len(table))
    known = dict(zip(regression.names, regression.values, strict=True))
    return np.array([regression.constant, *(known.get(term, 0.0) for term in table)])


def _with_equal_constants(rows: np.ndarray) -> np.ndarray:
    """Return the rows reflected such that the first column has equal values, divided by these."""
    constant = rows[:, 0]
    size = np.linalg.norm(constant) / np.sqrt(len(constant))
    equal = -size if np.sum(constant) > 0 else size  # of the sign that does not cancel
    normal = constant - equal
    normal = normal / np.linalg.norm(normal)
    return (rows - 2.0 * np.outer(normal, normal @ rows)) / equal
