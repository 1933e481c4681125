"""The checks of the records of a batch, each case by itself."""

from typing import Any

import jax
import numpy as np

from .._foundation.checks import InputError, require
from .._foundation.host import to_device
from ..data.record import Record
from ..estimation.argument_checks import check_arguments
from ..estimation.estimate import check_channels, check_known
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel


class CaseChecks:
    """The checks of `estimate` for the records of many cases.

    The checks of channels, times and missing samples are made once for all records that have these
    in common, as in a Monte Carlo; the values of each record are checked by themselves.

    Args:
        likelihood: the likelihood.
    """

    def __init__(self, likelihood: AbstractLikelihood) -> None:
        self.likelihood, self.prepared = likelihood, likelihood.prepared  # a lookup takes 0.1 ms
        self.structures: dict[object, Any] = {}  # of records without names, by common properties

    def without_names(self, model: AbstractModel, records: Record) -> Record:
        """Return a stack without names after all checks.

        Args:
            model: the model.
            records: a record or a stack.

        Returns:
            The stack, its arrays on the host.

        Raises:
            InputError: as `estimate`.
        """
        leaves, structure = jax.tree.flatten(records)
        new_axis = () if records.is_stack else (None,)
        leaves = [np.asarray(leaf)[new_axis] for leaf in leaves]
        if not all(np.isfinite(leaf).all() for leaf in leaves):  # masked values need not be
            _check_finite(structure.unflatten(leaves))
        t, _, _, mask = leaves[:4]
        units = (records.input_units, records.output_units, tuple(sorted(records.constants)))
        channels = (records.inputs, records.outputs, *units)
        common = (t.tobytes(), mask.tobytes(), t.shape, channels, jax.tree.structure(model))
        if common not in self.structures:
            on_device = to_device(structure.unflatten(leaves))
            check_arguments(model, on_device, self.likelihood)
            check_channels(model, on_device)
            check_known(model, on_device, self.likelihood)
            self.structures[common] = jax.tree.structure(on_device.anonymous())
        return self.structures[common].unflatten(leaves)


def _check_finite(records: Record) -> None:
    """Refuse records with a value that is not finite.

    `record(...)` refuses it as well; the constructor `Record(...)` does not.
    """
    valid = np.where(np.asarray(records.mask), np.asarray(records.z), 0.0)
    time = np.asarray(records.t)[..., None]
    for kind, values, names in (
        ("time", time, ("t",)),
        ("input", np.asarray(records.u), records.inputs),
        ("output", valid, records.outputs),
    ):
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            case, row, channel = bad[0]
            raise InputError(
                f"Record {records.names[case]!r}: the {kind} {names[channel]!r} is "
                f"{values[case, row, channel]} in row {row} ({len(bad)} such values). Mask or "
                "interpolate them; `jaxid.record` takes NaN in an output as a missing sample."
            )
    for name, value in records.constants.items():
        require(
            bool(np.all(np.isfinite(np.asarray(value)))),
            f"The constant {name!r} of the record is {np.asarray(value)}. Give a finite number.",
        )
