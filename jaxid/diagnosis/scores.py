"""The score test: how much of the residual each absent effect could explain, beyond what the free parameters already do.

With `S_phi` the sensitivities to the absent gains at zero, `S_perp` what is left of them when the columns of all free parameters,
each record's own included, are projected out with the weight `R^-1`,

    score = (S_perp' R^-1 v)^2 / (S_perp' R^-1 S_perp),    phi = S_perp' R^-1 v / (S_perp' R^-1 S_perp)

are chi-square with one degree of freedom where the effect is absent and the residual white, and the gain to expect (Rao 1948).
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.types import Array, Bool, Float
from ..estimation.coloured import colour_inflation
from ..estimation.problem import Problem
from ..models.free import Parameters
from ..sensitivity.information import Information, gather, record_triangles

LEFT_OVER = (
    1e-8  # of a column's squared length: less than this is rounding, and the effect cannot be told from what is free
)


class Scores(eqx.Module):
    """Scores of all columns at once; those of columns that are free are zero.

    Attributes:
        score: chi-square with one degree of freedom, were the residual white.
        inflation: by how much the colour of the residual, the column's own share taken out, inflates the score's variance.
        expected: the gain to expect.
        left: share of the column's squared length that the free parameters cannot imitate; NaN where the column is not finite,
            which then has no score and does the others no harm.
        overlap: correlations between the columns' left-over parts.
    """

    score: Float[Array, " column"]
    inflation: Float[Array, " column"]
    expected: Float[Array, " column"]
    left: Float[Array, " column"]
    overlap: Float[Array, "column column"]

    @property
    def significance(self) -> Float[Array, " column"]:
        """Chi-square with one degree of freedom, the colour of the residual accounted for."""
        return self.score / self.inflation


@eqx.filter_jit
def sensitivities(
    problem: Problem, parameters: Parameters
) -> tuple[Float[Array, "case time output"], Float[Array, "case time output column"]]:
    """Residuals and sensitivities, each record's own unknowns in the first columns: the one pass that all questions share."""
    return problem.sensitivities(parameters)


@eqx.filter_jit
def whitened(
    problem: Problem, v: Float[Array, "case time output"], S: Float[Array, "case time output column"]
) -> tuple[Float[Array, "case time output"], Float[Array, "case time output column"]]:
    """The same in units of the noise."""
    return problem.whiten(v, v), problem.whiten(v, S)


@eqx.filter_jit
def scores_of(
    v: Float[Array, "case time output"], S: Float[Array, "case time output column"], is_free: Bool[Array, " shared"]
) -> Scores:
    """The score test of columns that are there already.

    Args:
        v, S: residuals and sensitivities whose noise is white with variance one, as `whitened` gives them.
        is_free: of the last columns of S, the shared ones, which are free.
    """
    count = S.shape[-1] - is_free.size
    S, finite = _finite(S, is_free)
    information = _information(S, v, is_free.size)
    columns, rhs = information.triangle, information.rhs
    rest, coefficients = _perpendicular(columns, rhs, is_free)
    left, toward = jnp.sum(rest[:, :-1] ** 2, axis=0), rest[:, :-1].T @ rest[:, -1]
    whole = jnp.sum(columns**2, axis=0)
    seen = (left > LEFT_OVER * whole) & (left > 0) & ~is_free
    safe = jnp.where(seen, left, 1.0)
    expected = jnp.where(seen, toward / safe, 0.0)
    inflation = _inflation(S, v, count, is_free, coefficients, information, expected)
    length = jnp.sqrt(safe)
    overlap = jnp.where(
        seen[:, None] & seen[None], rest[:, :-1].T @ rest[:, :-1] / (length[:, None] * length[None]), 0.0
    )
    share = jnp.where(seen, left / jnp.where(whole > 0, whole, 1.0), 0.0)
    share = jnp.where(finite, share, jnp.nan)
    return Scores(jnp.where(seen, toward**2 / safe, 0.0), jnp.where(seen, inflation, 1.0), expected, share, overlap)


@eqx.filter_jit
def left_over(
    v: Float[Array, "case time output"], S: Float[Array, "case time output column"], shared: int
) -> Float[Array, ""]:
    """Chi-square that no value of any column takes away.

    Args:
        v, S: as `scores_of` takes them.
        shared: how many of the last columns are shared by all records.
    """
    information = _information(S, v, shared)
    rest, _ = _perpendicular(information.triangle, information.rhs, jnp.ones(shared, bool))
    return jnp.sum(rest[:, -1] ** 2)


