"""How an input runs between its samples: zero-order hold, straight lines, cubic spline, band-limited."""

import abc

import equinox as eqx
import interpax
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require
from .._foundation.grid import is_uniform, strictly_increasing
from .._foundation.types import Array, Float, Int
from ..models.followers import AbstractFollower


class AbstractPath(eqx.Module):
    """An input signal as a function of continuous time."""

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""]) -> Float[Array, " input"]:
        """The value at one time; at a jump, the value after it."""

    @abc.abstractmethod
    def stages(self, t: Float[Array, " time"], substeps: int) -> Float[Array, "step stage=3 input"]:
        """The values that a Runge-Kutta step sees at its start, middle and end, for `substeps` steps in each interval.

        A jump never lies inside a step: each step sees the limits from its own side.
        """

    @abc.abstractmethod
    def delayed(self, channel: int, delay: Float[Array, ""]) -> "AbstractPath":
        """The path with one channel later by `delay` [s]."""

    @abc.abstractmethod
    def corners(self) -> Float[Array, " corner"] | None:
        """Times, in order, at which the path jumps or bends, where an adaptive solver must start a step anew."""

    @abc.abstractmethod
    def towards_band_limited(self, channel: int, weight: Float[Array, ""]) -> "AbstractPath":
        """The path with one channel moved by `weight` towards the band-limited run through the same samples."""

    @abc.abstractmethod
    def followed(self, channel: int, follower: AbstractFollower, weight: Float[Array, ""]) -> "AbstractPath":
        """The path with one channel moved by `weight` towards what follows it."""


class Smooth(AbstractPath):
    """A continuous path through knots: straight lines, or cubics where the slopes at the knots are given.

    Args:
        knots: strictly increasing times [s].
        values: the input at the knots.
        delay: by how much each channel is late [s].
        end: the last real sample, behind which stands padding [s].
        slopes: the rate of the input at the knots.
        parts: lines from one sample to the next.
    """

    knots: Float[Array, " knot"]
    values: Float[Array, "knot input"]
    delay: Float[Array, " input"]
    end: Float[Array, ""]
    slopes: Float[Array, "knot input"] | None = None
    parts: int = eqx.field(static=True, default=1)

    def _at(self, t):
        """Values at any number of times; before the first sample and after the last the signal stands still."""

        def channel(values, delay, slopes):
            # With no delay yet, the derivative is that of a signal that comes later: it stands still at its first sample.
            late = jnp.where(t - delay > self.knots[0], t - delay, self.knots[0])
            late = jnp.where(late > self.end, self.end, late)
            if slopes is None:
                return _straight(late, self.knots, values)
            with jax.numpy_rank_promotion("allow"):  # interpax promotes ranks inside
                return interpax.interp1d(late, self.knots, values, method="cubic", fx=slopes)

        return jax.vmap(channel, in_axes=(1, 0, 1), out_axes=-1)(self.values, self.delay, self.slopes)

    def __call__(self, t):
        return self._at(t[None])[0]

    def stages(self, t, substeps):
        begin, length = substeps_of(t, substeps)
        times = begin[:, None] + length[:, None] * jnp.array([[0.0, 0.5, 1.0]])
        return self._at(times.reshape(-1)).reshape(*times.shape, -1)

    def delayed(self, channel, delay):
        return eqx.tree_at(lambda path: path.delay, self, self.delay.at[channel].add(delay))

    def towards_band_limited(self, channel, weight):
        return _towards_band_limited(self, channel, weight)

    def followed(self, channel, follower, weight):
        if self.slopes is None:
            path = self if self.parts >= follower.parts else self._cut(follower.parts)
            values, _ = follower.of_lines(path.knots, path.values[:, channel], None)
            return _moved(path, channel, values, weight)
        slopes = self.slopes[:, channel]
        values, running = follower.of_lines(self.knots, self.values[:, channel], slopes)
        assert running is not None
        slopes = self.slopes.at[:, channel].add(weight * (running - slopes))
        return eqx.tree_at(lambda one: one.slopes, _moved(self, channel, values, weight), slopes)

    def _cut(self, parts: int) -> "Smooth":
        """The same straight lines between the samples, each cut into so many."""

        def finer(leaf):
            share = (jnp.arange(parts) / parts).reshape(1, parts, *(1,) * (leaf.ndim - 1))
            inner = (1.0 - share) * leaf[:-1, None] + share * leaf[1:, None]
            return jnp.concatenate([inner.reshape(-1, *leaf.shape[1:]), leaf[-1:]])

        return Smooth(finer(self.knots), finer(self.values), self.delay, self.end, parts=parts)

    def corners(self):
        return _times(self) if self.slopes is None else None


