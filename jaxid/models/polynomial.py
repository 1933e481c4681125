"""Polynomials in named signals, the report's form of every coefficient (Eq. 3.9), with |x| and
splines.
"""

import functools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from .._foundation.checks import InputError, require, require_known
from .._foundation.host import on_host
from .._foundation.types import Array, Float, Numbers
from .signal_dependence import Signal, with_differences

# A factor: `alpha`, `|alpha|`, `(alpha-0.26)+` or `(x-y)`, and an integer power.
NAME_PATTERN, NUMBER_PATTERN = r"[^\s^|()+-]+", r"\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?"
DIFFERENCE_PATTERN = rf"{NAME_PATTERN}-(?!(?:{NUMBER_PATTERN})[)|]){NAME_PATTERN}"
FACTOR_PATTERN = re.compile(
    rf"(?P<base>\|(?P<size>{DIFFERENCE_PATTERN}|{NAME_PATTERN})\|"
    rf"|\((?P<cut>{NAME_PATTERN})(?P<knot>[+-](?:{NUMBER_PATTERN}))\)\+"
    rf"|\((?P<difference>{DIFFERENCE_PATTERN})\)|(?P<plain>[^\s^|()]+))(?:\^(?P<power>[1-9]\d*))?"
)

# Terms up to which products of scalars are used, which compile to fewer loops than the gathers of
# vectors of factors (chosen).
FEW_TERMS = 8


class Polynomial(eqx.Module):
    r"""A sum of monomials in named signals, `p = sum_k c_k prod_s (s - centre_s)^n_ks` (Eq. 3.9).

    Examples of terms are `"1"`, `"alpha"`, `"alpha^2"`, `"alpha q"`; `"|beta| beta"` with the
    absolute value of a signal; the spline term `"(alpha-0.26)+^2"`, zero below the knot and the
    square of the distance above it; `"(x-y)^3"` with the difference of two signals. A coefficient's
    dotted name ends in its term, as in `Cm.alpha^2`; the name of a centre is `Cm.centre.alpha`.

    Args:
        coefficients: value by term.
        centre: value by signal that is subtracted from the signal first, before absolute values and
            distances from a knot [the signal's unit]; other signals are not changed.
    """

    coefficients: Float[Array, " term"]
    centre: dict[str, Float[Array, ""]]
    terms: tuple[str, ...] = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("coefficients",)

    def __init__(
        self,
        coefficients: Mapping[str, float],
        centre: Mapping[str, float | Float[Array, ""]] | None = None,
    ):
        self.terms = tuple(coefficients)
        self.coefficients = _vector([coefficients[term] for term in self.terms])
        self.centre = {
            signal: jnp.asarray(value, float) for signal, value in (centre or {}).items()
        }

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"coefficients": self.terms}

    def with_terms(self, terms: Sequence[str]) -> "Polynomial":
        """The polynomial in other terms, with the coefficient zero for those that it lacks.

        Args:
            terms: all terms of the result, in order; a term of this polynomial that is not among
                them is left out with its coefficient.
        """
        values = dict(zip(self.terms, np.asarray(self.coefficients).tolist(), strict=True))
        return Polynomial({term: values.get(term, 0.0) for term in terms}, self.centre)

    def __call__(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, ""]:
        """The value at an instant.

        Raises:
            InputError: when `signals` has no signal that a term or a centre needs.
        """
        if 0 < len(self.terms) <= FEW_TERMS:
            return jnp.sum(self.coefficients * monomials(self.terms, signals, self.centre))
        one_sum = np.ones((1, len(self.terms)))
        return sums_of_monomials(one_sum, self.coefficients, self.terms, signals, self.centre)[0]


def monomials(
    terms: tuple[str, ...],
    signals: Mapping[str, Float[Array, ""]],
    centre: Mapping[str, Float[Array, ""]] | None = None,
) -> Float[Array, " term"]:
    """Return the values of terms such as `"alpha^2 q"`, shape (term,).

    The number of operations depends on the largest degree, not on the number of terms. Integer
    powers are products, so that they have a derivative at zero.

    Args:
        terms: products of powers of signals, of their differences, of absolute values and of
            distances above a knot; `"1"` for a constant.
        signals: scalars by name.
        centre: value by signal that is subtracted first; zero by default.

    Raises:
        InputError: when a term cannot be parsed, or `signals` has no signal that a term or a centre
            needs.
    """
    values, indices = _factor_values(terms, signals, centre)
    if len(terms) <= FEW_TERMS:
        one = values[0]
        return jnp.stack([math.prod((values[k] for k in row if k), start=one) for row in indices.T])
    return _products(jnp.stack(values), indices)


