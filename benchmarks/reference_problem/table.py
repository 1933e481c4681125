"""The table of the reference problem."""

from collections.abc import Iterable

# Title, key of the row, format.
COLUMNS = (
    ("pass ms", "pass_ms", ".2f"),
    ("x C", "pass_times_c", ".1f"),
    ("fit ms", "fit_ms", ".1f"),
    ("x C", "fit_times_c", ".1f"),
    ("passes", "passes", "d"),
    ("cold s", "cold_seconds", ".1f"),
    ("cached s", "cached_seconds", ".1f"),
    ("MB", "megabytes", ".0f"),
    ("S differs", "sensitivity_difference", ".0e"),
    ("estimate", "estimate_difference", ".0e"),
    ("misfit", "misfit", ".4f"),
)
NOTE = (
    "pass: simulation, 30 sensitivities, R, information; fit: warm, from 20 % off; cold, cached: "
    "first estimate in a new\nprocess without and with compiled code, imports aside; MB: peak "
    "memory of the cold process; S differs: relative to the\nlargest entry of the column; "
    "estimate: difference in standard errors; misfit: in standard deviations of the noise."
)


def contender_table(rows: Iterable[dict]) -> str:
    """Return the rows of `measure` as a text table; what was not measured is a dash."""
    heads = " ".join(f"{title:>9}" for title, *_ in COLUMNS)
    lines = [f"{'program':<27} {'status':<13} {heads}"]
    for row in rows:
        cells = [_cell(row.get(key), form) for _, key, form in COLUMNS]
        lines.append(f"{row['way']:<27} {row['status']:<13} {' '.join(cells)}")
    return "\n".join(lines)


def growth_table(rows: Iterable[dict]) -> str:
    """Return the rows of `growth` as a text table."""
    lines = ["jaxid's pass [ms] by size, and the exponent of the size"]
    for row in rows:
        points = zip(row["sizes"], row["pass_ms"], strict=True)
        cells = "  ".join(f"{size}: {taken:.1f}" for size, taken in points)
        lines.append(f"{row['kind']:<11} {row['exponent']:>5.2f}   {cells}")
    return "\n".join(lines)


def _cell(value: float | None, form: str) -> str:
    return f"{'-' if value is None else format(value, form):>9}"
