"""Look-up tables on rectangular grids with named axes, differentiable in the signals and in every value."""

import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal, get_args

import equinox as eqx
import interpax
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._foundation.checks import InputError, require, require_known, require_unique
from .._foundation.types import Array, Float, Numbers

Interpolation = Literal["linear", "cubic", "monotone"]
Extrapolation = Literal["hold", "linear", "refuse"]
STENCIL = {"linear": 2, "cubic": 4, "monotone": 4}  # knots that a value between two of them depends on
SLOPES = {"cubic": "cubic", "monotone": "monotonic"}  # interpax's words


class Table(eqx.Module):
    r"""One quantity, or several that share a grid, looked up between knots of one to three named signals.

    Dimension by dimension, in the order of the axes, `f(s)` is `linear`: straight between two knots; `cubic`: the Hermite
    cubic whose slope at a knot is the mean of those of the two lines that meet there, continuous with its derivative; or
    `monotone`: the same with slopes that never pass the data (Fritsch and Butland), also in between. Outside the knots it
    is held, goes on along its slope at the edge (`linear`), or is NaN (`refuse`; `require_inside` says it in words).

    Only the knots around the point are touched: two in each dimension, or four, which give the slopes of the whole axis,
    at its ends too, for there the four are shifted inwards so that their own end is the end of the axis. At a knot of a
    linear table the derivative is the one to the right. With two axes or more a monotone table has kinks where the slope
    along a later axis changes sign from knot to knot of an earlier one. And where a value equals its neighbour, a monotone
    table has no derivative in that value, for the slope there stays zero to one side: free such values of a `cubic` one.

    Args:
        values: numbers on the grid, shape (*knots), or (*knots, quantity) where `quantities` are named.
        knots: for each axis at least two increasing numbers [SI].
        axes: name of the signal for each axis.
        units: unit for each axis, which only names use: an axis in `"rad"` shows degrees, `alpha=10`. None when left out.
        quantities: names of what shares the grid; empty for one.
        interpolation: between knots.
        extrapolation: beyond them.

    Raises:
        InputError: when knots are too few, unordered or not finite, a value is not finite, or shapes or names disagree.
    """

    values: Float[Array, "..."]
    knots: tuple[tuple[float, ...], ...] = eqx.field(static=True)
    axes: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    quantities: tuple[str, ...] = eqx.field(static=True)
    interpolation: Interpolation = eqx.field(static=True)
    extrapolation: Extrapolation = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("values",)

    def __init__(
        self,
        values: Numbers | Sequence,
        knots: Sequence[Sequence[float] | np.ndarray],
        axes: Sequence[str],
        *,
        units: Sequence[str] | None = None,
        quantities: Sequence[str] = (),
        interpolation: Interpolation = "linear",
        extrapolation: Extrapolation = "hold",
    ):
        self.values = jnp.asarray(values, float)
        self.knots = tuple(tuple(float(knot) for knot in line) for line in knots)
        self.axes, self.quantities = tuple(axes), tuple(quantities)
        self.units = ("",) * len(self.axes) if units is None else tuple(units)
        self.interpolation, self.extrapolation = interpolation, extrapolation
        _check(self)

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"values": _grid_names(self.knots, self.axes, self.units, self.quantities)}

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """First and last knot by axis [SI]."""
        return {axis: (line[0], line[-1]) for axis, line in zip(self.axes, self.knots, strict=True)}

    def __call__(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, "..."]:
        """The value at an instant; one for each quantity, where they are named.

        Args:
            signals: scalars by name [SI].

        Raises:
            InputError: when the signal of an axis is not there.
        """
        require_known("signal", self.axes, signals)
        points = [signals[axis] for axis in self.axes]
        inside = [_hold(point, line) for point, line in zip(points, self.knots, strict=True)]
        widths = [min(STENCIL[self.interpolation], len(line)) for line in self.knots]
        starts = [_start(*three) for three in zip(inside, self.knots, widths, strict=True)]
        shared = self.values.shape[len(self.axes) :]
        value = jax.lax.dynamic_slice(self.values, (*starts, *(0 for _ in shared)), (*widths, *shared))
        for point, held, line, start, width in zip(points, inside, self.knots, starts, widths, strict=True):
            near = jax.lax.dynamic_slice(jnp.asarray(line), (start,), (width,))
            beyond = point - held if self.extrapolation == "linear" else None
            value = _between(held, beyond, near, value, self.interpolation)
        if self.extrapolation == "refuse":
            value = jnp.where(functools.reduce(jnp.logical_or, map(jnp.not_equal, points, inside)), jnp.nan, value)
        return value


def require_inside(table: Table, signals: Mapping[str, Numbers]) -> None:
    """Refuse signals that leave a table whose extrapolation is `refuse`; other tables take any.

    Args:
        table: which.
        signals: numbers or time histories of any shape by name [SI].

    Raises:
        InputError: with the axis, the value, and the range.
    """
    if table.extrapolation == "refuse":
        found = outside(table.limits, signals, dict(zip(table.axes, table.units, strict=True)))
        if found:
            what = f"The table of {', '.join(table.quantities)}" if table.quantities else "The table"
            raise InputError(
                f"{what} refuses to extrapolate: {'; '.join(found)}. Keep inside, or make the table with "
                '`extrapolation="hold"` or `"linear"`.'
            )


