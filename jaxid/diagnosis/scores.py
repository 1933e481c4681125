"""Score test of effects that are not in the model, from sensitivities at zero gain alone.

`v` is the residual, `S_phi` the sensitivity of the outputs to the gain `phi` of one such effect at
`phi = 0`. `S_perp` is the part of `S_phi` that is orthogonal (with the weight `R^-1`) to the
sensitivities to all free parameters, shared and per record. Then

    score = (S_perp' R^-1 v)^2 / (S_perp' R^-1 S_perp),
    phi = S_perp' R^-1 v / (S_perp' R^-1 S_perp)

The score is chi-square distributed with one degree of freedom if the effect is absent from the data
and the residual is white; `phi` is the estimated gain (Rao 1948).

In the code a column is the sensitivity to one parameter; shared parameters have one value for all
records, per-record parameters (`own`) one value per record.
"""

from statistics import NormalDist

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.compiler import fast_compile_jit
from .._foundation.host import on_host
from .._foundation.types import Array, Bool, Float
from ..estimation.coloured import colour_inflation
from ..estimation.problem import Problem
from ..models.free import Parameters
from ..sensitivity.information import Information, gather, record_triangles

# Share of a column's squared length, orthogonal to the columns of the free parameters, below which
# the column counts as a linear combination of these (chosen: above the rounding error).
IDENTIFIABLE = 1e-8


class Scores(eqx.Module):
    """Score tests of all shared columns; the score of a column of a free parameter is zero.

    Attributes:
        score: chi-square with one degree of freedom if the residual is white.
        variance_inflation: factor by which autocorrelation increases the variance of
            `S_perp' R^-1 v`, from the residual after the column has been fitted to it.
        estimated_gain: `phi`, the gain if the outputs were linear in it.
        identifiable_fraction: share of the column's squared length that is orthogonal to the
            columns of the free parameters. NaN if the column is not finite; its score is then zero,
            and the other columns are not affected.
        overlap: correlations between the orthogonal parts of the columns.
    """

    score: Float[Array, " column"]
    variance_inflation: Float[Array, " column"]
    estimated_gain: Float[Array, " column"]
    identifiable_fraction: Float[Array, " column"]
    overlap: Float[Array, "column column"]

    @property
    def significance(self) -> Float[Array, " column"]:
        """Score divided by the variance inflation: chi-square also for a coloured residual."""
        return self.score / self.variance_inflation


@fast_compile_jit
def sensitivities(
    problem: Problem, parameters: Parameters
) -> tuple[Float[Array, "case time output"], Float[Array, "case time output column"]]:
    """Residuals and sensitivities; the first columns belong to the per-record parameters.

    The sensitivities are computed once and used by all tests of a fit.
    """
    return problem.sensitivities(parameters)


@eqx.filter_jit
def whitened(
    problem: Problem,
    v: Float[Array, "case time output"],
    S: Float[Array, "case time output column"],
) -> tuple[Float[Array, "case time output"], Float[Array, "case time output column"]]:
    """Residuals and sensitivities divided by the square root of the noise covariance."""
    return problem.misfit(v), problem.whiten(v, S)


@eqx.filter_jit
def scores_of(
    v: Float[Array, "case time output"],
    S: Float[Array, "case time output column"],
    mask: Bool[Array, "case time output"],
    is_free: Bool[Array, " shared"],
) -> Scores:
    """Return the score tests of the shared columns of S.

    Args:
        v, S: whitened residuals and sensitivities, from `whitened`.
        mask: valid samples.
        is_free: true for a shared column (the last ones of S) whose parameter is free in the fit.
    """
    count = S.shape[-1] - is_free.size
    S, finite = _finite(S, is_free)
    information = _information(S, v, is_free.size)
    columns, rhs = information.triangle, information.rhs
    remainder, coefficients = _orthogonal_part(columns, rhs, is_free)
    orthogonal, target = remainder[:, :-1], remainder[:, -1]
    squared_length, product = jnp.sum(orthogonal**2, axis=0), orthogonal.T @ target
    total_squared_length = jnp.sum(columns**2, axis=0)
    identifiable = (
        (squared_length > IDENTIFIABLE * total_squared_length) & (squared_length > 0) & ~is_free
    )
    safe = jnp.where(identifiable, squared_length, 1.0)
    gain = jnp.where(identifiable, product / safe, 0.0)
    inflation = _variance_inflation(S, v, mask, count, is_free, coefficients, information, gain)
    length = jnp.sqrt(safe)
    overlap = jnp.where(
        identifiable[:, None] & identifiable[None],
        orthogonal.T @ orthogonal / (length[:, None] * length[None]),
        0.0,
    )
    share = jnp.where(
        identifiable,
        squared_length / jnp.where(total_squared_length > 0, total_squared_length, 1.0),
        0.0,
    )
    return Scores(
        score=jnp.where(identifiable, product**2 / safe, 0.0),
        variance_inflation=jnp.where(identifiable, inflation, 1.0),
        estimated_gain=gain,
        identifiable_fraction=jnp.where(finite, share, jnp.nan),
        overlap=overlap,
    )


