"""Maps of a residual: its mean over the range of a variable, and whether it is more than chance, colour accounted for."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaincc

from .._foundation.checks import require
from .._foundation.quickly import quickly
from .._foundation.types import Array, Bool, Float
from ..estimation.coloured import score_covariance

WEAK = 1e-9  # of the largest eigenvalue of the bins' covariance: an empty bin, or one that never changes


class ResidualMaps(eqx.Module):
    """The mean residual of each channel in each bin of each variable.

    Attributes:
        outputs, variables: names of the channels and of the variables.
        edges: of the bins, which hold equally many samples.
        mean: of the residual in each bin [output units].
        deviation: standard deviation of that mean where nothing is missing.
        p_value: probability of means at least as far off zero, over all bins together.
    """

    outputs: tuple[str, ...] = eqx.field(static=True)
    variables: tuple[str, ...] = eqx.field(static=True)
    edges: Float[Array, "variable edge"]
    mean: Float[Array, "output variable bin"]
    deviation: Float[Array, "output variable bin"]
    p_value: Float[Array, "output variable"]

    def __str__(self) -> str:
        width = max(len(name) for name in (*self.variables, "variable"))
        lines = [
            f"{'variable':<{width}} " + " ".join(f"{name:>10}" for name in self.outputs) + "   p-values of the map"
        ]
        for k, name in enumerate(self.variables):
            lines.append(f"{name:<{width}} " + " ".join(f"{float(p):>10.2g}" for p in self.p_value[:, k]))
        return "\n".join(lines)


def residual_maps(
    residuals: Float[Array, "case time output"],
    mask: Bool[Array, "case time output"],
    variables: Mapping[str, Float[Array, "case time"]],
    outputs: tuple[str, ...],
    *,
    bins: int = 8,
) -> ResidualMaps:
    r"""Mean residual over the range of each variable, pooled over the records, with its significance.

        m_b = sum_i 1_b(i) v_i / n_b,    Q = s' C^-1 s  ~  chi-square,    s_b = sum_i 1_b(i) v_i

    with `C` the covariance of the sums for a residual of the colour that this one shows less its means (`score_covariance`;
    Morelli & Klein, Journal of Aircraft 34(6), 1997), so that a slow residual does not make every map significant.

    Args:
        residuals: `v = z - y` [output units].
        mask: valid samples.
        variables: by name, such as states, inputs, or time [any].
        outputs: names of the channels.
        bins: how many, with equally many samples in each.

    Returns:
        The maps; one variable tells nothing for certain where many are asked about: compare p-values with a level divided by
        their number.

    Raises:
        InputError: when names are not as many as the channels, there is no variable, or fewer than two bins.
    """
    found = residuals.shape[2]
    require(len(outputs) == found, f"There are {found} residual channels and {len(outputs)} names. Name each once.")
    require(len(variables) > 0, "There is no variable to map the residual over. Name one.")
    require(bins >= 2, f"There are {bins} bins. A map has two at least.")
    s = jnp.stack([jnp.asarray(one, float) for one in variables.values()], axis=-1)
    inside = np.asarray(jnp.any(mask, axis=-1))
    edges = jnp.asarray(np.quantile(np.asarray(s)[inside], np.linspace(0.0, 1.0, bins + 1), axis=0).T)
    mean, deviation, p_value = _numbers(residuals, mask, s, edges)
    return ResidualMaps(tuple(outputs), tuple(variables), edges, mean, deviation, p_value)


@quickly
def _numbers(residuals, mask, s, edges):
    """Means, their deviations and p-values, channel by channel and variable by variable, to keep memory small."""
    bins = edges.shape[1] - 1

    def one(v, seen, s, edges):
        which = jnp.clip(jnp.searchsorted(edges[1:-1], s, side="right"), 0, bins - 1)
        inside = (which[..., None] == jnp.arange(bins)[None, None]) & seen[..., None]
        v = jnp.where(seen, v, 0.0)
        count = jnp.sum(inside, axis=(0, 1))
        sums = jnp.einsum("cib,ci->b", inside, v)
        mean = sums / jnp.maximum(count, 1)
        left = v - inside @ mean  # the colour of what the map does not say, else every strong map looks like colour
        C = score_covariance(inside[:, :, None, :] * 1.0, left[..., None])
        values, vectors = jnp.linalg.eigh(C)
        strong = values > WEAK * jnp.maximum(values[-1], jnp.finfo(float).tiny)
        Q = jnp.sum(jnp.where(strong, (vectors.T @ sums) ** 2 / jnp.where(strong, values, 1.0), 0.0))
        p_value = gammaincc(jnp.maximum(jnp.sum(strong), 1) / 2, Q / 2)
        return mean, jnp.sqrt(jnp.maximum(jnp.diagonal(C), 0.0)) / jnp.maximum(count, 1), p_value

    def of_output(j):
        v, seen = residuals[..., j], mask[..., j]
        return jax.lax.map(lambda k: one(v, seen, s[..., k], edges[k]), jnp.arange(s.shape[-1]))

    return jax.lax.map(of_output, jnp.arange(residuals.shape[-1]))
