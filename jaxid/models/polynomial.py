"""Polynomials in named signals: the form in which the report writes every coefficient (Eq. 3.9)."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

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
        return jnp.dot(self.coefficients, monomials(self.terms, signals))


def monomials(terms: tuple[str, ...], signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " term"]:
    """The values of terms such as `"alpha^2 q"`, all at once: few operations however many terms there are.

    Integer powers are products, so that they have a derivative at zero.

    Args:
        terms: products of powers of signals, `"1"` for a constant.
        signals: scalars by name.

    Raises:
        InputError: when a term names a signal that is not there.
    """
    products = [[name for name, power in factors(term) for _ in range(power)] for term in terms]
    used = sorted({name for product in products for name in product})
    require_known("signal", used, signals)
    ladder = jnp.stack([jnp.ones(()), *(signals[name] for name in used)])
    degree = max(map(len, products), default=0)
    rungs = np.zeros((degree, len(terms)), int)
    for column, product in enumerate(products):
        rungs[: len(product), column] = [1 + used.index(name) for name in product]
    value = jnp.ones(len(terms))
    for rung in rungs:
        value = value * ladder[rung]
    return value


def factors(term: str) -> tuple[tuple[str, int], ...]:
    """The factors of a term: `"alpha^2 q"` gives `(("alpha", 2), ("q", 1))`, and `"1"` gives none."""
    if term == "1":
        return ()
    parts = (factor.partition("^") for factor in term.split())
    return tuple((name, int(power) if power else 1) for name, _, power in parts)
