"""All sentences of the findings on records."""

from collections.abc import Sequence
from typing import Any

from ..._foundation.notebook import Table, paragraphs

# By name of the kind: observation and remedy. `{names}` are channels or parameters.
SENTENCES = {
    "HOLE": "no samples for {seconds:.3g} s ({ratio:.3g} median steps). Split the record there.",
    "UNEVEN_TIMES": "steps of {shortest:.3g} to {longest:.3g} times the median. Delay, drift and "
    "feedback were not examined; `resample` the record for that.",
    "MISSING": "{names}: {share:.1%} of the samples are missing, for up to {longest:.3g} s.",
    "CONSTANT": "{names} has the value {value:.4g} in all samples. An input that rests shows none "
    "of its parameters; an output that rests may be a dead sensor.",
    "SLOW_SAMPLING": "the fastest mode of the model ({rate:.3g} rad/s) has {samples:.2g} samples "
    "in a period. Take more steps in an interval (`OutputError(stepper=RK4({substeps:.0f}))`), or "
    "sample faster.",
    "SHORT_RECORD": "it covers {periods:.2g} of the period or time constant of a mode at "
    "{rate:.3g} rad/s. Parameters of slow motion need a longer record.",
    "UNEXCITED_MODE": "{share:.1e} of the power of the inputs is near the mode at {rate:.3g} "
    "rad/s. Excite it, for example by a doublet of half its period.",
    "COLLINEAR": "{names} is nearly a combination of the other inputs (variance inflation "
    "{inflation:.3g}). Their effects cannot be separated: move them at different times.",
    "QUANTISATION": "{names} is recorded in steps of {step:.3g} ({levels:.0f} levels). The error "
    "is not white; consider `effects.SensorQuantisation`.",
    "SATURATION": "{names} stays at {value:.4g} in {share:.1%} of the samples. Mark them as "
    "missing (NaN), or take `effects.SensorSaturation` as a candidate.",
    "OFFSET": "{names} is {value:.4g} at rest, where the model is zero ({errors:.3g} standard "
    "errors). Subtract the trim, or add `effects.SensorBias`.",
    "DRIFT": "{names} changes by {slope:.3g} per second without a cause in the inputs "
    "({errors:.3g} standard errors). Consider `effects.SensorDrift`, or shorter pieces.",
    "DELAY": "{names[1]} responds to {names[0]} {seconds:.3g} s (+/- {deviation:.2g}) later than "
    "the model: a delay, or a lag. Consider `effects.InputDelay` or `InputLag`.",
    "FEEDBACK": "{names[0]} follows the noise of {names[1]} (correlation {correlation:.2g} after "
    "{lag:.3g} s): a controller or a direct path that the model lacks. Under feedback take "
    "`FilterError` or short pieces (`segment`).",
    "UNIT": "{names} is in [{units[0]}] in the record and in [{units[1]}] in the model.",
    "DEGREES": "{names} reaches {largest:.3g} with the unit {units[0]}. If it is in degrees, give "
    "`units`.",
    "OTHER_UNIT": "{names[0]} responds to {names[1]} {ratio:.3g} times as strongly as in record "
    "{units[1]}, like {units[0]}. Give `units` for both records.",
    "MILLISECONDS": "the time t increases by {step:.3g} s, in whole numbers, and the model is much "
    "faster. If it is in milliseconds, give `units={{'t': 'ms'}}`.",
    "RATE": "{names} moves {ratio:.3g} times as far as the integral of its rate, which the other "
    "channels give. Probable cause: {units[0]}. Give `units` (or `signs`) when reading.",
    "DIVERGENCE": "the simulation with the present values is not finite after {seconds:.3g} s. "
    "Start from a stable model, or cut the record into pieces (`segment`).",
    "UNDETERMINED": "{units[0]}. Fix a parameter, give a prior, or add a record that shows it.",
    "HARDLY": "{names}: the expected standard error is {relative:.0%} of the value.",
}
CLEAN = "No finding."
EXPECTED = "Expected from all records, at the present values:"


def sentence(
    kind: str, names: tuple[str, ...], numbers: dict[str, float], units: tuple[str, ...]
) -> str:
    """Return a finding in words.

    Args:
        kind: name of its kind.
        names: channels or parameters.
        numbers: measured quantities by name.
        units: units, or other words.
    """
    shown: Any = names if "{names[" in SENTENCES[kind] else ", ".join(names)
    words = SENTENCES[kind].format(names=shown, units=units, **numbers)
    return words[0].upper() + words[1:] if not names or kind == "UNDETERMINED" else words


def table(
    findings: Sequence[tuple[str, str, str]], excitation: Sequence[Any], information: Any
) -> str:
    """Return the findings as a table, then the inputs and the expected standard errors.

    Args:
        findings: title, record and words of each.
        excitation: rows of `Excitation`.
        information: a `PlannedInformation` or None.
    """
    left = max((len(title) for title, _, _ in findings), default=0)
    middle = max((len(record) for _, record, _ in findings), default=0)
    lines = [f"{title:<{left}}  {record:<{middle}}  {words}" for title, record, words in findings]
    lines = lines or [CLEAN]
    if excitation:
        lines += ["", *_excitation_table(excitation).lines()]
    if information is not None:
        lines += ["", EXPECTED, str(information)]
    return "\n".join(lines)


def html_tables(
    findings: Sequence[tuple[str, str, str]], excitation: Sequence[Any], information: Any
) -> str:
    """Return the tables of `table` as HTML elements."""
    rows = tuple((title, record, words) for title, record, words in findings)
    parts = [Table(("finding", "record", "observation and remedy"), (7, 6), rows).html()]
    parts = parts if rows else [paragraphs([CLEAN])]
    if excitation:
        parts.append(_excitation_table(excitation).html())
    if information is not None:
        parts += [paragraphs([EXPECTED]), information._repr_html_()]
    return "".join(parts)


def _excitation_table(excitation: Sequence[Any]) -> Table:
    """Return size and band of each input in words."""
    rows = (
        (
            row.record,
            row.input,
            f"{row.rms:.3g}",
            f"{row.extent:.3g}",
            row.unit,
            f"{row.low:.3g} to {row.high:.3g}",
        )
        for row in excitation
    )
    heads = ("record", "input", "RMS", "range", "unit", "rad/s")
    widths = (6, max(6, *(len(row.input) + 1 for row in excitation)), 10, 10, 7)
    return Table(heads, widths, tuple(rows))
