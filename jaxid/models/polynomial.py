"""Polynomials in named signals: the form in which the report writes every coefficient (Eq. 3.9)."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require_known
from .._foundation.types import Array, Float


class Polynomial(eqx.Module):
    r"""A sum of monomials in named signals, `p = sum_k c_k prod_s s^n_ks` (Eq. 3.9).

    Terms are written as they are read: `"1"`, `"alpha"`, `"alpha^2"`, `"alpha q"`. A coefficient's dotted name ends in its
    term: `Cm.alpha^2`.

    Args:
        coefficients: value by term.
    """

    coefficients: Float[Array, " term"]
    terms: tuple[str, ...] = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("coefficients",)

    def __init__(self, coefficients: Mapping[str, float]):
        self.terms = tuple(coefficients)
        self.coefficients = jnp.array([coefficients[term] for term in self.terms], float)

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"coefficients": self.terms}

    def __call__(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, ""]:
        """The value at an instant.

        Raises:
            InputError: when a term names a signal that is not there.
        """
        return jnp.dot(self.coefficients, jnp.stack([monomial(term, signals) for term in self.terms]))


def monomial(term: str, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, ""]:
    """The value of one term, such as `"alpha^2 q"`; integer powers are products, so that zero has a derivative."""
    value = jnp.ones(())
    for name, power in factors(term):
        require_known("signal", [name], signals)
        for _ in range(power):
            value = value * signals[name]
    return value


def factors(term: str) -> tuple[tuple[str, int], ...]:
    """The factors of a term: `"alpha^2 q"` gives `(("alpha", 2), ("q", 1))`, and `"1"` gives none."""
    if term == "1":
        return ()
    parts = (factor.partition("^") for factor in term.split())
    return tuple((name, int(power) if power else 1) for name, _, power in parts)
