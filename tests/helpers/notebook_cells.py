"""The HTML of an object in a notebook against its print."""

import html5lib


def rows_and_notes(shown):
    """Cells of the tables by row, and lines of text, of an object in a notebook."""
    root = html5lib.parse(shown._repr_html_(), namespaceHTMLElements=False)
    rows = [[cell.text or "" for cell in row] for row in root.iter("tr")]
    for table in root.iter("table"):
        _, *body = table.iter("tr")
        last = "right" if all(is_number(row[-1].text) for row in body) else "left"
        for row in table.iter("tr"):
            sides = [cell.get("style").rpartition(" ")[2] for cell in row]
            assert sides == ["left", *["right"] * (len(sides) - 2), last]
    assert "color" not in shown._repr_html_()  # notebooks are light or dark
    return rows, [paragraph.text for paragraph in root.iter("p")]


def is_number(words):
    """True for words of a number, such as 1.5, inf and nan."""
    try:
        return isinstance(float(words or "none"), float)
    except ValueError:
        return False


def assert_has_printed_lines(shown):
    """Assert that tables and notes together have the words of every printed line."""
    rows, notes = rows_and_notes(shown)
    lines = [line for line in str(shown).splitlines() if line]
    words = [" ".join(row).split() for row in rows] + [note.split() for note in notes]
    assert rows
    assert sorted(words) == sorted(line.split() for line in lines)
