"""`Airframe`: mass, size and aerodynamics of a type of aircraft."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.checks import require, require_known
from ..._foundation.types import Array, Float, Numbers
from ..physics.mass import MassProperties
from .aerodynamics import AbstractAerodynamics
from .controls import SURFACES

Ranges = tuple[tuple[str, tuple[float, float]], ...]


class Airframe(eqx.Module):
    """An aircraft without its engines, controls and instruments.

    Args:
        name: for tables and messages.
        mass_properties: mass and inertia.
        S: reference area [m^2].
        b: span [m].
        cbar: mean chord [m].
        aerodynamics: the six coefficients.
        reference: position of the aerodynamic reference point from the centre of gravity, in body
            axes [m].
        limits: lowest and highest position of each control surface [rad]; without them the
            airframe serves identification, and simulations whose surfaces are measured.
        trusted: range of signals in which the data of this aircraft are reliable [rad]; a signal
            that is absent has no such range.

    Raises:
        InputError: when `limits` are given and do not hold each of the three surfaces, or a range
            is empty.
    """

    mass_properties: MassProperties
    S: Float[Array, ""]
    b: Float[Array, ""]
    cbar: Float[Array, ""]
    reference: Float[Array, "3"]
    aerodynamics: AbstractAerodynamics
    name: str = eqx.field(static=True)
    limit_pairs: Ranges = eqx.field(static=True)
    trusted_pairs: Ranges = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("mass_properties", "aerodynamics")

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"reference": ("reference.x", "reference.y", "reference.z")}

    def __init__(
        self,
        *,
        name: str,
        mass_properties: MassProperties,
        S,
        b,
        cbar,
        aerodynamics: AbstractAerodynamics,
        limits: Mapping[str, tuple[float, float]] | None = None,
        reference: Numbers | Sequence[float] = (0.0, 0.0, 0.0),
        trusted: Mapping[str, tuple[float, float]] | None = None,
    ):
        limits = dict(limits or {})
        require_known("control surface (in `limits`)", limits, SURFACES)
        for surface in SURFACES if limits else ():
            require(
                surface in limits,
                f"Airframe {name!r} has no limits of the {surface}. Give (lowest, highest) in rad.",
            )
            low, high = limits[surface]
            require(
                low < high,
                f"Airframe {name!r}: the {surface} goes from {low:g} to {high:g} rad. "
                "Put the lower first.",
            )
        self.name, self.mass_properties, self.aerodynamics = name, mass_properties, aerodynamics
        self.S, self.b, self.cbar = (
            jnp.asarray(S, float),
            jnp.asarray(b, float),
            jnp.asarray(cbar, float),
        )
        self.reference = jnp.asarray(reference, float)
        self.limit_pairs = tuple(limits.items())
        self.trusted_pairs = tuple((trusted or {}).items())

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest position of each control surface [rad]."""
        return dict(self.limit_pairs)

    @property
    def trusted(self) -> dict[str, tuple[float, float]]:
        """Range of signals in which the data are reliable [rad]."""
        return dict(self.trusted_pairs)

    @property
    def lengths(self) -> Float[Array, "3"]:
        """Reference lengths of moments and rates about x, y and z: b, cbar, b [m]."""
        return jnp.stack([self.b, self.cbar, self.b])


def aerodynamic_loads(
    airframe: Airframe, qbar: Float[Array, ""], coefficients: Float[Array, " coefficient"]
) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Return the aerodynamic force and its moment about the centre of gravity.

        F = qbar S (CX, CY, CZ),    M = qbar S (b Cl, cbar Cm, b Cn) + reference x F

    Args:
        airframe: its size and reference point.
        qbar: dynamic pressure [Pa].
        coefficients: CX, CY, CZ, Cl, Cm, Cn.

    Returns:
        Force [N] and moment [N m] in body axes.
    """
    force = qbar * airframe.S * coefficients[:3]
    return force, qbar * airframe.S * airframe.lengths * coefficients[3:] + jnp.cross(
        airframe.reference, force
    )
