"""Tables as text and as HTML, which notebooks show in place of the `repr` of an object."""

import html
from collections.abc import Sequence
from typing import NamedTuple

# Of a cell, without colours: notebooks are light or dark.
CELL_STYLE = "padding: 0.1em 0.8em; white-space: {}; text-align: {}"
LONGEST_LINE = 60  # characters of a cell that is not broken into lines (chosen)


class Table(NamedTuple):
    """Rows of words: names on the left, numbers to the right, units or words in the last column.

    Attributes:
        heads: titles of the columns; a last column without a title is not shown in HTML.
        widths: smallest widths of the columns of the text, except the last one.
        rows: the cells.
    """

    heads: tuple[str, ...]
    widths: tuple[int, ...]
    rows: tuple[tuple[str, ...], ...]

    def lines(self) -> list[str]:
        """Return the table as lines of text."""
        first = max([self.widths[0], *(len(row[0]) for row in self.rows)])
        lines = []
        for name, *numbers, unit in (self.heads, *self.rows):
            cells = zip(numbers, self.widths[1:], strict=True)
            text = "".join(f" {cell:>{width}}" for cell, width in cells)
            lines.append(f"{name:<{first}}{text}  {unit}".rstrip())
        return lines

    def html(self, above: Sequence[str] = (), below: Sequence[str] = ()) -> str:
        """Return the table as an HTML element, with lines of text above and below."""
        words_at = (0, len(self.heads) - 1)
        shown = len(self.heads) if self.heads[-1] else len(self.heads) - 1
        head, *rows = (cells[:shown] for cells in (self.heads, *self.rows))
        head, body = _row("th", head, words_at), "".join(_row("td", row, words_at) for row in rows)
        table = f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"
        return f'<div style="overflow-x: auto">{paragraphs(above)}{table}{paragraphs(below)}</div>'


def paragraphs(lines: Sequence[str]) -> str:
    """Return lines of text as HTML elements, without the empty ones."""
    return "".join(f'<p style="margin: 0.3em 0">{html.escape(line)}</p>' for line in lines if line)


def preformatted(text: str) -> str:
    """Return a text as an HTML element with its line breaks and columns."""
    return f'<pre style="overflow-x: auto">{html.escape(text)}</pre>'


def _row(tag: str, cells: Sequence[str], words_at: tuple[int, int]) -> str:
    """Return a row, with words on the left of their cells and numbers on the right."""
    elements = []
    for place, cell in enumerate(cells):
        space = "nowrap" if len(cell) <= LONGEST_LINE else "normal"
        style = CELL_STYLE.format(space, "left" if place in words_at else "right")
        elements.append(f'<{tag} style="{style}">{html.escape(cell)}</{tag}>')
    return f"<tr>{''.join(elements)}</tr>"
