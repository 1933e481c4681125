"""Measures of an information matrix, computed from its square-root factor.

With a factor `T` of the information, `M = T'T`, every measure is a cost to be minimised. Its
derivative by M is `-K'K`. An additional experiment with rows `a` has the value `|a K'|^2`, the
function of the general equivalence theorem (Theorem C.1).
"""

import abc
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
import scipy.linalg

from .._foundation.checks import require
from .._foundation.linalg import triangle
from .._foundation.types import Array, Float, Int, Numbers

Factor = Float[Numbers, "row parameter"]


class AbstractMeasure(eqx.Module):
    """A convex function of the information matrix that a design minimises.

    An information matrix without full rank has the cost infinity or NaN.

    A factor in NumPy gives a result in NumPy, without any compilation; all others give one in JAX.

    Attributes:
        is_variance: True if the cost is a variance, False if it is a logarithm.
    """

    is_variance: ClassVar[bool] = False

    @abc.abstractmethod
    def cost(self, factor: Factor) -> Float[Numbers, ""] | np.floating:
        """Return the cost of the information `factor' factor`; smaller is better."""

    @abc.abstractmethod
    def gradient_rows(self, factor: Factor) -> Float[Numbers, "target parameter"]:
        """Return rows `K` with `K'K = -d cost / dM`."""

    def gain(
        self, factor: Factor, rows: Float[Numbers, "*case sample parameter"]
    ) -> Float[Numbers, "*case"] | np.floating:
        """Return the initial fall of the cost per unit of information `rows' rows`.

            phi = trace(K rows' rows K')        (Eq. C.5, C.75)

        Args:
            factor: information of the present design, any factor of it.
            rows: whitened sensitivities of one experiment, or of many.
        """
        K = self.gradient_rows(factor)
        products = rows.reshape(-1, rows.shape[-1]) @ K.T
        return _library(factor).sum((products**2).reshape(*rows.shape[:-2], -1), axis=-1)

    def gradient(self, factor: Factor) -> Float[Numbers, "row parameter"]:
        """Return the derivative of the cost by the rows of the factor, `-2 rows K'K`."""
        K = self.gradient_rows(factor)
        return -2.0 * (factor @ K.T) @ K


class Determinant(AbstractMeasure):
    """D-optimality: `-log det M`, the volume of the confidence ellipsoid.

    The optimal design does not depend on the units of the parameters.
    """

    def cost(self, factor):
        return -_log_det(_triangle(factor))

    def gradient_rows(self, factor):
        T = _triangle(factor)
        return _solve(T, _library(T).eye(T.shape[0]), transposed=True)


class Trace(AbstractMeasure):
    """A-optimality: `sum_i w_i var(theta_i) = trace(diag(w) M^-1)`.

    Args:
        weights: weight `w` of the variance of each parameter [1/unit^2]; `1/theta^2` for the sum of
            squared relative errors.
    """

    weights: Float[Array, " parameter"]

    is_variance: ClassVar[bool] = True

    def __init__(self, weights: Float[Numbers, " parameter"] | list[float]):
        self.weights = _positive(weights, "weights")

    def cost(self, factor):
        return _variance(factor, self._targets())

    def gradient_rows(self, factor):
        return _by_information(factor, self._targets())

    def _targets(self):
        return jnp.eye(self.weights.size) * jnp.sqrt(self.weights)[None]


class Combination(AbstractMeasure):
    """c-optimality: the variance `c' M^-1 c` of one linear combination of the parameters.

    Args:
        coefficients: the coefficients `c`.
    """

    coefficients: Float[Array, " parameter"]

    is_variance: ClassVar[bool] = True

    def __init__(self, coefficients: Float[Numbers, " parameter"] | list[float]):
        self.coefficients = jnp.asarray(coefficients, float)
        require(
            bool(jnp.any(self.coefficients != 0)),
            "All coefficients of the combination are zero. Give one that is not.",
        )

    def cost(self, factor):
        return _variance(factor, self.coefficients[None])

    def gradient_rows(self, factor):
        return _by_information(factor, self.coefficients[None])


class SmallestEigenvalue(AbstractMeasure):
    """E-optimality: `-log` of the smallest eigenvalue of `D M D`, the worst direction.

    The derivative is that of a simple eigenvalue. Where the smallest eigenvalue is multiple, the
    cost has a corner and no certificate exists.

    Args:
        scale: diagonal of `D`, the typical size of each parameter [unit]; parameters in comparable
            units need none.
    """

    scale: Float[Array, " parameter"] | None = None

    def cost(self, factor):
        xp = _library(factor)
        return -2.0 * xp.log(xp.linalg.svd(self._scaled(factor), compute_uv=False)[-1])

    def gradient_rows(self, factor):
        _, s, Vt = _library(factor).linalg.svd(self._scaled(factor), full_matrices=False)
        direction = Vt[-1:] / s[-1]
        return direction if self.scale is None else direction * self._sizes(factor)

    def _scaled(self, factor):
        T = _triangle(factor)
        return T if self.scale is None else T * self._sizes(factor)

    def _sizes(self, factor):
        return _library(factor).asarray(self.scale)[None]


