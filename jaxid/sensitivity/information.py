"""Square-root information of records, priors and earlier flights.

The rows `[S_own S_shared v]` of one record, whitened, are decomposed into a triangle. The unknowns
that belong to this record alone (`own`: its initial state, its biases) are eliminated in a block
of their own. The remaining rows hold the information on the shared parameters; the remainders of
all records are stacked and decomposed again. Sign convention: `v = z - y`, `S = dy/dtheta`, so that
the Gauss-Newton step solves `S d = v` in the least-squares sense.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.linalg import stack_factors, triangle
from .._foundation.types import Array, Bool, Float
from .spectrum import SHARE, Spectrum

# Chosen: move of an unknown by one standard error of the shared parameters, over its own standard
# error, below which the move is rounding.
ROUNDED_MOVE = 1e-6

RANK_TOLERANCE = (
    # relative to the largest singular value of a block with columns of unit length; some 500 times
    # the rounding error of float64
    1e-13
)
# Chosen: share of a column's length that may be left by rounding once the own unknowns are
# eliminated. The rounding of simulated sensitivities is below 1e-13; a share of 1e-11 is an
# eigenvalue of 1e-22, which no threshold for weak directions takes as determined.
ELIMINATED = 1e-11

# Rows decomposed at once, and number of such blocks from which a record is divided (chosen).
ROWS_AT_ONCE, LEAST_BLOCKS = 1024, 4


class OwnBlock(eqx.Module):
    """Information of one record on its own unknowns, given the shared ones.

        jacobian d_own = rhs - coupling d_shared

    Directions that the record does not determine have zero rows here; their rows are part of the
    shared information.
    """

    jacobian: Float[Array, "*case own own"]
    coupling: Float[Array, "*case own parameter"]
    rhs: Float[Array, "*case own"]
    inverse: Float[Array, "*case own own"]
    undetermined: Bool[Array, "*case own"]

    def solve(self, d_shared: Float[Array, " parameter"]) -> Float[Array, "*case own"]:
        """Return the step of the own unknowns for a given step of the shared parameters."""
        remainder = self.rhs - self.coupling @ d_shared
        return jnp.squeeze(self.inverse @ remainder[..., None], -1)

    def covariance(
        self, shared: Float[Array, "parameter parameter"], decomposition: Spectrum, threshold: float
    ) -> Float[Array, "*case own own"]:
        """Return the covariance of the record's own unknowns, which includes the covariance of the
        shared ones.

            P_own = A^-1 (I + C P C') A^-T,    A = jacobian, C = coupling, P = shared

        The variance of an unknown that the record does not determine is infinite, and so is the
        variance of one that moves with an undetermined direction of the shared parameters.

        Args:
            shared: covariance of the shared parameters, shape (parameter, parameter).
            decomposition: of their information, for the undetermined directions.
            threshold: eigenvalues below this share of the largest are undetermined [-].
        """
        eye = jnp.eye(self.rhs.shape[-1])[None]
        known = jnp.where(jnp.isfinite(shared), shared, 0.0)
        covariance = (
            self.inverse @ (eye + self.coupling @ known @ self.coupling.mT) @ self.inverse.mT
        )
        lost = self.undetermined
        if shared.size:
            lost = lost | self._moves_with_weak(decomposition, threshold)
        return covariance + jnp.where(lost, jnp.inf, 0.0)[..., None] * eye

    def _moves_with_weak(
        self, decomposition: Spectrum, threshold: float
    ) -> Bool[Array, "*case own"]:
        """Return which unknowns move with an undetermined direction of the shared parameters."""
        moved = self.inverse @ self.coupling
        share = decomposition.weak_share(moved.reshape(-1, moved.shape[-1]), threshold)
        by_shared = jnp.linalg.norm(moved / decomposition.scale[None, None], axis=-1)
        alone = jnp.linalg.norm(self.inverse, axis=-1)
        # Rounding moves an unknown that is independent of the shared parameters.
        return (share.reshape(alone.shape) > SHARE) & (by_shared > ROUNDED_MOVE * alone)

    def joint_covariance(
        self, shared: Float[Array, "parameter parameter"]
    ) -> Float[Array, "*case own unknown"]:
        """Return the covariances of the record's own unknowns with themselves and with the shared
        ones.

        An undetermined unknown counts as known.
        """
        turned = self.inverse @ self.coupling
        own = self.inverse @ self.inverse.mT + turned @ shared @ turned.mT
        return jnp.concatenate([own, -turned @ shared], axis=-1)


def covariance_of_unknowns(
    own: Float[Array, "*case own unknown"], shared: Float[Array, "parameter parameter"]
) -> Float[Array, "*case unknown unknown"]:
    """Return the covariance of each record's own unknowns and the shared parameters.

    Args:
        own: covariances of the own unknowns with themselves, then with the shared parameters.
        shared: covariance of the shared parameters.
    """
    below = jnp.broadcast_to(shared, (*own.shape[:-2], *shared.shape))
    below = jnp.concatenate([own[..., own.shape[-2] :].mT, below], axis=-1)
    return jnp.concatenate([own, below], axis=-2)


class Profile(eqx.Module):
    """Rows `C` by which an estimated noise covariance lowers the curvature: `M - C'C` for M.

    Attributes:
        shared: columns of the shared parameters.
        own: columns of each record's own unknowns.
        count: smallest number of valid samples of a channel.
    """

    shared: Float[Array, "row parameter"]
    own: Float[Array, "*case row own"]
    count: Float[Array, ""]


class Information(eqx.Module):
    """Square-root information of all records: `1/2 |r - T d|^2` for the shared parameters, and a
    block per record.

    Attributes:
        factor: triangle of `[T r]` for the shared parameters, whose last diagonal element is the
            norm of the whitened residual that no parameter explains.
        own: the blocks of the records, stacked.
        profile: correction of the curvature for an estimated noise covariance.
    """

    factor: Float[Array, "column column"]
    own: OwnBlock
    profile: Profile

    @property
    def triangle(self) -> Float[Array, "row parameter"]:
        """`T`: `T'T` is the information matrix of the shared parameters, own unknowns
        eliminated.
        """
        return self.factor[:, :-1]

    @property
    def rhs(self) -> Float[Array, " row"]:
        """`r`: `T'r` is the negative gradient of the cost in the shared parameters, own unknowns at
        their best.
        """
        return self.factor[:, -1]

    def gradient(self) -> tuple[Float[Array, " parameter"], Float[Array, "case own"]]:
        """Gradient of the cost (4.17) in the shared parameters and in each record's own."""
        own = jnp.einsum("cij,ci->cj", self.own.jacobian, self.own.rhs)
        shared = self.triangle.T @ self.rhs + jnp.einsum(
            "cij,ci->j", self.own.coupling, self.own.rhs
        )
        return -shared, -own

    def apply(
        self, d_shared: Float[Array, " parameter"], d_own: Float[Array, "case own"]
    ) -> tuple[Float[Array, " parameter"], Float[Array, "case own"]]:
        """The information matrix (4.18) times a step."""
        by_record = (
            jnp.einsum("cij,cj->ci", self.own.jacobian, d_own) + self.own.coupling @ d_shared
        )
        shared = self.triangle.T @ (self.triangle @ d_shared) + jnp.einsum(
            "cij,ci->j", self.own.coupling, by_record
        )
        return shared, jnp.einsum("cij,ci->cj", self.own.jacobian, by_record)


def record_triangles(
    own: Float[Array, "case time output own"],
    shared: Float[Array, "case time output parameter"],
    v: Float[Array, "case time output"],
) -> Float[Array, "case column column"]:
    """Triangles of `[S_own S_shared v]`, record by record.

    Args:
        own: whitened sensitivities to each record's own unknowns.
        shared: whitened sensitivities to the shared parameters.
        v: whitened residuals.
    """
    return jax.vmap(_record_triangle)((own, shared, v[..., None]))


def _record_triangle(columns: tuple[Float[Array, "time output column"], ...]):
    """Return the triangle of one record, by blocks of samples that fit the processor's cache."""
    samples, n_rows = columns[0].shape[:2]
    size = max(ROWS_AT_ONCE // n_rows, 1)
    count = samples // size

    def rows(columns):
        joined = jnp.concatenate(columns, axis=-1)
        return joined.reshape(-1, joined.shape[-1])

    if count < LEAST_BLOCKS:
        return triangle(rows(columns))

    def add(factor, index):
        block = [jax.lax.dynamic_slice_in_dim(leaf, index * size, size) for leaf in columns]
        return triangle(jnp.concatenate([factor, rows(block)])), None

    rest = triangle(rows([leaf[count * size :] for leaf in columns]))
    return jax.lax.scan(add, rest, jnp.arange(count))[0]


def gather(
    triangles: Float[Array, "case column column"],
    extra: Float[Array, "row shared_column"],
    fixed_own: Bool[Array, "case own"],
    fixed_shared: Bool[Array, " parameter"],
    profile_rows: Float[Array, "case channel free"] | None = None,
    count: Float[Array, ""] | None = None,
) -> Information:
    """Eliminate the own unknowns of each record and sum the remaining information.

    Args:
        triangles: from `record_triangles`.
        extra: further rows `[T r]` on the shared parameters: a prior, an earlier flight.
        fixed_own, fixed_shared: unknowns that may not move now (they stand on a bound), whose
            columns are left out.
        profile_rows: from `AbstractNoise.profile_rows`; none by default.
        count: smallest number of valid samples of a channel, for `profile_rows`.
    """
    n_own = fixed_own.shape[1]
    if profile_rows is None:
        profile_rows = jnp.zeros((triangles.shape[0], 0, triangles.shape[-1] - 1))
    profile = Profile(
        jnp.sum(profile_rows[..., n_own:], axis=0) * ~fixed_shared[None],
        profile_rows[..., :n_own] * ~fixed_own[:, None],
        jnp.zeros(()) if count is None else count,
    )
    keep = jnp.concatenate([~fixed_shared, jnp.array([True])])
    own, remainders = jax.vmap(lambda factor, fixed: _eliminate(factor, fixed, keep, n_own))(
        triangles, fixed_own
    )
    factor = stack_factors(remainders)
    return Information(triangle(jnp.concatenate([factor, extra * keep[None]])), own, profile)


def _eliminate(factor, fixed, keep, count):
    """Return the block of one record and the remaining rows on the shared parameters."""
    jacobian = jnp.where(fixed[None], 0.0, factor[:count, :count])
    top, remainder = factor[:count, count:] * keep[None], factor[count:, count:] * keep[None]
    length = jnp.linalg.norm(jacobian, axis=0)
    scale = jnp.where(length > 0, length, 1.0)
    U, s, Vt = jnp.linalg.svd(jacobian / scale[None])
    strong = s > RANK_TOLERANCE * jnp.max(s, initial=0.0)
    rotated = U.T @ top
    inverse = (Vt.T / scale[:, None]) * jnp.where(strong, 1.0 / jnp.where(strong, s, 1.0), 0.0)[
        None
    ]
    own_rows = jnp.where(strong[:, None], rotated, 0.0)
    undetermined = jnp.any(~strong[:, None] & (jnp.abs(Vt) > 1e-3), axis=0)
    own = jnp.where(strong, s, 0.0)[:, None] * Vt * scale[None]
    block = OwnBlock(own, own_rows[:, :-1], own_rows[:, -1], inverse, undetermined)
    return block, _without_rounding(
        jnp.concatenate([remainder, rotated - own_rows]), jnp.linalg.norm(factor[:, count:], axis=0)
    )


def _without_rounding(remainder, before):
    """Return the remaining rows with zeros in the columns that hold only rounding.

    A parameter with the effect of an own unknown, such as the offset of a sensor of a place whose
    start is free, has no information left. Scaled to unit length, as the spectrum scales its
    columns, its rounding would count as a well-determined direction.

    Args:
        remainder: rows `[T r]` on the shared parameters, own unknowns eliminated.
        before: lengths of the columns before the elimination.
    """
    left = jnp.linalg.norm(remainder[:, :-1], axis=0) > ELIMINATED * before[:-1]
    return remainder * jnp.append(left, True)[None]
