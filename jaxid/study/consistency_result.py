"""`Consistency`: the errors of the instruments, and the residuals with and without them."""

import dataclasses
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.notebook import Table
from ..data.record import Record
from ..estimation import Estimate
from ..models.base import AbstractModel
from ..models.free import with_values

# `input_bias.ax`, `instruments.delay.alpha`, `scale of V.gain`: the kind of an error, then the
# channel.
KIND = re.compile(
    r"(?:^|.*[._])(?P<kind>bias|scale|delay|lag)(?:\.| of "
    r")(?P<channel>[^.]+)(?:\.gain)?$"
)
# Cited: correlation from which on two parameters are nearly collinear (Klein & Morelli, 2006,
# section 5.2.5).
COLLINEAR_CORRELATION = 0.9
# Chosen: ratio of corrected to plain standard errors from which on the residual is reported as
# coloured. Less reports chance correlations of short records.
COLOUR_INFLATION = 1.5


class SensorError(NamedTuple):
    """One error of an instrument, as estimated.

    Attributes:
        name: name of the parameter.
        record: name of the record that it belongs to; None if all records share it.
        value, standard_error: estimate; the standard error is infinite if the records do not
            determine it, NaN on a bound [unit].
        unit: SI.
        chance: probability that, if no instrument has an error, one of the errors tried would look
            as large (Holm).
        significant: True if `chance` is below the level.
    """

    name: str
    record: str | None
    value: float
    standard_error: float
    unit: str
    chance: float = 1.0
    significant: bool = False

    @property
    def is_known(self) -> bool:
        """True if the records determine it."""
        return bool(np.isfinite(self.standard_error) and self.standard_error > 0)

    @property
    def description(self) -> str:
        """Description of the error in engineering terms."""
        match, size, is_positive = KIND.match(self.name), f"{abs(self.value):.2g}", self.value > 0
        where = "" if self.record is None else f" in {self.record}"
        if match is None:
            return f"{self.name} is {self.value:.3g} {self.unit}".rstrip() + where
        percent = f"{100 * abs(self.value):.2g}"
        descriptions = {
            "bias": f"is off by {self.value:+.2g} {self.unit}".rstrip(),
            "scale": f"reads {percent} % too {'high' if is_positive else 'low'}",
            "delay": f"is {size} s {'late' if is_positive else 'early'}",
            "lag": f"lags by {self.value:.2g} s",
        }
        return f"{match['channel']} {descriptions[match['kind']]}{where}"


class Channel(NamedTuple):
    """Residual of one channel, root mean square, initial states estimated both times.

    Attributes:
        name: name of the channel.
        unit: SI.
        before: residual with the errors at their starting values.
        after: residual with the errors estimated.
    """

    name: str
    unit: str
    before: float
    after: float


