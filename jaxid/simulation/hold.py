"""Holds: interpolation of an input between its samples."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require
from .._foundation.grid import is_uniform_by_record, strictly_increasing
from .._foundation.types import Array, Float, Int, Numbers
from .input_signal import (
    AbstractInputSignal,
    SmoothSignal,
    SteppedSignal,
    band_limited_signal,
    last_row,
)


class AbstractHold(eqx.Module):
    """Interpolation of an input between its samples."""

    @abc.abstractmethod
    def path(self, t: Float[Array, " time"], u: Float[Array, "time input"]) -> AbstractInputSignal:
        """Return the continuous input through the samples of one record."""

    def check(self, t: Float[Array, "*case time"]) -> None:
        """Check that the hold is defined for the sample times."""


class ZeroOrder(AbstractHold):
    """Each sample is held until the next, as at the output of a digital controller."""

    def path(self, t, u):
        knots = strictly_increasing(t)
        return SteppedSignal(knots, u, jnp.zeros(u.shape[1]), knots[last_row(t)])


class Linear(AbstractHold):
    """Linear interpolation between the samples: the usual choice for measured positions."""

    def path(self, t, u):
        knots = strictly_increasing(t)
        return SmoothSignal(knots, u, jnp.zeros(u.shape[1]), knots[last_row(t)])


class Cubic(AbstractHold):
    """A cubic spline through the samples, twice differentiable, for smooth inputs sampled slowly.

    The first two intervals share one cubic, and the last two share one (de Boor, A Practical
    Guide to Splines, chapter IV).
    """

    def path(self, t, u):
        knots = strictly_increasing(t)
        return SmoothSignal(
            knots,
            u,
            jnp.zeros(u.shape[1]),
            knots[last_row(t)],
            _spline_slopes(knots, u, last_row(t)),
        )

    def check(self, t):
        require(
            _fewest_samples(t) > 3,
            f"A cubic spline needs more than 3 samples in each record, and there is one with "
            f"{_fewest_samples(t)}. Use Linear().",
        )


class BandLimited(AbstractHold):
    """The unique signal through the samples without content above half the sampling rate.

        u(t) = sum_k u_k sinc((t - t_k)/T) w((t - t_k)/T)

    with w a Kaiser window over 2 `half_width` samples. It is evaluated on a grid eight times finer
    and by local cubics in between, with an error of 1e-5 of a component at a third of the sampling
    rate. Beyond its ends the signal is continued by point
    reflection (Oppenheim & Schafer, Discrete-Time Signal Processing, sections 4.2 and 7.5). The
    sampling of each record must be uniform.
    """

    half_width: int = eqx.field(static=True, default=32)

    def path(self, t, u):
        return band_limited_signal(t, u, self.half_width)

    def check(self, t):
        require(
            is_uniform_by_record(np.asarray(t)),
            "A band-limited input needs uniform sampling, and these sample times are uneven. Use "
            "Cubic() or Linear().",
        )
        require(
            _fewest_samples(t) > self.half_width,
            f"A band-limited input needs more than {self.half_width} samples in each record, and "
            f"there is one with {_fewest_samples(t)}. Use Cubic(), or a smaller half_width.",
        )


def _fewest_samples(t: Float[Numbers, "*case time"]) -> int:
    """Return the number of samples of the shortest record, without its padding."""
    return int(np.min(np.sum(np.diff(np.asarray(t)) > 0, axis=-1))) + 1


def _spline_slopes(
    knots: Float[Array, " time"], values: Float[Array, "time input"], last: Int[Array, ""]
) -> Float[Array, "time input"]:
    """Return the slopes at the knots of the cubic spline that ends at row `last`.

    Later rows are ignored.
    """
    h = jnp.diff(knots)
    rise = jnp.diff(values, axis=0) / h[:, None]

    def end(h0, h1, rise0, rise1):
        """Return the equation at an end: one cubic for the last interval and its neighbour."""
        return h1, h0 + h1, ((3.0 * h0 + 2.0 * h1) * h1 * rise0 + h0**2 * rise1) / (h0 + h1)

    first_row = end(h[0], h[1], rise[0], rise[1])
    last_row = end(h[last - 1], h[last - 2], rise[last - 1], rise[last - 2])
    row = jnp.arange(knots.size)
    inner, at_end = (row > 0) & (row < last), row == last
    before, after = jnp.pad(h, (1, 0)), jnp.pad(h, (0, 1))
    lower = jnp.where(inner, after, jnp.where(at_end, last_row[1], 0.0))
    diagonal = (
        jnp.where(inner, 2.0 * (before + after), jnp.where(at_end, last_row[0], 1.0))
        .at[0]
        .set(first_row[0])
    )
    upper = jnp.where(inner, before, 0.0).at[0].set(first_row[1])
    pair = (
        before[:, None],
        after[:, None],
        jnp.pad(rise, ((1, 0), (0, 0))),
        jnp.pad(rise, ((0, 1), (0, 0))),
    )
    right = jnp.where(inner[:, None], 3.0 * (pair[0] * pair[3] + pair[1] * pair[2]), 0.0)
    right = jnp.where(at_end[:, None], last_row[2][None], right).at[0].set(first_row[2])
    return jax.lax.linalg.tridiagonal_solve(lower, diagonal, upper, right)
