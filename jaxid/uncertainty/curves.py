"""Coefficient curves and surfaces with their bands, and their combination point by point."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require
from .._foundation.types import Array, Bool, Float, Numbers
from ..estimation.result import Estimate
from .fixed_constants import FixedConstants
from .propagation import propagate


class Curve(eqx.Module):
    """A function of the model over points, such as a coefficient over alpha (Figs. 6.9, 6.19).

    Attributes:
        points: shape (point,), or (point, 2) for a surface over two variables.
        value, standard_errors: at each point; NaN and infinity where nothing determines the value.
        covariance: of the values at all points, its finite part; None for combined curves.
        valid: True where the estimate applies.
    """

    points: Float[Array, "point *variable"]
    value: Float[Array, " point"]
    standard_errors: Float[Array, " point"]
    covariance: Float[Array, "point point"] | None
    valid: Bool[Array, " point"]

    def band(self, width: float = 1.0) -> Float[Array, "point 2"]:
        """Return the ends of the band, `value -/+ width standard errors` at each point.

        Args:
            width: 1.0 as in the report's figures; 1.96 holds the true value of each single point
                with 95 %.
        """
        half = width * self.standard_errors
        return jnp.stack([self.value - half, self.value + half], axis=-1)


def curve(
    estimate: Estimate,
    function: Callable[[Any, Array], Array],
    points: Float[Numbers, "point *variable"],
    *,
    within: tuple[float, float] | Bool[Numbers, " point"] | None = None,
    coloured: bool = False,
    considered: FixedConstants | None = None,
) -> Curve:
    """Return a function of the model over points, with its standard errors (Eq. 6.4).

    Args:
        estimate: from `estimate`.
        function: takes the model and a point, returns a number:
            `lambda model, alpha: model.Cm({"alpha": alpha})`.
        points: of one variable, or rows of several.
        within: lowest and highest point, or a mask of points, at which the records of this
            estimate were: elsewhere a polynomial is extrapolated, and must not be used.
        coloured, considered: as in `propagate`.

    Raises:
        InputError: when the function does not return one number, or the mask has another length.
    """
    points = jnp.asarray(points, float)
    result = propagate(
        estimate, _OverPoints(function, points), coloured=coloured, considered=considered
    )
    require(
        jnp.shape(result.value) == points.shape[:1],
        f"The function returns an array of shape {jnp.shape(result.value)[1:]} at a point; it "
        "must return one number.",
    )
    count = points.shape[0]
    if isinstance(within, tuple):
        valid = jnp.all(((points >= within[0]) & (points <= within[1])).reshape(count, -1), axis=1)
    else:
        valid = jnp.ones(count, bool) if within is None else jnp.asarray(within, bool)
    require(valid.shape == (count,), f"`within` has shape {valid.shape} for {count} points.")
    return Curve(points, result.value, result.standard_errors, result.covariance, valid)


class _OverPoints(eqx.Module):
    """A function of the model as a function over all points."""

    function: Callable[[Any, Array], Array] = eqx.field(static=True)
    points: Float[Array, "point *variable"]

    def __call__(self, model: Any) -> Float[Array, "point *shape"]:
        return jax.vmap(lambda point: self.function(model, point))(self.points)


def combine_curves(curves: Sequence[Curve]) -> Curve:
    """Return the weighted mean of several curves, point by point (Eq. 4.15).

        C = sum_i w_i C_i / sum_i w_i,    w_i = 1 / sigma_i^2,    sigma = ( sum_i w_i )^-1/2

    with the curves that are valid at a point. The report's `sigma_i` are variances. The curves
    are of independent flights. Where no curve has an error, such as at `alpha = 0` of `a alpha`,
    the mean has none; elsewhere a curve without an error, such as of a parameter on its bound, is
    left out.

    Args:
        curves: over the same points.

    Raises:
        InputError: when there is no curve, or the points differ.
    """
    require(len(curves) > 0, "There is no curve to combine. Give at least one.")
    points = np.asarray(curves[0].points)
    for number, one in enumerate(curves):
        require(
            np.shape(one.points) == points.shape and bool(np.all(np.asarray(one.points) == points)),
            f"Curve {number} is over other points than curve 0. Evaluate all at the same points.",
        )
    value = np.stack([np.asarray(one.value) for one in curves])
    errors = np.stack([np.asarray(one.standard_errors) for one in curves])
    valid = np.stack([np.asarray(one.valid) for one in curves])
    used = valid & np.isfinite(errors)
    exact = ~np.any(used & (errors > 0), axis=0)
    used = used & (exact | (errors > 0))
    weight = np.where(used, 1.0 / np.where(used & ~exact, errors, 1.0) ** 2, 0.0)
    total = np.sum(weight, axis=0)
    determined = total > 0
    safe = np.where(determined, total, 1.0)
    mean = np.where(determined, np.sum(weight * np.where(used, value, 0.0), axis=0) / safe, np.nan)
    deviation = np.where(determined, np.where(exact, 0.0, safe**-0.5), np.inf)
    return Curve(
        curves[0].points,
        jnp.asarray(mean),
        jnp.asarray(deviation),
        None,
        jnp.asarray(determined),
    )
