"""The figure of where a residual sits: the places by what they explain, and the disturbance in the first of them."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..diagnosis.where import Place, Where
from .style import AFTER, FONT, INK, MEASURED, OTHER, canvas, plain
from .words import percent

MOST_PLACES = 10


def where(found: Where) -> Figure:
    """Places by their share, and the disturbance in the first one, in time and against the variable that it follows.

    Args:
        found: from `where` or a study.

    Returns:
        Three panels.
    """
    best = found.places[:MOST_PLACES]
    figure, ((bars, time, against),) = canvas(1.0 + 0.24 * max(len(best), 8), 1, 3, width_ratios=(1, 1, 1))
    _bars(bars, best, {(one.kind, one.name) for one in found.rivals()})
    first = best[0]
    _in_time(time, found, first)
    _against(against, found, first)
    return figure


def _bars(ax: Axes, places: tuple[Place, ...], rivals: set[tuple[str, str]]) -> None:
    shares = np.nan_to_num(np.clip([one.share for one in places], 0.0, None))
    colours = [AFTER if (one.kind, one.name) in rivals else OTHER for one in places]
    rows = np.arange(len(places))
    ax.barh(rows, shares, color=colours, height=0.68)
    for row, one, share in zip(rows, places, shares, strict=True):
        ax.annotate(
            percent(one.share), (share, row), (3, 0), textcoords="offset points", va="center", fontsize=FONT - 1
        )
    ax.set(xlim=(0, 1.3 * max(np.max(shares), 0.1)), ylim=(len(places) - 0.4, -0.6))
    ax.set_yticks(rows, [f"{one.kind} {one.name}" for one in places], parse_math=False)
    plain(ax, "share of the residual explained")
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)


def _in_time(ax: Axes, found: Where, place: Place) -> None:
    """The disturbance of the first record, where it is known at all."""
    t, d, error = found.knots[0], place.disturbance[0], 2.0 * place.deviation[0]
    ax.fill_between(t, d - error, d + error, where=np.isfinite(error), color=AFTER, alpha=0.2, linewidth=0)
    ax.plot(t, d, color=AFTER, linewidth=1.2)
    ax.axhline(0.0, color=INK, linewidth=0.5)
    known = np.isfinite(error) & (error <= 3.0 * np.median(error))
    size = np.max(np.abs(d[known]) + error[known], initial=0.0)
    if size > 0:
        ax.set_ylim(-1.1 * size, 1.1 * size)
    ax.set_xlim(t[0], t[-1])
    plain(ax, "time [s]", "", f"disturbance in {place.kind} {place.name}, record 1")


def _against(ax: Axes, found: Where, place: Place) -> None:
    """The disturbance at all knots of all records against the variable that says most of it."""
    name, share = found.follows(place)[0]
    s, d, error = (one.reshape(-1) for one in (found.variables[name], place.disturbance, 2.0 * place.deviation))
    known = np.isfinite(error) & (error <= 3.0 * np.median(error))
    ax.errorbar(
        s[known], d[known], error[known], linestyle="", marker="o", markersize=2.5, linewidth=0.5, color=MEASURED
    )
    ax.axhline(0.0, color=INK, linewidth=0.5)
    plain(ax, f"{name} (SI)", "", f"follows {name}: its cubic says {percent(max(share, 0.0))}")