def exchange_falls(
    v: Float[Array, "case time output"],
    S: Float[Array, "case time output column"],
    is_free: Bool[Array, " shared"],
    out: Bool[Array, "set shared"],
    values: Float[Array, " shared"],
) -> Float[Array, "set shared"]:
    """Return the decrease of chi-square in the linear model if a column replaces free columns.

    Each set of free columns is replaced by each column in turn. The residual without a set `S_out`
    with parameter values `phi` is `v + S_out phi`.

    Args:
        v, S, is_free: as in `scores_of`, after the estimation of the free columns.
        out: mask of the replaced columns, one row per set.
        values: parameter values of the shared columns.

    Returns:
        Decreases; minus infinity for a new column that is free already, or is a linear combination
        of the free columns that remain.
    """
    information = _information(_finite(S, is_free)[0], v, is_free.size)
    return _stacked(
        [_exchange_fall(information, is_free, replaced, values) for replaced in _rows(out)]
    )


@on_host
def _rows(xp, array):
    """Return the rows of an array."""
    return tuple(array)


@on_host
def _stacked(xp, rows):
    """Return rows as one array."""
    return xp.stack(rows)


@eqx.filter_jit
def _exchange_fall(information: Information, is_free, out, values) -> Float[Array, " shared"]:
    """Decrease of chi-square for one set of replaced columns, by each column in turn."""
    columns, rhs = information.triangle, information.rhs
    rhs_without = rhs + columns @ jnp.where(out, values, 0.0)
    remainder, _ = _orthogonal_part(columns, rhs_without, is_free & ~out)
    orthogonal, target = remainder[:, :-1], remainder[:, -1]
    squared_length, product = jnp.sum(orthogonal**2, axis=0), orthogonal.T @ target
    total_squared_length = jnp.sum(columns**2, axis=0)
    identifiable = (
        (squared_length > IDENTIFIABLE * total_squared_length) & (squared_length > 0) & ~is_free
    )
    score = jnp.where(
        identifiable, product**2 / jnp.where(identifiable, squared_length, 1.0), -jnp.inf
    )
    return jnp.sum(rhs**2) - jnp.sum(target**2) + score


@eqx.filter_jit
def _finite(S, is_free):
    """Return S with zeros for candidate columns that are not finite, and a mask of finite ones."""
    finite = jnp.all(jnp.isfinite(S[..., S.shape[-1] - is_free.size :]), axis=(0, 1, 2)) | is_free
    is_kept = jnp.concatenate([jnp.ones(S.shape[-1] - is_free.size, bool), finite])
    return jnp.where(is_kept, S, 0.0), finite


@eqx.filter_jit
def _information(S, v, shared: int) -> Information:
    """Information on the shared parameters, with the per-record parameters eliminated."""
    count = S.shape[-1] - shared
    triangles = record_triangles(S[..., :count], S[..., count:], v)
    no_prior = jnp.zeros((1, shared + 1))
    is_held = jnp.zeros((v.shape[0], count), bool), jnp.zeros(shared, bool)
    return gather(triangles, no_prior, *is_held)


def _orthogonal_part(columns, rhs, is_free):
    """Return the part of `[columns rhs]` orthogonal to the free columns, and the coefficients of
    the projection on these.
    """
    free, extended = jnp.where(is_free, columns, 0.0), jnp.column_stack([columns, rhs])
    coefficients = _least_squares(free, extended)
    return extended - free @ coefficients, coefficients


def _variance_inflation(S, v, mask, count, is_free, coefficients, information, gain):
    """Return the factor by which autocorrelation of the residual increases each variance.

    The residual of each column is the one left after that column has been fitted to it. The columns
    are computed one after the other to save memory.
    """
    own, shared = S[..., :count], S[..., count:]
    free = jnp.where(is_free, shared, 0.0)
    rotated = jnp.concatenate([information.own.coupling, information.own.rhs[..., None]], axis=-1)
    rotated_free = jnp.where(is_free, information.own.coupling, 0.0)

    def perpendicular(rows, index):
        solution = coefficients[:, index]
        rhs = rotated[..., index] - rotated_free @ solution
        own_part = information.own.inverse @ rhs[..., None]
        return rows - free @ solution - jnp.squeeze(own @ own_part[:, None], -1)

    v_perp = perpendicular(v, is_free.size)

    def inflation(index):
        column = perpendicular(shared[..., index], index)
        return colour_inflation(column, v_perp - gain[index] * column, mask)

    return jax.lax.map(inflation, jnp.arange(is_free.size))


def _least_squares(
    A: Float[Array, "row column"], B: Float[Array, "row rhs"]
) -> Float[Array, "column rhs"]:
    """Return the least-squares solution, computed with columns of unit length.

    Its component along singular vectors with a negligible singular value is zero.
    """
    length = jnp.linalg.norm(A, axis=0)
    length = jnp.where(length > 0, length, 1.0)
    U, s, Vt = jnp.linalg.svd(A / length[None], full_matrices=False)
    strong = s > 1e-10 * jnp.max(s, initial=0.0)
    inverse = jnp.where(strong, 1.0 / jnp.where(strong, s, 1.0), 0.0)
    return (Vt.T @ (inverse[:, None] * (U.T @ B))) / length[:, None]


def critical(probability: float) -> float:
    """Return the chi-square (one degree of freedom) exceeded with the given probability."""
    return NormalDist().inv_cdf(0.5 * probability) ** 2
