"""Text of an object as HTML, which notebooks show in place of its `repr`."""

import html


def preformatted(text: str) -> str:
    """Return a text as an HTML element with its line breaks and columns."""
    return f'<pre style="overflow-x: auto">{html.escape(text)}</pre>'
