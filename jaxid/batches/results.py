"""Results of a batch: one array per quantity, with the case as first axis, and their dataset."""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from .._foundation.results import RESULTS
from ..estimation.result import describe_weak_directions
from .cases import Case
from .chunk import Finished
from .iteration import CaseResult

if TYPE_CHECKING:
    import xarray as xr

UNFINISHED = "unfinished"
REFUSED = "refused"
UNDETERMINED = "undetermined"
SUCCESSFUL = ("successful", "at_bound")
# Names of the statuses, which are the names of `RESULTS`.
STATUSES = (*SUCCESSFUL, UNDETERMINED, "steps_exhausted", "no_descent", "start_diverges", REFUSED)
STATUS_TYPE = "<U15"  # as long as the longest of them

Arrays = dict[str, np.ndarray]


class Variable(NamedTuple):
    """One quantity of all cases.

    Attributes:
        dimensions: names of its axes after `case`.
        type: NumPy's name of its type.
        description: one sentence.
    """

    dimensions: tuple[str, ...]
    type: str
    description: str


PAIR = ("parameter", "other_parameter")
OWN = ("record", "own_parameter")
VARIABLES = {
    "start": Variable(("parameter",), "float64", "values at which the iteration started"),
    "values": Variable(("parameter",), "float64", "estimates of the shared parameters"),
    "standard_errors": Variable(
        ("parameter",), "float64", "Cramer-Rao bounds; infinite for an undetermined parameter"
    ),
    "corrected_errors": Variable(
        ("parameter",), "float64", "standard errors corrected for the colour of the residuals"
    ),
    "corrected_dof": Variable(
        ("parameter",), "float64", "degrees of freedom of the corrected variances"
    ),
    "covariance": Variable(PAIR, "float64", "covariance of the shared parameters"),
    "on_bound": Variable(("parameter",), "bool", "true for a parameter on one of its bounds"),
    "own": Variable(OWN, "float64", "estimates of the parameters of each record"),
    "own_errors": Variable(OWN, "float64", "their standard errors"),
    "noise": Variable(("output", "other_output"), "float64", "covariance R of the measurements"),
    "cost": Variable((), "float64", "negative log-likelihood without its constant"),
    "degrees_of_freedom": Variable(
        (), "float64", "valid measurements less free parameters; infinite where R is known"
    ),
    "iterations": Variable((), "int64", "accepted steps"),
    "status": Variable((), STATUS_TYPE, "outcome by name"),
    "reason": Variable((), "object", "outcome and remedy in words"),
}


class Layout(NamedTuple):
    """Names along the axes of the results.

    Attributes:
        cases: name of each case.
        parameters, units: shared parameters.
        own: parameters of each record.
        records: largest number of records of a case; a case with fewer has NaN for the others.
        outputs: measured outputs.
        threshold: eigenvalues below this share of the largest are weak.
    """

    cases: tuple[str, ...]
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    own: tuple[str, ...]
    records: int
    outputs: tuple[str, ...]
    threshold: float

    @classmethod
    def of(cls, cases: Sequence[Case], threshold: float) -> "Layout":
        """Return the layout of the results of some cases."""
        accepted = [case for case in cases if not case.refusal]
        model, free, _ = accepted[0].arrays
        units = model.units()
        return cls(
            tuple(case.name for case in cases),
            free.shared,
            tuple(units.get(name, "") for name in free.shared),
            free.per_record,
            max(case.records[0].shape[0] for case in accepted),
            model.outputs,
            threshold,
        )

    @property
    def sizes(self) -> dict[str, int]:
        """Length of each axis after `case`."""
        shared, outputs = len(self.parameters), len(self.outputs)
        return {
            "parameter": shared,
            "other_parameter": shared,
            "record": self.records,
            "own_parameter": len(self.own),
            "output": outputs,
            "other_output": outputs,
        }

    def empty(self) -> Arrays:
        """Return arrays without results: NaN, zero, and the status `unfinished`."""
        fills: dict[str, Any] = {"float64": np.nan, "object": "", STATUS_TYPE: UNFINISHED}
        return {
            name: np.full(
                (len(self.cases), *(self.sizes[axis] for axis in variable.dimensions)),
                fills.get(variable.type, 0),
                variable.type,
            )
            for name, variable in VARIABLES.items()
        }

    def add(self, arrays: Arrays, finished: Finished) -> list[int]:
        """Write the results of finished cases into the arrays, and return their indices."""
        indices = [case.index for case in finished.cases]
        results, status = finished.results, _status(finished.results)
        arrays["status"][indices] = status
        arrays["reason"][indices] = [self._reason(results, *row) for row in enumerate(status)]
        for name, values in results._asdict().items():
            if name in ("own", "own_errors"):
                arrays[name][indices, : values.shape[1]] = values
            elif name in arrays:
                arrays[name][indices] = values
        return indices

    def _reason(self, results: CaseResult, row: int, status: str) -> str:
        """Return the outcome of one case in words."""
        sentence = _sentence(status)
        if status != UNDETERMINED:
            return sentence
        one = jax.tree.map(lambda leaf: leaf[row], results)
        words = describe_weak_directions(
            self.parameters,
            np.asarray(one.values),
            np.asarray(one.on_bound),
            np.asarray(one.factor),
            np.asarray(one.scale),
            self.threshold,
        )
        return f"{sentence} Here: {'; '.join(words)}."

    def dataset(self, arrays: Arrays, attributes: dict[str, str]) -> "xr.Dataset":
        """Return the results as a dataset.

        Args:
            arrays: from `empty`, filled by `add`.
            attributes: version and settings.
        """
        import xarray as xr  # imported here because it is slow to import

        variables = {
            name: (
                ("case", *variable.dimensions),
                arrays[name],
                {"description": variable.description},
            )
            for name, variable in VARIABLES.items()
        }
        coordinates = {
            "case": np.arange(len(self.cases)),
            "name": ("case", np.array(self.cases, str)),
            "parameter": np.array(self.parameters, str),
            "other_parameter": np.array(self.parameters, str),
            "unit": ("parameter", np.array(self.units, str)),
            "own_parameter": np.array(self.own, str),
            "output": np.array(self.outputs, str),
            "other_output": np.array(self.outputs, str),
        }
        return xr.Dataset(variables, coordinates, attributes)


def refuse(arrays: Arrays, cases: Sequence[Case]) -> list[int]:
    """Write the refusals of cases into the arrays, and return the indices of these cases."""
    refused = [case for case in cases if case.refusal]
    for case in refused:
        arrays["status"][case.index] = REFUSED
        arrays["reason"][case.index] = f"{_sentence(REFUSED)} {case.refusal}"
    return [case.index for case in refused]


def _status(results: CaseResult) -> np.ndarray:
    """Return the names of the statuses of some cases."""
    status = np.array([_names()[code] for code in results.result.tolist()], STATUS_TYPE)
    is_undetermined = np.any(np.isinf(results.standard_errors), axis=1)
    return np.where(np.isin(status, SUCCESSFUL) & is_undetermined, UNDETERMINED, status)


@functools.cache
def _names() -> dict[int, str]:
    """Return the names of the statuses by their codes."""
    return {int(jax.tree.leaves(getattr(RESULTS, name))[0]): name for name in STATUSES}


@functools.cache
def _sentence(status: str) -> str:
    """Return the sentence of a status, as `Estimate.status` does."""
    return RESULTS[getattr(RESULTS, status)] or "converged"
