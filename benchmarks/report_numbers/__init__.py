"""Numbers of the report's Tables 3.3, 3.4, 5.1, 6.3 and 6.5 to 6.16, for comparison with our
results.

Each CSV file holds one kind of number, and each row names its table (Table 6.6 is in
`jaxid.aircraft.instruments.noise_levels`, Figure 6.2 in `benchmarks.report_cases`). Cases have the
names of `jaxid.aircraft.flight.report_cases`. Terms are written in our notation: `phat`, `qhat`,
`rhat` where the report writes p, q, r, and `1` for a constant; alpha and beta inside a term are
differences from the record's means. Angles are in radians; signs are the report's, which are also
ours. A value is printed in two places where possible, and the value on which both agree is kept;
where the scan differs from it, `note` gives the scanned value. A value that no second place
decides is kept as scanned and marked `doubtful`.

How to read the report's numbers (each is checked in the test of this module):

- A cost is the cost of Table 4.2, half of `log det R` plus half the number m of outputs: the
  negative log-likelihood of a sample at the R of Eq. 4.4. The printed "noise covariances" are
  standard deviations sigma_i: with them, `J = sum ln(sigma_i) + m/2` gives every printed final cost
  except for its minus sign, which only Table 6.12 has. All costs here have the minus sign.
- The two-sigma bands of terms with F of 100 and more are printed ten times too large:
  `2 |value| / sqrt(F)` is right.
- The 4 % rule gives the estimated sets of Tables 6.5 to 6.12, with a constant for each equation
  and, in the lateral tables, the bias of beta. It does not give the set of Table 6.14, which
  holds 12 of the rule's 21 terms, those with F of 139 and more, and not the bias.

Steps of the sections that the tables show only in part:

- 6.3.2, process noise: the estimator is still output error, without process noise. The gusts count
  as noise of the outputs, as their estimated sigma shows. Ten terms, three constants, the bias of
  beta. (The section cites Table 6.8 for the gusts; Table 6.6 has them.)
- 6.4.2, two experiments combined: a coefficient is averaged instead of the parameters, point by
  point in the range of alpha that both records cover, with the inverse of its variance from each
  fit as weights (Eq. 4.15, whose sigma_i the text calls variances). Elsewhere each estimate stands
  alone. The example is the slope of Cn in beta, from lateral 1 and 4.
- 6.4.3, 22 parameters for the record of lateral 1: the twelve, started at their estimates; the six
  terms of Table 6.3 with the next largest F, 50 and more, started at the regression's values;
  biases of ay, p and r; and alpha^5 in Cl, which Table 6.3 does not have and which we cannot
  explain. (The section cites Table 6.14; the right one is Table 6.15.)
- 6.4.4, coupled: seven outputs (all but ax), the equation of u left out, 24 terms and the seven
  sigma: 31. No regression is printed; three terms have no value at the start. The "30" for the two
  separate cases without u is 28 by our count (9 and 12 terms, 7 sigma).
- Table 6.4 lists `alpha^2 stabilator` in Cm of longitudinal 1, fixed at the regression's value;
  Table 6.3 does not have it.
"""

import csv
from pathlib import Path
from typing import NamedTuple

FOLDER = Path(__file__).parent


class Equation(NamedTuple):
    """A regression as a whole: the F-ratio of its fit."""

    table: str
    page: int
    case: str
    response: str
    F: float


class Selected(NamedTuple):
    """A term that the regression chose; `kept` by the 4 % rule; constants have no F."""

    table: str
    case: str
    response: str
    term: str
    estimate: float
    F: float | None
    kept: bool
    doubtful: bool
    note: str


class Refined(NamedTuple):
    """A parameter that maximum likelihood estimated; the `response` of an output's bias is `bias`,
    its term the channel.

    Attributes:
        start: value before the first iteration.
        F_regression: of the regression.
        F_start: by likelihood at the start.
        final: estimate.
        F_final: by likelihood, `(final / sigma)^2` (Eq. 6.7).
        two_sigma: band of the estimate as printed.
    """

    table: str
    case: str
    response: str
    term: str
    start: float | None
    F_regression: float | None
    F_start: float | None
    final: float
    F_final: float
    two_sigma: float | None
    doubtful: bool
    note: str


class Fit(NamedTuple):
    """A run of maximum likelihood: costs before and after, relative change in the last
    iteration.
    """

    table: str
    page: int
    case: str
    parameters: int
    J0: float
    Jf: float
    relative_change: float
    iterations: int


class Noise(NamedTuple):
    """Estimated standard deviation of an output's noise, in the unit printed."""

    table: str
    case: str
    channel: str
    sigma: float
    unit: str
    doubtful: bool
    note: str


class Example(NamedTuple):
    """A small manoeuvre: the terms that explain this share of the response's variation."""

    table: str
    page: int
    case: str
    response: str
    terms: tuple[str, ...]
    explained: float
    note: str


def equations(case: str | None = None) -> list[Equation]:
    """Overall F of each regression."""
    return _read("equations", Equation, case)


def regression(case: str | None = None) -> list[Selected]:
    """Terms chosen by the regression (Tables 6.3, 6.7, 6.9, 6.11, 6.13), in the order printed."""
    return _read("regression", Selected, case)


def likelihood(case: str | None = None) -> list[Refined]:
    """Parameters estimated by maximum likelihood (Tables 6.5, 6.8, 6.10, 6.12, 6.14 to 6.16), in
    the order printed.
    """
    return _read("likelihood", Refined, case)


def fits(case: str | None = None) -> list[Fit]:
    """Costs and iterations of each run; lateral 1 has two, of 12 and of 22 parameters."""
    return _read("fits", Fit, case)


def noise(case: str | None = None) -> list[Noise]:
    """Estimated standard deviations of the outputs' noise; Table 6.15 prints none."""
    return _read("noise", Noise, case)


def examples(case: str | None = None) -> list[Example]:
    """The small manoeuvres of Tables 3.3, 3.4 and 5.1."""
    return _read("examples", Example, case)


def _read(name: str, row, case: str | None) -> list:
    with (FOLDER / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        rows = [
            row(**{key: _cell(key, text) for key, text in line.items()})
            for line in csv.DictReader(file)
        ]
    return [one for one in rows if case in (None, one.case)]


def _cell(column: str, text: str):
    """The cell in the column's type; an empty number is None."""
    if column in ("table", "case", "response", "term", "channel", "unit", "note"):
        return text
    if column in ("kept", "doubtful"):
        return text == "x"
    if column in ("page", "parameters", "iterations"):
        return int(text)
    if column == "terms":
        return tuple(text.split("; "))
    return float(text) if text else None
