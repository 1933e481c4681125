"""`Studies`: the results of many studies, printed as one table."""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...loop.outcome import Outcome

if TYPE_CHECKING:
    import pandas as pd

FAILED = "failed"


@dataclasses.dataclass(frozen=True)
class StudyResult:
    """The result of one study of many, or its failure.

    Attributes:
        name: name of the study.
        seconds: its duration [s].
        content: the result, as `Study.to_json` writes it; None for a study that failed.
        failure: reason of the failure; empty for all others.
    """

    name: str
    seconds: float
    content: Mapping[str, Any] | None
    failure: str = ""

    @property
    def outcome(self) -> Outcome | None:
        """The outcome; None for a study that failed."""
        return None if self.content is None else Outcome(self.content["outcome"])

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that were added."""
        return () if self.content is None else tuple(self.content["effects"])

    def row(self) -> dict[str, Any]:
        """Return one row of the table.

        The errors are those of the channel and test set with the largest ratio of error to noise
        before. A channel without an error on either side, such as one that is not measured, is left
        out unless all are.
        """
        row = {
            "study": self.name,
            "outcome": FAILED if self.outcome is None else self.outcome.value,
            "effects": ", ".join(self.effects),
            "channel": "",
            "before": float("nan"),
            "after": float("nan"),
            "seconds": self.seconds,
            "failure": self.failure,
        }
        if self.content is None:
            return row
        noise = self.content["noise"]
        errors = [
            (channel, test["before"][channel], test["after"][channel])
            for test in self.content["tests"].values()
            for channel in test["before"]
        ]
        known = [error for error in errors if error[1:] != (None, None)]
        channel, before, after = max(
            known or errors, key=lambda error: _ratio(_number(error[1]), noise[error[0]])
        )
        return row | {"channel": channel, "before": _number(before), "after": _number(after)}


def _ratio(error: float, noise: float | None) -> float:
    """Return the ratio of an error to a noise; JSON holds no noise for an unmeasured channel."""
    if noise is None:
        return 0.0
    if noise == 0.0:
        return float("inf") if error > 0.0 else 0.0
    return error / noise


def _number(stored: float | None) -> float:
    """Return an error; JSON holds none for a prediction that diverges."""
    return float("inf") if stored is None else stored


@dataclasses.dataclass(frozen=True)
class Studies:
    """The results of many studies.

    Attributes:
        results: one result for each study.
    """

    results: tuple[StudyResult, ...]

    def __getitem__(self, name: str) -> StudyResult:
        """Return the result of the study of a name."""
        return {result.name: result for result in self.results}[name]

    @property
    def failures(self) -> dict[str, str]:
        """Reasons of the studies that failed, by name."""
        return {result.name: result.failure for result in self.results if result.content is None}

    def to_dataframe(self) -> "pd.DataFrame":
        """Return the table with one row for each study; `before` and `after` in the unit of
        `channel`.
        """
        import pandas as pd  # imported here because it is slow to import

        return pd.DataFrame([result.row() for result in self.results]).set_index("study")

    def __str__(self) -> str:
        rows = [result.row() for result in self.results]
        left = max(len(row["study"]) for row in rows)
        lines = [f"{'study':<{left}}  {'outcome':<12} {'before':>10} {'after':>10}  effects"]
        for row in rows:
            ends = row["failure"].strip().splitlines()[-1:] or [row["effects"] or "none"]
            lines.append(
                f"{row['study']:<{left}}  {row['outcome']:<12} {row['before']:>10.4g} "
                f"{row['after']:>10.4g}  {ends[0]}"
            )
        return "\n".join(lines)
