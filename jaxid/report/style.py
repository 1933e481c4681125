"""Style of all figures: colours for colour-blind readers, plain axes, labels in line colours."""

import io

from matplotlib.axes import Axes
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
    figure = NotebookFigure(figsize=(FIGURE_WIDTH, height), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, **options)
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
        loc="outside upper right",
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
        figure.suptitle(title, x=0.0, ha="left", fontsize=FONT + 1, color=INK, parse_math=False)
    lay_out(figure)


def lay_out(figure: Figure) -> None:
    """Compute the layout of a complete figure once, with the y labels of each column in line.

    Each draw would compute it again, and `Figure.align_ylabels` measures at each draw the tick
    labels of all panels for every panel.

    Args:
        figure: the figure, from `canvas`.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine(None)
    columns: dict[int, list[Axes]] = {}
    for ax in figure.axes:
        place = ax.get_subplotspec()
        if place is not None:
            columns.setdefault(place.colspan.start, []).append(ax)
    for panels in columns.values():
        left = min(ax.yaxis.label.get_position()[0] for ax in panels)
        for ax in panels:
            ax.yaxis.set_label_coords(ax.transAxes.inverted().transform((left, 0.0))[0], 0.5)


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
