"""Reduced rates of the air angles as factors of terms (report section 3.2.2.1 b, Eq. E.21)."""

from collections.abc import Iterable, Mapping

import jax.numpy as jnp

from ..._foundation.checks import require
from ..._foundation.types import Array, Float
from ...models.polynomial import factors
from .channels import Channels

RATE_SIGNALS = ("alphadot_hat", "betadot_hat")  # alphadot cbar/2V, betadot b/2V
ANGLE_STATES = {"alphadot_hat": ("w", "alpha"), "betadot_hat": ("v", "beta")}  # in either frame


def propagated_rates(channels: Channels) -> tuple[str, ...]:
    """Return the rates of the angles that a model propagates.

    Args:
        channels: channels of the model.
    """
    return tuple(
        name
        for name in RATE_SIGNALS
        if any(state in channels.states for state in ANGLE_STATES[name])
    )


def needed_rates(terms: Mapping[str, Iterable[str]], channels: Channels) -> tuple[str, ...]:
    """Return the rates on which terms depend.

    Args:
        terms: terms by coefficient.
        channels: channels of the model.

    Raises:
        InputError: if a term is not linear in the rates, or the angle is not propagated, so that
            the model does not determine its rate.
    """
    needed = []
    for coefficient, products in terms.items():
        for product in products:
            powers = [(name, power) for name, power in factors(product) if name in RATE_SIGNALS]
            require(
                sum(power for _, power in powers) <= 1,
                f"The term {product!r} of {coefficient} is not linear in the rates of the air "
                "angles, which the coefficients determine. Use their first power.",
            )
            needed += [name for name, _ in powers]
    known = propagated_rates(channels)
    for name in dict.fromkeys(needed):
        require(
            name in known,
            f"A term depends on {name}, and the equation of {ANGLE_STATES[name][1]} is not "
            "propagated. Keep it (`keep` of `IdentifyOptions`), or leave the term out.",
        )
    return tuple(dict.fromkeys(needed))


def solve_2x2(matrix: Float[Array, "2 2"], rhs: Float[Array, "2"]) -> Float[Array, "2"]:
    """Return the solution of two linear equations by Cramer's rule, a few scalar operations."""
    (a, b), (c, d) = matrix
    return jnp.stack([d * rhs[0] - b * rhs[1], a * rhs[1] - c * rhs[0]]) / (a * d - b * c)