class SubsetDeterminant(AbstractMeasure):
    """Ds-optimality: `log det` of the covariance of some parameters, the others estimated too.

    Args:
        indices: positions of the parameters of interest.
    """

    indices: Int[Array, " target"]

    def __init__(self, indices: Int[Numbers, " target"] | list[int]):
        self.indices = jnp.asarray(indices, int)

    def cost(self, factor):
        return _log_det(self._root(factor))

    def gradient_rows(self, factor):
        rows = _by_information(factor, self._targets(factor))
        return _solve(self._root(factor), rows, transposed=True)

    def _targets(self, factor):
        xp = _library(factor)
        return xp.eye(factor.shape[1])[xp.asarray(self.indices)]

    def _root(self, factor):
        """Return the triangle `U` with `U'U` the covariance of the subset."""
        return _triangle(_whitened_targets(_triangle(factor), self._targets(factor)))


class CurveWidth(AbstractMeasure):
    """Mean squared standard error of a coefficient curve over a range (Eq. C.46).

        J = integral of d(alpha) var(sum_k theta_k phi_k(alpha)) d alpha = trace(W M^-1)

    Args:
        rows: a factor of W; `curve_width` computes it.
    """

    rows: Float[Array, "target parameter"]

    is_variance: ClassVar[bool] = True

    def cost(self, factor):
        return _variance(factor, self.rows)

    def gradient_rows(self, factor):
        return _by_information(factor, self.rows)


def curve_width(
    basis: Callable[[Array], Array],
    low: float,
    high: float,
    *,
    density: Callable[[Array], Array] | None = None,
    nodes: int = 32,
) -> CurveWidth:
    """Return the measure of the expected width of a coefficient curve over a range.

    The integral of Eq. C.46 by Gauss-Legendre quadrature, exact for polynomials up to degree
    `2 nodes - 1`, divided by the length of the range.

    Args:
        basis: function of points, shape (point,), that returns the regressors of the curve, shape
            (point, parameter).
        low, high: the range [unit of the points].
        density: weight `d` of a point; 1 by default.
        nodes: number of nodes.

    Raises:
        InputError: when the range is empty.
    """
    require(low < high, f"The range from {low:g} to {high:g} is empty. Give its lower end first.")
    abscissa, weight = np.polynomial.legendre.leggauss(nodes)
    points = jnp.asarray(low + (high - low) * 0.5 * (abscissa + 1.0))
    w = jnp.asarray(0.5 * weight)
    if density is not None:
        w = w * density(points)
    return CurveWidth(triangle(jnp.sqrt(w)[:, None] * basis(points)))


def _library(array) -> Any:
    """Return NumPy for a NumPy array, else `jax.numpy`."""
    return np if isinstance(array, np.ndarray) else jnp


def _triangle(factor) -> Any:
    """Return the triangle of a factor; in NumPy its diagonal may be negative."""
    if _library(factor) is jnp:
        return triangle(factor)
    missing = max(factor.shape[1] - factor.shape[0], 0)
    return np.linalg.qr(np.pad(factor, ((0, missing), (0, 0))), mode="r")


def _solve(T, right, *, transposed: bool = False) -> Any:
    """Return `T^-1 right` or `T^-T right`, not finite where the triangle is singular."""
    trans: Any = "T" if transposed else "N"
    if _library(T) is jnp:
        return jax.scipy.linalg.solve_triangular(T, right, trans=trans)
    try:
        return scipy.linalg.solve_triangular(T, right, trans=trans, check_finite=False)
    except np.linalg.LinAlgError:
        return np.full(right.shape, np.inf)


def _log_det(T):
    """Return `log det T'T` of a triangle."""
    xp = _library(T)
    with np.errstate(divide="ignore"):
        return 2.0 * xp.sum(xp.log(xp.abs(xp.diagonal(T))))


def _whitened_targets(T, targets):
    """Return `T^-T targets'`, shape (parameter, target)."""
    return _solve(T, _library(T).asarray(targets).T, transposed=True)


def _variance(factor, targets):
    """Return the sum of the variances of the linear combinations `targets theta`."""
    return _library(factor).sum(_whitened_targets(_triangle(factor), targets) ** 2)


def _by_information(factor, targets):
    """Return `targets M^-1`."""
    T = _triangle(factor)
    return _solve(T, _whitened_targets(T, targets)).T


def _positive(values, name: str) -> Array:
    array = jnp.asarray(values, float)
    require(
        bool(jnp.all(array >= 0)) and bool(jnp.any(array > 0)),
        f"The {name} must not be negative, and one must be positive.",
    )
    return array
