"""Units of the channels and parameters of an identification model."""

from collections.abc import Iterable, Mapping

from ...models.polynomial import factors
from ..air.turbulence import GUSTS
from ..instruments.channels import ANGULAR, RATES
from ..instruments.instruments import Instruments

SIGNALS = {
    **dict.fromkeys(("u", "v", "w", "V"), "m/s"),
    **dict.fromkeys(
        ("alpha", "beta", "phi", "pitch", "psi", "stabilator", "aileron", "rudder"), "rad"
    ),
    **dict.fromkeys(RATES, "rad/s"),
    **dict.fromkeys(ANGULAR, "rad/s^2"),
    **dict.fromkeys(GUSTS[:3], "m/s"),
    **{"altitude": "m", "density": "kg/m^3", "sound_speed": "m/s", "thrust": "N"},
}
BODY_UNITS = {
    **{"mass": "kg", "S": "m^2", "b": "m", "cbar": "m"},
    **dict.fromkeys(("Ix", "Iy", "Iz", "Ixy", "Ixz", "Iyz"), "kg*m^2"),
    **dict.fromkeys(("reference.x", "reference.y", "reference.z"), "m"),
}
IN_RADIANS = {
    "alpha",
    "beta",
    "phi",
    "pitch",
    "psi",
    "stabilator",
    "aileron",
    "rudder",
    "phat",
    "qhat",
    "rhat",
}


def units_of(
    signals: Iterable[str], instruments: Instruments, terms: Mapping[str, Iterable[str]]
) -> dict[str, str]:
    """Return the units of signals, outputs and parameters by name.

    Args:
        signals: names of states, inputs and constants.
        instruments: instruments of the outputs.
        terms: terms by coefficient.
    """
    errors = {f"instruments.{name}": unit for name, unit in instruments.parameter_units().items()}
    coefficients = {
        f"{name}.{term}": unit
        for name, names in terms.items()
        for term in names
        if (unit := per_radian(term)) is not None
    }
    return (
        {name: SIGNALS[name] for name in signals}
        | BODY_UNITS
        | instruments.units()
        | errors
        | coefficients
    )


def per_radian(term: str) -> str | None:
    """Return the unit of the coefficient of a term.

    The unit is None if a factor is neither an angle nor a reduced rate.

    Args:
        term: such as `"alpha^2 qhat"`.
    """
    parts = factors(term)
    if not all(base.strip("|") in IN_RADIANS or base.startswith("(") for base, _ in parts):
        return None
    power = sum(power for _, power in parts)
    return "" if power == 0 else "1/rad" if power == 1 else f"1/rad^{power}"