class Steps(AbstractPath):
    """A piecewise constant path, each sample held until the next.

    With a delay the jumps fall inside a step; the step then sees the mean of the signal over its length, which keeps the
    impulse and is differentiable in the delay.

    Args:
        knots: strictly increasing times [s].
        values: the input from each knot on.
        delay: by how much each channel is late [s].
        end: the last real sample, behind which stands padding [s].
    """

    knots: Float[Array, " knot"]
    values: Float[Array, "knot input"]
    delay: Float[Array, " input"]
    end: Float[Array, ""]

    def __call__(self, t):
        index = jax.vmap(lambda delay: jnp.searchsorted(self.knots, t - delay, side="right") - 1)(self.delay)
        return jnp.take_along_axis(self.values, jnp.clip(index, 0)[None, :], axis=0)[0]

    def stages(self, t, substeps):
        begin, length = substeps_of(t, substeps)
        safe = jnp.where(length > 0, length, 1.0)

        def channel(values, delay):
            # A step is no longer than an interval between knots, so that it meets one jump at most.
            # Of one that starts on a jump this is the one: with no delay yet, jumps are about to come later, not earlier.
            index = jnp.searchsorted(self.knots, begin - delay - 1e-9 * length, side="right") - 1
            now, then = jnp.clip(index, 0), jnp.clip(index + 1, 0, self.knots.size - 1)
            over = begin + length - delay - self.knots[then]
            share = jnp.where((over > 1e-9 * length) & (index >= 0), over / safe, 0.0)
            return values[now] + share * (values[then] - values[now])

        mean = jax.vmap(channel, in_axes=(1, 0), out_axes=-1)(self.values, self.delay)
        return jnp.repeat(mean[:, None], 3, axis=1)

    def delayed(self, channel, delay):
        return eqx.tree_at(lambda path: path.delay, self, self.delay.at[channel].add(delay))

    def towards_band_limited(self, channel, weight):
        return _towards_band_limited(self, channel, weight)

    def followed(self, channel, follower, weight):
        return _moved(self, channel, follower.of_steps(self.knots, self.values[:, channel]), weight)

    def corners(self):
        return _times(self)


class Blend(AbstractPath):
    """A path on its way to the band-limited run through its samples: `(1 - weight) one + weight other`, channel by channel.

    Args:
        one: the path as it was.
        other: the band-limited run of all channels.
        weight: of the latter, by channel.
    """

    one: AbstractPath
    other: AbstractPath
    weight: Float[Array, " input"]

    def __call__(self, t):
        return (1.0 - self.weight) * self.one(t) + self.weight * self.other(t)

    def stages(self, t, substeps):
        one, other = self.one.stages(t, substeps), self.other.stages(t, substeps)
        weight = self.weight[None, None]
        return (1.0 - weight) * one + weight * other

    def delayed(self, channel, delay):
        return Blend(self.one.delayed(channel, delay), self.other.delayed(channel, delay), self.weight)

    def towards_band_limited(self, channel, weight):
        before = self.weight[channel]
        return Blend(self.one, self.other, self.weight.at[channel].set(before + weight - before * weight))

    def followed(self, channel, follower, weight):
        one, other = (path.followed(channel, follower, weight) for path in (self.one, self.other))
        return Blend(one, other, self.weight)

    def corners(self):
        return corners_of(self.one, self.other)


