"""Results as printed tables and as plain numbers for JSON."""

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from benchmarks import report_numbers
from benchmarks.report_tables.cases import CaseResult
from benchmarks.report_tables.examples import Small
from benchmarks.report_tables.noise_share import noise_shares
from benchmarks.report_tables.rows import overall_F, parameter_rows
from benchmarks.report_tables.settings import SETTINGS
from benchmarks.report_tables.verdicts import Verdict

HEADS = ("regression", "F", "F start", "final", "F final")
WIDTH = 120


def case_table(result: CaseResult, table: str | None = None) -> str:
    """Return the table of a case and the report: equations, terms of both stages, costs, noise.

    Args:
        result: of a case.
        table: of the report's likelihood, where a case has two.
    """
    case = result.flights[0].record.names[0]
    fits = [one for one in report_numbers.fits(case) if table in (None, one.table)]
    title = f"{result.name}, with Table {fits[0].table}" if fits else result.name
    lines = [title, "=" * len(title), ""]
    printed = {one.response: one.F for one in report_numbers.equations(case)}
    for name, one in result.identified.equations.items():
        theirs = f", the report's {printed[name]:g}" if name in printed else ""
        lines.append(
            f"{name}: {one.reason}{theirs}; R2 {one.regression.R2:.4f}, "
            f"{len(one.regression.names)} terms"
        )
    lines += ["", f"{'':<20} {'ours':^52} | {'the report':^52}"]
    lines.append(f"{'term':<20} " + " | ".join([" ".join(f"{head:>10}" for head in HEADS)] * 2))
    for row in parameter_rows(result, table):
        both = (" ".join(map(_cell, each)) for each in (row.ours, row.printed))
        lines.append(f"{row.response + ' ' + row.term:<20} " + " | ".join(both))
    lines += ["", *_costs(result, fits), ""]
    sigma = {
        one.channel: one.sigma for one in report_numbers.noise(case) if table in (None, one.table)
    }
    noise = [
        f"{name} {value:.2e}" + (f" ({sigma[name]:.2e})" if name in sigma else "")
        for name, value in result.sigma().items()
    ]
    lines.append("noise (the report's), rad, rad/s, g: " + ", ".join(noise))
    return "\n".join(lines)


def _costs(result: CaseResult, fits: Sequence[report_numbers.Fit]) -> list[str]:
    mine = result.fitted
    until = f", {mine.until} to the report's last relative change" if mine.until else ""
    lines = [
        f"ours: {mine.parameters} parameters, cost {mine.J0:.3f} to {mine.Jf:.3f}, "
        f"{mine.iterations} iterations{until}; "
        f"{mine.status}"
    ]
    for one in fits:
        lines.append(
            f"the report: {one.parameters} parameters, cost {one.J0:g} to {one.Jf:g}, "
            f"{one.iterations} iterations"
        )
    return lines


def error_table(results: Mapping[str, CaseResult], totals: bool) -> str:
    """Errors of coefficients, one line for each record, one column for each coefficient.

    Args:
        results: by name.
        totals: of the whole coefficients along the fitted motion; else of the static ones at the
            true angles.
    """
    part = "total" if totals else "static"
    names = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
    lines = [
        f"{part + ', error relative to the range':<44}" + "".join(f"{name:>12}" for name in names)
    ]
    for result in results.values():
        for flight, errors in zip(result.flights, result.errors, strict=True):
            by_coefficient = {one.coefficient: one for one in errors if one.part == part}
            if not by_coefficient:
                continue
            label = (
                result.name
                if len(result.flights) == 1
                else f"{result.name}: {flight.record.names[0]}"
            )
            cells = [
                f"{100 * by_coefficient[n].relative:5.1f}%" if n in by_coefficient else ""
                for n in names
            ]
            lines.append(f"{label:<44}" + "".join(f"{cell:>12}" for cell in cells))
    return "\n".join(lines)


