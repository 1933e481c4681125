"""Coloured measurement noise: an autoregression in each channel, estimated with the parameters.

    v_i = a_1 v_(i-1) + ... + a_p v_(i-p) + e_i,    e_i white, of variance s^2

The noise is stationary. The first samples of a record are predicted from the fewer samples before
them, by the predictors of lower order of the Levinson recursion, which makes the likelihood that
of the stationary process (Box, Jenkins, Reinsel, *Time Series Analysis*, 2008, section A7.4):

    J = sum_j N_j/2 (log s_j^2 + 1) + 1/2 sum_t n_jt log r_jt,    s_j^2 = 1/N_j sum e_ij^2 / r_jt

where `r_jt` is the error variance of the predictor of order t < p, divided by the error variance of
order p, and `n_jt` the number of records with such a sample. A sample after a gap serves as
predecessor only, until p samples before it are valid.
"""

from functools import partial
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from .._foundation.checks import require
from .._foundation.grid import uneven_steps
from .._foundation.types import Array, Bool, Float, Numbers
from ..models.noise import AbstractNoise, AbstractWhitening

# Samples with valid predecessors that a channel needs for each coefficient (chosen).
SAMPLES_PER_COEFFICIENT = 10
# Tolerance of the search for the coefficients, whose error enters the cost squared (chosen).
TOLERANCE = 1e-8
# Iterations of this search; about ten are usual (chosen).
MAX_STEPS = 100


class Predictors(NamedTuple):
    """Predictors of orders 0 to p of a stationary process.

    Attributes:
        coefficients: coefficients of each predictor, filled with zeros.
        ratio: error variance of each predictor, divided by the error variance of the last one.
    """

    coefficients: Float[Array, "order lag"]
    ratio: Float[Array, " order"]


class Autoregression(AbstractWhitening):
    """Whitening by the errors of the best predictors, `e_i / s_i`.

    Attributes:
        predictors: predictors of every channel.
        deviation: standard deviation `s` of the innovations.
    """

    predictors: Predictors
    deviation: Float[Array, " output"]

    def __call__(self, rows, mask):
        coefficients, ratio = self.predictors
        order = coefficients.shape[-1]
        at = jnp.minimum(jnp.arange(mask.shape[1]), order)
        columns = (1,) * (rows.ndim - mask.ndim)
        rows = jnp.where(mask.reshape(*mask.shape, *columns), rows, 0.0)
        predicted = jnp.einsum("jtk,ktcj...->ctj...", coefficients[:, at], _lagged(rows, order))
        scale = (jnp.sqrt(ratio[:, at]) * self.deviation[:, None]).T
        used = usable(mask, order).reshape(*mask.shape, *columns)
        return jnp.where(used, (rows - predicted) / scale.reshape(1, *scale.shape, *columns), 0.0)


