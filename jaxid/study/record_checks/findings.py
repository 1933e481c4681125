"""`Finding`: one observation on a record, as data; `Advice`: all of them, with their numbers."""

import enum
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from ...design.information import PlannedInformation
from .wording import html_tables, sentence, table


class FindingKind(enum.Enum):
    """Kind of a finding; the value is its title in tables.

    Attributes:
        HOLE: a step of time far above the median (`seconds`, `ratio`).
        UNEVEN_TIMES: the steps of time differ; the checks of delay, drift and feedback are left out
            (`longest`, `shortest` in median steps).
        MISSING: samples of an output are missing (`share`, `longest` in seconds).
        CONSTANT: a channel has one value (`value`).
        SLOW_SAMPLING: the fastest mode of the model is faster than the samples (`rate` in rad/s,
            `samples` in a period).
        SHORT_RECORD: the record is shorter than a period of the slowest mode (`rate`, `periods`).
        UNEXCITED_MODE: no input has power near a mode (`rate`, `share`).
        COLLINEAR: an input is nearly a combination of the other inputs (`inflation`).
        QUANTISATION: an output is recorded in visible steps (`step`, `levels`).
        SATURATION: an output stays at its largest or smallest value (`value`, `share`).
        OFFSET: an output at rest is not zero, where the model rests (`value`, `errors`).
        DRIFT: an output has a trend that the inputs do not explain (`slope`, `errors`).
        DELAY: an output responds later than the model (`seconds`, `deviation`, `fall`).
        FEEDBACK: an input contains the noise of an output: a controller or pilot closes the loop
            (`lag` in seconds, `correlation`).
        UNIT: record and model have different units for a channel.
        DEGREES: an angle looks as if it were in degrees (`largest`, `ratio`).
        OTHER_UNIT: an output responds to an input more strongly than in another record, or less, by
            the ratio of two units (`ratio`).
        MILLISECONDS: time looks as if it were in milliseconds (`step`).
        RATE: a channel does not move as the integral of its rate, which other channels give: a
            wrong unit or sign (`ratio`, `share` of the motion).
        DIVERGENCE: the simulation with the present values is not finite (`seconds`).
        UNDETERMINED: no record determines the parameters, or one of their combinations.
        HARDLY: the expected standard error exceeds half of the value (`error`, `relative`).
    """

    HOLE = "hole in time"
    UNEVEN_TIMES = "uneven times"
    MISSING = "missing samples"
    CONSTANT = "constant channel"
    SLOW_SAMPLING = "slow sampling"
    SHORT_RECORD = "short record"
    UNEXCITED_MODE = "mode not excited"
    COLLINEAR = "collinear inputs"
    QUANTISATION = "coarse steps"
    SATURATION = "saturation"
    OFFSET = "offset at rest"
    DRIFT = "drift"
    DELAY = "delay"
    FEEDBACK = "feedback"
    UNIT = "unit"
    DEGREES = "degrees?"
    OTHER_UNIT = "unit of another record?"
    MILLISECONDS = "milliseconds?"
    RATE = "rate?"
    DIVERGENCE = "divergence"
    UNDETERMINED = "not determined"
    HARDLY = "hardly determined"


class Finding(NamedTuple):
    """One observation on a record.

    Attributes:
        kind: kind of the finding.
        record: name of the record, or its number; empty for all records together.
        names: channels or parameters.
        numbers: measured quantities by name, see `FindingKind` [SI].
        units: units, or a combination of parameters, in words.
    """

    kind: FindingKind
    record: str
    names: tuple[str, ...]
    numbers: dict[str, float]
    units: tuple[str, ...] = ()

    def __str__(self) -> str:
        return sentence(self.kind.name, self.names, self.numbers, self.units)


class Excitation(NamedTuple):
    """Size and frequency band of one input of one record.

    Attributes:
        record: name or number of the record.
        input: name of the input.
        unit: its unit.
        rms: root mean square about the mean [unit].
        extent: largest less smallest value [unit].
        low, high: frequencies below and above which 5 % of the power lie [rad/s].
    """

    record: str
    input: str
    unit: str
    rms: float
    extent: float
    low: float
    high: float


class Advice(eqx.Module):
    """Findings on records, before a model is fitted to them.

    Attributes:
        findings: the findings, in the order of `FindingKind` for each record.
        excitation: size and band of each input.
        information: expected standard errors from all records together at the present values of the
            model; None where it was not computed.
    """

    findings: tuple[Finding, ...] = eqx.field(static=True)
    excitation: tuple[Excitation, ...] = eqx.field(static=True)
    information: PlannedInformation | None

    def of(self, kind: FindingKind) -> tuple[Finding, ...]:
        """Return the findings of one kind."""
        return tuple(finding for finding in self.findings if finding.kind is kind)

    def to_dict(self) -> dict[str, Any]:
        """Return findings, excitation and expected standard errors as plain numbers and words."""
        information = self.information
        return {
            "findings": [
                {
                    "kind": finding.kind.value,
                    "record": finding.record,
                    "names": list(finding.names),
                    "numbers": dict(finding.numbers),
                    "words": str(finding),
                }
                for finding in self.findings
            ],
            "excitation": [row._asdict() for row in self.excitation],
            "standard_errors": {}
            if information is None
            else dict(
                zip(
                    information.names, np.asarray(information.standard_errors).tolist(), strict=True
                )
            ),
        }

    def __str__(self) -> str:
        return table(self._rows(), self.excitation, self.information)

    def _repr_html_(self) -> str:
        return html_tables(self._rows(), self.excitation, self.information)

    def _rows(self) -> list[tuple[str, str, str]]:
        """Return title, record and words of each finding."""
        return [(finding.kind.value, finding.record, str(finding)) for finding in self.findings]
