"""`inline_svg`: a figure as an SVG element of a page, with the panels that can be zoomed."""

import html
import io
import json
import re
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

POINTS_PER_INCH = 72  # the unit of length of an SVG by matplotlib
DIGITS = 3  # of coordinates of lines after the point (chosen: half a point when enlarged 500 times)
NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))


class Panel(NamedTuple):
    """A panel that can be zoomed.

    Attributes:
        id: of the group of its elements.
        box: left, bottom, right and top edge in the coordinates of the SVG.
        x, y: values at the edges, in the numbers of the tick labels.
    """

    id: str
    box: tuple[float, float, float, float]
    x: tuple[float, float]
    y: tuple[float, float]


def inline_svg(figure: Figure, name: str, label: str) -> str:
    """Return a figure as an SVG element that stands in a page.

    The attribute `data-panels` lists the panels with linear axes and without bars or error bars
    (`Panel`), for the script of the page.

    Args:
        figure: the figure.
        name: start of all ids of the element; unique on the page.
        label: description for readers who do not see the figure.

    Returns:
        The element.
    """
    buffer = io.StringIO()
    # Text stays text, and ids depend on the figure alone. Lines keep all their samples, as
    # simplified ones would be visible when enlarged.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "jaxid", "path.simplify": False}):
        figure.savefig(buffer, format="svg", metadata=NO_METADATA)
    drawn = buffer.getvalue()
    opening = re.search(r'<svg [^>]*viewBox="([^"]*)"[^>]*>', drawn)
    assert opening is not None
    body = re.sub(r"<style.*?</style>", "", drawn[opening.end() :], flags=re.DOTALL)
    body = re.sub(r"<[^<>]*>", lambda tag: _rewritten(tag[0], name), body)
    panels = json.dumps([panel._asdict() for panel in _panels(figure, name)])
    return (
        f'<svg viewBox="{opening[1]}" role="img" aria-label="{html.escape(label)}" '
        f'data-panels="{html.escape(panels)}">{body}'
    )


def _rewritten(tag: str, name: str) -> str:
    """Return a tag whose ids start with a name, and whose path has `DIGITS` digits after the
    point.
    """
    tag = re.sub(r' id="', f' id="{name}-', tag)
    tag = re.sub(r'(href="|url\()#', rf"\1#{name}-", tag)
    return re.sub(r'(?<= d=")[^"]*', _shortened, tag)


def _shortened(path: re.Match[str]) -> str:
    """Return the data of a path with `DIGITS` digits after the point, without line breaks."""
    return " ".join(re.sub(rf"(\.\d{{{DIGITS}}})\d+", r"\1", path[0]).split())


def _panels(figure: Figure, name: str) -> list[Panel]:
    height = POINTS_PER_INCH * figure.get_figheight()
    width = POINTS_PER_INCH * figure.get_figwidth()
    panels = []
    for number, ax in enumerate(figure.axes, 1):
        if not _zoomable(ax):
            continue
        place = ax.get_position()
        box = (place.x0 * width, (1 - place.y0) * height, place.x1 * width, (1 - place.y1) * height)
        panels.append(
            Panel(
                f"{name}-axes_{number}",
                (round(box[0], 3), round(box[1], 3), round(box[2], 3), round(box[3], 3)),
                _labelled(ax.xaxis),
                _labelled(ax.yaxis),
            )
        )
    return panels


def _zoomable(ax: Axes) -> bool:
    return not ax.containers and ax.get_xscale() == ax.get_yscale() == "linear"


def _labelled(axis: Axis) -> tuple[float, float]:
    """Return the limits of an axis as its tick labels would state them, which may leave out an
    offset and a power of ten.
    """
    limits = np.asarray(axis.get_view_interval(), float)
    formatter, ticks = axis.get_major_formatter(), list(axis.get_majorticklocs())
    if isinstance(formatter, ScalarFormatter) and len(ticks) > 1:
        labels = [text.replace("\N{MINUS SIGN}", "-") for text in formatter.format_ticks(ticks)]
        first, last = float(labels[0]), float(labels[-1])
        slope = (last - first) / (ticks[-1] - ticks[0])
        limits = first + slope * (limits - ticks[0])
    return float(limits[0]), float(limits[1])
