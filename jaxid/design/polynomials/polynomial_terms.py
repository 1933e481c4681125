"""Which terms of a polynomial coefficient one experiment shows, and the amplitude that they need.

Where all states and rates are measured, a coefficient that depends on one signal, such as
`Cm(alpha)`, is measured sample by sample (section C.4.2.1 of the report):

    y_k = C(alpha_k) + n_k,    C(alpha) = sum_i C_i P_i(x),    x = (alpha - centre) / half range

With polynomials `P_i` that are orthogonal over the visited values of alpha the estimates of the
`C_i` are independent of each other and of the order of the polynomial (Eq. C.57 to C.63):

    se_i = sigma / sqrt(sum_k P_i(x_k)^2),    t_i = C_i / se_i

The `P_i` have the leading coefficient 1, as in Eq. C.65, where the cubic one is misprinted.
"""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.chebyshev import chebgauss
from numpy.polynomial.legendre import leggauss
from numpy.polynomial.polynomial import polyroots, polyval

from ..._foundation.checks import require
from ..._foundation.notebook import preformatted
from ..._foundation.types import Float, Numbers

# |t| from which a term counts as shown (chosen; about 1 in 400 by chance).
SHOWN = 3.0
QUADRATURE_NODES = 64  # of the quadrature over a distribution, exact to degree 127
ZERO_SHARE = 1e-12  # share of a power in a term that counts as none (chosen)


class Visited(eqx.Module):
    """Distribution of the values of a signal during an experiment, `d(alpha)` of Eq. C.56.

    Attributes:
        low, high: smallest and largest value [unit of the signal].
        nodes: values, scaled to -1 at `low` and 1 at `high`.
        shares: share of the time at each node; the sum is one.
        samples: number of samples of the experiment.
    """

    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)
    nodes: Float[np.ndarray, " node"]
    shares: Float[np.ndarray, " node"]
    samples: int = eqx.field(static=True)

    def __check_init__(self):
        require(
            bool(np.isfinite(self.low) and np.isfinite(self.high)) and self.low < self.high,
            f"The visited values go from {self.low:g} to {self.high:g}. Give a range with a "
            "positive width, and a history without NaN.",
        )
        require(
            self.samples > 0,
            f"An experiment of {self.samples} samples shows nothing. Give at least one sample.",
        )

    @property
    def half_range(self) -> float:
        """Half of the width of the range."""
        return 0.5 * (self.high - self.low)

    def scaled(self, half_range: float) -> "Visited":
        """Return the same distribution about the same centre with another half range."""
        centre, h = 0.5 * (self.low + self.high), float(half_range)
        return Visited(centre - h, centre + h, self.nodes, self.shares, self.samples)


def visited(history: Float[Numbers, " time"]) -> Visited:
    """Return the distribution of a planned or measured history, sampled at equal intervals.

    Args:
        history: samples of the signal [its unit].

    Raises:
        InputError: when the signal does not move, or a sample is not finite.
    """
    values = np.asarray(history, float)
    low, high = float(np.min(values)), float(np.max(values))
    nodes = (2.0 * values - low - high) / max(high - low, np.finfo(float).tiny)
    return Visited(low, high, nodes, np.full(values.size, 1.0 / values.size), values.size)


def equal_time(low: float, high: float, samples: int) -> Visited:
    """Return equal time at all values of a range (Eq. C.64), as of a slow sweep.

    Args:
        low, high: the range [unit of the signal].
        samples: number of samples of the experiment.
    """
    nodes, weights = leggauss(QUADRATURE_NODES)
    return Visited(float(low), float(high), nodes, 0.5 * weights, samples)


def sinusoid(low: float, high: float, samples: int) -> Visited:
    """Return the values of a sinusoid, which stays long at both ends of its range.

    Args:
        low, high: the range [unit of the signal].
        samples: number of samples of the experiment.
    """
    nodes, weights = chebgauss(QUADRATURE_NODES)
    return Visited(float(low), float(high), nodes, weights / np.pi, samples)


class PolynomialTerms(eqx.Module):
    """The terms of a coefficient in orthogonal polynomials, and how well an experiment shows them.

    Attributes:
        visited: the visited values of the signal.
        values: coefficients `C_i` of the terms [unit of the coefficient].
        standard_errors: their standard errors.
        polynomials: coefficients of each `P_i` by the powers of `x`.
    """

    visited: Visited
    values: Float[np.ndarray, " term"]
    standard_errors: Float[np.ndarray, " term"]
    polynomials: Float[np.ndarray, "term power"]

    @property
    def t_ratios(self) -> Float[np.ndarray, " term"]:
        """Values over standard errors (Eq. C.63)."""
        return self.values / self.standard_errors

    def order(self, level: float = SHOWN) -> int:
        """Return the highest degree whose |t| reaches a level; zero if none does."""
        return int(max(np.flatnonzero(np.abs(self.t_ratios) >= level), default=0))

    def curve_error(self, signal: Float[Numbers, " point"]) -> Float[np.ndarray, " point"]:
        """Return the standard error of the estimated curve at values of the signal.

        se(alpha)^2 = sum_i P_i(x)^2 se_i^2        (integrand of Eq. C.46)
        """
        low, high = self.visited.low, self.visited.high
        x = (2.0 * np.asarray(signal, float) - low - high) / (high - low)
        return np.linalg.norm(polyval(x, self.polynomials.T).T * self.standard_errors, axis=-1)

    def __str__(self) -> str:
        low, high = self.visited.low, self.visited.high
        lines = [f"{'degree':>6}{'value':>12}{'std. error':>12}{'t':>9}"]
        rows = zip(self.values, self.standard_errors, self.t_ratios, strict=True)
        lines += [f"{i:>6}{c:>12.4g}{s:>12.3g}{t:>9.2f}" for i, (c, s, t) in enumerate(rows)]
        return "\n".join([*lines, f"values from {low:.4g} to {high:.4g}"])

    def _repr_html_(self) -> str:
        return preformatted(str(self))


