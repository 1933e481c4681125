"""Maps of a residual: its mean over the range of a variable, and the significance of that mean."""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaincc

from .._foundation.checks import require
from .._foundation.compiler import fast_compile_jit
from .._foundation.host import to_device
from .._foundation.notebook import Table
from .._foundation.types import Array, Bool, Float
from ..estimation.coloured import score_covariance, score_covariance_under
from .thresholds import WEAK_BIN
from .validation import root_mean_square

TITLE = "p-values of the mean residual over the range of each variable"


class ResidualMaps(eqx.Module):
    """Mean residual of each channel in each bin of each variable.

    Attributes:
        outputs, variables: names of the channels and of the variables.
        edges: edges of the bins, which hold equal numbers of samples.
        mean: mean of the residual in each bin [output units].
        deviation: standard deviation of that mean if no effect is missing.
        p_value: probability of means at least this far from zero, over all bins together.
    """

    outputs: tuple[str, ...] = eqx.field(static=True)
    variables: tuple[str, ...] = eqx.field(static=True)
    edges: Float[Array, "variable edge"]
    mean: Float[Array, "output variable bin"]
    deviation: Float[Array, "output variable bin"]
    p_value: Float[Array, "output variable"]

    def _repr_html_(self) -> str:
        return self._table().html(above=[TITLE])

    def __str__(self) -> str:
        return "\n".join([TITLE, *self._table().lines()])

    def _table(self) -> Table:
        """Return the p-values of the maps in words."""
        rows = (
            (name, *(f"{float(p):.2g}" for p in self.p_value[:, k]), "")
            for k, name in enumerate(self.variables)
        )
        widths = (8, *(10 for _ in self.outputs))
        return Table(("variable", *self.outputs, ""), widths, tuple(rows))


def residual_maps(
    residuals: Float[Array, "case time output"],
    mask: Bool[Array, "case time output"],
    variables: Mapping[str, Float[Array, "case time"]],
    outputs: tuple[str, ...],
    *,
    bins: int = 8,
) -> ResidualMaps:
    r"""Return the mean residual over the range of each variable, pooled over the records.

        m_b = sum_i 1_b(i) v_i / n_b,    Q = s' C^-1 s  ~  chi-square,    s_b = sum_i 1_b(i) v_i

    with `C` the covariance of the sums, computed for the autocorrelation of the residual less its
    means (`score_covariance`; Morelli & Klein, Journal of Aircraft 34(6), 1997), so that a slow
    residual does not make every map significant. The p-value is the larger of this one and the one
    for first-order autoregressive noise. Noise with a memory as long as the stay in a bin still
    gives more alarms than the level over time.

    Args:
        residuals: `v = z - y` [output units].
        mask: valid samples.
        variables: by name, such as states, inputs, or time [any]; samples where one is not finite
            do not count in its map.
        outputs: names of the channels.
        bins: number of bins, with equal numbers of samples.

    Returns:
        The maps. If many variables are tested, compare the p-values with a level divided by their
        number.

    Raises:
        InputError: if the number of names differs from that of the channels, or if there is no
            variable, one without a finite sample, or fewer than two bins.
    """
    channels = residuals.shape[2]
    require(
        len(outputs) == channels,
        f"There are {channels} residual channels and {len(outputs)} names. Name each once.",
    )
    require(len(variables) > 0, "There is no variable to map the residual over. Name one.")
    require(bins >= 2, f"There are {bins} bins. A map has two at least.")
    s = np.stack([np.asarray(variable, float) for variable in variables.values()], axis=-1)
    inside = np.any(np.asarray(mask), axis=-1)
    known = np.isfinite(s)
    shares = np.linspace(0.0, 1.0, bins + 1)
    edges = np.zeros((s.shape[-1], bins + 1))
    for k, name in enumerate(variables):
        counted = inside & known[..., k]
        require(
            bool(np.any(counted)),
            f"Variable {name!r} is not finite at any valid sample. Leave it out.",
        )
        edges[k] = np.quantile(s[counted, k], shares)
    s, known, edges = to_device((np.where(known, s, 0.0), known, edges))
    means = _numbers(residuals, mask, s, known, edges)
    return ResidualMaps(tuple(outputs), tuple(variables), edges, *means)


