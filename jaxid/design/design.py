"""`Design`: a designed input with its predicted standard errors and the limits that it uses."""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from .._foundation.notebook import Table
from ..data.record import Record
from .information import PlannedInformation
from .signals import InputSignal

# Chi-square by which a hypothesis must lose to be refuted: a likelihood ratio of 20 (chosen).
DECISIVE = 6.0


class Comparison(NamedTuple):
    """Cost of a conventional input at the energy and at the peak of the design, and in its limits.

    A logarithmic cost: half the difference of two is the logarithm of a ratio of standard errors
    where the measure is a variance.
    """

    name: str
    equal_energy: float
    equal_peak: float
    within_limits: float


class Design(eqx.Module):
    """A designed input.

    Attributes:
        signal: deviations from trim.
        record: the noise-free record to fly.
        information: predicted standard errors.
        cost: cost of the objective; the logarithm of a measure that is a variance.
        comparisons: costs of conventional inputs.
        limits_used: share of each limit that the design uses, in a simulation at a sample rate four
            times higher; at most 1.
        starts: costs that the optimisation reached from its starts.
        chi_square: expected chi-square by which the wrong one of two hypotheses loses, the harmonic
            mean over which is true; None without a rival.
    """

    signal: InputSignal
    record: Record
    information: PlannedInformation
    cost: float = eqx.field(static=True)
    comparisons: tuple[Comparison, ...] = eqx.field(static=True)
    limits_used: dict[str, float] = eqx.field(static=True)
    starts: tuple[float, ...] = eqx.field(static=True)
    chi_square: float | None = eqx.field(static=True, default=None)

    def __str__(self) -> str:
        compared = self._comparison_table().lines()
        lines = [str(self.information), "", *self._cost_lines(), *compared, self._limits_line()]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        compared = self._comparison_table().html(self._cost_lines(), [self._limits_line()])
        return self.information._repr_html_() + compared

    def _cost_lines(self) -> list[str]:
        cost = f"cost of the design {self.cost:.4g}"
        if self.chi_square is None:
            return [cost]
        words = f"expected chi-square between the two hypotheses {self.chi_square:.4g} "
        return [f"{words}({DECISIVE:g} and more decides)", cost]

    def _comparison_table(self) -> Table:
        """Return the costs of the conventional inputs; they have no unit."""
        rows = ((name, *(f"{cost:.4g}" for cost in costs)) for name, *costs in self.comparisons)
        return Table(
            ("conventional", "equal energy", "equal peak", "limits", ""),
            (12, 13, 11, 9),
            tuple((*row, "") for row in rows),
        )

    def _limits_line(self) -> str:
        used = (f"{name} {100 * share:.0f} %" for name, share in self.limits_used.items())
        return f"limits used: {', '.join(used)}"

    def to_dict(self) -> dict[str, Any]:
        """Return the input, its limits and the expected standard errors as plain numbers."""
        errors = np.asarray(self.information.standard_errors).tolist()
        flown = zip(self.signal.inputs, np.asarray(self.record.u).T, strict=True)
        return {
            "t": np.asarray(self.signal.t).tolist(),
            "inputs": {name: values.tolist() for name, values in flown},
            "standard_errors": dict(zip(self.information.names, errors, strict=True)),
            "weak_directions": list(self.information.weak_directions),
            "cost": self.cost,
            "chi_square": self.chi_square,
            "comparisons": [comparison._asdict() for comparison in self.comparisons],
            "limits_used": dict(self.limits_used),
        }

    def plot(self) -> Any:
        """Return a figure of the record to fly and the limits used, by matplotlib
        (`jaxid[report]`).
        """
        from ..report.figures_design import design_figure

        return design_figure(self)
