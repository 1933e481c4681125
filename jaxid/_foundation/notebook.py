"""Tables as text and as HTML, which notebooks show in place of the `repr` of an object."""

import html
from collections.abc import Sequence
from typing import NamedTuple

# Of a cell, without colours: notebooks are light or dark.
CELL_STYLE = "padding: 0.1em 0.8em; white-space: nowrap; text-align: "


class Table(NamedTuple):
    """Rows of words: names on the left, numbers to the right, units in the last column.

    Attributes:
        heads: titles of the columns.
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
        head, body = _row("th", self.heads), "".join(_row("td", row) for row in self.rows)
        table = f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"
        return f'<div style="overflow-x: auto">{paragraphs(above)}{table}{paragraphs(below)}</div>'


def paragraphs(lines: Sequence[str]) -> str:
    """Return lines of text as HTML elements, without the empty ones."""
    return "".join(f'<p style="margin: 0.3em 0">{html.escape(line)}</p>' for line in lines if line)


def preformatted(text: str) -> str:
    """Return a text as an HTML element with its line breaks and columns."""
    return f'<pre style="overflow-x: auto">{html.escape(text)}</pre>'


def _row(tag: str, cells: Sequence[str]) -> str:
    words = []
    for place, cell in enumerate(cells):
        side = "left" if place in (0, len(cells) - 1) else "right"
        words.append(f'<{tag} style="{CELL_STYLE}{side}">{html.escape(cell)}</{tag}>')
    return f"<tr>{''.join(words)}</tr>"
