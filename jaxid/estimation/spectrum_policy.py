"""Treatment of weak eigenvalues of the information matrix: the report's fixes (section 4.3.1)."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import optimistix as optx

from .._foundation.types import Array, Bool, Float, Int
from ..sensitivity.information import RANK_TOLERANCE
from ..sensitivity.spectrum import Spectrum

# By which the eigenvalues of the scaled information are raised at first (Marquardt 1963).
DAMPING = 1e-2
SPREAD = 1e-10  # the report acts when the spread of the eigenvalues exceeds 1e10 (section 4.4)


class AbstractPolicy(eqx.Module):
    """Weights of the singular directions of the scaled information in a step.

        d = sum_k weight_k (u_k'r) v_k

    All policies solve rather than invert (fix a) and scale the columns first (fix b).

    Attributes:
        threshold: eigenvalues below this share of the largest are weak.
        curved: True if the weights depend on the size of the step; otherwise it scales all alike.
    """

    threshold: eqx.AbstractVar[float]
    curved: ClassVar[bool] = False

    @abc.abstractmethod
    def weights(
        self, spectrum: Spectrum, phase: Int[Array, ""], size: Float[Array, ""] | float = 1.0
    ) -> Float[Array, " parameter"]:
        """Return the weights in a phase of the iteration.

        Args:
            spectrum: spectrum of the information.
            phase: number of steps so far, accepted or abandoned.
            size: share of the full step, which `curved` policies use.
        """

    def search(self) -> optx.AbstractSearch:
        """Return the search that decides on the size of the steps; backtracking by default."""
        return optx.BacktrackingArmijo(slope=1e-4)

    def optional(self, spectrum: Spectrum, phase: Int[Array, ""]) -> Bool[Array, ""]:
        """Return True if a search without descent starts the next phase.

        Otherwise it ends the iteration.
        """
        return jnp.array(False)


class Plain(AbstractPolicy):
    """Fixes a and b only: every direction has its full step."""

    threshold: float = eqx.field(static=True, default=SPREAD)

    def weights(self, spectrum, phase, size=1.0):
        return _inverse(spectrum.singular_values)


class Truncate(AbstractPolicy):
    """Fix c: weak directions have no step (Eq. 4.27)."""

    threshold: float = eqx.field(static=True, default=SPREAD)

    def weights(self, spectrum, phase, size=1.0):
        return jnp.where(spectrum.weak(self.threshold), 0.0, _inverse(spectrum.singular_values))


class Clip(AbstractPolicy):
    """Fix d: weak eigenvalues are raised to the threshold (Eq. 4.29)."""

    threshold: float = eqx.field(static=True, default=SPREAD)

    def weights(self, spectrum, phase, size=1.0):
        s = spectrum.singular_values
        raised = jnp.maximum(s**2, self.threshold * s[0] ** 2)
        return s / jnp.where(raised > 0, raised, 1.0)


class TwoStep(AbstractPolicy):
    """Fix e: steps in the strong directions, then in all weak ones, then in each weak one.

    The first follows Eq. 4.27, the second Eq. 4.30. Every step has its own one-dimensional search.
    The phases repeat in a cycle, so that the search along each weak eigenvector, which the report
    makes once at the end, is repeated as long as there are iterations. A search along weak
    directions without descent is abandoned for the next phase. Directions whose singular value is
    only rounding are not searched: the data hold no information there, and the right-hand side is
    rounding too.
    """

    threshold: float = eqx.field(static=True, default=SPREAD)

    def optional(self, spectrum, phase):
        """Return True if this phase searches weak directions."""
        return self._phase_index(spectrum, phase) > 0

    def _searched(self, spectrum) -> Bool[Array, " parameter"]:
        s = spectrum.singular_values
        return spectrum.weak(self.threshold) & (s > RANK_TOLERANCE * s[0])

    def _phase_index(self, spectrum, phase) -> Int[Array, ""]:
        count = jnp.sum(self._searched(spectrum))
        return jnp.where(count > 0, phase % (2 + count), 0)

    def weights(self, spectrum, phase, size=1.0):
        index, weak = self._phase_index(spectrum, phase), self._searched(spectrum)
        single = jnp.cumsum(weak) == index - 1
        chosen = jnp.where(
            index == 0, ~spectrum.weak(self.threshold), jnp.where(index == 1, weak, weak & single)
        )
        return jnp.where(chosen, _inverse(spectrum.singular_values), 0.0)


class Damp(AbstractPolicy):
    """Damping in place of a fix: the more all eigenvalues are raised, the shorter the step, and the
    more it turns to the steepest descent.

        weight_k = s_k / (s_k^2 + DAMPING / size)

    A trust region decides on the size, which one step leaves to the next.

    Sources: Levenberg, Quarterly of Applied Mathematics 2, 1944; Marquardt, SIAM Journal on Applied
    Mathematics 11, 1963.
    """

    threshold: float = eqx.field(static=True, default=SPREAD)
    curved: ClassVar[bool] = True

    def weights(self, spectrum, phase, size=1.0):
        s = spectrum.singular_values
        return s / (s**2 + DAMPING / size)

    def search(self):
        # ratios of Moré, Lecture Notes in Mathematics 630, 1978; factors of optimistix
        return optx.ClassicalTrustRegion(high_cutoff=0.75, low_cutoff=1e-4)


def _inverse(s: Float[Array, " parameter"]) -> Float[Array, " parameter"]:
    """Return the reciprocals, zero for a column of zeros."""
    return jnp.where(s > 0, 1.0 / jnp.where(s > 0, s, 1.0), 0.0)