class _BinMeans(NamedTuple):
    """Means of the residual over bins, with the axes of `ResidualMaps`.

    Attributes:
        mean: [output units].
        deviation: standard deviation of the mean [output units].
        p_value: of all means together.
    """

    mean: Float[Array, "*axes bin"]
    deviation: Float[Array, "*axes bin"]
    p_value: Float[Array, "*axes"]


@fast_compile_jit
def _numbers(residuals, mask, s, known, edges) -> _BinMeans:
    """Means, their deviations and p-values.

    Channels and variables are computed one after the other, to keep memory small.
    """
    bins = edges.shape[1] - 1

    def one_map(v, mask, s, edges):
        which = jnp.clip(jnp.searchsorted(edges[1:-1], s, side="right"), 0, bins - 1)
        inside = (which[..., None] == jnp.arange(bins)[None, None]) & mask[..., None]
        v = jnp.where(mask, v, 0.0)
        count = jnp.sum(inside, axis=(0, 1))
        sums = jnp.einsum("cib,ci->b", inside, v)
        mean = sums / jnp.maximum(count, 1)
        # The map itself is removed first; otherwise every strong map would look like coloured
        # noise.
        remainder = v - inside @ mean
        S, remainder, mask = inside[:, :, None, :] * 1.0, remainder[..., None], mask[..., None]
        measured = score_covariance(S, remainder, mask)
        # The bins of a slow variable take the slow part of a residual with them, and the remainder
        # then seems to have less of it than noise. The larger variance is used.
        fitted = score_covariance_under(S, _first_order(remainder, mask))
        p_value = jnp.maximum(_p_value(sums, measured), _p_value(sums, fitted))
        variance = jnp.maximum(jnp.diagonal(measured), jnp.diagonal(fitted))
        deviation = jnp.sqrt(variance) / jnp.maximum(count, 1)
        return _BinMeans(mean, deviation, p_value)

    def of_output(j):
        v, valid = residuals[..., j], mask[..., j]
        return jax.lax.map(
            lambda k: one_map(v, valid & known[..., k], s[..., k], edges[k]),
            jnp.arange(s.shape[-1]),
        )

    return jax.lax.map(of_output, jnp.arange(residuals.shape[-1]))


def _first_order(v, mask):
    """Return the autocovariance of first-order autoregressive noise, by `tapered_covariance`'s
    lags; white noise where neighbours are not positively correlated.
    """
    count = v.shape[1]
    lag = jnp.minimum(jnp.arange(2 * count), 2 * count - jnp.arange(2 * count))[:, None]
    variance = root_mean_square(v, mask) ** 2
    pairs = mask[:, 1:] & mask[:, :-1]
    product = jnp.sum(v[:, 1:] * v[:, :-1], axis=(0, 1)) / jnp.maximum(jnp.sum(pairs, (0, 1)), 1)
    rho = jnp.clip(product / jnp.maximum(variance, jnp.finfo(float).tiny), 0.0, 1.0)
    return variance[None] * rho[None] ** lag


def _p_value(sums, C):
    """Return the probability of sums at least this large, for their covariance."""
    values, vectors = jnp.linalg.eigh(C)
    strong = values > WEAK_BIN * jnp.maximum(values[-1], jnp.finfo(float).tiny)
    Q = jnp.sum(jnp.where(strong, (vectors.T @ sums) ** 2 / jnp.where(strong, values, 1.0), 0.0))
    return gammaincc(jnp.maximum(jnp.sum(strong), 1) / 2, Q / 2)
