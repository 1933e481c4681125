"""Variances of estimates under coloured residuals, right for short records.

The whitened residual `v` of each channel is described by an autoregressive process, of the order
that the Bayesian information criterion selects, by Burg's recursion on the windows without gaps:

    Gamma(k) = autocovariance,    V = C (S' Gamma S + T) C,    C = (S'S + T)^-1

with the information T of the priors, whose errors have no colour. A residual has less power than
the noise that made it, most of all at the frequencies of the sensitivities: with `H = S C S'`,
`v = (I - H) e - S C T (errors of the priors)`. The expected loss is added to the autocovariance,

    E c(k) = gamma(k) - tr J_k (2 Gamma H - S V S') / pairs(k)      (J_k: shift by k samples)

and the process computed again (Yule-Walker), two times. V depends on the estimated process, and so
has a variance of its own; an interval takes Student's t with Satterthwaite's degrees of freedom,
`nu = 2 / relative variance of V`.

Coverage of 95 % intervals under AR(1) noise with 0.8, three parameters: 94 to 95 % of 200 samples
and of 600, with 30 % of them missing at random as well. Noise that no process of low order
describes is harder: of 200 samples with ARMA(1, 1) noise (0.9, -0.5), 89 % are covered.
All records share one process, by samples and not by time: of two records with steps of 0.05 s and
1 s, 600 samples each, under noise with a correlation time of 1 s, 87 % are covered.

Sources: Burg, Maximum entropy spectral analysis, Stanford, 1975; Schwarz, Annals of Statistics
6(2), 1978; Satterthwaite, Biometrics Bulletin 2(6), 1946; the loss of power: Bell and McCaffrey,
Survey Methodology 28(2), 2002, for another covariance.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from .._foundation.host import on_host
from .._foundation.types import Array, Bool, Complex, Float, Int

HIGHEST_ORDER = 10  # of the autoregressive process; chosen
SAMPLES_PER_COEFFICIENT = 10  # windows for each coefficient; chosen
ITERATIONS = 2  # of the correction; tuned on AR(1) with 0.8 and 200 samples: a third adds 0.1 %


@on_host
def colour_ratio(xp, standard_errors, corrected_errors):
    """Return corrected over standard errors; one for a parameter that has no standard error."""
    is_determined = xp.isfinite(standard_errors)
    return xp.where(is_determined, corrected_errors, 1.0) / xp.where(
        is_determined, standard_errors, 1.0
    )


class ScoreSpectrum(NamedTuple):
    """Fourier transforms of the sensitivities, padded to twice the length.

    Attributes:
        power: of the weights `S C` by which a residual moves each parameter, over all records.
        columns: of orthonormal columns that span the sensitivities, those to the parameters of the
            record first; None for a stack of records too large to keep, whose loss of power is
            negligible.
        own: number of the columns of the record.
        prior_power: variance of each parameter by the errors of the priors, diagonal of `C T C`.
        prior_products: part of the priors in `ColouredVariances.products`, of the shared columns.
    """

    power: Float[Array, "frequency output parameter"]
    columns: Complex[Array, "case frequency output column"] | None
    own: int
    prior_power: Float[Array, " parameter"]
    prior_products: Float[Array, "column column"]


class ColouredVariances(NamedTuple):
    """Variances of estimates under coloured residuals.

    Attributes:
        variance: of each shared parameter.
        dof: degrees of freedom of this variance.
        products: covariances of the products of residual and columns, of each record for its own
            columns, of all records and priors for the shared ones; the identity for white
            residuals, None without columns.
    """

    variance: Float[Array, " parameter"]
    dof: Float[Array, " parameter"]
    products: Float[Array, "case column column"] | None


class Process(NamedTuple):
    """An autoregressive process for each channel.

    Attributes:
        coefficients: `v_i = sum_l coefficients_l v_(i-l) + e_i`, zero beyond the order.
        variance: of `e`.
        order: the selected order.
        count: number of windows from which the coefficients were estimated.
        autocovariance: at the lags 0 to `HIGHEST_ORDER`.
    """

    coefficients: Float[Array, "lag output"]
    variance: Float[Array, " output"]
    order: Int[Array, " output"]
    count: Float[Array, " output"]
    autocovariance: Float[Array, "lag_and_zero output"]


def coloured_variances(
    score: ScoreSpectrum,
    v: Float[Array, "case time output"],
    mask: Bool[Array, "case time output"],
    batch: int,
) -> ColouredVariances:
    """Return the variances of the estimates.

    Args:
        score: from the sensitivities.
        v: whitened residuals, zero at missing samples.
        mask: valid samples.
        batch: number of records at a time, a divisor of all.
    """
    length = score.power.shape[0] - 1
    process = burg(v, mask, batch)
    if score.columns is None:
        return ColouredVariances(*_variances(process, score, length), None)
    powers = _powers(score)
    pairs = _pairs(mask)

    def correct(state, _):
        loss = _loss(score, powers, spectral_density(state, length), pairs)
        return _levinson(process, process.autocovariance + loss), None

    process, _ = jax.lax.scan(correct, process, None, ITERATIONS)
    products = _products(score, powers[1], spectral_density(process, length))
    return ColouredVariances(*_variances(process, score, length), products)


def burg(
    v: Float[Array, "case time output"], mask: Bool[Array, "case time output"], batch: int
) -> Process:
    """Return the autoregressive process of each channel, pooled over records.

    Only windows without a missing sample count, so that gaps need no filling. Every reflection
    coefficient is below one, so that the process is stable. The windows of an order are computed
    from the residuals, for some records at a time, so that no window is kept.

    Args:
        v: residuals, zero at missing samples.
        mask: valid samples.
        batch: number of records at a time, a divisor of all.
    """
    total = jnp.maximum(jnp.sum(mask, axis=(0, 1)), 1) * 1.0
    shape = (-1, batch, *v.shape[1:])
    records = v.reshape(shape), mask.reshape(shape)

    def raise_order(state, index):
        last, reflections, best, criterion, least = state
        sums = jax.lax.map(lambda some: _window_sums(some, reflections, index), records)
        power, product, count = jax.tree.map(lambda leaf: jnp.sum(leaf, axis=0), sums)
        k = jnp.where(power > 0, 2.0 * product / jnp.where(power > 0, power, 1.0), 0.0)
        remaining = jnp.maximum(1.0 - k**2, jnp.finfo(float).eps)
        last = Process(
            _raised(last.coefficients, k, index),
            last.variance * remaining,
            last.order + 1,
            count,
            last.autocovariance,
        )
        # Bayesian information criterion, order by order on the windows that have it
        change = count * jnp.log(remaining) + jnp.log(jnp.maximum(count, 1.0))
        criterion = criterion + change
        better = (criterion < least) & (count >= SAMPLES_PER_COEFFICIENT * (index + 1))
        best = jax.tree.map(lambda new, old: jnp.where(better, new, old), last, best)
        reflections = reflections.at[index].set(k)
        return (last, reflections, best, criterion, jnp.where(better, criterion, least)), None

    zeros = jnp.zeros((HIGHEST_ORDER, v.shape[2]))
    white = Process(
        zeros,
        jnp.sum(v**2, axis=(0, 1)) / total,
        jnp.zeros(v.shape[2], int),
        total,
        jnp.zeros((HIGHEST_ORDER + 1, v.shape[2])),
    )
    begin = (white, zeros, white, zeros[0], zeros[0])
    state, _ = jax.lax.scan(raise_order, begin, jnp.arange(HIGHEST_ORDER))
    process = state[2]
    density = spectral_density(process, v.shape[1])
    return process._replace(autocovariance=_inverse_transform(density))


def _window_sums(records, reflections: Float[Array, "lag output"], index):
    """Return for the next order the power, the products and the number of the windows of forward
    and backward residuals, by channel (Burg's lattice).
    """

    def shifted(x):
        return jnp.pad(x[:, :-1], ((0, 0), (1, 0), (0, 0)))

    def windows(state):
        forward, backward, valid = state
        valid = valid & shifted(valid)
        return *(jnp.where(valid, x, 0.0) for x in (forward, shifted(backward))), valid

    def raise_order(lower, state):
        forward, backward, valid = windows(state)
        rows = reflections[lower][None, None]
        return forward - rows * backward, backward - rows * forward, valid

    v, mask = records
    forward, backward, valid = windows(jax.lax.fori_loop(0, index, raise_order, (v, v, mask)))
    power, product = forward**2 + backward**2, forward * backward
    return jax.tree.map(lambda x: jnp.sum(x, axis=(0, 1)), (power, product, valid * 1.0))


def _raised(coefficients, k, index):
    """Return the coefficients of the next order for its reflection coefficient (Levinson)."""
    lag = jnp.arange(HIGHEST_ORDER)[:, None]
    mirrored = jnp.where(lag < index, coefficients[(index - 1 - lag[:, 0])], 0.0)
    return jnp.where(lag == index, k[None], coefficients - k[None] * mirrored)


def spectral_density(process: Process, length: int) -> Float[Array, "frequency output"]:
    """Return the spectrum of a process, `variance / |A|^2`, at the frequencies of twice `length`
    samples.
    """
    return process.variance[None] / jnp.abs(_polynomial(process, length)) ** 2


def _polynomial(process: Process, length: int):
    """Return `A = 1 - sum_l coefficients_l exp(-i w l)`."""
    ones = jnp.ones((1, process.coefficients.shape[1]))
    return jnp.fft.rfft(jnp.concatenate([ones, -process.coefficients]), 2 * length, axis=0)


def _inverse_transform(density):
    """Return the autocovariance of a spectrum at the lags 0 to `HIGHEST_ORDER`."""
    return jnp.fft.irfft(density, 2 * (density.shape[0] - 1), axis=0)[: HIGHEST_ORDER + 1]


def _levinson(process: Process, autocovariance) -> Process:
    """Return the process of the same order with this autocovariance (Levinson's recursion).

    Reflection coefficients of one or more, of an autocovariance that is not positive definite,
    keep the coefficients of the given process.
    """
    lag = jnp.arange(HIGHEST_ORDER)
    first = autocovariance[0]

    def raise_order(state, index):
        coefficients, variance = state
        # The sum over l of coefficients_l c(index + 1 - l), l from 1 on
        reversed_lags = jnp.where((lag < index)[:, None], autocovariance[(index - lag)], 0.0)
        rest = autocovariance[index + 1] - jnp.sum(coefficients * reversed_lags, axis=0)
        k = jnp.where(index < process.order, rest / jnp.where(variance > 0, variance, 1.0), 0.0)
        return (_raised(coefficients, k, index), variance * (1.0 - k**2)), jnp.abs(k) < 1.0

    begin = jnp.zeros_like(process.coefficients), first
    (coefficients, variance), fine = jax.lax.scan(raise_order, begin, lag)
    stable = jnp.all(fine, axis=0) & (first > 0)
    return process._replace(
        coefficients=jnp.where(stable[None], coefficients, process.coefficients),
        variance=jnp.where(stable, variance, process.variance),
    )


def _powers(score: ScoreSpectrum):
    """Return the power of the columns, and their real and imaginary parts as one real array."""
    assert score.columns is not None
    parts = jnp.concatenate([score.columns.real, score.columns.imag], axis=0)
    return jnp.sum(parts**2, axis=(0, 3)), parts


def _products(score: ScoreSpectrum, parts, density) -> Float[Array, "case column column"]:
    """Return the covariances of the products of residual and columns (`ColouredVariances`)."""
    twice_cases, count = parts.shape[0], density.shape[0] - 1
    # A one-sided transform: all but two frequencies represent two.
    ends = (jnp.arange(count + 1) == 0) | (jnp.arange(count + 1) == count)
    weighted = density * jnp.where(ends, 0.5, 1.0)[:, None] / count
    inner = jnp.einsum("cfjp,cfjq->cpq", parts * weighted[None, :, :, None], parts)
    inner = inner[: twice_cases // 2] + inner[twice_cases // 2 :]
    shared = jnp.sum(inner[:, score.own :, score.own :], axis=0) + score.prior_products
    return inner.at[:, score.own :, score.own :].set(shared[None])


def _loss(score: ScoreSpectrum, powers, density, pairs):
    """Return the autocovariance that residuals have less than their noise, by lag and channel."""
    total, parts = powers
    inner = _products(score, parts, density)
    inner = jnp.concatenate([inner, inner])
    once = _inverse_transform(total * density)
    twice = jnp.einsum("cfjq,cfjq->fj", jnp.einsum("cfjp,cpq->cfjq", parts, inner), parts)
    # A missing sample leaves out of the first sum as many products as of the pairs.
    return 2.0 * once / pairs[:1] - _inverse_transform(twice) / pairs


def _pairs(mask):
    """Return the number of pairs of valid samples of each channel at the lags of a process."""
    length = mask.shape[1]
    power = jnp.sum(jnp.abs(jnp.fft.rfft(mask * 1.0, 2 * length, axis=1)) ** 2, axis=0)
    return jnp.maximum(jnp.round(_inverse_transform(power)), 1.0)


def _variances(process: Process, score: ScoreSpectrum, length: int):
    """Return the variance of each estimate and its degrees of freedom.

    The variance of the coefficients of a process of n samples is `variance Gamma^-1 / n`, and the
    relative one of its `variance` 2/n (Brockwell & Davis, Time Series, 1991, section 8.8). With the
    lower triangular Toeplitz matrices `A` of `1, -phi_1, ...` and `B` of `-phi_p, -phi_(p-1), ...`
    it is `variance Gamma^-1 = A A' - B B'` (Siddiqui, Annals of Mathematical Statistics 29, 1958).
    """
    polynomial = _polynomial(process, length)
    frequency = jnp.arange(length + 1)
    twice = jnp.where((frequency == 0) | (frequency == length), 1.0, 2.0) / (2 * length)
    density = twice[:, None] * process.variance[None] / jnp.abs(polynomial) ** 2
    weighted = density[..., None] * score.power
    by_channel = jnp.sum(weighted, axis=0)
    total = jnp.sum(by_channel, axis=0) + score.prior_power
    # d density / d coefficient_l = 2 density Re( exp(-i w l) / A )
    lag = jnp.arange(1, HIGHEST_ORDER + 1)
    angle = jnp.pi / length * frequency[:, None] * lag[None]
    inverse = 1.0 / polynomial
    slope = jnp.einsum("fl,fjp->ljp", jnp.cos(angle), inverse.real[..., None] * weighted)
    slope = slope + jnp.einsum("fl,fjp->ljp", jnp.sin(angle), inverse.imag[..., None] * weighted)
    used = lag[:, None] <= process.order[None]
    slope = 2.0 * jnp.where(used[..., None], slope, 0.0)
    ones = jnp.ones((1, process.order.size))
    polynomial_rows = jnp.concatenate([ones, -process.coefficients])
    at = process.order[None] - jnp.arange(HIGHEST_ORDER)[:, None]
    backward = jnp.take_along_axis(polynomial_rows, jnp.maximum(at, 0), axis=0)
    backward = jnp.where(at > 0, backward, 0.0)
    difference = jnp.arange(HIGHEST_ORDER)[:, None] - jnp.arange(HIGHEST_ORDER)[None]

    def form(column):
        matrix = jnp.where(difference[..., None] >= 0, column[jnp.maximum(difference, 0)], 0.0)
        return jnp.sum(jnp.einsum("ljp,lmj->mjp", slope, matrix) ** 2, axis=0)

    of_coefficients = form(polynomial_rows[:HIGHEST_ORDER]) - form(backward)
    count = process.count[:, None]
    variance = jnp.sum((of_coefficients + 2.0 * by_channel**2) / count, axis=0)
    dof = 2.0 * total**2 / jnp.where(variance > 0, variance, 1.0)
    return total, jnp.where(variance > 0, dof, jnp.inf)