@dataclasses.dataclass(frozen=True)
class Consistency:
    """The result of `consistency`; prints as a table with its verdict.

    Attributes:
        model: the given model, with the errors at their starting values.
        estimate: estimate of the errors and the initial states.
        errors: all errors, each with its significance.
        channels: residuals before and after.
        level: level of the test.
        records: names of the records.
        noise_known: True if the standard errors include a known noise of the inputs.
    """

    model: AbstractModel
    estimate: Estimate
    errors: tuple[SensorError, ...]
    channels: tuple[Channel, ...]
    level: float
    records: tuple[str, ...]
    noise_known: bool = False

    @property
    def significant_errors(self) -> tuple[SensorError, ...]:
        """The errors that are significant."""
        return tuple(error for error in self.errors if error.significant)

    @property
    def weak(self) -> tuple[str, ...]:
        """Descriptions of the errors that the records cannot distinguish: undetermined
        combinations, and nearly collinear pairs.
        """
        shared = [error.name for error in self.errors if error.record is None]
        imitated = [name for name in shared if name not in self.estimate.names]
        confounded = tuple(
            f"{name} cannot be distinguished from a different initial state" for name in imitated
        )
        return (*confounded, *self.estimate.weak_directions, *_pairs(self.estimate))

    @property
    def inflation(self) -> float:
        """Largest factor by which the colour of the residuals raises a standard error; 1 for white
        residuals.
        """
        ratio = np.asarray(self.estimate.corrected_errors / self.estimate.standard_errors)
        return float(np.max(ratio[np.isfinite(ratio)], initial=1.0))

    @property
    def verdict(self) -> str:
        """Description of the instruments that disagree with the others."""
        if not bool(self.estimate.successful):
            return f"No verdict. {self.estimate.status[0].upper()}{self.estimate.status[1:]}"
        unknown = [error.name for error in self.errors if not error.is_known]
        significant = self.significant_errors
        clauses = [error.description for error in significant]
        if len(self.errors) > len(significant) + len(unknown):
            clauses.append(
                f"{'the others agree' if clauses else 'the instruments agree'} within their errors"
            )
        if unknown:
            clauses.append(f"the records do not determine {', '.join(dict.fromkeys(unknown))}")
        words = "; ".join(clauses)
        return f"{words[:1] if significant else words[:1].upper()}{words[1:]}."

    def corrected(self, record: Record) -> Record:
        """Return the record without the estimated errors, significant or not, by
        `model.corrected`.

        All errors are removed, because they are estimated together: an error that remained would
        be compensated by the others.

        Args:
            record: a record with at least the channels of the model; if errors are one per record,
                one of the records checked.

        Raises:
            InputError: if the model has no `corrected`, or per-record errors are unknown for this
                record.
        """
        names, values = self.estimate.names, np.asarray(self.estimate.values)
        own = {
            name: k
            for k, name in enumerate(self.estimate.free.per_record)
            if "initial_state." not in name
        }
        if own:
            require(
                not record.is_stack,
                "Some errors are one per record. Correct one record of the stack at a time.",
            )
            require_known("record with errors of its own", record.names, self.records)
            case = self.records.index(record.names[0])
            names = (*names, *own)
            values = np.concatenate(
                [values, np.asarray(self.estimate.own)[case, list(own.values())]]
            )
        return with_values(self.model, names, jnp.asarray(values)).corrected(record)

    def to_dict(self) -> dict[str, Any]:
        """Return verdict, errors, residuals and estimate as plain numbers and words."""
        return {
            "verdict": self.verdict,
            "errors": [error._asdict() for error in self.errors],
            "channels": [channel._asdict() for channel in self.channels],
            "level": self.level,
            "records": list(self.records),
            "weak": list(self.weak),
            "inflation": self.inflation,
            "noise_known": self.noise_known,
            "estimate": self.estimate.to_dict(),
        }

    def to_xarray(self) -> Any:
        """Return errors and residuals as an `xarray.Dataset` with the axes `error` and `channel`;
        the record of an error is empty if all records share it.
        """
        import xarray as xr  # imported here because it is slow to import

        def column(rows: Sequence[tuple], name: str) -> list:
            return [getattr(row, name) for row in rows]

        errors = ("value", "standard_error", "chance", "significant")
        return xr.Dataset(
            {name: ("error", column(self.errors, name)) for name in errors}
            | {name: ("channel", column(self.channels, name)) for name in ("before", "after")},
            coords={
                "error": column(self.errors, "name"),
                "record": ("error", [error.record or "" for error in self.errors]),
                "error_unit": ("error", column(self.errors, "unit")),
                "channel": column(self.channels, "name"),
                "unit": ("channel", column(self.channels, "unit")),
            },
            attrs={"verdict": self.verdict, "level": self.level},
        )

    def _repr_html_(self) -> str:
        level, *notes = self._notes()
        errors = self._error_table().html(above=[self.verdict], below=[level])
        return errors + self._channel_table().html(below=notes)

    def __str__(self) -> str:
        level, *notes = self._notes()
        errors, channels = self._error_table().lines(), self._channel_table().lines()
        return "\n".join([self.verdict, "", *errors, level, "", *channels, *notes])

    def _error_table(self) -> Table:
        rows = []
        for error in self.errors:
            chance = f"{error.chance:.3g}{'*' if error.significant else ' '}"
            numbers = (f"{error.value:.5g}", f"{error.standard_error:.3g}", chance)
            mark = f" in {error.record}" if error.record is not None else ""
            rows.append((error.name, *numbers, error.unit + mark))
        heads = ("error", "value", "std. error", "chance ", "unit")
        return Table(heads, (7, 12, 11, 10), tuple(rows))

    def _channel_table(self) -> Table:
        width = max(len(name) for name, *_ in (*self.errors, *self.channels))
        return Table(
            ("channel", "RMS before", "RMS after", "unit"),
            (max(width, 7), 12, 11),
            tuple((c.name, f"{c.before:.4g}", f"{c.after:.4g}", c.unit) for c in self.channels),
        )

    def _notes(self) -> list[str]:
        """Level of the test, errors that are not determined, colour, assumptions and status."""
        lines = [f"* significant at {self.level:g} over all {len(self.errors)} tried (Holm)"]
        lines += [f"weak: {words}" for words in self.weak]
        if self.inflation > COLOUR_INFLATION:
            lines.append(
                f"The residuals are coloured, and standard errors up to {self.inflation:.2g} times "
                "as large as for white noise: the inputs are noisy, the air moves, or an error is "
                "missing among those tried."
            )
        if not self.noise_known:
            lines.append(
                "The inputs are assumed to be free of noise; give `input_noise` if they are not."
            )
        return [*lines, f"status: {self.estimate.status}"]


def _pairs(fitted: Estimate) -> tuple[str, ...]:
    """Descriptions of the pairs of errors that are nearly collinear."""
    correlation = np.asarray(fitted.correlation)
    rows, columns = np.nonzero(
        np.triu(np.abs(correlation) > COLLINEAR_CORRELATION, 1) & np.isfinite(correlation)
    )
    return tuple(
        f"{fitted.names[i]} and {fitted.names[j]} can hardly be distinguished (correlation "
        f"{correlation[i, j]:.3f})"
        for i, j in zip(rows, columns, strict=True)
    )
