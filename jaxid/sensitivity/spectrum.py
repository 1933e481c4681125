"""Spectrum of the information: combinations of parameters that the data do or do not determine."""

from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.host import on_host
from .._foundation.types import Array, Bool, Float, Int, Numbers


class Spectrum(eqx.Module):
    """Singular values of the column-scaled triangle; squared, they are the eigenvalues of M* (Eq.
    4.26).

    Attributes:
        singular_values: in falling order.
        directions: one right singular vector per row, in scaled parameters.
        scale: column lengths `sqrt(M_ii)` (Eq. 4.25), or the inverse of the given typical sizes.
        turned: the right-hand side in the basis of left singular vectors.
    """

    singular_values: Float[Array, " parameter"]
    directions: Float[Array, "parameter parameter"]
    scale: Float[Array, " parameter"]
    turned: Float[Array, " parameter"]

    @property
    def eigenvalues(self) -> Float[Array, " parameter"]:
        """Eigenvalues of the scaled information matrix, in falling order."""
        return self.singular_values**2

    def weak(self, threshold: float) -> Bool[Array, " parameter"]:
        """Which directions have an eigenvalue of at most `threshold` times the largest (Eq. 4.28);
        all, where all eigenvalues are zero.
        """
        return _is_weak(self.singular_values, threshold=threshold)

    def step(self, weights: Float[Array, " parameter"]) -> Float[Array, " parameter"]:
        """Return the step whose component along each scaled direction is `weights * turned`."""
        return (self.directions.T @ (weights * self.turned)) / self.scale

    def covariance(self, threshold: float) -> Float[Array, "parameter parameter"]:
        """Inverse of the information over the strong directions (Cramer-Rao).

        A parameter with a share in a weak direction has an infinite variance, and so has one with a
        column of zeros.
        """
        half = self.square_root(threshold)
        strong = ~self.weak(threshold)
        undetermined = jnp.any(~strong[:, None] & (jnp.abs(self.directions) > SHARE), axis=0)
        covariance = half @ half.T
        return covariance + jnp.diag(jnp.where(undetermined, jnp.inf, 0.0))

    def square_root(self, threshold: float) -> Float[Array, "parameter parameter"]:
        """Return `H` with `H H'` the inverse of the information over the strong directions.

        A weak direction has a column of zeros.
        """
        strong = ~self.weak(threshold)
        inverse = jnp.where(strong, 1.0 / jnp.where(strong, self.singular_values, 1.0), 0.0)
        return self.directions.T / self.scale[:, None] * inverse[None]

    def weak_share(
        self, gradient: Float[Array, "function parameter"], threshold: float
    ) -> Float[Array, " function"]:
        """Return the share of a function's gradient that lies in the weak directions, 0 to 1.

        Args:
            gradient: derivative of the function by the parameters.
            threshold: eigenvalues below this share of the largest are weak.
        """
        scaled = gradient / self.scale[None]
        length = jnp.linalg.norm(scaled, axis=-1)
        weak = (scaled @ self.directions.T) * self.weak(threshold)[None]
        return jnp.linalg.norm(weak, axis=-1) / jnp.where(length > 0, length, 1.0)


@on_host
def _is_weak(xp, singular_values, threshold: float):
    """True for eigenvalues of at most `threshold` times the largest."""
    eigenvalues = xp.square(singular_values)
    return eigenvalues <= threshold * eigenvalues[:1]


# a share in a weak direction below this is rounding of the singular vectors, not participation
SHARE = 1e-3


def spectrum(
    triangle: Float[Numbers, "row parameter"],
    rhs: Float[Numbers, " row"],
    scale: Float[Numbers, " parameter"] | None = None,
) -> Spectrum:
    """Decompose a triangle `T` with its right-hand side after scaling its columns (fixes a and b of
    section 4.3.1).

    Args:
        triangle: square-root information `T`.
        rhs: right-hand side `r`.
        scale: typical sizes of the parameters, NaN where the column's own length serves; None for
            all.
    """
    return Spectrum(*_decompose(triangle, rhs, scale))


@on_host
def _decompose(xp, triangle, rhs, scale):
    """Return the fields of a `Spectrum`; NaN where the triangle is not finite."""
    length = xp.linalg.norm(triangle, axis=0)
    length = xp.where(length > 0, length, 1.0)
    if scale is not None:
        # Where only some have a size, these are brought to the length of the others, one.
        given = ~xp.isnan(scale)
        largest = xp.max(xp.where(given, length * scale, 0.0), initial=0.0)
        largest = xp.where(xp.all(given) | (largest == 0), 1.0, largest)
        length = xp.where(given, largest / scale, length)
    scaled = triangle / length[None]
    if xp is np and not np.all(np.isfinite(scaled)):  # NumPy raises an error, JAX returns NaN
        count = min(scaled.shape)
        nan = np.full((count, scaled.shape[1] + 1), np.nan)
        return nan[:, 0], nan[:, 1:], length, nan[:, 0]
    U, s, Vt = xp.linalg.svd(scaled, full_matrices=False)
    return s, Vt, length, U.T @ rhs


def weak_directions(
    names: tuple[str, ...],
    values: Float[np.ndarray, " parameter"],
    decomposition: Spectrum,
    threshold: float,
    share: float = 0.05,
) -> tuple[str, ...]:
    """Undetermined combinations in words, such as `a - 2.1 b is not determined`.

    Args:
        names: names of the parameters.
        values: their values; a combination is written in units of the parameters themselves.
        decomposition: the spectrum.
        threshold: eigenvalues below this share of the largest are weak.
        share: components smaller than this share of the largest are left out of the sentence.

    Returns:
        One sentence per weak direction, with the best determined combination of the same parameters
        added.
    """
    sentences = []
    for direction, kept in weak_components(decomposition, threshold, share):
        components = direction[kept] / np.asarray(decomposition.scale)[kept]
        together = [names[i] for i in kept]
        weak = _combination(together, components / components[0])
        if len(kept) == 1:
            sentences.append(f"{names[kept[0]]} is not determined")
        elif len(kept) == 2:
            # The determined combination is the one that does not change along the weak direction.
            strong = _combination(together, np.array([1.0, -components[0] / components[1]]))
            sentences.append(f"{strong} is determined, {weak} is not")
        else:
            sentences.append(f"{weak} is not determined")
    return tuple(sentences)


def weak_components(
    decomposition: Spectrum, threshold: float, share: float = 0.05
) -> Iterator[tuple[Float[np.ndarray, " parameter"], Int[np.ndarray, " n"]]]:
    """Yield the weak directions, each with the positions of the parameters that `weak_directions`
    names.

    Args:
        decomposition: the spectrum.
        threshold: eigenvalues below this share of the largest are weak.
        share: components smaller than this share of the largest are left out.
    """
    for index in np.flatnonzero(np.asarray(decomposition.weak(threshold))):
        direction = np.asarray(decomposition.directions[index])
        yield direction, np.flatnonzero(np.abs(direction) >= share * np.max(np.abs(direction)))


def _combination(names: list[str], weights: Float[np.ndarray, " n"]) -> str:
    """A linear combination in words: `k + 0.93 c`."""
    words = names[0]
    for name, weight in zip(names[1:], weights[1:], strict=True):
        words += f" {'-' if weight < 0 else '+'} {abs(weight):.3g} {name}"
    return words
