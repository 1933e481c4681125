"""Units of the channels and parameters of an identification model."""

from typing import TYPE_CHECKING

from ..models.polynomial import factors
from .instrument_channels import ANGULAR, RATES
from .turbulence import GUSTS

if TYPE_CHECKING:
    from .identification import IdentificationModel

SIGNALS = {
    **dict.fromkeys(("u", "v", "w", "V"), "m/s"),
    **dict.fromkeys(("alpha", "beta", "phi", "pitch", "psi", "stabilator", "aileron", "rudder"), "rad"),
    **dict.fromkeys(RATES, "rad/s"),
    **dict.fromkeys(ANGULAR, "rad/s^2"),
    **dict.fromkeys(GUSTS[:3], "m/s"),
    **{"altitude": "m", "density": "kg/m^3", "thrust": "N"},
}
SIZES = {
    **{"mass": "kg", "S": "m^2", "b": "m", "cbar": "m"},
    **dict.fromkeys(("Ix", "Iy", "Iz", "Ixy", "Ixz", "Iyz"), "kg*m^2"),
    **dict.fromkeys(("reference.x", "reference.y", "reference.z"), "m"),
}
IN_RADIANS = {"alpha", "beta", "phi", "pitch", "psi", "stabilator", "aileron", "rudder", "phat", "qhat", "rhat"}


def units_of(model: "IdentificationModel") -> dict[str, str]:
    """Units by name, of states, inputs, outputs, constants and parameters.

    Args:
        model: whose.
    """
    named = (*model.states, *model.inputs, *model.held)
    own = {f"instruments.{name}": unit for name, unit in model.instruments.parameter_units().items()}
    terms = model.airframe.aerodynamics.terms.items()
    coefficients = {
        f"{name}.{term}": unit for name, of in terms for term in of if (unit := per_radian(term)) is not None
    }
    return {name: SIGNALS[name] for name in named} | SIZES | model.instruments.units() | own | coefficients


def per_radian(term: str) -> str | None:
    """The unit of the coefficient of a term; None where a factor is not an angle or a reduced rate.

    Args:
        term: such as `"alpha^2 qhat"`.
    """
    parts = factors(term)
    if not all(base.strip("|") in IN_RADIANS or base.startswith("(") for base, _ in parts):
        return None
    power = sum(power for _, power in parts)
    return "" if power == 0 else "1/rad" if power == 1 else f"1/rad^{power}"
