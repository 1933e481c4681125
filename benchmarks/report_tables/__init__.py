"""The report's tables from our own flights, and verdicts on its claims: `python -m
benchmarks.report_tables`.

`run(case)` flies and identifies one of the eight cases, `fit` any flights; their results are plain
named tuples that the notebooks use too. `settings` separates the
report's choices from ours.
"""

from benchmarks.report_tables.cases import CaseResult, fit, fly_case, larger_set, run
from benchmarks.report_tables.comparisons import combined, curves, predicted
from benchmarks.report_tables.examples import small
from benchmarks.report_tables.rows import parameter_rows
from benchmarks.report_tables.verdicts import judge, verdicts

__all__ = [
    "CaseResult",
    "combined",
    "curves",
    "fit",
    "fly_case",
    "judge",
    "larger_set",
    "parameter_rows",
    "predicted",
    "run",
    "small",
    "verdicts",
]