def corners_of(*paths: AbstractPath) -> Float[Array, " corner"] | None:
    """Times, in order, at which any of the paths jumps or bends."""
    found = [corners for path in paths if (corners := path.corners()) is not None]
    return jnp.sort(jnp.concatenate(found)) if found else None


def _straight(t: Float[Array, " time"], knots: Float[Array, " knot"], values: Float[Array, " knot"]):
    """Straight lines between knots, at any times between the first and the last.

    A knot counts to the line before it: with no delay yet, the derivative in the delay is then that of a signal that comes
    later, and not one of a signal that comes early.
    """
    index = jnp.clip(jnp.searchsorted(knots + 1e-9 * jnp.diff(knots, append=knots[-1:]), t), 1, knots.size - 1)
    begin, end = knots[index - 1], knots[index]
    share = (t - begin) / (end - begin)
    return (1.0 - share) * values[index - 1] + share * values[index]


def _towards_band_limited(path: Smooth | Steps, channel: int, weight: Float[Array, ""]) -> Blend:
    """The blend of a path with the band-limited run through its samples."""
    parts = path.parts if isinstance(path, Smooth) else 1
    other = BandLimited().path(jnp.minimum(path.knots, path.end)[::parts], path.values[::parts])
    other = eqx.tree_at(lambda path: path.delay, other, path.delay)
    return Blend(path, other, jnp.zeros(path.delay.size).at[channel].set(weight))


def _moved(path, channel: int, values: Float[Array, " knot"], weight: Float[Array, ""]):
    """A path with the values of one channel moved by `weight` towards others."""
    own = path.values[:, channel]
    return eqx.tree_at(lambda one: one.values, path, path.values.at[:, channel].add(weight * (values - own)))


def _times(path: Smooth | Steps) -> Float[Array, " corner"]:
    """Knots of all channels, each late by its delay."""
    return jnp.sort((path.knots[:, None] + path.delay[None]).reshape(-1))


class AbstractHold(eqx.Module):
    """The rule by which an input runs between its samples."""

    @abc.abstractmethod
    def path(self, t: Float[Array, " time"], u: Float[Array, "time input"]) -> AbstractPath:
        """The continuous input through the samples of one record."""

    def check(self, t: Float[Array, "*case time"]) -> None:
        """Refuse sampling times on which this rule is not defined."""


class ZeroOrder(AbstractHold):
    """Each sample is held until the next, as a digital controller's output is."""

    def path(self, t, u):
        knots = strictly_increasing(t)
        return Steps(knots, u, jnp.zeros(u.shape[1]), knots[_last(t)])


class Linear(AbstractHold):
    """Straight lines between the samples: the usual choice for measured positions."""

    def path(self, t, u):
        knots = strictly_increasing(t)
        return Smooth(knots, u, jnp.zeros(u.shape[1]), knots[_last(t)])


class Cubic(AbstractHold):
    """A cubic spline through the samples, twice differentiable, for smooth inputs sampled slowly.

    Its first two intervals share one cubic, and so do its last two (de Boor, A Practical Guide to Splines, chapter IV).
    """

    def path(self, t, u):
        knots = strictly_increasing(t)
        return Smooth(knots, u, jnp.zeros(u.shape[1]), knots[_last(t)], _spline_slopes(knots, u, _last(t)))

    def check(self, t):
        require(t.shape[-1] > 3, "A cubic spline needs more than 3 samples. Use Linear().")


