"""Interface of all models of the aerodynamic forces and moments."""

import abc
from collections.abc import Mapping

import equinox as eqx

from ..._foundation.types import Array, Float
from .force_axes import FORCES, MOMENTS

COEFFICIENTS = (*FORCES, *MOMENTS)


class AbstractAerodynamics(eqx.Module):
    """Six coefficients as functions of signals, in body axes about the aerodynamic reference point.

    Forces are `qbar S (CX, CY, CZ)`, CZ negative upwards; moments `qbar S (b Cl, cbar Cm, b Cn)`. A
    positive stabilator has its trailing edge down (Cm negative), a positive aileron rolls left (Cl
    negative), a positive rudder yaws left (Cn negative).
    """

    @abc.abstractmethod
    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        """Return CX, CY, CZ, Cl, Cm and Cn at an instant.

        Args:
            signals: scalars by name: `alpha`, `beta`, `stabilator`, `aileron`, `rudder` [rad],
                `phat`, `qhat`, `rhat` [rad], and further signals that the model needs.

        Raises:
            InputError: when a signal is missing.
        """

    def known(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"] | None:
        """Return the part of CX to Cn that has no terms, such as tables; None without one.

        Args:
            signals: as for `coefficients`.
        """
        return None

    @property
    @abc.abstractmethod
    def limits(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value of each signal with data [SI]; a signal that is absent has no
        limit.
        """

    @property
    def hard_limits(self) -> dict[str, tuple[float, float]]:
        """The limits beyond which the coefficients are NaN."""
        return {}

    @property
    def force_axes(self) -> str:
        """Axes of the force coefficients that have terms, a name in `FORCE_AXES`."""
        return "body"

    @property
    def terms(self) -> dict[str, tuple[str, ...]]:
        """Monomials by coefficient whose factors are parameters of this model; empty for a model
        without them.
        """
        return {}