def example_table(examples: Iterable[Small]) -> str:
    """Tables 3.3, 3.4 and 5.1."""
    lines = [
        "Small manoeuvres (Tables 3.3, 3.4, 5.1): the terms that explain as much as the report's, "
        "ours and the report's"
    ]
    for one in examples:
        (a, b), (c, d) = one.alpha_deg, one.beta_deg
        flown = f"alpha {a:.1f} to {b:.1f} deg, beta {c:.1f} to {d:.1f} deg"
        lines.append(f"{one.table}  {one.case}, {one.response} ({flown})")
        lines.append(f"       ours   {one.explained:.4f}: {', '.join(one.terms)}")
        lines.append(
            f"       report {one.printed_explained:.4f} on our data, printed "
            f"{one.printed_share:g}: {', '.join(one.printed)}"
        )
    return "\n".join(lines)


def verdict_lines(claims: Iterable[Verdict]) -> str:
    """Return one paragraph for each claim: share of the seeds with its interval, and medians."""
    lines = []
    for one in claims:
        share = (
            f"{one.held} of {one.judged} seeds (95 % interval {100 * one.low:.0f} to "
            f"{100 * one.high:.0f} %)"
        )
        numbers = ", ".join(f"{name} {value:.3g}" for name, value in one.numbers.items())
        words = f"{one.verdict.upper()}: {one.name} ({one.section}, page {one.page}): {share}."
        lines += textwrap.wrap(words, WIDTH, subsequent_indent="    ")
        if numbers:
            indent = "    "
            lines += textwrap.wrap(
                f"medians: {numbers}", WIDTH, initial_indent=indent, subsequent_indent=indent
            )
    return "\n".join(lines)


def F_table(results: Mapping[str, CaseResult]) -> str:
    """Return the overall F of each equation, ours and the report's, and the share of noise."""
    lines = [
        f"{'overall F':<16} {'':>4} {'ours':>9} {'k':>3} {'report':>9} {'k':>3} {'ratio':>6} "
        f"{'signal':>7} {'terms':>6} {'F, same k':>10} {'no errors':>10} {'noise':>6}"
    ]
    for result in (one for one in results.values() if one.name in SETTINGS):
        rows = overall_F(result)
        noise = noise_shares(result) if rows else {}
        for row in rows:
            lines.append(
                f"{result.name:<16} {row.response:>4} {row.ours:>9.4g} {row.terms:>3} "
                f"{row.printed:>9.5g} {row.printed_terms:>3} {row.ours / row.printed:>6.2f} "
                f"{row.signal:>7.2f} {row.form:>6.2f} {row.same_terms:>10.4g} "
                f"{row.without_errors:>10.4g} "
                f"{noise[row.response]:>6.2f}"
            )
    return "\n".join(lines)


def as_numbers(result: CaseResult, table: str | None = None) -> dict:
    """Return a result as plain numbers."""
    equations = {
        name: {
            "overall_F": one.regression.overall_F,
            "R2": one.regression.R2,
            "kept": one.kept,
            "estimated": one.estimated,
        }
        for name, one in result.identified.equations.items()
    }
    return {
        "setting": result.setting._asdict(),
        "equations": equations,
        "parameters": [row._asdict() for row in parameter_rows(result, table)],
        "fit": result.fitted._asdict(),
        "printed_fits": [
            one._asdict() for one in report_numbers.fits(result.flights[0].record.names[0])
        ],
        "overall_F": [row._asdict() for row in overall_F(result)],
        "sigma": result.sigma(),
        "errors": [[one._asdict() for one in errors] for errors in result.errors],
    }


def plain(value):
    """Return a value of JSON types: arrays as lists, nonfinite numbers as None."""
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, tuple | list | np.ndarray):
        return [plain(each) for each in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _cell(value: float) -> str:
    return f"{'':>10}" if math.isnan(value) else f"{value:>10.3g}"