class BandLimited(AbstractHold):
    """The only signal through the samples without content above half the sampling rate, by a windowed sinc.

        u(t) = sum_k u_k sinc((t - t_k)/T) w((t - t_k)/T),   w a Kaiser window over 2 `half_width` samples

    evaluated on a grid eight times finer and by local cubics in between, which leaves 1e-5 of a component at a third of the
    sampling rate. Beyond its ends the signal is continued by point reflection (Oppenheim & Schafer, Discrete-Time Signal
    Processing, sections 4.2 and 7.5). The sampling must be uniform.
    """

    half_width: int = eqx.field(static=True, default=32)

    def path(self, t, u):
        last, half, fine = _last(t), self.half_width, 8
        offsets = np.arange(-half * fine, half * fine + 1) / fine
        kernel = np.sinc(offsets) * np.kaiser(offsets.size, 10.0)
        at = jnp.arange(-half, t.size + half)
        within = jnp.clip(at, 0, last)
        mirrored = jnp.clip(2 * within - at, 0, last)
        extended = jnp.where((at == within)[:, None], u[within], 2.0 * u[within] - u[mirrored])
        spread = jnp.zeros((extended.shape[0], fine, u.shape[1])).at[:, 0].set(extended).reshape(-1, u.shape[1])
        smooth = jax.vmap(lambda v: jax.scipy.signal.fftconvolve(v, jnp.asarray(kernel), mode="same"), 1, 1)(spread)
        smooth = smooth.at[::fine].set(extended)
        step = (t[-1] - t[0]) / (last * fine)
        grid = t[0] + step * jnp.arange((t.size - 1) * fine + 1)
        near, far = (jnp.roll(smooth, -k, 0) - jnp.roll(smooth, k, 0) for k in (1, 2))
        slopes = (8.0 * near - far) / (12.0 * step)  # of the fourth order, as the cubics are
        values, slopes = (array[half * fine :][: grid.size] for array in (smooth, slopes))
        return Smooth(grid, values, jnp.zeros(u.shape[1]), grid[last * fine], slopes)

    def check(self, t):
        require(
            is_uniform(np.asarray(t)),
            "A band-limited input needs uniform sampling, and these sample times are uneven. Use Cubic() or Linear().",
        )
        require(
            t.shape[-1] > self.half_width,
            f"A band-limited input needs more than {self.half_width} samples. Use Cubic(), or a smaller half_width.",
        )


def _last(t: Float[Array, " time"]) -> Int[Array, ""]:
    """The row of the last real sample, behind which time stands still."""
    return jnp.sum(jnp.diff(t) > 0)


def _spline_slopes(
    knots: Float[Array, " time"], values: Float[Array, "time input"], last: Int[Array, ""]
) -> Float[Array, "time input"]:
    """Slopes at the knots of the cubic spline that ends at row `last`; what stands behind it counts for nothing."""
    h = jnp.diff(knots)
    rise = jnp.diff(values, axis=0) / h[:, None]

    def end(h0, h1, rise0, rise1):
        """The equation at an end, from the interval there and its neighbour: one cubic for both."""
        return h1, h0 + h1, ((3.0 * h0 + 2.0 * h1) * h1 * rise0 + h0**2 * rise1) / (h0 + h1)

    first_row = end(h[0], h[1], rise[0], rise[1])
    last_row = end(h[last - 1], h[last - 2], rise[last - 1], rise[last - 2])
    row = jnp.arange(knots.size)
    inner, at_end = (row > 0) & (row < last), row == last
    before, after = jnp.pad(h, (1, 0)), jnp.pad(h, (0, 1))
    lower = jnp.where(inner, after, jnp.where(at_end, last_row[1], 0.0))
    diagonal = jnp.where(inner, 2.0 * (before + after), jnp.where(at_end, last_row[0], 1.0)).at[0].set(first_row[0])
    upper = jnp.where(inner, before, 0.0).at[0].set(first_row[1])
    pair = (before[:, None], after[:, None], jnp.pad(rise, ((1, 0), (0, 0))), jnp.pad(rise, ((0, 1), (0, 0))))
    right = jnp.where(inner[:, None], 3.0 * (pair[0] * pair[3] + pair[1] * pair[2]), 0.0)
    right = jnp.where(at_end[:, None], last_row[2][None], right).at[0].set(first_row[2])
    return jax.lax.linalg.tridiagonal_solve(lower, diagonal, upper, right)


def substeps_of(t: Float[Array, " time"], substeps: int):
    """Begin and length of every step, (time - 1) * substeps of them, in order of time: shapes (step,)."""
    length = jnp.repeat(jnp.diff(t) / substeps, substeps)
    begin = jnp.repeat(t[:-1], substeps) + jnp.tile(jnp.arange(substeps), t.size - 1) * length
    return begin, length