class AutoregressiveNoise(AbstractNoise):
    """Noise of each channel with a memory of some samples, unknown, independent between channels.

    An anti-aliasing filter of second order gives noise of order 2 or more. Standard errors and
    steps of the parameters use the whitened rows, so that the Cramer-Rao bound holds for coloured
    noise. `Estimate.noise` then is the covariance of the innovations, not of the noise. Sampling
    must be uniform, with one step for all records. `select_order` finds the order from the
    residuals of a first fit.

    The coefficients of a short record are estimated too low: with one coefficient of 0.8, 95 %
    intervals of a first-order lag cover 92 % at 200 samples, 94 % at 600 and 95 % at 1,200 (500
    records each).

    Args:
        order: number of coefficients p of every channel.

    Raises:
        InputError: for an order below one.
    """

    order: int = eqx.field(static=True)

    is_known: ClassVar[bool] = False

    def __init__(self, order: int = 1):
        require(order >= 1, f"The order of the noise is {order}; give at least 1.")
        self.order = order

    def whitening(self, v, mask) -> Autoregression:
        predictors, variance = autoregression(v, mask, self.order)
        return Autoregression(predictors, jnp.sqrt(variance))

    def coefficients(
        self, v: Float[Array, "case time output"], mask: Bool[Array, "case time output"]
    ) -> Float[Array, "output lag"]:
        """Return the coefficients `a_1` to `a_p` of every channel, from residuals."""
        return autoregression(v, mask, self.order)[0].coefficients[:, -1]

    def cholesky(self, v, mask):
        return jnp.diag(self.whitening(v, mask).deviation)

    def cost(self, v, mask):
        predictors, variance = autoregression(v, mask, self.order)
        count = _counts(mask, self.order)
        starts = jnp.sum(count * jnp.log(predictors.ratio))
        return 0.5 * (jnp.sum(jnp.sum(count, axis=1) * (jnp.log(variance) + 1.0)) + starts)

    def profile_rows(self, white_S, white_v, mask):
        return jnp.einsum("ctjp,ctj->cjp", white_S, white_v)  # of the variances, as a diagonal R

    def profile_weights(self, mask):
        return 2.0 / jnp.maximum(jnp.sum(usable(mask, self.order), axis=(0, 1)), 1)

    def check(self, mask, outputs):
        count = np.sum(usable(np.asarray(mask), self.order, np), axis=(0, 1))
        needed = SAMPLES_PER_COEFFICIENT * self.order
        for name, samples in zip(outputs, count, strict=True):
            require(
                bool(samples >= needed),
                f"The output {name!r} has {samples} samples with {self.order} valid predecessors; "
                f"noise of order {self.order} needs {needed}. Lower the order, or use "
                "DiagonalNoise() where a channel has many gaps.",
            )

    def check_times(self, t):
        steps = uneven_steps(np.asarray(t))
        require(
            steps is None,
            f"Autoregressive noise needs uniform sampling, of one step for all records, and "
            f"{steps}. Resample the records to one step, use DiagonalNoise() with "
            "`corrected_errors`, or give the noise a correlation time: FilterError with "
            "FirstOrder, for any times.",
        )


@partial(jax.jit, static_argnames="order")
def autoregression(
    v: Float[Array, "case time output"], mask: Bool[Array, "case time output"], order: int
) -> tuple[Predictors, Float[Array, " output"]]:
    """Return the most likely predictors and innovation variance of every channel, all records
    pooled (jitted: one trace serves all programs of a fit).

    Args:
        v: residuals.
        mask: valid samples.
        order: number of coefficients.
    """
    v, used = jnp.where(mask, v, 0.0), usable(mask, order)
    present_and_past = jnp.concatenate([v.swapaxes(0, 1)[None], _lagged(v, order)])
    valid = jnp.where(used.swapaxes(0, 1)[None], present_and_past, 0.0)
    by_time = jnp.einsum("ktcj,ltcj->tjkl", valid, valid)
    rest = jnp.sum(by_time[order:], axis=0, keepdims=True)
    products = jnp.concatenate([by_time[:order], rest]).swapaxes(0, 1)
    lags = jnp.einsum("tcj,ktcj->jk", v.swapaxes(0, 1), present_and_past)
    predictors, power = jax.vmap(_most_likely)(products, _counts(mask, order), lags)
    return predictors, power


def _most_likely(products, count, lags):
    """Return the predictors of one channel and the variance of the innovations.

    Args:
        products: sums of the products of the samples and their predecessors, for each number of
            predecessors.
        count: number of samples with this number of predecessors.
        lags: sums of products of all samples, for the start of the search by Yule and Walker.
    """
    total = jnp.maximum(jnp.sum(count), 1)

    def variance(predictors):
        ones = jnp.ones((predictors.ratio.size, 1))
        error = jnp.concatenate([ones, -predictors.coefficients], axis=1)
        squares = jnp.einsum("tk,tkl,tl->t", error, products, error)
        return jnp.maximum(jnp.sum(squares / predictors.ratio) / total, jnp.finfo(float).tiny)

    def cost(angle, _):
        predictors = _predictors(jnp.tanh(angle))
        starts = jnp.sum(count * jnp.log(predictors.ratio))
        return 0.5 * (jnp.log(variance(predictors)) + starts / total)

    search = optx.BFGS(rtol=TOLERANCE, atol=TOLERANCE)
    start = jnp.arctanh(_partial_correlations(lags))
    best = optx.minimise(cost, search, start, max_steps=MAX_STEPS, throw=False).value
    predictors = _predictors(jnp.tanh(best))
    return predictors, variance(predictors)


