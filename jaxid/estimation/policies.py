"""What to do with weak eigenvalues of the information matrix: the report's fixes (section 4.3.1) as small objects."""

import abc

import equinox as eqx
import jax.numpy as jnp

from .._foundation.types import Array, Bool, Float, Int
from ..sensitivity.information import RANK_TOLERANCE
from ..sensitivity.spectrum import Spectrum

SPREAD = 1e-10  # the report acts when the spread of the eigenvalues exceeds 1e10 (section 4.4)


class AbstractPolicy(eqx.Module):
    """Weights of the singular directions of the scaled information in a step: `d = sum_k weight_k (u_k'r) v_k`.

    All policies solve rather than invert (fix a) and scale the columns first (fix b).

    Attributes:
        threshold: eigenvalues below this share of the largest are weak.
    """

    threshold: eqx.AbstractVar[float]

    @abc.abstractmethod
    def weights(self, spectrum: Spectrum, phase: Int[Array, ""]) -> Float[Array, " parameter"]:
        """The weights, in the given phase of the iteration (it counts steps, accepted or given up)."""

    def optional(self, spectrum: Spectrum, phase: Int[Array, ""]) -> Bool[Array, ""]:
        """Whether a fruitless search in this phase goes on with the next one instead of ending the iteration."""
        return jnp.array(False)


class Plain(AbstractPolicy):
    """Fixes a and b only: every direction is followed all the way."""

    threshold: float = eqx.field(static=True, default=SPREAD)

    def weights(self, spectrum, phase):
        return _inverse(spectrum.singular_values)


class Truncate(AbstractPolicy):
    """Fix c: weak directions are not followed (Eq. 4.27)."""

    threshold: float = eqx.field(static=True, default=SPREAD)

    def weights(self, spectrum, phase):
        return jnp.where(spectrum.weak(self.threshold), 0.0, _inverse(spectrum.singular_values))


class Clip(AbstractPolicy):
    """Fix d: weak eigenvalues are raised to the threshold (Eq. 4.29)."""

    threshold: float = eqx.field(static=True, default=SPREAD)

    def weights(self, spectrum, phase):
        s = spectrum.singular_values
        raised = jnp.maximum(s**2, self.threshold * s[0] ** 2)
        return s / jnp.where(raised > 0, raised, 1.0)


class TwoStep(AbstractPolicy):
    """Fix e: a step in the strong directions (Eq. 4.27), then one in the weak (Eq. 4.30), then each weak one by itself.

    Every step has its own one-dimensional search. The phases follow each other and begin again, so that the search
    along each weak eigenvector, which the report makes at the end, is made as often as there are iterations for it.
    A search that finds nothing along weak directions is given up for the next phase. Directions of mere rounding are
    not searched: there the data say nothing, and the right-hand side is rounding too.
    """

    threshold: float = eqx.field(static=True, default=SPREAD)

    def optional(self, spectrum, phase):
        """True where this phase searches weak directions."""
        return self._turn(spectrum, phase) > 0

    def _followed(self, spectrum) -> Bool[Array, " parameter"]:
        s = spectrum.singular_values
        return spectrum.weak(self.threshold) & (s > RANK_TOLERANCE * s[0])

    def _turn(self, spectrum, phase) -> Int[Array, ""]:
        count = jnp.sum(self._followed(spectrum))
        return jnp.where(count > 0, phase % (2 + count), 0)

    def weights(self, spectrum, phase):
        turn, weak = self._turn(spectrum, phase), self._followed(spectrum)
        single = jnp.cumsum(weak) == turn - 1
        chosen = jnp.where(turn == 0, ~spectrum.weak(self.threshold), jnp.where(turn == 1, weak, weak & single))
        return jnp.where(chosen, _inverse(spectrum.singular_values), 0.0)


def _inverse(s: Float[Array, " parameter"]) -> Float[Array, " parameter"]:
    """Reciprocals, zero for a column that is switched off."""
    return jnp.where(s > 0, 1.0 / jnp.where(s > 0, s, 1.0), 0.0)