def outside(
    limits: Mapping[str, tuple[float, float]], signals: Mapping[str, Numbers], units: Mapping[str, str] | None = None
) -> tuple[str, ...]:
    """Words for each signal that leaves its range, such as `alpha reaches 24.3 deg, the range is -10 to 21 deg`.

    Args:
        limits: lowest and highest value by name [SI].
        signals: numbers or time histories of any shape by name [SI]; NaN counts as inside.
        units: unit by name; what is in `"rad"` is shown in degrees.

    Returns:
        One phrase for each signal that is outside, none where all are inside.
    """
    found = []
    for name, (low, high) in limits.items():
        if name in signals:
            numbers = np.asarray(signals[name], float).ravel()
            excess = np.nan_to_num(np.maximum(low - numbers, numbers - high), nan=-np.inf)
            if excess.size and excess.max() > 0:
                unit = (units or {}).get(name, "")
                worst, least, most = (_shown(n, unit) for n in (numbers[excess.argmax()], low, high))
                word = "deg" if unit == "rad" else unit
                found.append(
                    f"{name} reaches {worst} {word}".rstrip() + f", the range is {least} to {most} {word}".rstrip()
                )
    return tuple(found)


def _hold(point, line: tuple[float, ...]):
    """The nearest point inside; written so that the derivative at the outermost knots is that of the inside."""
    return jnp.where(point < line[0], line[0], jnp.where(point > line[-1], line[-1], point))


def _start(point, line: tuple[float, ...], width: int):
    """Where the stencil begins: the cell of the point and its neighbours, shifted to stay on the axis."""
    cell = jnp.sum(point >= np.array(line[1:-1]))
    return jnp.clip(cell - (width // 2 - 1), 0, len(line) - width)


def _between(point, beyond, knots, values, interpolation: Interpolation):
    """Interpolate along the leading dimension of a stencil, and go on by `beyond` outside of it."""
    with jax.numpy_rank_promotion("allow"):  # interpax promotes ranks inside
        if interpolation == "linear":
            return interpax.interp1d(point if beyond is None else point + beyond, knots, values, "linear", extrap=True)
        method = SLOPES[interpolation] if knots.size > 2 else "cubic"  # through two knots, both are the straight line
        slopes = interpax.approx_df(knots, values, method, 0)
    # The cubic itself is written out: interp1d does the same in more than twice the time.
    cell = jnp.sum(point >= knots[1:-1])
    (k0, k1), (f0, f1), (d0, d1) = (_ends(cell, row) for row in (knots, values, slopes))
    step = k1 - k0
    t = (point - k0) / step
    ahead, back = t * t * (3.0 - 2.0 * t), (1.0 - t) ** 2 * (1.0 + 2.0 * t)
    value = back * f0 + ahead * f1 + step * (t * (1.0 - t) ** 2 * d0 - t * t * (1.0 - t) * d1)
    return value if beyond is None else value + beyond * jnp.where(beyond < 0, d0, d1)


def _ends(cell, row):
    """What stands at the two ends of a cell. Selection, not indexing: it fuses with what follows."""
    low, high = row[0], row[1]
    for k in range(1, row.shape[0] - 1):
        low, high = jnp.where(cell >= k, row[k], low), jnp.where(cell >= k, row[k + 1], high)
    return low, high


def _check(table: Table) -> None:
    """Refuse what cannot be a table."""
    name = f"Table over {', '.join(table.axes) or '(no axis)'}"
    require(1 <= len(table.axes) <= 3, f"{name}: it has {len(table.axes)} axes. Give one, two or three.")
    require_unique("axis", table.axes)
    require_unique("quantity", table.quantities)
    require_known("interpolation", [table.interpolation], get_args(Interpolation))
    require_known("extrapolation", [table.extrapolation], get_args(Extrapolation))
    for what, many in (("lines of knots", table.knots), ("units", table.units)):
        require(len(many) == len(table.axes), f"{name}: {len(many)} {what} for {len(table.axes)} axes. Give one each.")
    for axis, line in zip(table.axes, table.knots, strict=True):
        require(len(line) >= 2, f"{name}: axis {axis!r} has {len(line)} knots. Give two or more.")
        require(bool(np.isfinite(line).all()), f"{name}: a knot of axis {axis!r} is not finite. Correct it.")
        wrong = [(a, b) for a, b in itertools.pairwise(line) if a >= b]
        require(
            not wrong,
            f"{name}: the knots of axis {axis!r} do not increase: {wrong and wrong[0][1]} follows {wrong and wrong[0][0]}."
            " Sort them, with their values.",
        )
    shape = (*map(len, table.knots), *((len(table.quantities),) if table.quantities else ()))
    require(
        table.values.shape == shape,
        f"{name}: values of shape {table.values.shape}, and knots and quantities make {shape}. Bring them together.",
    )
    if not isinstance(table.values, Tracer):  # inside a transformation there is nothing to look at
        bad = np.argwhere(~np.isfinite(np.asarray(table.values)))
        names = table.element_names["values"]
        where = names[np.ravel_multi_index(tuple(bad[0]), shape)] if len(bad) else ""
        require(len(bad) == 0, f"{name}: the value at {where} is not finite. Correct it, or fill the gap.")


@functools.cache
def _grid_names(knots, axes, units, quantities) -> tuple[str, ...]:
    """Names of the values in their flat order: `alpha=10,beta=-5`, behind the quantity and a dot where there are several."""
    lines = [
        [f"{axis}={_shown(knot, unit)}" for knot in line] for axis, unit, line in zip(axes, units, knots, strict=True)
    ]
    points = [",".join(point) for point in itertools.product(*lines)]
    return tuple(f"{quantity}.{point}" for point in points for quantity in quantities) if quantities else tuple(points)


def _shown(number: float, unit: str) -> str:
    """A number as names and messages have it: angles in degrees, without the last bits of their conversion."""
    return f"{float(np.rad2deg(number) if unit == 'rad' else number):.10g}"