def _predictors(partial: Float[Array, " lag"]) -> Predictors:
    """Return the predictors of a process with these partial correlations (Levinson, Durbin)."""
    order = partial.size
    rows = [jnp.zeros(order)]
    for k in range(order):
        before = rows[-1][:k]
        entries = [before - partial[k] * before[::-1], partial[k, None], jnp.zeros(order - k - 1)]
        rows.append(jnp.concatenate(entries))
    remaining = jnp.cumprod((1.0 - partial**2)[::-1])[::-1]
    return Predictors(jnp.stack(rows), jnp.append(1.0 / remaining, 1.0))


def _partial_correlations(lags: Float[Array, " sum"]) -> Float[Array, " lag"]:
    """Return the partial correlations of sums of products at lags 0 to p (Yule, Walker)."""
    correlation = lags / (lags[0] + jnp.finfo(float).tiny)
    partial, before, remaining = [], jnp.zeros(0), jnp.ones(())
    for k in range(lags.size - 1):
        missing = correlation[k + 1] - before @ correlation[1 : k + 1][::-1]
        partial.append(missing / jnp.maximum(remaining, jnp.finfo(float).eps))
        before = jnp.append(before - partial[-1] * before[::-1], partial[-1])
        remaining = remaining * (1.0 - partial[-1] ** 2)
    limit = 1.0 - 1e-6  # a correlation of one has no finite angle
    return jnp.clip(jnp.stack(partial), -limit, limit)


def select_order(
    v: Float[Array, "case time output"], mask: Bool[Array, "case time output"], largest: int = 6
) -> int:
    """Return the order of the noise by the Bayesian information criterion, zero for white noise.

        BIC(p) = sum_j N_j log s_j^2(p) + p log N_j

    All orders are compared on the samples with `largest` valid predecessors, by least squares. The
    order is that of all channels together.

    Args:
        v: residuals of a fit with white noise, such as `Estimate.residuals`.
        mask: valid samples.
        largest: largest order.

    Source: G. Schwarz, Annals of Statistics 6, 1978.
    """
    residuals, valid_samples = np.asarray(v), np.asarray(mask)
    used = usable(valid_samples, largest, np)
    used[:, :largest] = False
    count = np.maximum(np.sum(used, axis=(0, 1)), 1)
    past = _lagged(np.where(valid_samples, residuals, 0.0), largest, np).swapaxes(1, 2)
    criteria = np.zeros(largest + 1)
    for channel, samples in enumerate(count):
        valid = used[..., channel]
        present, X = residuals[..., channel][valid], past[..., channel][:, valid].T
        for order in range(largest + 1):
            a = np.linalg.lstsq(X[:, :order], present, rcond=None)[0]
            power = max(float(np.mean((present - X[:, :order] @ a) ** 2)), np.finfo(float).tiny)
            criteria[order] += samples * np.log(power) + order * np.log(samples)
    return int(np.argmin(criteria))


def usable(
    mask: Bool[Numbers, "case time output"], order: int, xp=jnp
) -> Bool[Numbers, "case time output"]:
    """Return the valid samples whose `order` predecessors, as far as the record has them, are
    valid too; by NumPy if `xp` is NumPy.
    """
    return mask & ~xp.any(_lagged(~mask, order, xp).swapaxes(1, 2), axis=0)


def _counts(mask: Bool[Array, "case time output"], order: int) -> Float[Array, "output order"]:
    """Return the number of usable samples with 0, 1, ... and with `order` predecessors."""
    by_time = jnp.sum(usable(mask, order), axis=0) * 1.0
    rest = jnp.sum(by_time[order:], axis=0, keepdims=True)
    return jnp.concatenate([by_time[:order], rest]).T


def _lagged(rows: Numbers, order: int, xp=jnp) -> Numbers:
    """Return the predecessors of all samples, shape (lag, time, case, output, ...)."""
    rows = rows.swapaxes(0, 1)
    empty = xp.zeros((order, *rows.shape[1:]), rows.dtype)
    padded = xp.concatenate([empty, rows])
    count = rows.shape[0]
    return xp.stack([padded[order - lag : order - lag + count] for lag in range(1, order + 1)])
