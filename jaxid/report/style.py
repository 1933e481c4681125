"""Style of all figures: colours for colour-blind readers, plain axes, labels in line colours."""

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from .._foundation.checks import require

# Okabe & Ito, Color Universal Design, 2008.
MEASURED, BEFORE, AFTER, NOISE, OTHER = (
    "#8c8c8c",
    "#d55e00",
    "#0072b2",
    "#007a5a",
    "#c4c4c4",
)
INK = "#333333"
FIGURE_WIDTH = 9.0  # inches
FONT = 9.0
# Between panels with their words, and at the edges of a figure; and about the width of the words
# below and to the left of a panel, in inches (chosen).
GAP, WORDS = 0.05, 0.6
# Largest number of intervals between the ticks below a panel that has neighbours (chosen).
NARROW_INTERVALS = 5


class NotebookFigure(Figure):
    """A figure that a notebook shows when a cell returns it, also without pyplot."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def canvas(
    height: float, rows: int = 1, columns: int = 1, **options
) -> tuple[Figure, list[list[Axes]]]:
    """Return an empty figure of the report's width.

    Args:
        height: in inches.
        rows, columns: panels.
        options: of `Figure.subplots`.

    Returns:
        The figure and its panels, by row.
    """
    figure = NotebookFigure(figsize=(FIGURE_WIDTH, height))
    panels = figure.subplots(rows, columns, squeeze=False, **options)
    if columns > 1:
        for ax in panels.flat:
            ax.locator_params(axis="x", nbins=NARROW_INTERVALS)
    return figure, [list(row) for row in panels]


def plain(ax: Axes, x: str = "", y: str = "", title: str = "") -> None:
    """Remove ink without information, and write labels verbatim (dollar signs are no mathematics).

    Args:
        ax: the panel.
        x, y: labels of the axes.
        title: words above, to the left.
    """
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_color("#999999")
    ax.tick_params(colors=INK, labelsize=FONT - 1, width=0.6, length=3)
    ax.grid(True, color="#e8e8e8", linewidth=0.6)
    ax.set_axisbelow(True)
    for write, text in ((ax.set_xlabel, x), (ax.set_ylabel, y)):
        write(text, fontsize=FONT, color=INK, parse_math=False)
    if title:
        ax.set_title(title, fontsize=FONT, color=INK, loc="left", parse_math=False)


def key(figure: Figure, entries: list[tuple[str, str]], title: str = "") -> None:
    """Write a legend above a figure, each entry in its colour.

    Args:
        figure: the figure, its panels already there.
        entries: words and colour.
        title: words to the left of the entries.
    """
    handles = [Patch(color=colour, label=words) for words, colour in entries]
    legend = figure.legend(
        handles=handles,
        loc="upper right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=len(entries),
        frameon=False,
        fontsize=FONT,
        handlelength=1.0,
        handleheight=0.8,
        labelcolor="linecolor",
        columnspacing=1.6,
    )
    for text, (_, colour) in zip(legend.get_texts(), entries, strict=True):
        text.set_color(colour if colour != OTHER else INK)
    if title:
        edge = GAP / figure.get_figheight()
        style = {"fontsize": FONT + 1, "color": INK, "parse_math": False}
        figure.suptitle(title, x=0.0, y=1.0 - edge, ha="left", va="top", **style)
    lay_out(figure)


def lay_out(figure: Figure) -> None:
    """Place the panels of a complete figure, with the y labels of each column in line.

    The words around the panels are measured once, with panels of about their final size; the panels
    share what remains, by their ratios. Matplotlib's constrained layout measures them four times.

    Args:
        figure: the figure, from `canvas`.
    """
    width, height = figure.bbox.size
    gap, margin = GAP * figure.dpi, WORDS * figure.dpi
    words = [word.get_window_extent().height for word in (*figure.legends, *figure.texts)]
    top = height - max(words, default=0.0) - gap
    figure.subplots_adjust(margin / width, margin / height, 1 - gap / width, (top - gap) / height)
    panels = [(ax, place) for ax in figure.axes if (place := ax.get_subplotspec()) is not None]
    grid = panels[0][1].get_gridspec()
    renderer = FigureCanvasAgg(figure).get_renderer()
    outside = np.array([_outside(ax, renderer) for ax, _ in panels])
    columns = [place.colspan.start for _, place in panels]
    rows = [place.rowspan.start for _, place in panels]
    left, right, labels = _largest(outside[:, [0, 1, 4]], columns, grid.ncols)
    above, below = _largest(outside[:, [2, 3]], rows, grid.nrows)
    x, widths = _shares(left, right, grid.get_width_ratios(), width, gap)
    y, heights = _shares(above, below, grid.get_height_ratios(), top, gap)
    for (ax, _), i, k in zip(panels, columns, rows, strict=True):
        lower = top - y[k] - heights[k]
        ax.set_position((x[i] / width, lower / height, widths[i] / width, heights[k] / height))
        ax.yaxis.set_label_coords(-labels[i] / widths[i], 0.5)


def _outside(ax: Axes, renderer) -> tuple[float, ...]:
    """Return how far the words of a panel reach beyond its frame to the left, to the right, above
    and below, and the distance of its y label from the frame, in pixels.
    """
    words = ax.get_title(loc="left"), ax.get_xlabel(), ax.get_ylabel()
    numbers = [
        axis.get_tick_params().get(f"label{side}", True)
        for axis, side in ((ax.xaxis, "bottom"), (ax.yaxis, "left"))
    ]
    if not any((*words, *numbers)):
        return (0.0,) * 5  # a panel inside a grid with shared axes
    box, frame = ax.get_tightbbox(renderer, for_layout_only=True), ax.bbox
    assert box is not None  # only an invisible panel has none
    sides = frame.x0 - box.x0, box.x1 - frame.x1, box.y1 - frame.y1, frame.y0 - box.y0
    return (*(max(side, 0.0) for side in sides), frame.x0 - ax.yaxis.label.get_position()[0])


def _largest(values: np.ndarray, groups: list[int], count: int) -> np.ndarray:
    """Return the largest values of each group of rows, zero for a group without rows; by column."""
    largest = np.zeros((count, values.shape[1]))
    np.maximum.at(largest, groups, values)
    return largest.T


def _shares(before, after, ratios, length: float, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where the frames of a line of panels begin, and their lengths.

    Args:
        before, after: lengths of the words before and after each frame.
        ratios: ratios of the lengths of the frames.
        length: length of the line.
        gap: distance between panels, and at both ends.
    """
    weights = np.asarray(ratios) / np.sum(ratios)
    lengths = weights * (length - np.sum(before + after) - gap * (weights.size + 1))
    return np.cumsum(gap + before + lengths + after) - after - lengths, lengths


def channel_label(name: str, unit: str) -> str:
    """Return name and unit of a channel for an axis."""
    return f"{name} [{unit}]" if unit else name


def require_case(case: int, count: int) -> None:
    """Refuse a number of a record that does not exist.

    Args:
        case: number of the record.
        count: number of records.

    Raises:
        InputError: when there is no such record.
    """
    require(0 <= case < count, f"There is no record {case} among {count}. Give 0 to {count - 1}.")
