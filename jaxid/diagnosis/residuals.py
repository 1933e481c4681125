"""Residual tests: whiteness, and correlation with inputs, states or other signals."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaincc
from jax.scipy.stats import norm

from .._foundation.checks import InputError, require, require_level
from .._foundation.compiler import fast_compile_jit
from .._foundation.host import as_columns, on_host, to_device
from .._foundation.notebook import Table
from .._foundation.types import Array, Bool, Float, Int, Numbers
from ..data.record import Record
from ..estimation.estimate import as_stack
from ..estimation.result import Estimate
from .thresholds import BAND


def autocorrelation(
    v: Float[Array, "case time output"], mask: Bool[Array, "case time output"], lags: int
) -> Float[Array, "output lag"]:
    r"""Autocorrelation of residuals, pooled over the cases.

        r_k = (1/n_k sum v_i v_(i+k)) / (1/N sum v_i^2),    n_k = number of pairs of valid samples

    No mean is subtracted: a residual with a mean is not white. Works under `jit` and `vmap`.

    Args:
        v: residuals, shape (case, time, output) [output units].
        mask: valid samples, shape (case, time, output).
        lags: longest lag [samples].

    Returns:
        `r_0 = 1` to `r_lags`, shape (output, lags + 1) [-]; zero if there is no pair or the
        channel is zero throughout.
    """
    return _autocorrelation(v, mask, lags)[0].T


def cross_correlation(
    v: Float[Array, "case time output"],
    mask: Bool[Array, "case time output"],
    s: Float[Array, "case time signal"],
    lags: int,
) -> tuple[Float[Array, "output signal lag"], Float[Array, "output signal lag"]]:
    r"""Correlation of residuals with signals, pooled over the cases, and its 95 % band.

        r_k = (1/n_k sum v_i s_(i-k)) / (rms(v) rms(s)),    band 1.96 / sqrt(n_k)

    At positive lags the signal comes first. The means of the signals are subtracted, those of the
    residual are not. The band is Bartlett's, `var r_k = 1/n_k sum_j rho_v(j) rho_s(j)`, for a white
    residual: the colour of the signal then drops out (Bartlett, An Introduction to Stochastic
    Processes, 1955; Box, Jenkins & Reinsel, Time Series Analysis, chapter 12).

    Args:
        v: residuals, shape (case, time, output) [output units].
        mask: valid samples, shape (case, time, output).
        s: signals, shape (case, time, signal) [any]; values that are not finite are left out, and
            so are the rows after the last valid sample of a case.
        lags: longest lag to both sides [samples].

    Returns:
        `r_-lags` to `r_lags`, shape (output, signal, 2 lags + 1) [-], and the half width of the
        band.
    """
    known = jnp.isfinite(s) & _recorded(mask)[..., None]
    s = _centred(s, known)
    v = jnp.where(mask, v, 0.0)
    sums, pairs = _lagged(s, v, lags), jnp.round(_lagged(known * 1.0, mask * 1.0, lags))
    size = jnp.sqrt(_mean_square(v, mask)[:, None] * _mean_square(s, known)[None])
    r = _ratio(_ratio(sums, pairs), size[None])
    return jnp.moveaxis(r, 0, -1), jnp.moveaxis(_ratio(jnp.asarray(BAND), jnp.sqrt(pairs)), 0, -1)


class Whiteness(eqx.Module):
    """Ljung-Box statistic of each channel, its degrees of freedom, and the probability of a larger
    value under white noise.
    """

    statistic: Float[Array, " output"]
    dof: Int[Array, " output"]
    p_value: Float[Array, " output"]


def ljung_box(
    v: Float[Array, "case time output"],
    mask: Bool[Array, "case time output"],
    lags: int,
    fitted: int = 0,
) -> Whiteness:
    r"""Ljung-Box test of whiteness, channel by channel, pooled over the cases.

        Q = (N + 2)/N sum_(k=1..lags) n_k r_k^2  ~  chi-square with `lags - fitted` degrees of
        freedom

    with `r_k`, `n_k` as in `autocorrelation`; for one record without gaps it is the usual `N (N +
    2) sum r_k^2/(N - k)` with `r_k` over N instead of pairs (Ljung & Box, Biometrika 65(2), 1978).
    Works under `jit` and `vmap`.

    Args:
        v: residuals, shape (case, time, output) [output units].
        mask: valid samples, shape (case, time, output).
        lags: longest lag [samples].
        fitted: parameters of a noise model that was fitted to these residuals; parameters of the
            dynamics do not count.

    Returns:
        Statistic, degrees of freedom and p-value, each of shape (output,) [-].
    """
    r, pairs = _autocorrelation(v, mask, lags)
    count = jnp.sum(mask, axis=(0, 1))
    statistic = (count + 2) / jnp.maximum(count, 1) * jnp.sum(pairs[1:] * r[1:] ** 2, axis=0)
    dof = jnp.maximum(jnp.sum(pairs[1:] > 0, axis=0) - fitted, 1)
    return Whiteness(statistic, dof, gammaincc(dof / 2, statistic / 2))


class ResidualTests(eqx.Module):
    """Autocorrelation of the residuals of each channel, and their correlation with signals.

    Attributes:
        outputs, signals: names of the channels and of the signals they are compared with.
        level: probability of a false alarm, for all channels of one test together.
        autocorrelation: `r_0` to `r_lags` of each channel.
        band: half width of its 95 % band.
        whiteness: the Ljung-Box test.
        cross_correlation: `r_-lags` to `r_lags` with each signal.
        cross_band: half width of its 95 % band, wider if the residual is coloured.
        cross_p: probability of a correlation at least this large at any lag from 0 on, for a
            residual independent of the signal.
        cross_lag: lag of the largest correlation among these [samples].
    """

    outputs: tuple[str, ...] = eqx.field(static=True)
    signals: tuple[str, ...] = eqx.field(static=True)
    level: float = eqx.field(static=True)
    autocorrelation: Float[Array, "output lag"]
    band: Float[Array, " output"]
    whiteness: Whiteness
    cross_correlation: Float[Array, "output signal cross_lag"]
    cross_band: Float[Array, "output signal cross_lag"]
    cross_p: Float[Array, "output signal"]
    cross_lag: Int[Array, "output signal"]

    @property
    def white(self) -> Bool[Array, " output"]:
        """True for each channel whose residual is white (Bonferroni over the channels); False if a
        valid sample is not finite.
        """
        return _at_least(self.whiteness.p_value, level=self.level / len(self.outputs))

    @property
    def follows(self) -> Bool[Array, "output signal"]:
        """True if a channel's residual is correlated with a signal (Bonferroni over channels and
        signals).
        """
        return _below(self.cross_p, level=self.level / max(self.cross_p.size, 1))

    @property
    def passed(self) -> Bool[Array, ""]:
        """True if every channel is white and correlated with no signal."""
        return jnp.all(self.white) & ~jnp.any(self.follows)

    def _repr_html_(self) -> str:
        return self._table().html(below=[self._level_words()])

    def __str__(self) -> str:
        return "\n".join([*self._table().lines(), self._level_words()])

    def _level_words(self) -> str:
        return f"alarms at {100 * self.level:g} % over all channels"

    def _table(self) -> Table:
        """Return both tests of each channel in words."""
        known = jax.tree.map(np.asarray, self)
        middle, tests = self.autocorrelation.shape[1] - 1, known.whiteness
        lines, nothing = [], "-" if self.signals else "no signals were given"
        answers = np.asarray(self.white), np.asarray(self.follows)
        rows = zip(self.outputs, tests.statistic, tests.p_value, *answers, strict=True)
        for j, (name, Q, p, white, follows) in enumerate(rows):
            correlations = [
                f"{self.signals[k]} ({known.cross_correlation[j, k, middle + lag]:+.2f}, {lag})"
                for k, lag in enumerate(known.cross_lag[j])
                if bool(follows[k])
            ]
            numbers = (f"{float(Q):.4g}", f"{float(p):.2g}", "yes" if bool(white) else "no")
            if known.autocorrelation[j, 0] == 0:  # no sample, or no residual at all
                numbers = ("-", "-", "-")
            lines.append((name, *numbers, ", ".join(correlations) or nothing))
        heads = ("residual", "Ljung-Box", "p", "white", "follows (correlation, lag)")
        return Table(heads, (8, 10, 9, 6), tuple(lines))


def residual_tests(
    residuals: Estimate | Float[Array, "case time output"],
    mask: Bool[Array, "case time output"] | None = None,
    signals: Mapping[str, Float[Numbers, "case time"]] | Record | Sequence[Record] | None = None,
    outputs: tuple[str, ...] | None = None,
    *,
    level: float = 0.01,
    lags: int = 25,
) -> ResidualTests:
    """Test residuals for whiteness and for correlation with inputs, states or any other signals.

    A residual is correlated with a signal if the largest `|r_k|` from lag 0 on exceeds the band of
    an independent residual (Bonferroni over the lags). If a channel is not white, its
    autocorrelation widens the band (Bartlett's variance). The residuals of an estimate, with the
    inputs of its records:

        print(jaxid.residual_tests(fit, signals=train))

    Args:
        residuals: an estimate, or `v = z - y`, shape (case, time, output) [output units].
        mask: valid samples, shape (case, time, output); not for an estimate.
        signals: by name, shape (case, time) each [any], or the records of the residuals, whose
            inputs are the signals; whiteness alone is tested without them.
        outputs: names of the channels; not for an estimate.
        level: probability of a false alarm, over all channels.
        lags: longest lag [samples]; at most a fifth of the rows is used.

    Returns:
        The tests with their results; works under `jit` and `vmap`.

    Raises:
        InputError: if there are more or fewer names than channels, the signals have
            another number of records or samples, an estimate has several cases, or level or lags
            are out of range.
    """
    residuals, mask, names = _channels(residuals, mask, outputs)
    by_name = _signals(signals, residuals.shape[:2])
    rows, channels = residuals.shape[1:]
    require_level(level, 0.01)
    require(lags >= 1, f"lags is {lags}; choose 1 or more.")
    s = as_columns([*by_name.values()], shape=mask.shape[:2])
    numbers = _numbers(
        residuals, mask, s, to_device(np.asarray(level / channels)), min(lags, max(rows // 5, 1))
    )
    return ResidualTests(names, tuple(by_name), level, *numbers)


def _channels(residuals, mask, outputs) -> tuple[Array, Array, tuple[str, ...]]:
    """Return residuals, mask and names of the channels, of an estimate or as given."""
    if isinstance(residuals, Estimate):
        require(
            mask is None and outputs is None,
            "An estimate has the mask and the names of its outputs. Give the records alone, as "
            "`signals=records`.",
        )
        require(
            residuals.values.ndim == 1,
            "Residual tests are of one estimate, and this is a batch of them. Select one of them.",
        )
        return residuals.residuals, residuals.mask, residuals.model.outputs
    if mask is None or outputs is None:
        raise InputError(
            "Residuals need `mask`, the valid samples, and `outputs`, their names. An estimate has "
            "both: `residual_tests(fit, signals=records)`."
        )
    shape, valid = np.shape(residuals), np.shape(mask)
    require(
        len(shape) == 3 and valid == shape,
        f"The residuals have the shape {shape} and `mask` {valid}. Give both as (record, sample, "
        "output); `v[None]` makes a stack of one record.",
    )
    channels = shape[2]
    require(
        len(outputs) == channels,
        f"There are {channels} residual channels and {len(outputs)} names. Name each once.",
    )
    return jnp.asarray(residuals), jnp.asarray(mask), tuple(outputs)


def _signals(signals, shape: tuple[int, ...]) -> dict[str, Array]:
    """Return the signals by name; the signals of records are their inputs."""
    if signals is None:
        return {}
    if not isinstance(signals, Mapping):
        records = as_stack(signals)
        signals = dict(zip(records.inputs, jnp.moveaxis(records.u, -1, 0), strict=True))
    for name, signal in signals.items():
        require(
            jnp.shape(signal) == shape,
            f"The signal {name!r} has the shape {jnp.shape(signal)}, and the residuals have "
            f"{shape[0]} records of {shape[1]} samples. Give the records of the estimate.",
        )
    return dict(signals)


@on_host
def _at_least(xp, p_values, *, level: float):
    """Return True for each p-value from a level on."""
    return xp.asarray(p_values >= level)


@on_host
def _below(xp, p_values, *, level: float):
    """Return True for each p-value below a level."""
    return xp.asarray(p_values < level)


@fast_compile_jit
def _numbers(residuals, mask, s, level, lags):
    """Arrays of `ResidualTests`, in their order; `level` is the level of one channel."""
    white = ljung_box(residuals, mask, lags)
    r, r_s = autocorrelation(residuals, mask, lags), _signal_autocorrelation(s, mask, lags)
    colour = jnp.where((white.p_value < level)[:, None], _bartlett(r, r_s), 1.0)
    cross, band = cross_correlation(residuals, mask, s, lags)
    band = band * jnp.sqrt(colour)[..., None]
    deviations = (jnp.abs(cross) * BAND * _ratio(jnp.asarray(1.0), band))[..., lags:]
    p_value = jnp.minimum(2 * (lags + 1) * norm.sf(jnp.max(deviations, axis=-1)), 1.0)
    own_band = BAND / jnp.sqrt(jnp.maximum(jnp.sum(mask, axis=(0, 1)), 1))
    return r, own_band, white, cross, band, p_value, jnp.argmax(deviations, axis=-1)


def _autocorrelation(v, mask, lags):
    """Return `r_k` and the number of pairs, each (lag, output)."""
    v, both = jnp.where(mask, v, 0.0), mask * 1.0
    # Channel by channel, so that a record with many channels does not form all their products.
    by_channel = jax.vmap(
        lambda a: _lagged(a[..., None], a[..., None], lags)[lags:, 0, 0], in_axes=-1, out_axes=-1
    )
    pairs = jnp.round(by_channel(both))
    return _ratio(_ratio(by_channel(v), pairs), _mean_square(v, mask)[None]), pairs


def _signal_autocorrelation(s, mask, lags):
    """Autocorrelation of the signals about their means, (signal, lag)."""
    known = jnp.isfinite(s) & _recorded(mask)[..., None]
    return autocorrelation(_centred(s, known), known, lags)


def _bartlett(r_v, r_s):
    """`sum_j rho_v(j) rho_s(j)` over both sides under a triangular window, at least 1, (output,
    signal).
    """
    window = 1.0 - jnp.arange(r_v.shape[1]) / r_v.shape[1]
    return jnp.maximum(
        1.0 + 2.0 * jnp.einsum("jk,sk->js", r_v[:, 1:] * window[None, 1:], r_s[:, 1:]), 1.0
    )


def _lagged(a, b, lags):
    """`sum_case sum_i a_i b_(i+k)` for k from -lags to lags, (lag, channel of b, channel of a), by
    FFT unwrapped.
    """
    size = 1 << (a.shape[1] + lags).bit_length()
    spectra = jnp.fft.rfft(a, size, axis=1), jnp.fft.rfft(b, size, axis=1)
    sums = jnp.fft.irfft(jnp.einsum("cfs,cfj->fjs", jnp.conj(spectra[0]), spectra[1]), size, axis=0)
    return jnp.concatenate([sums[size - lags :], sums[: lags + 1]])


def _recorded(mask):
    """Rows up to the last one with a valid sample, (case, time), without the padding of a stack."""
    return jax.lax.cummax(jnp.any(mask, axis=-1).astype(int), axis=1, reverse=True) > 0


def _centred(s, known):
    """Signals about their means over the known values, zero elsewhere."""
    mean = _ratio(jnp.sum(jnp.where(known, s, 0.0), axis=(0, 1)), jnp.sum(known, axis=(0, 1)))
    return jnp.where(known, s - mean[None, None], 0.0)


def _mean_square(x, mask):
    return jnp.sum(jnp.where(mask, x, 0.0) ** 2, axis=(0, 1)) / jnp.maximum(
        jnp.sum(mask, axis=(0, 1)), 1
    )


def _ratio(a, b):
    """`a / b`, zero where b is zero, and not a number where one of them is not."""
    return jnp.where(b == 0, 0.0, a / jnp.where(b == 0, 1.0, b))