def exchange_falls(
    v: Float[Array, "case time output"],
    S: Float[Array, "case time output column"],
    is_free: Bool[Array, " shared"],
    out: Bool[Array, "set shared"],
    values: Float[Array, " shared"],
) -> Float[Array, "set shared"]:
    """By how much chi-square falls with each column in the place of a set of free ones, as far as the linear model tells.

    Without the columns that go out, whose values were phi, the residual is `v + S_out phi`.

    Args:
        v, S, is_free: as `scores_of` takes them, where the free columns have been estimated.
        out: which columns go out, in each set.
        values: of the shared columns.

    Returns:
        Falls; minus infinity where a column is free or no effect of its own.
    """
    information = _information(_finite(S, is_free)[0], v, is_free.size)
    return jnp.stack([_exchange_fall(information.triangle, information.rhs, is_free, one, values) for one in out])


@eqx.filter_jit
def _exchange_fall(columns, rhs, is_free, out, values) -> Float[Array, " shared"]:
    """The same for one set."""
    rest, _ = _perpendicular(columns, rhs + columns @ jnp.where(out, values, 0.0), is_free & ~out)
    left, toward = jnp.sum(rest[:, :-1] ** 2, axis=0), rest[:, :-1].T @ rest[:, -1]
    seen = (left > LEFT_OVER * jnp.sum(columns**2, axis=0)) & (left > 0) & ~is_free
    score = jnp.where(seen, toward**2 / jnp.where(seen, left, 1.0), -jnp.inf)
    return jnp.sum(rhs**2) - jnp.sum(rest[:, -1] ** 2) + score


@eqx.filter_jit
def _finite(S, is_free):
    """The columns with zeros in the place of those that are asked about and not finite, and which are."""
    finite = jnp.all(jnp.isfinite(S[..., S.shape[-1] - is_free.size :]), axis=(0, 1, 2)) | is_free
    kept = jnp.concatenate([jnp.ones(S.shape[-1] - is_free.size, bool), finite])
    return jnp.where(kept, S, 0.0), finite


@eqx.filter_jit
def _information(S, v, shared: int) -> Information:
    """All columns and the residual, each record's own unknowns eliminated."""
    count = S.shape[-1] - shared
    triangles = record_triangles(S[..., :count], S[..., count:], v)
    nothing = jnp.zeros((1, shared + 1))
    return gather(triangles, nothing, jnp.zeros((v.shape[0], count), bool), jnp.zeros(shared, bool))


def _perpendicular(columns, rhs, is_free):
    """What the free columns leave of all columns and, last, of a right-hand side; and with which coefficients."""
    free, both = jnp.where(is_free, columns, 0.0), jnp.column_stack([columns, rhs])
    coefficients = _least_squares(free, both)
    return both - free @ coefficients, coefficients


def _inflation(S, v, count, is_free, coefficients, information, expected):
    """Variance of each score relative to white noise, from the residual without the column's share; column by column, to
    keep memory small."""
    own, shared = S[..., :count], S[..., count:]
    free = jnp.where(is_free, shared, 0.0)
    turned = jnp.concatenate([information.own.coupling, information.own.rhs[..., None]], axis=-1)
    turned_free = jnp.where(is_free, information.own.coupling, 0.0)

    def perpendicular(rows, index):
        solution = coefficients[:, index]
        mine = information.own.inverse @ (turned[..., index] - turned_free @ solution)[..., None]
        return rows - free @ solution - jnp.squeeze(own @ mine[:, None], -1)

    v_perp = perpendicular(v, is_free.size)

    def one(index):
        column = perpendicular(shared[..., index], index)
        return colour_inflation(column, v_perp - expected[index] * column)

    return jax.lax.map(one, jnp.arange(is_free.size))


def _least_squares(A: Float[Array, "row column"], B: Float[Array, "row rhs"]) -> Float[Array, "column rhs"]:
    """Least squares with columns scaled and undetermined directions left at zero."""
    length = jnp.linalg.norm(A, axis=0)
    length = jnp.where(length > 0, length, 1.0)
    U, s, Vt = jnp.linalg.svd(A / length[None], full_matrices=False)
    strong = s > 1e-10 * jnp.max(s, initial=0.0)
    inverse = jnp.where(strong, 1.0 / jnp.where(strong, s, 1.0), 0.0)
    return (Vt.T @ (inverse[:, None] * (U.T @ B))) / length[:, None]


def critical(probability: float) -> float:
    """The chi-square with one degree of freedom that is exceeded with the given probability."""
    return float(jax.scipy.special.ndtri(0.5 * probability) ** 2)
