"""Noise models: the covariance R of the measurement noise, known or estimated with the parameters
(Eq. 4.4, A.63).
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular

from .._foundation.checks import InputError, require
from .._foundation.host import on_host
from .._foundation.types import Array, Bool, Float
from .base import as_float

# Difference of two covariances of one pair of outputs, in their standard deviations, that counts as
# rounding (chosen).
SYMMETRY = 1e-8


class AbstractWhitening(eqx.Module):
    """Linear map of residuals and sensitivities to rows whose noise is white, of unit variance."""

    @abc.abstractmethod
    def __call__(
        self, rows: Float[Array, "case time output *column"], mask: Bool[Array, "case time output"]
    ) -> Float[Array, "case time output *column"]:
        """Return the whitened rows, zero where there is no valid sample.

        Args:
            rows: residuals, or sensitivities with the parameter as last axis.
            mask: valid samples.
        """

    def misfit(
        self, v: Float[Array, "case time row"], mask: Bool[Array, "case time row"]
    ) -> Float[Array, "case time row"]:
        """Return the residuals by which the whitened sensitivities give the gradient of the cost.

        For normal noise they are the whitened residuals.

        Args:
            v: residuals.
            mask: valid samples.
        """
        return self(v, mask)


class Division(AbstractWhitening):
    """Whitening of noise without memory: `L^-1 rows` at every sample.

    Where only the first rows of misfit have sensitivities, their part of L whitens them.

    Attributes:
        L: Cholesky factor of the covariance.
    """

    L: Float[Array, "output output"]

    def __call__(self, rows, mask):
        count = rows.shape[2]
        return whiten(self.L[:count, :count], rows, mask[..., :count])


class Scaling(AbstractWhitening):
    """Whitening of independent noise without memory: each row divided by its standard deviation.

    Attributes:
        deviations: standard deviations.
    """

    deviations: Float[Array, " output"]

    def __call__(self, rows, mask):
        count, columns = rows.shape[2], (1,) * (rows.ndim - mask.ndim)
        mask = mask[..., :count].reshape(*mask.shape[:2], count, *columns)
        return jnp.where(mask, rows / self.deviations[:count].reshape(1, 1, count, *columns), 0.0)


class Identity(AbstractWhitening):
    """Whitening of rows that are white already; only the first ones may have sensitivities."""

    def __call__(self, rows, mask):
        columns = (1,) * (rows.ndim - mask.ndim)
        mask = mask[..., : rows.shape[2]]
        return jnp.where(mask.reshape(*mask.shape, *columns), rows, 0.0)


class AbstractNoise(eqx.Module):
    """Measurement noise: its covariance, its whitening, and the corresponding cost.

    A noise model computes from residuals `v` a Cholesky factor `L` of `R = L L'`, and the negative
    log-likelihood that a search minimises.

    Attributes:
        is_known: True if R is given, False if it is estimated from the residuals.
    """

    is_known: eqx.AbstractClassVar[bool]

    @abc.abstractmethod
    def cholesky(
        self, v: Float[Array, "case time output"], mask: Bool[Array, "case time output"]
    ) -> Float[Array, "output output"]:
        """Cholesky factor of R for these residuals."""

    def whitening(
        self, v: Float[Array, "case time output"], mask: Bool[Array, "case time output"]
    ) -> AbstractWhitening:
        """Return the whitening for these residuals; by default that of noise without memory."""
        return Division(self.cholesky(v, mask))

    @abc.abstractmethod
    def cost(
        self, v: Float[Array, "case time output"], mask: Bool[Array, "case time output"]
    ) -> Float[Array, ""]:
        """Negative log-likelihood, without the constant `N/2 log 2 pi`."""

    def white_power(
        self, misfit: Float[Array, "case time row"], mask: Bool[Array, "case time row"]
    ) -> Float[Array, ""]:
        """Return the least mean square of whitened residuals without colour, one for normal noise.

        A correction for colour does not make variances smaller than this share.

        Args:
            misfit: residuals, from `AbstractWhitening.misfit`.
            mask: valid samples.
        """
        return jnp.ones(())

    def profile_rows(
        self,
        white_S: Float[Array, "case time output column"],
        white_v: Float[Array, "case time output"],
        mask: Bool[Array, "case time output"],
    ) -> Float[Array, "case row column"]:
        """Return rows `C` of each record by which an estimated R changes the curvature of the cost.

        With R at its estimate for each value of the parameters, the second derivative of the cost
        of a linear model is `M - C' diag(w) C`, with C summed over the records and w from
        `profile_weights`. A given R has no such rows.

        Args:
            white_S: whitened sensitivities, zero at missing samples.
            white_v: whitened residuals, zero at missing samples.
            mask: valid samples.
        """
        return jnp.zeros((white_S.shape[0], 0, white_S.shape[-1]))

    def profile_weights(self, mask: Bool[Array, "case time output"]) -> Float[Array, " row"]:
        """Return the weights `w` of the rows of `profile_rows`, from the samples of all records."""
        return jnp.zeros(0)

    def check(self, mask: Bool[Array, "case time output"], outputs: tuple[str, ...]) -> None:
        """Refuse data that this noise model does not support."""

    def check_times(self, t: Float[Array, "*case time"]) -> None:
        """Refuse sample times that this noise model does not support."""


class FixedNoise(AbstractNoise):
    """R known: `J = 1/2 sum v' R^-1 v + n/2 log det R`.

    Args:
        R: covariance (output, output), or variances (output,).

    An estimate refuses an R that is not symmetric or not positive definite.
    """

    R: Float[Array, "output output"]

    is_known: ClassVar[bool] = True

    def __init__(self, R):
        R = as_float(R)
        self.R = _diagonal(R) if R.ndim == 1 else R

    def cholesky(self, v, mask):
        return jnp.linalg.cholesky(self.R)

    def cost(self, v, mask):
        L = self.cholesky(v, mask)
        log_det = jnp.log(jnp.diagonal(L))
        return 0.5 * jnp.sum(whiten(L, v, mask) ** 2) + jnp.sum(mask * log_det[None, None])

    def check(self, mask, outputs):
        require(
            self.R.shape == (len(outputs), len(outputs)),
            f"R has shape {self.R.shape}, but there are {len(outputs)} outputs "
            f"({', '.join(outputs)}).",
        )
        R = np.asarray(self.R)
        wrong = np.argwhere(_asymmetric(R))
        if wrong.size:
            row, column = wrong[0]
            raise InputError(
                f"R is not symmetric: the covariance of {outputs[row]!r} and {outputs[column]!r} "
                f"is {R[row, column]:g} in row {row} and {R[column, row]:g} in row {column}. Give "
                "one value for both."
            )
        require(
            _is_positive_definite(R),
            "R is not positive definite. Give variances, not standard deviations, and none of them "
            "zero.",
        )
        off_diagonal = bool(np.any(np.diag(np.diagonal(R)) != R))
        require(not off_diagonal or not _gaps(mask), _GAPS.format(where=_gap_names(mask, outputs)))


@on_host
def _diagonal(xp, variances):
    return xp.diag(variances)


class DiagonalNoise(AbstractNoise):
    """R unknown and diagonal, re-estimated at each iteration: `R = diag(1/N sum v v')` (Eq. 4.4),
    `J = sum_j N_j/2 log R_j`.

    `N_j` is the number of valid samples of channel j, so that gaps may be anywhere. A channel that
    is fitted exactly has the variance 1.5e-154: the square of its inverse is finite.
    """

    is_known: ClassVar[bool] = False

    def cholesky(self, v, mask):
        return jnp.diag(jnp.sqrt(self._variances(v, mask)))

    def whitening(self, v, mask):
        return Scaling(jnp.sqrt(self._variances(v, mask)))

    def cost(self, v, mask):
        count = jnp.sum(mask, axis=(0, 1))
        return 0.5 * jnp.sum(count * (jnp.log(self._variances(v, mask)) + 1.0))

    def profile_rows(self, white_S, white_v, mask):
        # cost of a channel: N/2 log v'v, whose second derivative is N S'(I - 2 v v'/v'v) S / v'v
        return jnp.sum(white_S * white_v[..., None], axis=1)

    def profile_weights(self, mask):
        return 2.0 / jnp.maximum(jnp.sum(mask, axis=(0, 1)), 1)

    def _variances(self, v, mask):
        count = jnp.maximum(jnp.sum(mask, axis=(0, 1)), 1)
        return jnp.maximum(
            jnp.sum(jnp.where(mask, v, 0.0) ** 2, axis=(0, 1)) / count,
            np.sqrt(np.finfo(float).tiny),
        )


class FullNoise(AbstractNoise):
    """R unknown and full, re-estimated at each iteration: `R = 1/N sum v v'` (A.63), `J = N/2 log
    det R`.

    A sample counts only when all channels are valid; gaps in single channels are refused, because R
    then has no closed form.
    """

    is_known: ClassVar[bool] = False

    def cholesky(self, v, mask):
        complete = jnp.all(mask, axis=-1)
        v = jnp.where(complete[..., None], v, 0.0)
        count = jnp.maximum(jnp.sum(complete), 1)
        return jnp.linalg.cholesky(jnp.einsum("cti,ctj->ij", v, v) / count)

    def cost(self, v, mask):
        count = jnp.sum(jnp.all(mask, axis=-1))
        log_det = 2.0 * jnp.sum(jnp.log(jnp.diagonal(self.cholesky(v, mask))))
        return 0.5 * count * (log_det + v.shape[-1])

    def profile_rows(self, white_S, white_v, mask):
        # second derivative of N/2 log det(V'V): one row for each channel and each pair of channels
        weighted = jnp.where(jnp.all(mask, axis=-1)[..., None], white_v, 0.0)
        products = jnp.einsum("ctip,ctj->cijp", white_S, weighted)
        first, second = jnp.triu_indices(products.shape[1])
        return products[:, first, second] + products[:, second, first]

    def profile_weights(self, mask):
        first, second = jnp.triu_indices(mask.shape[-1])
        count = jnp.maximum(jnp.sum(jnp.all(mask, axis=-1)), 1)
        return jnp.where(first == second, 0.5, 1.0) / count

    def check(self, mask, outputs):
        require(not _gaps(mask), _GAPS.format(where=_gap_names(mask, outputs)))


class InnovationNoise(AbstractNoise):
    """Noise of rows that are whitened already, with the log-determinant of their covariance.

        J = sum_i ( 1/2 w_i' w_i + log det L_i )

    The rows of a sample with m outputs are `w` (m), `I - w w'` (m (m + 1)/2), `log det L` (1) and
    the innovations (m), as `FilterError` computes them. Q and R are parameters of the model.
    """

    is_known: ClassVar[bool] = False

    def cholesky(self, v, mask):
        return jnp.eye(v.shape[-1])

    def whitening(self, v, mask):
        return Identity()

    def cost(self, v, mask):
        m = n_outputs_of(v.shape[-1])
        log_det = v[..., m * (m + 3) // 2]
        return 0.5 * jnp.sum(v[..., :m] ** 2) + jnp.sum(log_det)


def n_outputs_of(width: int) -> int:
    """Return the number m of outputs for the width `2 m + m (m + 1)/2 + 1` of their rows."""
    return int((np.sqrt(17 + 8 * width) - 5) / 2 + 1e-9)


def whiten(
    L: Float[Array, "output output"],
    rows: Float[Array, "case time output *column"],
    mask: Bool[Array, "case time output"],
) -> Float[Array, "case time output *column"]:
    """Return `L^-1 rows`, the rows in units of the noise, zero where there is no valid sample.

    Args:
        L: Cholesky factor of R.
        rows: residuals, or sensitivities with the parameter as last axis.
        mask: valid samples.
    """
    shape = mask.shape + (1,) * (rows.ndim - mask.ndim)
    rows = jnp.where(mask.reshape(shape), rows, 0.0)
    # L has the size of the number of outputs, so that its inverse is cheap. For long batched rows
    # XLA solves a hundred times slower than it multiplies.
    inverse = solve_triangular(L, jnp.eye(L.shape[0]), lower=True)
    return jnp.where(mask.reshape(shape), jnp.einsum("ij,ctj...->cti...", inverse, rows), 0.0)


_GAPS = (
    "A full R has no closed form where single channels miss samples ({where}). Use "
    "DiagonalNoise(), or mark these samples as missing in all channels."
)


def _asymmetric(R: Float[np.ndarray, "output output"]) -> Bool[np.ndarray, "output output"]:
    """Return the elements that differ from their transposed ones by more than rounding."""
    deviation = np.sqrt(np.abs(np.diagonal(R)))
    return np.abs(R - R.T) > SYMMETRY * deviation[:, None] * deviation


def _is_positive_definite(R: Float[np.ndarray, "output output"]) -> bool:
    try:
        factor = np.linalg.cholesky(R)
    except np.linalg.LinAlgError:
        return False
    return bool(np.all(np.isfinite(factor)))


def _gaps(mask) -> bool:
    mask = np.asarray(mask)
    return bool(np.any(np.any(mask, axis=-1) & ~np.all(mask, axis=-1)))


def _gap_names(mask, outputs) -> str:
    mask = np.asarray(mask)
    gaps = np.sum(np.any(mask, axis=-1)[..., None] & ~mask, axis=(0, 1))
    return ", ".join(
        f"{name}: {int(count)} missing" for name, count in zip(outputs, gaps, strict=True) if count
    )
