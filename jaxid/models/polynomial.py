"""Polynomials in named signals: the form in which the report writes every coefficient (Eq. 3.9), with |x| and splines."""

import re
from collections.abc import Iterable, Mapping
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_known
from .._foundation.types import Array, Float
from .differences import with_differences

# A factor: `alpha`, `|alpha|`, `(alpha-0.26)+` or `(x-y)`, and a whole power.
NAME, NUMBER = r"[^\s^|()+-]+", r"\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?"
DIFFERENCE = rf"{NAME}-(?!(?:{NUMBER})[)|]){NAME}"
FACTOR = re.compile(
    rf"(?P<base>\|(?P<size>{DIFFERENCE}|{NAME})\||\((?P<cut>{NAME})(?P<knot>[+-](?:{NUMBER}))\)\+"
    rf"|\((?P<difference>{DIFFERENCE})\)|(?P<plain>[^\s^|()]+))(?:\^(?P<power>[1-9]\d*))?"
)


class Polynomial(eqx.Module):
    r"""A sum of monomials in named signals, `p = sum_k c_k prod_s (s - centre_s)^n_ks` (Eq. 3.9).

    Terms are written as they are read: `"1"`, `"alpha"`, `"alpha^2"`, `"alpha q"`; `"|beta| beta"` with a signal's size;
    `"(alpha-0.26)+^2"`, zero below the knot and the square of the distance above it, which makes a spline; `"(x-y)^3"` with the
    difference of two signals. A coefficient's dotted name ends in its term: `Cm.alpha^2`; a centre is called `Cm.centre.alpha`.

    Args:
        coefficients: value by term.
        centre: by signal, what is taken from it before anything else, so also before its size and before the distance from
            a knot [the signal's unit]; the other signals stay as they are.
    """

    coefficients: Float[Array, " term"]
    centre: dict[str, Float[Array, ""]]
    terms: tuple[str, ...] = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("coefficients",)

    def __init__(self, coefficients: Mapping[str, float], centre: Mapping[str, float | Float[Array, ""]] | None = None):
        self.terms = tuple(coefficients)
        self.coefficients = jnp.array([coefficients[term] for term in self.terms], float)
        self.centre = {signal: jnp.asarray(value, float) for signal, value in (centre or {}).items()}

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"coefficients": self.terms}

    def __call__(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, ""]:
        """The value at an instant.

        Raises:
            InputError: when a term names a signal that is not there.
        """
        return jnp.dot(self.coefficients, monomials(self.terms, signals, self.centre))


def monomials(
    terms: tuple[str, ...],
    signals: Mapping[str, Float[Array, ""]],
    centre: Mapping[str, Float[Array, ""]] | None = None,
) -> Float[Array, " term"]:
    """The values of terms such as `"alpha^2 q"`, all at once: few operations however many terms there are.

    Integer powers are products, so that they have a derivative at zero.

    Args:
        terms: products of powers of signals, of their differences, of sizes and of distances above a knot; `"1"` for a constant.
        signals: scalars by name.
        centre: by signal, what is taken from it first; nothing by default.

    Raises:
        InputError: when a term cannot be read, or names a signal that is not there.
    """
    products = [[base for base, power in factors(term) for _ in range(power)] for term in terms]
    bases = sorted({base for product in products for base in product})
    used = signals_in(terms)
    centred = {name: signals[name] - value for name, value in (centre or {}).items() if name in signals}
    signals = with_differences({**signals, **centred}, used)
    require_known("signal", used, signals)
    ladder = jnp.stack([jnp.ones(()), *(_value(_parse(base), signals) for base in bases)])
    degree = max(map(len, products), default=0)
    rungs = np.zeros((degree, len(terms)), int)
    for column, product in enumerate(products):
        rungs[: len(product), column] = [1 + bases.index(base) for base in product]
    value = jnp.ones(len(terms))
    for rung in rungs:
        value = value * ladder[rung]
    return value


def factors(term: str) -> tuple[tuple[str, int], ...]:
    """The factors of a term: `"alpha^2 |q|"` gives `(("alpha", 2), ("|q|", 1))`, and `"1"` gives none.

    Raises:
        InputError: when the term cannot be read.
    """
    if term == "1":
        return ()
    parsed = [_parse(factor) for factor in term.split()]
    if not parsed:
        raise InputError(f"The term {term!r} has no factor. Write '1' for a constant.")
    return tuple((factor.base, factor.power) for factor in parsed)


def require_readable(names: Iterable[str]) -> None:
    """Refuse names of signals that no term can hold.

    Raises:
        InputError: it names the signal.
    """
    for name in names:
        require(
            re.fullmatch(NAME, name) is not None,
            f"The name {name!r} cannot stand in a term: it holds a blank or one of ^ | ( ) + -. Rename the channel, as in "
            f"{re.sub(r'[^0-9A-Za-z_.]+', '_', name).strip('_') or 'x'!r}.",
        )


def next_powers(term: str) -> tuple[str, ...]:
    """The term with one factor more of each that it has: `"alpha^2 q"` gives `("alpha^3 q", "alpha^2 q^2")`.

    Raises:
        InputError: when the term cannot be read.
    """
    own = factors(term)

    def written(raised: str) -> str:
        powers = ((base, power + (base == raised)) for base, power in own)
        return " ".join(base if power == 1 else f"{base}^{power}" for base, power in powers)

    return tuple(written(base) for base in dict.fromkeys(base for base, _ in own))


def signals_in(terms: Iterable[str]) -> tuple[str, ...]:
    """Names of the signals in terms, sorted: those of `"|beta| beta"`, `"(alpha-0.26)+"` and `"(x-y)^3"` are alpha, beta, x-y."""
    return tuple(sorted({_parse(base).signal for term in terms for base, _ in factors(term)}))


def factor_of(signal: str) -> str:
    """A signal as a factor of a term: a difference in brackets."""
    return f"({signal})" if re.fullmatch(DIFFERENCE, signal) else signal


class _Factor(NamedTuple):
    """One factor of a term: `base` is its text without the power; a knot makes it the distance above, `size` its size."""

    base: str
    signal: str
    size: bool
    knot: float | None
    power: int


def _parse(factor: str) -> _Factor:
    found = FACTOR.fullmatch(factor)
    if not found:
        raise InputError(
            f"The factor {factor!r} cannot be read. Write a signal as alpha, its size as |alpha|, its distance above a knot as "
            "(alpha-0.26)+ or (alpha+0.1)+, a difference as (x-y), each with a whole power as alpha^2, and put blanks between "
            "factors only."
        )
    signal = found["size"] or found["cut"] or found["difference"] or found["plain"]
    knot = None if found["knot"] is None else -float(found["knot"])
    return _Factor(found["base"], signal, found["size"] is not None, knot, int(found["power"] or 1))


def _value(factor: _Factor, signals: Mapping) -> Float[Array, ""]:
    """A factor's value, without its power."""
    value = signals[factor.signal]
    if factor.size:
        return jnp.abs(value)
    if factor.knot is None:
        return value
    return jnp.where(value > factor.knot, value - factor.knot, 0.0)  # its derivative at the knot is that from below
