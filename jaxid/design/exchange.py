"""Optimal allocation of an effort to candidate experiments, by the exchange algorithm.

Each candidate adds `weight * rows' rows` to the information. A convex measure has its minimum where
no candidate is worth more than the design in the mean (Kiefer & Wolfowitz; Theorem C.1 of the
report), which gives the certificate

    max_i phi_i / sum_j w_j phi_j        (at least 1, and 1 at the optimum)

A step moves weight from the least useful point of the design to the most useful candidate (step
(c) and (d) of C.4.2.2 and C.2.1), then multiplies each weight by a power of its usefulness.

Sources: D. Boehning, A vertex-exchange method in D-optimal design theory, Metrika 33, 1986; Y. Yu,
D-optimal designs via a cocktail algorithm, Statistics and Computing 21, 2011.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.checks import require
from .._foundation.types import Array, Float, Int
from .measures import AbstractMeasure

# Points of one line search, and its repetitions, each on the interval around the best (chosen):
# 33 points and 4 repetitions determine a weight to 1e-5 of itself.
LINE_POINTS, LINE_ZOOMS = 33, 4
# Multiplicative steps per exchange (chosen), and their power: monotone for the trace at 1/2 and for
# the determinant up to 1 (Yu, Annals of Statistics 38, 2010).
MULTIPLICATIVE_STEPS, POWER = 10, 0.5
NEGLIGIBLE = 1e-7  # a weight below it is no point of a design (chosen)


class Allocation(eqx.Module):
    """Weights of candidates with the certificate of their optimality.

    Attributes:
        weights: share of the effort of each candidate; their sum is one.
        gains: usefulness phi of each candidate at this design.
        cost: value of the measure.
        certificate: largest usefulness over the mean of the design, 1 at the optimum. A trace or
            combination is within this factor of its optimum.
        steps: number of exchanges.
    """

    weights: Float[Array, " candidate"]
    gains: Float[Array, " candidate"]
    cost: Float[Array, ""]
    certificate: Float[Array, ""]
    steps: Int[Array, ""]


def allocate(
    rows: Float[Array, "candidate sample parameter"],
    measure: AbstractMeasure,
    *,
    earlier: Float[Array, "earlier_row parameter"] | None = None,
    tolerance: float = 1e-4,
    max_steps: int = 2000,
) -> Allocation:
    """Return the optimal weights of candidate experiments.

    Args:
        rows: whitened sensitivities of each candidate for the whole effort.
        measure: the measure to be minimised.
        earlier: factor of information that is there already; none by default.
        tolerance: the exchange stops at a certificate below `1 + tolerance`.
        max_steps: limit of the number of exchanges.

    Raises:
        InputError: when all candidates together do not determine the parameters.
    """
    width = rows.shape[-1]
    earlier = jnp.zeros((0, width)) if earlier is None else earlier
    scale = jnp.sqrt(jnp.sum(rows**2, axis=(0, 1)) + jnp.sum(earlier**2, axis=0))
    every = jnp.concatenate([rows.reshape(-1, width), earlier])
    strength = jnp.linalg.svd(every / jnp.where(scale > 0, scale, 1.0)[None], compute_uv=False)
    require(
        bool(strength[-1] > 1e-12 * strength[0]) and strength.size == width,
        "The candidates together do not determine all parameters. Add candidates, fix a "
        "parameter, or give earlier information.",
    )
    slots = min(rows.shape[0], width * (width + 1) // 2 + 2 * width + 8)
    start = jnp.linspace(0, rows.shape[0] - 1, slots).round().astype(int)
    return _exchange(rows, measure, earlier, start, tolerance, max_steps)


@eqx.filter_jit
def _exchange(rows, measure, earlier, start, tolerance, max_steps) -> Allocation:
    def factor_of(index, weight):
        own = jnp.sqrt(weight)[:, None, None] * rows[index]
        return jnp.concatenate([own.reshape(-1, rows.shape[-1]), earlier])

    def gains(index, weight):
        return measure.gain(factor_of(index, weight), rows)

    def certificate(index, weight, phi):
        return jnp.max(phi) / jnp.sum(weight * phi[index])

    def transfer(index, weight, phi):
        """Move weight from the least useful point to the most useful candidate."""
        best = jnp.argmax(phi)
        present = index == best
        target = jnp.where(jnp.any(present), jnp.argmax(present), jnp.argmin(weight))
        index = index.at[target].set(best)
        source = jnp.argmin(jnp.where(weight > NEGLIGIBLE, phi[index], jnp.inf))

        def cost(amount):
            moved = weight.at[source].add(-amount).at[target].add(amount)
            value = measure.cost(factor_of(index, jnp.maximum(moved, 0.0)))
            return jnp.where(jnp.isfinite(value), value, jnp.inf)

        def zoom(_, interval):
            low, high = interval
            amounts = jnp.linspace(low, high, LINE_POINTS)
            at = jnp.argmin(jax.vmap(cost)(amounts))
            return amounts[jnp.maximum(at - 1, 0)], amounts[jnp.minimum(at + 1, LINE_POINTS - 1)]

        low, high = jax.lax.fori_loop(0, LINE_ZOOMS, zoom, (0.0 * weight[source], weight[source]))
        amounts = jnp.stack([low, 0.5 * (low + high), high])
        amount = amounts[jnp.argmin(jax.vmap(cost)(amounts))]
        amount = jnp.where(source == target, 0.0, amount)
        return index, weight.at[source].add(-amount).at[target].add(amount)

    def multiply(_, state):
        index, weight = state
        phi = measure.gain(factor_of(index, weight), rows[index])
        weight = weight * (phi / jnp.sum(weight * phi)) ** POWER
        return index, weight / jnp.sum(weight)

    def step(state):
        index, weight, phi, count = state
        index, weight = transfer(index, weight, phi)
        index, weight = jax.lax.fori_loop(0, MULTIPLICATIVE_STEPS, multiply, (index, weight))
        weight = jnp.where(weight > NEGLIGIBLE, weight, 0.0)
        weight = weight / jnp.sum(weight)
        return index, weight, gains(index, weight), count + 1

    def unfinished(state):
        index, weight, phi, count = state
        return (certificate(index, weight, phi) > 1.0 + tolerance) & (count < max_steps)

    weight = jnp.full(start.shape, 1.0 / start.size)
    first = (start, weight, gains(start, weight), jnp.zeros((), int))
    index, weight, phi, count = jax.lax.while_loop(unfinished, step, first)
    weights = jnp.zeros(rows.shape[0]).at[index].add(weight)
    cost = measure.cost(factor_of(index, weight))
    return Allocation(weights, phi, cost, certificate(index, weight, phi), count)
