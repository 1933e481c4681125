"""Figure of a designed input: the record to fly, and the share of each limit that it uses."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..design.design import Design
from .style import AFTER, BEFORE, MEASURED, NOISE, canvas, channel_label, key, plain
from .words import display_unit, unit_words

NEARLY_USED = 0.98  # share from which on a limit is drawn as reached (chosen)


def design_figure(design: Design) -> Figure:
    """Return a figure of a designed input, the motion that it is to cause, and its limits.

    Args:
        design: the design.

    Returns:
        One panel for each input and output of the record to fly, in degrees where the unit is rad,
        and one with the share of each finite limit that is used.
    """
    record = design.record
    names = (*record.inputs, *record.outputs)
    units = (*record.input_units, *record.output_units)
    used = {name: share for name, share in design.limits_used.items() if share > 0.0}
    rows = len(names) + 1
    height = 1.0 + 1.3 * len(names) + 0.25 * (len(used) + 1)
    ratios = [1.3] * len(names) + [0.25 * (len(used) + 1)]
    figure, panels = canvas(height, rows, height_ratios=ratios)
    t = np.asarray(record.t)
    for number, (name, unit, (ax,)) in enumerate(zip(names, units, panels[:-1], strict=True)):
        scale, shown = display_unit(unit)
        colour = NOISE if number < len(record.inputs) else MEASURED
        ax.plot(t, scale * np.asarray(record.channel(name)), color=colour, linewidth=1.2)
        ax.set_xlim(t[0], t[-1])
        last = number == len(names) - 1
        label = channel_label(name, unit_words(shown))
        plain(ax, "time [s]" if last else "", title=label)
    _limits(panels[-1][0], used)
    entries = [
        ("inputs", NOISE),
        ("expected outputs", MEASURED),
        ("limit reached", BEFORE),
        ("limit not reached", AFTER),
    ]
    key(figure, entries, title="the record to fly")
    return figure


def _limits(ax: Axes, used: dict[str, float]) -> None:
    """Draw the share of each limit that is used."""
    names = list(used)[::-1]
    shares = [100.0 * used[name] for name in names]
    colours = [BEFORE if share >= 100.0 * NEARLY_USED else AFTER for share in shares]
    ax.barh(range(len(names)), shares, color=colours, height=0.6)
    ax.set_yticks(range(len(names)), names, parse_math=False)
    ax.set_xlim(0.0, 105.0)
    plain(ax, "share of each limit that is used [%]")
    ax.grid(False, axis="y")