def polynomial_terms(
    experiment: Visited, coefficients: Float[Numbers, " term"] | Sequence[float], deviation: float
) -> PolynomialTerms:
    """Return how well an experiment shows each term of a polynomial coefficient.

    Source: the report, section C.4.2.1, Eq. C.49 to C.63.

    Args:
        experiment: the values of the signal: `visited`, `equal_time` or `sinusoid`.
        coefficients: declared values by power of the signal, the constant first
            [unit of the coefficient / unit of the signal^power].
        deviation: standard deviation of the coefficient measured by one sample [its unit], such as
            `Iy / (qbar S c)` times the noise of the pitch acceleration for `Cm`.

    Raises:
        InputError: when the deviation is not positive, or the history has no more different values
            than coefficients.
    """
    R, c = _triangle(experiment, coefficients, deviation)
    scale = np.diagonal(R)
    polynomials = np.linalg.solve(R, np.diag(scale)).T
    by_power = c * experiment.half_range ** np.arange(c.size)
    return PolynomialTerms(experiment, R @ by_power / scale, deviation / scale, polynomials)


def half_ranges(
    experiment: Visited,
    coefficients: Float[Numbers, " term"] | Sequence[float],
    deviation: float,
    level: float = SHOWN,
) -> Float[np.ndarray, " term"]:
    """Return the smallest half range of the signal at which each term is shown.

        min h  with  |t_i(h)| = level,    t_i(h) = sum_j R_ij c_j h^j / sigma

    with the triangle `R` of the powers of `x` and the coefficients `c_j` about the centre. The
    last one is the amplitude that a polynomial of this order needs: its t grows as h^order. The
    t of the lower terms may fall again, because higher terms contribute to them.

    Source: the report, section C.4.2.1 ("a suitable (b - a) is chosen").

    Args:
        experiment: the distribution, which is scaled about its centre.
        coefficients, deviation: as for `polynomial_terms`.
        level: |t| from which a term counts as shown.

    Returns:
        Half ranges by degree; infinite for a term that no amplitude shows; zero for a constant
        that is shown without motion.

    Raises:
        InputError: as `polynomial_terms`; when the level is not positive.
    """
    require(level > 0, f"The level of t is {level:g}. Give a positive one, such as {SHOWN:g}.")
    R, c = _triangle(experiment, coefficients, deviation)
    return np.array([_first_reach(row * c / deviation, level) for row in R])


def _first_reach(t: np.ndarray, level: float) -> float:
    """Return the smallest h >= 0 at which a polynomial in h has the absolute value `level`."""
    if abs(t[0]) >= level:
        return 0.0
    shifted = np.stack([t, -t])
    shifted[:, 0] -= level
    roots = np.concatenate([polyroots(np.trim_zeros(side, "b")) for side in shifted])
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return float(np.min(real, initial=np.inf))


def _triangle(experiment: Visited, coefficients, deviation) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangle of the powers of x at all samples, and the coefficients by powers of the
    signal less its centre.
    """
    declared = np.atleast_1d(np.asarray(coefficients, float))
    require(
        np.isfinite(deviation) and deviation > 0,
        f"The standard deviation of a sample is {deviation:g}. Give a positive one.",
    )
    require(
        declared.ndim == 1 and bool(np.all(np.isfinite(declared))),
        "The coefficients are not a list of finite numbers, one for each power of the signal.",
    )
    different = np.unique(experiment.nodes).size
    require(
        different >= declared.size,
        f"{different} different values of the signal do not determine {declared.size} "
        "coefficients. Lower the order, or give a history that moves.",
    )
    powers = np.vander(experiment.nodes, declared.size, increasing=True)
    R = np.linalg.qr(np.sqrt(experiment.shares * experiment.samples)[:, None] * powers, mode="r")
    centre = 0.5 * (experiment.low + experiment.high)
    c = np.zeros(declared.size)
    about_centre = Polynomial(declared)(Polynomial([centre, 1.0])).coef
    c[: about_centre.size] = about_centre
    R *= np.sign(np.diagonal(R))[:, None]
    return np.where(np.abs(R) > ZERO_SHARE * np.linalg.norm(R, axis=0), R, 0.0), c
