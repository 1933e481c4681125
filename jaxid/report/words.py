"""Numbers, units and outcomes in words, for readers who do not know the code."""

import math
import re

from ..loop.outcome import Outcome

ABSENT = "n/a"
SUPERSCRIPT = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
# Numbers outside of this range are written with a power of ten (chosen).
LARGEST_PLAIN, SMALLEST_PLAIN = 1e6, 1e-4
MOST_DECIMALS = 9  # chosen
DEGREES = 180.0 / math.pi

OUTCOMES = {
    Outcome.EXPLAINED: "The error that remains with the effects found is consistent with "
    "measurement noise, on every channel. Only then does jaxid name an effect as the cause.",
    Outcome.PROXIES: "The effects found lower the error on the check records, but they are not "
    "shown to be its cause. Either the remaining error is larger than measurement noise, so that "
    "another or a further effect is missing, or there is reason to doubt that these effects are "
    "the cause. The verdict gives the reason. Use them as approximations of the missing effect.",
    Outcome.UNEXPLAINED: "The error is larger than measurement noise, and no candidate lowers it "
    "on the check records. The missing effect is not among the candidates, and no cause is named. "
    "Try more candidates next.",
    Outcome.PROCESS_NOISE: "The residual of the declared model is larger than measurement noise, "
    "but nothing predicts it. The innovations of a filter that models random forces in the "
    "equations, or gusts, are noise, and depend on none of the signals. These records therefore "
    "show no missing effect. The estimates after come from this filter.",
    Outcome.COLOURED_NOISE: "The residual of the declared model can be predicted from its past, "
    "but from nothing else. Noise of the sensors that is correlated in time explains it, and what "
    "is left depends on none of the signals. These records therefore show no missing effect. The "
    "estimates after allow for this noise.",
    Outcome.NOTHING_MISSING: "The residual of the declared model is already no larger than "
    "measurement noise, and no candidate explains any part of it. Nothing was added.",
}
NEXT = {
    Outcome.EXPLAINED: (
        "Use the model with the effects (study.after.model) within the range of these records.",
        "Predict a further record that took no part, in other conditions.",
    ),
    Outcome.PROXIES: (
        "Read the reason in the verdict; where inputs leave the range of the training records, "
        "record that range.",
        "Design the record that separates the best explanations: jaxid.study.next_record.",
        "Give further candidates (effects=), at the place that the location names.",
    ),
    Outcome.UNEXPLAINED: (
        "Write a candidate for the place that the location names (Contributing, Add an effect).",
        "Examine the records first: jaxid.advice(records, model, free, likelihood).",
        "Record the motion that excites the residual, and run the study again.",
    ),
    Outcome.PROCESS_NOISE: (
        "Estimate with FilterError, which models these forces.",
        "Record in calm air, or with larger inputs, to see smaller effects.",
    ),
    Outcome.COLOURED_NOISE: (
        "Use the corrected standard errors, which allow for the memory of the noise.",
        "Examine the filter and the sampling of the sensors that are named.",
    ),
    Outcome.NOTHING_MISSING: (
        "Use the model within the range of these records.",
        "Where standard errors are too large, design the next record: jaxid.design.",
    ),
}
NOISE_KNOWN = {
    True: "The noise was given beforehand. “Consistent with noise” therefore means: no larger than "
    "that noise allows (chi-square test), hardly predictable from its past, and not explained by "
    "any candidate.",
    False: "The noise was not given but estimated from the residual of the last model, so its size "
    "alone proves nothing. “Consistent with noise” therefore means: hardly predictable from its "
    "past, and not explained by any candidate.",
}

COLOURED_WORDS = (
    " In this study the past does predict a part of the residual: the noise of some sensors is "
    "correlated in time. The residual of a filter that models this correlation is predicted "
    "neither by its past nor by any candidate."
)


def unit_words(unit: str) -> str:
    """Return a unit in print: `m/s^2` becomes m/s².

    Args:
        unit: the unit in a record.

    Returns:
        The same with raised powers and centred dots; empty where there is none.
    """
    return raised(unit).replace("*", "·")


def raised(text: str) -> str:
    """Return a text with powers such as `x^3` raised, x³.

    Args:
        text: a name, a sentence or a unit.

    Returns:
        The same with superscript digits.
    """
    return re.sub(r"\^\(?(-?\d+)\)?", lambda match: match[1].translate(SUPERSCRIPT), text)


def display_unit(unit: str) -> tuple[float, str]:
    """Return the factor and the unit for the display of a channel: degrees for angles.

    Args:
        unit: the unit in a record, SI.

    Returns:
        The factor, and the unit, not yet raised; all but angles are unchanged.
    """
    return (DEGREES, "deg" + unit[3:]) if re.fullmatch(r"rad(/s(\^\d)?)?", unit) else (1.0, unit)


def number(value: float, digits: int = 4) -> str:
    """Return a number with a few significant digits, with a power of ten if very large or small.

    Args:
        value: any number.
        digits: significant digits.

    Returns:
        Such as `0.01421`, `3.2·10⁻⁷`; `not finite` for NaN and infinity.
    """
    if not math.isfinite(value):
        return "not finite"
    text = f"{value:.{digits}g}"
    if value == 0 or SMALLEST_PLAIN <= abs(value) < LARGEST_PLAIN:
        return f"{value:.0f}" if "e" in text else text
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    return (
        f"{mantissa.rstrip('0').rstrip('.') if '.' in mantissa else mantissa}·{_power(int(power))}"
    )


def percent(share: float) -> str:
    """Return a share in per cent.

    Args:
        share: such as 0.021.

    Returns:
        Such as `2.1 %`.
    """
    return (
        f"{100 * share:.{1 if abs(share) < 0.1 else 0}f} %"
        if math.isfinite(share)
        else "not finite"
    )


def with_error(value: float, error: float) -> str:
    """Return an estimate with its standard error, rounded at the second digit of the error; at
    most nine decimals of the estimate.

    Args:
        value: the estimate.
        error: its standard error; infinite if the data do not determine it, NaN on a bound.

    Returns:
        Such as `-0.5986 ± 0.0028`, or the value with words.
    """
    if math.isnan(error):
        return f"{number(value)} (on its bound)"
    if math.isinf(error):
        return f"{number(value)} (not determined by these data)"
    if error <= 0 or not math.isfinite(value):
        return number(value)
    size = max(abs(value), error)
    power = 0 if SMALLEST_PLAIN * 10 <= size < LARGEST_PLAIN else math.floor(math.log10(size))
    wanted = max(1 + power - math.floor(math.log10(error)), 0)
    decimals, scaled = min(wanted, MOST_DECIMALS), error / 10.0**power
    shown = f"{scaled:.{decimals}f}" if wanted == decimals else number(scaled, 2)
    pair = f"{value / 10.0**power:.{decimals}f} ± {shown}"
    return f"({pair})·{_power(power)}" if power else pair


def _power(power: int) -> str:
    return "10" + str(power).translate(SUPERSCRIPT)
