"""Look-up tables on rectangular grids with named axes, differentiable by the signals and by every
value.
"""

import enum
import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import interpax
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._foundation.checks import InputError, member, require, require_known, require_unique
from .._foundation.types import Array, Float, Numbers


class Interpolation(enum.Enum):
    """Interpolation between the knots of a table; a table also accepts the value as text.

    Attributes:
        LINEAR: straight lines.
        CUBIC: the Hermite cubic with the mean of the slopes of the two adjacent lines as slope at a
            knot; value and derivative are continuous.
        MONOTONE: the same with the slopes of Fritsch and Butland, for which no interpolated value
            exceeds the data.
    """

    LINEAR = "linear"
    CUBIC = "cubic"
    MONOTONE = "monotone"

    @property
    def stencil(self) -> int:
        """Number of knots per axis on which an interpolated value depends."""
        return 2 if self is Interpolation.LINEAR else 4


class Extrapolation(enum.Enum):
    """Extrapolation beyond the knots of a table; a table also accepts the value as text.

    Attributes:
        HOLD: the value is constant.
        LINEAR: the value continues with the slope at the edge.
        REFUSE: the value is NaN; `require_inside` raises an error with the reason.
    """

    HOLD = "hold"
    LINEAR = "linear"
    REFUSE = "refuse"


# interpax's names of the slopes
SLOPES = {Interpolation.CUBIC: "cubic", Interpolation.MONOTONE: "monotonic"}


