"""`Design`: a designed input with its predicted standard errors and the limits that it uses."""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from .._foundation.notebook import preformatted
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
        width = max(len(name) for name in ("conventional", *(c.name for c in self.comparisons)))
        lines = [str(self.information), ""]
        if self.chi_square is not None:
            lines.append(
                f"expected chi-square between the two hypotheses {self.chi_square:.4g} "
                f"({DECISIVE:g} and more decides)"
            )
        lines.append(f"cost of the design {self.cost:.4g}")
        lines.append(
            f"{'conventional':<{width}} {'equal energy':>13} {'equal peak':>11} {'limits':>9}"
        )
        for name, energy, peak, within in self.comparisons:
            lines.append(f"{name:<{width}} {energy:>13.4g} {peak:>11.4g} {within:>9.4g}")
        used = [f"{name} {100 * share:.0f} %" for name, share in self.limits_used.items()]
        return "\n".join([*lines, f"limits used: {', '.join(used)}"])

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

    def _repr_html_(self) -> str:
        return preformatted(str(self))