@on_host
def _vector(xp, numbers: list) -> Float[Numbers, " number"]:
    """Return numbers as a vector."""
    return xp.asarray(numbers, float)


@on_host
def monomials_of_samples(
    xp, signals, centre, *, terms: tuple[str, ...]
) -> Float[Numbers, "time term"]:
    """Return the values of terms at many samples, shape (time, term); compiles nothing.

    Args:
        xp: NumPy or `jax.numpy`.
        signals: time histories by name, at least one.
        centre: value by signal that is subtracted first.
        terms: as in `monomials`.

    Raises:
        InputError: as `monomials`.
    """
    values, indices = _factor_values(terms, signals, centre, xp)
    histories = xp.stack(xp.broadcast_arrays(*values, next(iter(signals.values())))[:-1], axis=-1)
    result = xp.ones((histories.shape[0], len(terms)))
    for factor in indices:
        result = result * histories[:, factor]
    return result


def sums_of_monomials(
    incidence: Float[np.ndarray, "sum term"],
    weights: Float[Array, " term"],
    terms: tuple[str, ...],
    signals: Mapping[str, Float[Array, ""]],
    centre: Mapping[str, Float[Array, ""]] | None = None,
) -> Float[Array, " sum"]:
    """Return weighted sums of terms, `s_r = sum_k incidence_rk w_k m_k`, shape (sum,).

    The derivatives by the factors of all terms are added up to one small matrix first, with which
    each direction, or each row in reverse mode, is multiplied: the cost of a further one does not
    depend on the number of terms.

    Args:
        incidence: sums to which each term belongs, one or zero.
        weights: weight of each term.
        terms, signals, centre: as in `monomials`.
    """
    values, indices = _factor_values(terms, signals, centre)
    incidence = np.asarray(incidence, float)
    pairs, members = _contributions(incidence, indices, len(values))

    @jax.custom_jvp
    def sums(weights, values):
        return jnp.asarray(incidence) @ (weights * _products(values, indices))

    @functools.partial(sums.defjvp, symbolic_zeros=True)
    def _(primals, tangents):
        (weights, values), (d_weights, d_values) = primals, tangents
        slopes = _slopes(values, indices)
        products = slopes[0] * values[indices[0]] if slopes else jnp.ones(len(terms))
        tangent = jnp.zeros(incidence.shape[0])
        if not isinstance(d_weights, SymbolicZero):
            tangent += jnp.asarray(incidence) @ (products * d_weights)
        if not isinstance(d_values, SymbolicZero):
            parts = jnp.concatenate([*(weights * slope for slope in slopes), jnp.zeros(1)])
            totals = jnp.append(jnp.sum(parts[members], axis=1), 0.0)
            tangent += totals[pairs] @ d_values
        return jnp.asarray(incidence) @ (weights * products), tangent

    return sums(weights, jnp.stack(values))


def _factor_values(terms, signals, centre, xp=jnp):
    """Return one and the values of all factors of some terms, and the index of each factor of each
    term among them.
    """
    products = [[base for base, power in factors(term) for _ in range(power)] for term in terms]
    bases = sorted({base for product in products for base in product})
    used = signals_in(terms)
    signals = with_differences(_centred(signals, centre or {}), used)
    require_known("signal", used, signals)
    values = [xp.ones(()), *(_value(_parse(base), signals, xp) for base in bases)]
    return values, _factor_indices(products, bases)


def _contributions(incidence: np.ndarray, indices: np.ndarray, n_values: int):
    """Return the pairs of a sum and a factor on which it depends, as indices of shape (sum, factor)
    into a list, and for each pair the entries of `_slopes` that contribute to it.

    The index after the last one stands for nothing.
    """
    entries_of: dict[tuple[int, int], list[int]] = {}
    for row, term in np.argwhere(incidence):
        for order, factor in enumerate(indices[:, term]):
            if factor:
                entries_of.setdefault((row, factor), []).append(order * indices.shape[1] + term)
    pairs = np.full((incidence.shape[0], n_values), len(entries_of))
    members = np.full(
        (len(entries_of), max(map(len, entries_of.values()), default=0)), indices.size
    )
    for number, (pair, entries) in enumerate(entries_of.items()):
        pairs[pair] = number
        members[number, : len(entries)] = entries
    return pairs, members


def _products(values: Float[Array, " factor"], indices: np.ndarray) -> Float[Array, " term"]:
    """Return the product of the factors of each term."""
    result = jnp.ones(indices.shape[1])
    for factor in indices:
        result = result * values[factor]
    return result


