"""Figure of the location of a residual: places by explained share, and the first disturbance."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._foundation.location import Location
from ..diagnosis.places import LocalisationResult, Place
from .style import AFTER, FONT, INK, MEASURED, OTHER, canvas, lay_out, plain
from .words import percent

MOST_PLACES_DRAWN = 10  # chosen


def where(located: LocalisationResult, level: float) -> Figure:
    """Return a figure of the places by explained share, and of the disturbance in the first one.

    The disturbance is drawn in time and against the variable that explains most of it.

    Args:
        located: result of the localisation.
        level: probability of a false alarm.

    Returns:
        Three panels.
    """
    best = located.places[:MOST_PLACES_DRAWN]
    figure, ((bars, time, against),) = canvas(
        1.0 + 0.24 * max(len(best), 8), 1, 3, width_ratios=(1, 1, 1)
    )
    _bars(bars, best, {place.location for place in located.significant(level)})
    first = best[0]
    _in_time(time, located, first)
    _against(against, located, first)
    lay_out(figure)
    return figure


def _bars(ax: Axes, places: tuple[Place, ...], best: set[Location]) -> None:
    shares = np.nan_to_num(np.clip([place.share for place in places], 0.0, None))
    colours = [AFTER if place.location in best else OTHER for place in places]
    rows = np.arange(len(places))
    ax.barh(rows, shares, color=colours, height=0.68)
    for row, place, share in zip(rows, places, shares, strict=True):
        ax.annotate(
            percent(place.share),
            (share, row),
            (3, 0),
            textcoords="offset points",
            va="center",
            fontsize=FONT - 1,
        )
    ax.set(xlim=(0, 1.3 * max(np.max(shares), 0.1)), ylim=(len(places) - 0.4, -0.6))
    ax.set_yticks(rows, [place.location.label for place in places], parse_math=False)
    plain(ax, "share of the residual explained")
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)


def _in_time(ax: Axes, located: LocalisationResult, place: Place) -> None:
    """Draw the disturbance of the first record, scaled by the times at which it is determined."""
    t, d, error = located.knots[0], place.disturbance[0], 2.0 * place.deviation[0]
    ax.fill_between(
        t, d - error, d + error, where=np.isfinite(error), color=AFTER, alpha=0.2, linewidth=0
    )
    ax.plot(t, d, color=AFTER, linewidth=1.2)
    ax.axhline(0.0, color=INK, linewidth=0.5)
    known = np.isfinite(error) & (error <= 3.0 * np.median(error))
    size = np.max(np.abs(d[known]) + error[known], initial=0.0)
    if size > 0:
        ax.set_ylim(-1.1 * size, 1.1 * size)
    ax.set_xlim(t[0], t[-1])
    plain(ax, "time [s]", "", f"disturbance in {place.location.label}, record 1")


def _against(ax: Axes, located: LocalisationResult, place: Place) -> None:
    """Draw the disturbance at all knots of all records against the variable that explains most."""
    name, share = located.explained_by(place)[0]
    s, d, error = (
        array.reshape(-1)
        for array in (located.variables[name], place.disturbance, 2.0 * place.deviation)
    )
    known = np.isfinite(error) & (error <= 3.0 * np.median(error))
    ax.errorbar(
        s[known],
        d[known],
        error[known],
        linestyle="",
        marker="o",
        markersize=2.5,
        linewidth=0.5,
        color=MEASURED,
    )
    ax.axhline(0.0, color=INK, linewidth=0.5)
    plain(ax, f"{name} (SI)", "", f"cubic of {name}: {percent(max(share, 0.0))}")
