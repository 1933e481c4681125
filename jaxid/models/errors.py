"""`EstimateErrors`: values, standard errors and covariance of an estimate as plain numbers."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np

from .._foundation.checks import InputError, require, require_known
from .._foundation.notebook import Table
from .._foundation.types import Float
from ..data.io.document import names_of, number


class EstimateErrors(eqx.Module):
    """Values and errors of an estimate, without its records: the part of it that `save` writes.

    Attributes:
        names: names of the shared parameters.
        values, standard_errors, corrected_errors, covariance: as in `Estimate`.
        own_names: names of the parameters of each record.
        own, own_errors: their values and standard errors, one row for each record.
        outputs: names of the outputs.
        noise: R, as fixed or as estimated [products of output units].
        fit: share of each output that the model explains [percent].
        noise_known: True if R was given.
        successful, status: outcome of the iteration, and its sentence.
    """

    values: Float[np.ndarray, " parameter"]
    standard_errors: Float[np.ndarray, " parameter"]
    corrected_errors: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    own: Float[np.ndarray, "case own"]
    own_errors: Float[np.ndarray, "case own"]
    noise: Float[np.ndarray, "output output"]
    fit: Float[np.ndarray, " output"]
    names: tuple[str, ...] = eqx.field(static=True)
    own_names: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)
    noise_known: bool = eqx.field(static=True)
    successful: bool = eqx.field(static=True)
    status: str = eqx.field(static=True)

    @classmethod
    def arrays(cls) -> tuple[str, ...]:
        """Return the names of the fields that are arrays."""
        static = {field.name for field in dataclasses.fields(cls) if field.metadata.get("static")}
        return tuple(field.name for field in dataclasses.fields(cls) if field.name not in static)

    def standard_error(self, name: str) -> float:
        """Return the standard error of one shared parameter, by name."""
        require_known("shared free parameter", [name], self.names)
        return float(self.standard_errors[self.names.index(name)])

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as lists, numbers and words, for JSON."""
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {
            name: np.asarray(value).tolist() if isinstance(value, np.ndarray | tuple) else value
            for name, value in fields.items()
        }

    def __str__(self) -> str:
        return "\n".join([*self._table().lines(), f"status: {self.status}"])

    def _repr_html_(self) -> str:
        return self._table().html(below=[f"status: {self.status}"])

    def _table(self) -> Table:
        """Return the shared parameters in words."""
        columns = (self.values, self.standard_errors, self.corrected_errors)
        rows = (
            (name, f"{value:.6g}", f"{error:.3g}", f"{coloured:.3g}", "")
            for name, value, error, coloured in zip(self.names, *columns, strict=True)
        )
        heads = ("parameter", "value", "std. error", "coloured", "")
        return Table(heads, (9, 13, 11, 11), tuple(rows))


def errors_of(content: Any, file: str) -> EstimateErrors | None:
    """Return the errors of a file of `save`, None if it has none.

    Args:
        content: the entry of the file.
        file: its name, for messages.

    Raises:
        InputError: when an entry is missing, of another kind, or of another size.
    """
    if content is None:
        return None
    require(isinstance(content, Mapping), f"{file}: 'errors' is no object. Write the file again.")
    names = {
        key: names_of(content, key, f"{file}: errors") for key in ("names", "own_names", "outputs")
    }
    parameters, outputs = len(names["names"]), len(names["outputs"])
    own = content.get("own")
    rows = (len(own) if isinstance(own, list) else 0, len(names["own_names"]))
    shapes = {
        **dict.fromkeys(("values", "standard_errors", "corrected_errors"), (parameters,)),
        **dict.fromkeys(("own", "own_errors"), rows),
        "covariance": (parameters, parameters),
        "noise": (outputs, outputs),
        "fit": (outputs,),
    }
    words = {"noise_known": bool, "successful": bool, "status": str}
    for key, kind in words.items():
        require(
            isinstance(content.get(key), kind),
            f"{file}: errors: {key!r} is missing or no {kind.__name__}. Write the file again.",
        )
    return EstimateErrors(
        **{key: _array(content, key, shape, file) for key, shape in shapes.items()},
        **names,
        **{key: content[key] for key in words},
    )


def _array(content: Mapping[str, Any], key: str, shape: tuple[int, ...], file: str) -> np.ndarray:
    """Return an array of the file; one of another shape is refused."""
    entries = np.array(content.get(key), dtype=object)
    if entries.shape != shape and not (entries.size == 0 and 0 in shape):
        raise InputError(
            f"{file}: errors: {key!r} has the shape {entries.shape}, and {shape} belongs to its "
            "names. Write the file again."
        )
    numbers = [number(entry, f"{file}: errors: {key!r}") for entry in entries.ravel()]
    return np.array(numbers, float).reshape(shape)
