"""Time grids: continuation of padding, typical step, uniformity, holes."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .types import Array, Bool, Float

# Median steps: a longer step is a hole. With 20 samples in a period of the fastest motion, w h is
# 0.31 at the median step. One Runge-Kutta step of 5 median steps has w h = 1.6 and an error of
# (w h)^5/120 = 8 % of the motion; from 9 median steps on (w h = 2.8) the method is unstable.
HOLE = 5.0


class Hole(NamedTuple):
    """A step of a time base that is far above the median of its record.

    Attributes:
        case: index of the record in its stack; 0 for a single record.
        row: the last row before the hole.
        start, end: times of this row and of the next [s].
        ratio: length of the step in median steps.
    """

    case: int
    row: int
    start: float
    end: float
    ratio: float


def holes(t: Float[np.ndarray, "*case time"], longest: float = HOLE) -> list[Hole]:
    """Return the steps longer than `longest` median steps of their record, in order.

    Padding, where time stands still, does not count.
    """
    gaps = []
    for case, times in enumerate(np.reshape(t, (-1, t.shape[-1]))):
        step = np.diff(times)
        real = step > 0
        typical = np.median(step[real]) if real.any() else np.inf
        for row in np.flatnonzero(step > longest * (1.0 + 1e-6) * typical):
            ratio = float(step[row] / typical)
            gaps.append(Hole(case, int(row), float(times[row]), float(times[row + 1]), ratio))
    return gaps


def strictly_increasing(t: Float[Array, " time"]) -> Float[Array, " time"]:
    """Return the grid with its padding (repeated times) replaced by steps of the first length.

    Interpolation needs distinct knots; no query ever falls into the padding. The other times stay
    the same bit for bit, so that a sample belongs to its own knot.
    """
    step, row = jnp.diff(t), jnp.arange(t.size)
    last = jnp.sum(step > 0)
    return jnp.where(row <= last, t, t[last] + step[0] * (row - last))


@eqx.filter_jit
def typical_step(t: Float[Array, "*case time"]) -> Float[Array, ""]:
    """Return the median of all non-zero steps."""
    step = jnp.diff(t, axis=-1)
    return jnp.nanmedian(jnp.where(step > 0, step, jnp.nan))


def is_uniform(t: Float[np.ndarray, "*case time"], tolerance: float = 1e-6) -> bool:
    """Whether all real steps are equal, up to a tolerance relative to them and the rounding of the
    times.
    """
    step = np.diff(np.asarray(t), axis=-1)
    real: Bool[np.ndarray, "*case time"] = step > 0
    typical = np.median(step[real])
    rounding = 4.0 * np.finfo(float).eps * float(np.max(np.abs(t)))
    return bool(np.all(np.abs(step[real] - typical) <= tolerance * typical + rounding))


def is_uniform_by_record(t: Float[np.ndarray, "*case time"]) -> bool:
    """Whether the steps of each record are equal; those of two records may differ."""
    return all(is_uniform(times) for times in np.reshape(t, (-1, t.shape[-1])))


def uneven_steps(t: Float[np.ndarray, "*case time"]) -> str | None:
    """Return a description of the steps of all records; None if they are equal."""
    if is_uniform(t):
        return None
    if not is_uniform_by_record(t):
        return "these sample times are uneven"
    steps = t[..., 1] - t[..., 0]
    return f"the records have steps of {np.min(steps):.6g} to {np.max(steps):.6g} s"


def standing_row(t: Float[np.ndarray, "*case time"]) -> tuple[int, int] | None:
    """Return the case and row of the first time that is not after the one before it, padding at the
    end left out; None if all are.
    """
    step = np.diff(np.reshape(t, (-1, t.shape[-1])))
    moving = step != 0
    padding = ~np.logical_or.accumulate(moving[:, ::-1], axis=1)[:, ::-1]
    padding &= np.any(moving, axis=1, keepdims=True)
    wrong = np.argwhere(~(step > 0) & ~padding)
    return (int(wrong[0, 0]), int(wrong[0, 1]) + 1) if wrong.size else None
