"""`SpectrumDescent`: the Gauss-Newton step within the bounds."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optimistix as optx

from .._foundation.types import Array, Bool, Float, Int
from ..models.free import Parameters
from ..sensitivity.information import Information
from ..sensitivity.spectrum import Spectrum, spectrum
from .spectrum_policy import AbstractPolicy

# Largest share of the curvature along any direction that the estimated noise covariance may take
# away (chosen): far from the minimum the second derivative of the cost is not positive.
LARGEST_PROFILE = 0.9
# Square of the length of a step, as a share of the number of samples, up to which the cost of an
# estimated noise covariance is nearly quadratic (chosen).
PROFILE_RANGE = 0.1


def profiled_step(
    information: Information, svd: Spectrum, weights: Float[Array, " parameter"]
) -> Parameters:
    """Return the step of shared and own parameters, with the curvature of an estimated R.

        d = (M - C'C)^-1 b = d_0 + P C' (I - C P C')^-1 C d_0,    d_0 = P b,    P = M^-1

    With R re-estimated at each step, `d_0` alone converges linearly, the more slowly the
    more the gradients of single channels differ at the minimum, where only their sum is zero. Along
    weak directions P follows the policy.

    Args:
        information: information with its `profile` C.
        svd: spectrum of the shared triangle.
        weights: weights of the policy.
    """
    own, profile = information.own, information.profile
    inverse = jnp.where(svd.singular_values > 0, 1.0 / svd.singular_values, 0.0)

    def solve(shared, rows):
        """Apply P to a vector of the shared and own parameters."""
        local = jnp.einsum("coi,co->ci", own.inverse, rows)
        reduced = shared - jnp.einsum("cip,ci->p", own.coupling, local)
        turned = inverse * (svd.directions @ (reduced / svd.scale))
        d_shared = (svd.directions.T @ (weights * turned)) / svd.scale
        return d_shared, jnp.einsum("coi,ci->co", own.inverse, local - own.coupling @ d_shared)

    step = svd.step(weights)
    step = Parameters(step, own.solve(step))
    if not profile.shared.shape[0]:
        return step
    images = jax.vmap(solve, in_axes=(0, 1))(profile.shared, profile.own)

    def products(shared, rows):
        return profile.shared @ shared + jnp.einsum("cko,co->k", profile.own, rows)

    share = jax.vmap(products, out_axes=1)(*images)
    values, vectors = jnp.linalg.eigh((share + share.T) / 2)
    length = jnp.sum(own.rhs**2) + jnp.sum((weights > 0) * svd.turned**2)
    is_near = length < PROFILE_RANGE * profile.count
    remaining = 1.0 - jnp.where(is_near, jnp.clip(values, 0.0, LARGEST_PROFILE), 0.0)
    projected = vectors.T @ products(step.shared, step.rows)
    amounts = is_near * (vectors @ (projected / remaining))
    return Parameters(
        step.shared + amounts @ images[0],
        step.rows + jnp.einsum("k,kco->co", amounts, images[1]),
    )


class DescentState(NamedTuple):
    """A direction, and the one that may replace it.

    Attributes:
        direction: the full step.
        phase: number of directions so far.
        optional: True if a search along it without descent only ends its phase.
        clipped, has_other: the step clipped at the bounds, and whether it is another one.
        begin: shared parameters and information at its begin, for a policy with a curved step; else
            None.
    """

    direction: Parameters
    phase: Int[Array, ""]
    optional: Bool[Array, ""]
    clipped: Float[Array, " parameter"]
    has_other: Bool[Array, ""]
    begin: tuple[Float[Array, " parameter"], Information] | None


class SpectrumDescent(optx.AbstractDescent):
    """Gauss-Newton step within the bounds, under a policy for weak eigenvalues.

    A step that is clipped at a bound can increase the cost, because the other parameters move as if
    it were not clipped. So the first shared parameter that reaches its bound is fixed there, the
    step of the others is recomputed, and so on (the primal active-set method: Nocedal & Wright,
    Numerical Optimization, 2006, section 16.5). Each record's own parameters are clipped. Where the
    cost has a corner, no part of this step may lower it; then the clipped step is tried (`turn`).

    Args:
        policy: the treatment of weak directions.
        scale: typical sizes of the shared parameters, NaN for scaling by the sensitivity.
        lower, upper: bounds of the shared parameters, infinite where there are none.
    """

    policy: AbstractPolicy
    scale: Float[Array, " parameter"]
    lower: Float[Array, " parameter"]
    upper: Float[Array, " parameter"]

    def init(self, y, f_info_struct):
        no = jnp.array(False)
        return DescentState(y, jnp.array(0), no, y.shared, no, self._begin(y, f_info_struct))

    def query(self, y, f_info, state):
        phase = state.phase
        information: Information = f_info.information
        begin = self._begin(y, f_info)
        if not self.scale.size:
            nothing, no = jnp.zeros(0), jnp.array(False)
            direction = Parameters(nothing, information.own.solve(nothing))
            return DescentState(direction, phase + 1, no, nothing, no, begin)
        svd = spectrum(information.triangle, information.rhs, self.scale)
        full_step, shared, direction = self._direction(y.shared, information, svd, phase, 1.0)
        clipped = jnp.clip(full_step.shared, self.lower - y.shared, self.upper - y.shared)
        # a curved step turns as it shortens, and needs no other direction at a corner
        has_other = jnp.any(clipped != shared) & (not self.policy.curved)
        optional = self.policy.optional(svd, phase)
        return DescentState(direction, phase + 1, optional, clipped, has_other, begin)

    def _begin(self, y: Parameters, f_info):
        return (y.shared, f_info.information) if self.policy.curved else None

    def _direction(self, values, information: Information, svd: Spectrum, phase, size):
        """Return the step without bounds, its shared part within them, and the step within them."""

        def weights(svd):
            return self.policy.weights(svd, phase, size)

        full_step = profiled_step(information, svd, weights(svd))
        shared = self._within_bounds(values, full_step.shared, information, weights)
        inside = jnp.all(shared == full_step.shared)
        rows = jnp.where(inside, full_step.rows, information.own.solve(shared))
        return full_step, shared, Parameters(shared, rows)

    def turn(self, f_info, state):
        """Return the state with the clipped step as its direction."""
        direction = Parameters(state.clipped, f_info.information.own.solve(state.clipped))
        return state._replace(direction=direction, has_other=jnp.array(False))

    def _within_bounds(
        self,
        values: Float[Array, " parameter"],
        full_step: Float[Array, " parameter"],
        information: Information,
        weights: Callable[[Spectrum], Array],
    ) -> Float[Array, " parameter"]:
        """Return the step that respects the bounds, from the unconstrained one."""
        low, high = self.lower - values, self.upper - values

        def crosses(state):
            target, _, blocked = state
            return jnp.any(~blocked & ((target < low) | (target > high)))

        def block(state):
            target, step, blocked = state
            move = jnp.where(blocked, 0.0, target - step)
            room = jnp.where(move < 0, low - step, high - step)
            beyond = ~blocked & ((target < low) | (target > high))
            share = jnp.where(beyond, room / jnp.where(beyond, move, 1.0), jnp.inf)
            first = jnp.argmin(share)
            step = step + jnp.clip(share[first], 0.0, 1.0) * move
            step = step.at[first].set(jnp.where(move < 0, low, high)[first])
            blocked = blocked.at[first].set(True)
            fixed = jnp.where(blocked, step, 0.0)
            columns = jnp.where(blocked[None], 0.0, information.triangle)
            svd = spectrum(columns, information.rhs - information.triangle @ fixed, self.scale)
            target = jnp.where(blocked, step, svd.step(weights(svd)))
            return target, step, blocked

        initial = (full_step, jnp.zeros_like(full_step), jnp.zeros(full_step.shape, bool))
        return jax.lax.while_loop(crosses, block, initial)[0]

    def decrement(self, information: Information) -> Float[Array, ""]:
        """Return the length of the full Gauss-Newton step [standard errors].

        Weak shared directions do not count.
        """
        own = jnp.sum(information.own.rhs**2)
        if not self.scale.size:
            return jnp.sqrt(own)
        svd = spectrum(information.triangle, information.rhs, self.scale)
        return jnp.sqrt(
            own + jnp.sum(jnp.where(svd.weak(self.policy.threshold), 0.0, svd.turned) ** 2)
        )

    def step(self, step_size, state):
        if self.policy.curved and self.scale.size:
            values, information = state.begin
            svd = spectrum(information.triangle, information.rhs, self.scale)
            *_, step = self._direction(values, information, svd, state.phase, step_size)
        else:
            step = jax.tree.map(lambda leaf: step_size * leaf, state.direction)
        return step, optx.RESULTS.successful
