"""Input signals as functions of continuous time: smooth, stepped, and a blend of the two."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float, Int
from ..effects.rate_hysteresis import AbstractMemoryOperator


class AbstractInputSignal(eqx.Module):
    """An input signal as a function of continuous time."""

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""]) -> Float[Array, " input"]:
        """Return the value at one time; at a jump, the value after it."""

    @abc.abstractmethod
    def stages(self, t: Float[Array, " time"], substeps: int) -> Float[Array, "step stage=3 input"]:
        """Return the values at the start, middle and end of every Runge-Kutta step.

        There are `substeps` steps in each interval. A jump never lies inside a step: each step
        uses the limits from its side.
        """

    @abc.abstractmethod
    def delayed(self, channel: int, delay: Float[Array, ""]) -> "AbstractInputSignal":
        """Return the signal with one channel delayed by `delay` [s]."""

    @abc.abstractmethod
    def corners(self) -> Float[Array, " corner"] | None:
        """Return the ordered times of jumps and bends: an adaptive solver starts a step there."""

    @abc.abstractmethod
    def blend_band_limited(self, channel: int, weight: Float[Array, ""]) -> "AbstractInputSignal":
        """Return the signal with one channel blended with its band-limited interpolation.

        The weight of the latter is `weight`.
        """

    @abc.abstractmethod
    def followed(
        self, channel: int, follower: AbstractMemoryOperator, weight: Float[Array, ""]
    ) -> "AbstractInputSignal":
        """Return the signal with one channel blended with the output of a memory operator.

        The weight of the latter is `weight`.
        """


class SmoothSignal(AbstractInputSignal):
    """A continuous signal through knots: straight lines, or cubics if slopes are given.

    Args:
        knots: strictly increasing times [s].
        values: the input at the knots.
        delay: delay of each channel [s].
        end: time of the last real sample, after which there is padding [s].
        slopes: rates of the input at the knots.
        parts: number of lines from one sample to the next.
    """

    knots: Float[Array, " knot"]
    values: Float[Array, "knot input"]
    delay: Float[Array, " input"]
    end: Float[Array, ""]
    slopes: Float[Array, "knot input"] | None = None
    parts: int = eqx.field(static=True, default=1)

    def _at(self, t):
        """Return the values at any number of times; the signal is constant outside the samples."""

        def channel(values, delay, slopes):
            # At zero delay the derivative is one-sided, of a signal that is delayed: constant at
            # its first sample.
            late = jnp.where(t - delay > self.knots[0], t - delay, self.knots[0])
            late = jnp.where(late > self.end, self.end, late)
            return _interpolated(late, self.knots, values, slopes)

        return jax.vmap(channel, in_axes=(1, 0, 1), out_axes=-1)(
            self.values, self.delay, self.slopes
        )

    def __call__(self, t):
        return self._at(t[None])[0]

    def stages(self, t, substeps):
        begin, length = substeps_of(t, substeps)
        times = begin[:, None] + length[:, None] * jnp.array([[0.0, 0.5, 1.0]])
        return self._at(times.reshape(-1)).reshape(*times.shape, -1)

    def delayed(self, channel, delay):
        return eqx.tree_at(lambda path: path.delay, self, self.delay.at[channel].add(delay))

    def blend_band_limited(self, channel, weight):
        return _blended_band_limited(self, channel, weight)

    def followed(self, channel, follower, weight):
        if self.slopes is None:
            path = self if self.parts >= follower.parts else self._cut(follower.parts)
            values, _ = follower.on_ramps(path.knots, path.values[:, channel], None)
            return _blended(path, channel, values, weight)
        slopes = self.slopes[:, channel]
        values, running = follower.on_ramps(self.knots, self.values[:, channel], slopes)
        assert running is not None
        slopes = self.slopes.at[:, channel].add(weight * (running - slopes))
        return eqx.tree_at(
            lambda signal: signal.slopes, _blended(self, channel, values, weight), slopes
        )

    def _cut(self, parts: int) -> "SmoothSignal":
        """Return the same signal with each straight line cut into `parts` lines."""

        def finer(leaf):
            share = (jnp.arange(parts) / parts).reshape(1, parts, *(1,) * (leaf.ndim - 1))
            inner = (1.0 - share) * leaf[:-1, None] + share * leaf[1:, None]
            return jnp.concatenate([inner.reshape(-1, *leaf.shape[1:]), leaf[-1:]])

        return SmoothSignal(
            finer(self.knots), finer(self.values), self.delay, self.end, parts=parts
        )

    def corners(self):
        return _shifted_knots(self) if self.slopes is None else None


class SteppedSignal(AbstractInputSignal):
    """A piecewise constant signal, each sample held until the next.

    With a delay the jumps fall inside a step, several of them inside a step longer than an interval
    between samples. The step then uses the mean of the signal over its length, which keeps the
    impulse and is differentiable in the delay.

    Args:
        knots: strictly increasing times [s].
        values: the input from each knot on.
        delay: delay of each channel [s].
        end: time of the last real sample, after which there is padding [s].
    """

    knots: Float[Array, " knot"]
    values: Float[Array, "knot input"]
    delay: Float[Array, " input"]
    end: Float[Array, ""]

    def __call__(self, t):
        late = t - self.delay + 1e-9 * (self.knots[1] - self.knots[0])  # a delayed jump is rounded
        index = jnp.searchsorted(self.knots, late, side="right") - 1
        return jnp.take_along_axis(self.values, jnp.clip(index, 0)[None, :], axis=0)[0]

    def stages(self, t, substeps):
        begin, length = substeps_of(t, substeps)
        safe = jnp.where(length > 0, length, 1.0)
        # A jump at the start of a step counts to it, one at the end does not: a positive delay
        # moves it inside.
        edge = 1e-9 * length

        def held(time):
            """Return the row of the sample held at a time."""
            return jnp.clip(jnp.searchsorted(self.knots, time, side="right") - 1, 0)

        def channel(values, delay):
            start, end = begin - delay, begin + length - delay
            first, last = held(start - edge), held(end - edge)
            # Integral of the signal less its first value, which without a jump is exactly zero.
            jump = jnp.minimum(first + 1, last)
            area = jnp.cumsum(jnp.append(0.0, values[:-1] * jnp.diff(self.knots)))
            excess = area[last] - area[jump] - values[first] * (self.knots[last] - self.knots[jump])
            excess += (values[last] - values[first]) * (end - self.knots[last])
            return values[first] + excess / safe

        mean = jax.vmap(channel, in_axes=(1, 0), out_axes=-1)(self.values, self.delay)
        return jnp.repeat(mean[:, None], 3, axis=1)

    def delayed(self, channel, delay):
        return eqx.tree_at(lambda path: path.delay, self, self.delay.at[channel].add(delay))

    def blend_band_limited(self, channel, weight):
        return _blended_band_limited(self, channel, weight)

    def followed(self, channel, follower, weight):
        return _blended(
            self, channel, follower.on_holds(self.knots, self.values[:, channel]), weight
        )

    def corners(self):
        return _shifted_knots(self)


class BlendedSignal(AbstractInputSignal):
    """Blend `(1 - weight) original + weight band_limited` of a signal, channel by channel.

    Args:
        original: the signal.
        band_limited: the band-limited interpolation of all its channels.
        weight: weight of the band-limited interpolation of each channel.
    """

    original: AbstractInputSignal
    band_limited: AbstractInputSignal
    weight: Float[Array, " input"]

    def __call__(self, t):
        return (1.0 - self.weight) * self.original(t) + self.weight * self.band_limited(t)

    def stages(self, t, substeps):
        original, band_limited = (
            self.original.stages(t, substeps),
            self.band_limited.stages(t, substeps),
        )
        weight = self.weight[None, None]
        return (1.0 - weight) * original + weight * band_limited

    def delayed(self, channel, delay):
        return BlendedSignal(
            self.original.delayed(channel, delay),
            self.band_limited.delayed(channel, delay),
            self.weight,
        )

    def blend_band_limited(self, channel, weight):
        before = self.weight[channel]
        return BlendedSignal(
            self.original,
            self.band_limited,
            self.weight.at[channel].set(before + weight - before * weight),
        )

    def followed(self, channel, follower, weight):
        original, band_limited = (
            path.followed(channel, follower, weight) for path in (self.original, self.band_limited)
        )
        return BlendedSignal(original, band_limited, self.weight)

    def corners(self):
        return discontinuities_of(self.original, self.band_limited)


def discontinuities_of(*paths: AbstractInputSignal) -> Float[Array, " corner"] | None:
    """Return the ordered times at which any of the signals jumps or bends."""
    times = [corners for path in paths if (corners := path.corners()) is not None]
    return jnp.sort(jnp.concatenate(times)) if times else None


def _interpolated(
    t: Float[Array, " time"],
    knots: Float[Array, " knot"],
    values: Float[Array, " knot"],
    slopes: Float[Array, " knot"] | None,
):
    """Return the interpolation between knots at times between the first and the last, by straight
    lines, or by cubics if slopes are given.

    A knot belongs to the line before it: at zero delay, the derivative by the delay is then that of
    a delayed signal, not of an advanced one.
    """
    index = jnp.clip(
        jnp.searchsorted(knots + 1e-9 * jnp.diff(knots, append=knots[-1:]), t), 1, knots.size - 1
    )
    begin, end = knots[index - 1], knots[index]
    share = (t - begin) / (end - begin)
    line = (1.0 - share) * values[index - 1] + share * values[index]
    if slopes is None:
        return line
    # The cubic less the line: a Hermite polynomial of the slopes in excess of the line's.
    rise = (values[index] - values[index - 1]) / (end - begin)
    first, last = slopes[index - 1] - rise, slopes[index] - rise
    bend = (1.0 - share) * first - share * last
    return line + (t - begin) * (1.0 - share) * bend


def _blended_band_limited(
    path: SmoothSignal | SteppedSignal, channel: int, weight: Float[Array, ""]
) -> BlendedSignal:
    """Return the blend of a signal with the band-limited interpolation of its samples."""
    parts = path.parts if isinstance(path, SmoothSignal) else 1
    other = band_limited_signal(jnp.minimum(path.knots, path.end)[::parts], path.values[::parts])
    other = eqx.tree_at(lambda path: path.delay, other, path.delay)
    return BlendedSignal(path, other, jnp.zeros(path.delay.size).at[channel].set(weight))


def _blended(path, channel: int, values: Float[Array, " knot"], weight: Float[Array, ""]):
    """Return a signal with one channel blended with other values, by `weight`."""
    original = path.values[:, channel]
    return eqx.tree_at(
        lambda signal: signal.values,
        path,
        path.values.at[:, channel].add(weight * (values - original)),
    )


def _shifted_knots(path: SmoothSignal | SteppedSignal) -> Float[Array, " corner"]:
    """Return the ordered knots of all channels, each shifted by its delay."""
    return jnp.sort((path.knots[:, None] + path.delay[None]).reshape(-1))


def band_limited_signal(
    t: Float[Array, " time"], u: Float[Array, "time input"], half_width: int = 32
) -> SmoothSignal:
    """Return the band-limited interpolation by a windowed sinc of `2 half_width` samples."""
    last, half, fine = last_row(t), half_width, 8
    offsets = np.arange(-half * fine, half * fine + 1) / fine
    kernel = np.sinc(offsets) * np.kaiser(offsets.size, 10.0)
    at = jnp.arange(-half, t.size + half)
    within = jnp.clip(at, 0, last)
    mirrored = jnp.clip(2 * within - at, 0, last)
    extended = jnp.where((at == within)[:, None], u[within], 2.0 * u[within] - u[mirrored])
    spread = (
        jnp.zeros((extended.shape[0], fine, u.shape[1]))
        .at[:, 0]
        .set(extended)
        .reshape(-1, u.shape[1])
    )
    smooth = jax.vmap(
        lambda v: jax.scipy.signal.fftconvolve(v, jnp.asarray(kernel), mode="same"), 1, 1
    )(spread)
    smooth = smooth.at[::fine].set(extended)
    step = (t[-1] - t[0]) / (last * fine)
    grid = t[0] + step * jnp.arange((t.size - 1) * fine + 1)
    near, far = (jnp.roll(smooth, -k, 0) - jnp.roll(smooth, k, 0) for k in (1, 2))
    slopes = (8.0 * near - far) / (12.0 * step)  # of fourth order, like the error of the cubics
    values, slopes = (array[half * fine :][: grid.size] for array in (smooth, slopes))
    return SmoothSignal(grid, values, jnp.zeros(u.shape[1]), grid[last * fine], slopes)


def last_row(t: Float[Array, " time"]) -> Int[Array, ""]:
    """Return the row of the last real sample, after which the time is constant."""
    return jnp.sum(jnp.diff(t) > 0)


def substeps_of(t: Float[Array, " time"], substeps: int):
    """Return the start and length of each of the (time - 1) * substeps steps, shapes (step,)."""
    length = jnp.repeat(jnp.diff(t) / substeps, substeps)
    begin = jnp.repeat(t[:-1], substeps) + jnp.tile(jnp.arange(substeps), t.size - 1) * length
    return begin, length
