"""What every description of the aerodynamic forces and moments offers."""

import abc
from collections.abc import Mapping

import equinox as eqx

from .._foundation.types import Array, Float

COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")


class AbstractAerodynamics(eqx.Module):
    """Signals in, six coefficients out, in body axes about the aerodynamic reference point.

    Forces are `qbar S (CX, CY, CZ)`, CZ negative upwards; moments `qbar S (b Cl, cbar Cm, b Cn)`. A positive stabilator has its
    trailing edge down (Cm negative), a positive aileron rolls left (Cl negative), a positive rudder yaws left (Cn negative).
    """

    @abc.abstractmethod
    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        """CX, CY, CZ, Cl, Cm and Cn at an instant.

        Args:
            signals: scalars by name: `alpha`, `beta`, `stabilator`, `aileron`, `rudder` [rad], `phat`, `qhat`, `rhat` [rad], and
                what else the description asks for.

        Raises:
            InputError: when a signal is not there.
        """

    @property
    @abc.abstractmethod
    def limits(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value of each signal for which there are data [SI]; a signal that is absent has no limit."""

    @property
    def refuses(self) -> dict[str, tuple[float, float]]:
        """Those of the limits beyond which coefficients are NaN."""
        return {}

    @property
    def terms(self) -> dict[str, tuple[str, ...]]:
        """The monomials by coefficient whose factors are parameters of this description, where it has such."""
        return {}
