"""Columns of a regression from named terms, with the syntax of a model's polynomial."""

from collections.abc import Mapping, Sequence

import numpy as np

from .._foundation.checks import require, require_float64, require_known, require_unique
from .._foundation.types import Float, Numbers
from ..models.polynomial import monomials, monomials_of_samples, signals_in


def columns(
    terms: Sequence[str],
    signals: Mapping[str, Float[Numbers, " time"]],
    centre: Mapping[str, float | Float[Numbers, ""]] | None = None,
) -> Float[np.ndarray, "time term"]:
    """Return the value of each term at each sample, `X_ik = prod_s (s_i - centre_s)^n_ks`.

    A factor can also be an absolute value, or a spline with a knot.

    Args:
        terms: such as `"alpha^2 q"`, `"|beta| beta"`, `"(alpha-0.26)+^2"`.
        signals: time histories by name.
        centre: value subtracted from each signal, by name; zero by default.

    Returns:
        One column for each term, in their order.

    Raises:
        InputError: if a term is given twice, cannot be parsed, or contains an unknown signal, and
            if JAX does not run in 64 bit.
    """
    require_float64()
    terms = tuple(terms)
    require_unique("term", terms)
    require_known("signal (in `centre`)", centre or {}, signals)
    needed = signals_in(terms)
    used = {name: np.asarray(signals[name], float) for name in needed if name in signals}
    about = {n: np.asarray(value, float) for n, value in (centre or {}).items() if n in used}
    if not used:  # all terms are constants, or a name is unknown, which `monomials` reports
        require(bool(signals), "There are no signals, so there are no samples. Give at least one.")
        count = len(next(iter(signals.values())))
        return np.tile(np.asarray(monomials(terms, {})), (count, 1))
    lengths = {name: len(value) for name, value in used.items()}
    require(
        len(set(lengths.values())) == 1,
        f"The signals have different numbers of samples: {lengths}. Give signals of one length.",
    )
    return np.asarray(monomials_of_samples(used, about, terms=terms))
