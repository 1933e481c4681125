"""How the report writes numbers, units and outcomes, so that a person who has not seen the code reads them."""

import math
import re

SUPERSCRIPT = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
LARGEST_PLAIN, SMALLEST_PLAIN = 1e6, 1e-4  # numbers beyond are written with a power of ten
MOST_DECIMALS = 9
DEGREES = 180.0 / math.pi

OUTCOMES = {
    "explained": "What is left of the error after the effects found is consistent with measurement noise, on every "
    "channel. Only then does jaxid name an effect as the cause.",
    "proxies": "The effects found lower the error on the records that decided, but they are not shown to be its cause: "
    "either more than measurement noise is left, so that something else, or something more, is missing; or there is reason to "
    "doubt that these effects are it. The verdict says which. Take them as stand-ins, not as the cause.",
    "unexplained": "The error is more than measurement noise, and no candidate that was tried lowers it on the records "
    "that decided. So something is missing that is not among the candidates; no cause is named. "
    "More candidates are the next thing to try.",
    "process noise": "What the declared model leaves is more than measurement noise, but nothing predicts it: once a filter "
    "knows of random forces in the equations or of gusts, what is left is noise, and neither a candidate nor any simple function "
    "of the signals explains any part of it. So no term is missing that these records could show. What a round may have added is "
    "taken out again.",
    "coloured noise": "What the declared model leaves can be predicted from its own past, but from nothing else: once a filter "
    "knows of noise with a memory in the sensors, what is left is white noise, and neither a candidate nor any simple function "
    "of the signals explains any part of it. So no term is missing that these records could show. What a round may have added is "
    "taken out again.",
    "nothing missing": "Already the declared model leaves no more than measurement noise, and no candidate explains "
    "any part of it. Nothing was added.",
}
NOISE_KNOWN = {
    True: "The noise was given beforehand. “Consistent with noise” therefore means: no larger than that noise allows "
    "(chi-square test), hardly predictable from its own past, and not explained by any candidate.",
    False: "The noise was not given but estimated from what the last model leaves, so its size alone proves nothing. "
    "“Consistent with noise” therefore means: hardly predictable from its own past, and not explained by any "
    "candidate.",
}

COLOURED = (
    " In this study the past does predict a part of what is left: the noise of some sensors has a memory. A filter that knows of "
    "this memory leaves nothing that its past, or any candidate, explains."
)


def unit_words(unit: str) -> str:
    """A unit as it is printed: `m/s^2` becomes m/s².

    Args:
        unit: as records hold it.

    Returns:
        The same with raised powers and centred dots; empty where there is none.
    """
    return raised(unit).replace("*", "·")


def raised(text: str) -> str:
    """Text with powers such as `x^3` raised, x³.

    Args:
        text: a name, a sentence or a unit.

    Returns:
        The same with superscript digits.
    """
    return re.sub(r"\^\(?(-?\d+)\)?", lambda found: found[1].translate(SUPERSCRIPT), text)


def display_unit(unit: str) -> tuple[float, str]:
    """The factor and the unit in which a channel is shown: degrees for angles, else as it stands.

    Args:
        unit: as records hold it, SI.

    Returns:
        What to multiply by, and the unit, not yet raised.
    """
    return (DEGREES, "deg" + unit[3:]) if re.fullmatch(r"rad(/s(\^\d)?)?", unit) else (1.0, unit)


def number(value: float, digits: int = 4) -> str:
    """A number with a few significant digits, a power of ten where it is very large or small.

    Args:
        value: any number.
        digits: significant digits.

    Returns:
        Such as `0.01421`, `3.2·10⁻⁷`; `not finite` where it is not.
    """
    if not math.isfinite(value):
        return "not finite"
    text = f"{value:.{digits}g}"
    if value == 0 or SMALLEST_PLAIN <= abs(value) < LARGEST_PLAIN:
        return f"{value:.0f}" if "e" in text else text
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    return f"{mantissa.rstrip('0').rstrip('.') if '.' in mantissa else mantissa}·{_power(int(power))}"


def percent(share: float) -> str:
    """A share as per cent.

    Args:
        share: such as 0.021.

    Returns:
        Such as `2.1 %`.
    """
    return f"{100 * share:.{1 if abs(share) < 0.1 else 0}f} %" if math.isfinite(share) else "not finite"


def with_error(value: float, error: float) -> str:
    """An estimate with its standard error, cut where the error's second digit stands.

    Args:
        value: the estimate.
        error: its standard error; infinite where the data do not determine it, NaN where it stands on a bound.

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
    decimals = min(max(1 + power - math.floor(math.log10(error)), 0), MOST_DECIMALS)
    pair = f"{value / 10.0**power:.{decimals}f} ± {error / 10.0**power:.{decimals}f}"
    return f"({pair})·{_power(power)}" if power else pair


def _power(power: int) -> str:
    return "10" + str(power).translate(SUPERSCRIPT)