def _slopes(values: Float[Array, " factor"], indices: np.ndarray) -> list[Float[Array, " term"]]:
    """Return the derivative of each term by each of its factors: the product of the others."""
    by_factor = [values[factor] for factor in indices]
    ones = jnp.ones(indices.shape[1])
    return [
        math.prod((*by_factor[:k], *by_factor[k + 1 :]), start=ones) for k in range(len(indices))
    ]


def _centred(
    signals: Mapping[str, Signal], centre: Mapping[str, Float[Numbers, ""]]
) -> dict[str, Signal]:
    """Signals minus their centres; signals without a centre are not changed."""
    require_known("signal", centre, signals)
    return {**signals, **{name: signals[name] - value for name, value in centre.items()}}


def _factor_indices(products: list[list[str]], bases: list[str]) -> np.ndarray:
    """Index of each factor of each product, shape (degree, product); 0 is a factor of one."""
    degree = max(map(len, products), default=0)
    indices = np.zeros((degree, len(products)), int)
    for column, product in enumerate(products):
        indices[: len(product), column] = [1 + bases.index(base) for base in product]
    return indices


def factors(term: str) -> tuple[tuple[str, int], ...]:
    """Return the factors of a term with their powers.

    The factors of `"alpha^2 |q|"` are `(("alpha", 2), ("|q|", 1))`; `"1"` has none.

    Raises:
        InputError: when the term cannot be parsed.
    """
    if term == "1":
        return ()
    parsed = [_parse(factor) for factor in term.split()]
    if not parsed:
        raise InputError(f"The term {term!r} has no factor. Write '1' for a constant.")
    return tuple((factor.base, factor.power) for factor in parsed)


def require_readable(names: Iterable[str]) -> None:
    """Refuse names of signals that cannot be part of a term.

    Raises:
        InputError: for the first such name.
    """
    for name in names:
        require(
            re.fullmatch(NAME_PATTERN, name) is not None,
            f"The name {name!r} cannot be used in a term: it has a blank or one of ^ | ( ) + -. "
            "Rename the channel, as in "
            f"{re.sub(r'[^0-9A-Za-z_.]+', '_', name).strip('_') or 'x'!r}.",
        )


def next_powers(term: str) -> tuple[str, ...]:
    """Return the terms in which the power of one factor is increased by one.

    The result for `"alpha^2 q"` is `("alpha^3 q", "alpha^2 q^2")`.

    Raises:
        InputError: when the term cannot be parsed.
    """
    term_factors = factors(term)

    def with_next_power(raised: str) -> str:
        powers = ((base, power + (base == raised)) for base, power in term_factors)
        return " ".join(base if power == 1 else f"{base}^{power}" for base, power in powers)

    return tuple(with_next_power(base) for base in dict.fromkeys(base for base, _ in term_factors))


def signals_in(terms: Iterable[str]) -> tuple[str, ...]:
    """Return the sorted names of the signals in terms.

    The signals of `"|beta| beta"`, `"(alpha-0.26)+"` and `"(x-y)^3"` are alpha, beta, x-y.
    """
    return tuple(sorted({_parse(base).signal for term in terms for base, _ in factors(term)}))


def factor_of(signal: str) -> str:
    """Return a signal as a factor of a term, with a difference in brackets."""
    return f"({signal})" if re.fullmatch(DIFFERENCE_PATTERN, signal) else signal


class _Factor(NamedTuple):
    """One factor of a term.

    Attributes:
        base: its text without the power.
        signal: its signal.
        size: True for the absolute value of the signal.
        knot: knot of a distance above a knot; None for another factor.
        power: its power.
    """

    base: str
    signal: str
    size: bool
    knot: float | None
    power: int


def _parse(factor: str) -> _Factor:
    match = FACTOR_PATTERN.fullmatch(factor)
    if not match:
        raise InputError(
            f"The factor {factor!r} cannot be read. Write a signal as alpha, its absolute value as "
            "|alpha|, its distance above a knot as (alpha-0.26)+ or (alpha+0.1)+, a difference as "
            "(x-y), each with an integer power as in alpha^2, and blanks between factors only."
        )
    signal = match["size"] or match["cut"] or match["difference"] or match["plain"]
    knot = None if match["knot"] is None else -float(match["knot"])
    return _Factor(match["base"], signal, match["size"] is not None, knot, int(match["power"] or 1))


def _value(factor: _Factor, signals: Mapping, xp):
    """Value of a factor without its power, in the namespace `xp`."""
    value = signals[factor.signal]
    if factor.size:
        return xp.abs(value)
    if factor.knot is None:
        return value
    # At the knot this has the derivative from below.
    return xp.where(value > factor.knot, value - factor.knot, 0.0)
