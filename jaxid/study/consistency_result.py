"""`Consistency`: which instruments err, by how much, and what that explains of the residuals."""

import dataclasses
import re
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from ..data.record import Record
from ..estimation import Estimate
from ..models.base import AbstractModel
from ..models.free import with_values

CORRELATED = 0.9  # from here on two parameters are near to one: Klein & Morelli (2006), section 5.2.5
COLOURED = (
    1.5  # standard errors that grow by more than this with the colour of the residuals tell of a cause beside noise
)

# `input_bias.ax`, `instruments.delay.alpha`, `scale of V.gain`: the kind of an error, then the channel.
KIND = re.compile(r"(?:^|.*[._])(?P<kind>bias|scale|delay|lag)(?:\.| of )(?P<channel>[^.]+)(?:\.gain)?$")


class SensorError(NamedTuple):
    """One error of an instrument, as estimated.

    Attributes:
        name: of the parameter.
        record: name of the record that has it to itself; None where all records share it.
        value, standard_error: infinite where the records do not determine it, NaN on a bound [unit].
        unit: SI.
        chance: probability that, were there no errors at all, one of those tried would look as large (Holm).
        found: whether that is less than the level.
    """

    name: str
    record: str | None
    value: float
    standard_error: float
    unit: str
    chance: float = 1.0
    found: bool = False

    @property
    def is_known(self) -> bool:
        """Whether the records determine it."""
        return bool(np.isfinite(self.standard_error) and self.standard_error > 0)

    @property
    def sentence(self) -> str:
        """What it is, in words that an engineer uses."""
        match, size, more = KIND.match(self.name), f"{abs(self.value):.2g}", self.value > 0
        where = "" if self.record is None else f" in {self.record}"
        if match is None:
            return f"{self.name} is {self.value:.3g} {self.unit}".rstrip() + where
        said = {
            "bias": f"is off by {self.value:+.2g} {self.unit}".rstrip(),
            "scale": f"shows {100 * abs(self.value):.2g} % too {'much' if more else 'little'}",
            "delay": f"is {size} s {'late' if more else 'early'}",
            "lag": f"lags by {self.value:.2g} s",
        }
        return f"{match['channel']} {said[match['kind']]}{where}"


class Channel(NamedTuple):
    """Residual of one channel, root mean square, initial states estimated both times.

    Attributes:
        name: of the channel.
        unit: SI.
        before: with the errors at their start.
        after: with the errors estimated.
    """

    name: str
    unit: str
    before: float
    after: float


@dataclasses.dataclass(frozen=True)
class Consistency:
    """The result of `consistency`; prints as a table with its verdict.

    Attributes:
        model: as given, with the errors at their start.
        estimate: of the errors and the initial states.
        errors: each with its significance.
        channels: residuals before and after.
        level: of the test.
        records: names of the records.
        noise_known: whether standard errors hold a known noise of the inputs.
    """

    model: AbstractModel
    estimate: Estimate
    errors: tuple[SensorError, ...]
    channels: tuple[Channel, ...]
    level: float
    records: tuple[str, ...]
    noise_known: bool = False

    @property
    def found(self) -> tuple[SensorError, ...]:
        """The errors that are significant."""
        return tuple(error for error in self.errors if error.found)

    @property
    def weak(self) -> tuple[str, ...]:
        """What the records do not tell apart, in words: undetermined combinations, and pairs that are nearly one."""
        shared = [error.name for error in self.errors if error.record is None]
        imitated = [name for name in shared if name not in self.estimate.names]
        told = tuple(f"{name} is not told from another initial state" for name in imitated)
        return (*told, *self.estimate.weak_directions, *_pairs(self.estimate))

    @property
    def inflation(self) -> float:
        """By how much the colour of the residuals raises a standard error, at most; 1 for white ones."""
        ratio = np.asarray(self.estimate.coloured_errors / self.estimate.standard_errors)
        return float(np.max(ratio[np.isfinite(ratio)], initial=1.0))

    @property
    def verdict(self) -> str:
        """Which instruments disagree with the others, in a sentence or a few."""
        if not bool(self.estimate.successful):
            return f"No verdict. {self.estimate.status[0].upper()}{self.estimate.status[1:]}"
        unknown = [error.name for error in self.errors if not error.is_known]
        rest = len(self.errors) - len(self.found) - len(unknown)
        said = [error.sentence for error in self.found]
        if rest:
            said.append(f"{'the others agree' if said else 'the instruments agree'} within their errors")
        if unknown:
            said.append(f"the records do not determine {', '.join(dict.fromkeys(unknown))}")
        words = "; ".join(said)
        return f"{words[:1].upper() if not self.found else words[:1]}{words[1:]}."

    def corrected(self, record: Record) -> Record:
        """The record with the estimated errors taken out, significant or not, as `model.corrected` does it.

        Errors are estimated together, and one left in would be made up for by the others.

        Args:
            record: one with the channels of the model, and more; where errors are one per record, one of those checked.

        Raises:
            InputError: when the model does not say how, or the record is none of those that have errors of their own.
        """
        names, values = self.estimate.names, np.asarray(self.estimate.values)
        own = {name: k for k, name in enumerate(self.estimate.free.per_record) if "initial_state." not in name}
        if own:
            require(not record.is_stack, "Some errors are one per record. Correct one record of the stack at a time.")
            require_known("record with errors of its own", record.names, self.records)
            case = self.records.index(record.names[0])
            names = (*names, *own)
            values = np.concatenate([values, np.asarray(self.estimate.own)[case, list(own.values())]])
        return with_values(self.model, names, jnp.asarray(values)).corrected(record)

    def __str__(self) -> str:
        width = max(len(error.name) for error in (*self.errors, SensorError("channel", None, 0, 0, "")))
        lines = [self.verdict, "", f"{'error':<{width}} {'value':>12} {'std. error':>11} {'chance':>9}  unit"]
        for error in self.errors:
            mark = f" in {error.record}" if error.record is not None else ""
            lines.append(
                f"{error.name:<{width}} {error.value:>12.5g} {error.standard_error:>11.3g} {error.chance:>9.3g}"
                f"{'*' if error.found else ' '} {error.unit}{mark}"
            )
        lines.append(f"* significant at {self.level:g} over all {len(self.errors)} tried (Holm)")
        lines += ["", f"{'channel':<{width}} {'RMS before':>12} {'RMS after':>11}  unit"]
        lines += [f"{c.name:<{width}} {c.before:>12.4g} {c.after:>11.4g}  {c.unit}" for c in self.channels]
        lines += [f"weak: {words}" for words in self.weak]
        if self.inflation > COLOURED:
            lines.append(
                f"The residuals are coloured, and standard errors up to {self.inflation:.2g} times as large as for white noise: "
                "inputs are noisy, the air moves, or an error is missing among those tried."
            )
        if not self.noise_known:
            lines.append("Inputs are taken as free of noise; give `input_noise` where they are not.")
        return "\n".join([*lines, f"status: {self.estimate.status}"])


def _pairs(found: Estimate) -> tuple[str, ...]:
    """Pairs of errors that are nearly one, in words."""
    correlation = np.asarray(found.correlation)
    rows, columns = np.nonzero(np.triu(np.abs(correlation) > CORRELATED, 1) & np.isfinite(correlation))
    return tuple(
        f"{found.names[i]} and {found.names[j]} are hardly told apart (correlation {correlation[i, j]:.3f})"
        for i, j in zip(rows, columns, strict=True)
    )
