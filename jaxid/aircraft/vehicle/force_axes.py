"""Axes of the force coefficients: body axes, or lift and drag in stability or wind axes."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax.numpy as jnp

from ..._foundation.types import Array, Float

FORCES, MOMENTS = ("CX", "CY", "CZ"), ("Cl", "Cm", "Cn")


class ForceAxes(NamedTuple):
    """Three orthogonal force coefficients.

        (CX, CY, CZ) = matrix(alpha, beta) (first, second, third)

    Attributes:
        names: the three coefficients, in the order of the equations of u, v, w.
        body: body components that determine each coefficient.
        matrix: orthogonal matrix at angles of attack and sideslip [rad].
    """

    names: tuple[str, str, str]
    body: Mapping[str, tuple[str, ...]]
    matrix: Callable[[Float[Array, ""], Float[Array, ""]], Float[Array, "3 3"]]

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The six coefficients: forces in these axes, moments in body axes."""
        return (*self.names, *MOMENTS)


def _body(alpha: Float[Array, ""], beta: Float[Array, ""]) -> Float[Array, "3 3"]:
    return jnp.eye(3)


def _stability(alpha: Float[Array, ""], beta: Float[Array, ""]) -> Float[Array, "3 3"]:
    """Return the columns of drag, side force and lift: `CX = -CD cos(alpha) + CL sin(alpha)`,
    `CZ = -CD sin(alpha) - CL cos(alpha)`.
    """
    c, s = jnp.cos(alpha), jnp.sin(alpha)
    zero, one = jnp.zeros(()), jnp.ones(())
    return jnp.stack([jnp.stack(row) for row in ([-c, zero, s], [zero, one, zero], [-s, zero, -c])])


def _wind(alpha: Float[Array, ""], beta: Float[Array, ""]) -> Float[Array, "3 3"]:
    """Return the columns of drag along the airspeed, force across it, and lift."""
    c, s, zero, one = jnp.cos(beta), jnp.sin(beta), jnp.zeros(()), jnp.ones(())
    rows = ([c, s, zero], [-s, c, zero], [zero, zero, one])
    return _stability(alpha, beta) @ jnp.stack([jnp.stack(row) for row in rows])


FORCE_AXES = {
    "body": ForceAxes(FORCES, {name: (name,) for name in FORCES}, _body),
    "stability": ForceAxes(
        ("CD", "CY", "CL"), {"CD": ("CX", "CZ"), "CY": ("CY",), "CL": ("CX", "CZ")}, _stability
    ),
    "wind": ForceAxes(("CD", "CC", "CL"), {"CD": FORCES, "CC": FORCES, "CL": ("CX", "CZ")}, _wind),
}
"""Axes by name (report section 2.3.2.2).

- "body": CX forward, CY to the right, CZ down.
- "stability": the plane of symmetry. Lift CL is normal to the airspeed's component in that plane,
  upwards; drag CD is opposite to this component; CY is the body component.
- "wind": drag CD is opposite to the airspeed, the crosswind force CC normal to it and to the lift,
  to the right.
"""


def with_axes(coefficient: str) -> str:
    """Return a coefficient in words, with the axes of CX, CY, CZ: `CZ (body axes)`, `CL`, `Cm`.

    Args:
        coefficient: name of the coefficient.
    """
    return f"{coefficient} (body axes)" if coefficient in FORCES else coefficient


ALL_COEFFICIENTS = tuple(
    dict.fromkeys(name for axes in FORCE_AXES.values() for name in axes.coefficients)
)