class Table(eqx.Module):
    r"""One quantity, or several quantities on the same grid, interpolated in one to three signals.

    The interpolation is done axis by axis, in the order of the axes.

    Only the knots around the point are evaluated, two or four on each axis. Four knots give the
    same slopes as all knots of the axis, also at its ends, where the four are shifted inwards to
    the end of the axis. At a knot of a linear table the derivative is the derivative to the right.
    With two axes or more a monotone table has kinks where the slope along a later axis changes sign
    between knots of an earlier axis. Where a value equals its neighbour, a monotone table has no
    derivative by this value, because the slope stays zero to one side: use a `cubic` table if such
    values are free.

    Args:
        values: numbers on the grid, shape (*knots), or (*knots, quantity) with named `quantities`.
        knots: for each axis at least two increasing numbers [SI].
        axes: name of the signal for each axis.
        units: unit for each axis, used in names only: the names of an axis in `"rad"` have degrees,
            as in `alpha=10`. No units when left out.
        quantities: names of the quantities; empty for a single quantity without a name.
        interpolation: an `Interpolation`, or its value, such as `"cubic"`.
        extrapolation: an `Extrapolation`, or its value, such as `"hold"`.

    Raises:
        InputError: when knots are too few, unordered or not finite, a value is not finite, or
            shapes or names disagree.
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
        interpolation: Interpolation | str = Interpolation.LINEAR,
        extrapolation: Extrapolation | str = Extrapolation.HOLD,
    ):
        self.values = jnp.asarray(values, float)
        self.knots = tuple(tuple(float(knot) for knot in line) for line in knots)
        self.axes, self.quantities = tuple(axes), tuple(quantities)
        self.units = ("",) * len(self.axes) if units is None else tuple(units)
        self.interpolation = member("interpolation", interpolation, Interpolation)
        self.extrapolation = member("extrapolation", extrapolation, Extrapolation)
        _check(self)

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"values": _grid_names(self.knots, self.axes, self.units, self.quantities)}

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """First and last knot by axis [SI]."""
        return {axis: (line[0], line[-1]) for axis, line in zip(self.axes, self.knots, strict=True)}

    def __call__(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, "..."]:
        """The value at an instant, or one value for each named quantity.

        Args:
            signals: scalars by name [SI].

        Raises:
            InputError: when the signal of an axis is missing.
        """
        require_known("signal", self.axes, signals)
        points = [signals[axis] for axis in self.axes]
        inside = [_hold(point, line) for point, line in zip(points, self.knots, strict=True)]
        widths = [min(self.interpolation.stencil, len(line)) for line in self.knots]
        starts = [
            _start(point, line, width)
            for point, line, width in zip(inside, self.knots, widths, strict=True)
        ]
        shared = self.values.shape[len(self.axes) :]
        value = jax.lax.dynamic_slice(
            self.values, (*starts, *(0 for _ in shared)), (*widths, *shared)
        )
        for point, held, line, start, width in zip(
            points, inside, self.knots, starts, widths, strict=True
        ):
            near = jax.lax.dynamic_slice(jnp.asarray(line), (start,), (width,))
            beyond = point - held if self.extrapolation is Extrapolation.LINEAR else None
            value = _between(held, beyond, near, value, self.interpolation)
        if self.extrapolation is Extrapolation.REFUSE:
            value = jnp.where(
                functools.reduce(jnp.logical_or, map(jnp.not_equal, points, inside)), jnp.nan, value
            )
        return value


def require_inside(table: Table, signals: Mapping[str, Numbers]) -> None:
    """Refuse signals outside a table whose extrapolation is `refuse`; other tables accept all.

    Args:
        table: the table.
        signals: numbers or time histories of any shape by name [SI].

    Raises:
        InputError: when a signal is outside; the message has the axis, the value and the range.
    """
    if table.extrapolation is Extrapolation.REFUSE:
        excesses = range_violations(
            table.limits, signals, dict(zip(table.axes, table.units, strict=True))
        )
        if excesses:
            subject = (
                f"The table of {', '.join(table.quantities)}" if table.quantities else "The table"
            )
            raise InputError(
                f"{subject} refuses to extrapolate: {'; '.join(excesses)}. Keep inside, or make "
                'the table with `extrapolation="hold"` or `"linear"`.'
            )


def range_violations(
    limits: Mapping[str, tuple[float, float]],
    signals: Mapping[str, Numbers],
    units: Mapping[str, str] | None = None,
) -> tuple[str, ...]:
    """Return a phrase for each signal that leaves its range.

    An example is `alpha reaches 24.3 deg, the range is -10 to 21 deg`.

    Args:
        limits: lowest and highest value by name [SI].
        signals: numbers or time histories of any shape by name [SI]; NaN counts as inside.
        units: unit by name; values in `"rad"` are printed in degrees.

    Returns:
        One phrase for each signal that is outside its range.
    """
    phrases = []
    for name, (low, high) in limits.items():
        if name in signals:
            numbers = np.asarray(signals[name], float).ravel()
            excess = np.nan_to_num(np.maximum(low - numbers, numbers - high), nan=-np.inf)
            if excess.size and excess.max() > 0:
                unit = (units or {}).get(name, "")
                worst, least, most = (
                    _shown(n, unit) for n in (numbers[excess.argmax()], low, high)
                )
                word = "deg" if unit == "rad" else unit
                phrases.append(
                    f"{name} reaches {worst} {word}".rstrip()
                    + f", the range is {least} to {most} {word}".rstrip()
                )
    return tuple(phrases)


def _hold(point, line: tuple[float, ...]):
    """The nearest point inside; at the outermost knots its derivative is the one of the inside."""
    return jnp.where(point < line[0], line[0], jnp.where(point > line[-1], line[-1], point))


def _start(point, line: tuple[float, ...], width: int):
    """Index of the first knot of the stencil: the cell of the point and its neighbours, shifted to
    stay on the axis.
    """
    cell = jnp.sum(point >= np.array(line[1:-1]))
    return jnp.clip(cell - (width // 2 - 1), 0, len(line) - width)


def _between(point, beyond, knots, values, interpolation: Interpolation):
    """Interpolate along the first axis of a stencil; `beyond` is the distance outside of it."""
    with jax.numpy_rank_promotion("allow"):  # interpax promotes ranks inside
        if interpolation is Interpolation.LINEAR:
            return interpax.interp1d(
                point if beyond is None else point + beyond, knots, values, "linear", extrap=True
            )
        # With two knots, both methods are the straight line.
        method = SLOPES[interpolation] if knots.size > 2 else "cubic"
        slopes = interpax.approx_df(knots, values, method, 0)
    # The cubic is evaluated here because interp1d takes more than twice the time.
    cell = jnp.sum(point >= knots[1:-1])
    (k0, k1), (f0, f1), (d0, d1) = (_ends(cell, row) for row in (knots, values, slopes))
    step = k1 - k0
    t = (point - k0) / step
    ahead, back = t * t * (3.0 - 2.0 * t), (1.0 - t) ** 2 * (1.0 + 2.0 * t)
    value = back * f0 + ahead * f1 + step * (t * (1.0 - t) ** 2 * d0 - t * t * (1.0 - t) * d1)
    return value if beyond is None else value + beyond * jnp.where(beyond < 0, d0, d1)


def _ends(cell, row):
    """The items of a row at the two ends of a cell.

    Selection is used instead of indexing, because XLA fuses it with the operations that follow.
    """
    low, high = row[0], row[1]
    for k in range(1, row.shape[0] - 1):
        low, high = jnp.where(cell >= k, row[k], low), jnp.where(cell >= k, row[k + 1], high)
    return low, high


def _check(table: Table) -> None:
    """Refuse a table with invalid axes, knots, values or options."""
    name = f"Table over {', '.join(table.axes) or '(no axis)'}"
    require(
        1 <= len(table.axes) <= 3, f"{name}: it has {len(table.axes)} axes. Give one, two or three."
    )
    require_unique("axis", table.axes)
    require_unique("quantity", table.quantities)
    for label, items in (("lines of knots", table.knots), ("units", table.units)):
        require(
            len(items) == len(table.axes),
            f"{name}: {len(items)} {label} for {len(table.axes)} axes. Give one each.",
        )
    for axis, line in zip(table.axes, table.knots, strict=True):
        _check_knots(name, axis, line)
    shape = (*map(len, table.knots), *((len(table.quantities),) if table.quantities else ()))
    require(
        table.values.shape == shape,
        f"{name}: values of shape {table.values.shape}, and knots and quantities make {shape}. "
        "Make them agree.",
    )
    if not isinstance(table.values, Tracer):  # a traced value cannot be checked
        for place in np.argwhere(~np.isfinite(np.asarray(table.values)))[:1]:
            where = table.element_names["values"][np.ravel_multi_index(tuple(place), shape)]
            raise InputError(
                f"{name}: the value at {where} is not finite. Correct it, or fill the gap."
            )


def _check_knots(name: str, axis: str, line: tuple[float, ...]) -> None:
    """Refuse knots of an axis that do not increase, are not finite or are too few."""
    require(len(line) >= 2, f"{name}: axis {axis!r} has {len(line)} knots. Give two or more.")
    require(
        bool(np.isfinite(line).all()), f"{name}: a knot of axis {axis!r} is not finite. Correct it."
    )
    for before, after in itertools.pairwise(line):
        require(
            before < after,
            f"{name}: the knots of axis {axis!r} do not increase: {after} follows {before}. Sort "
            "them, with their values.",
        )


@functools.cache
def _grid_names(knots, axes, units, quantities) -> tuple[str, ...]:
    """Names of the values in their flat order: `alpha=10,beta=-5`, with the quantity and a dot in
    front if quantities are named.
    """
    lines = [
        [f"{axis}={_shown(knot, unit)}" for knot in line]
        for axis, unit, line in zip(axes, units, knots, strict=True)
    ]
    points = [",".join(point) for point in itertools.product(*lines)]
    return (
        tuple(f"{quantity}.{point}" for point in points for quantity in quantities)
        if quantities
        else tuple(points)
    )


def _shown(number: float, unit: str) -> str:
    """A number as text for names and messages: angles in degrees, without the rounding errors of
    the conversion.
    """
    return f"{float(np.rad2deg(number) if unit == 'rad' else number):.10g}"
