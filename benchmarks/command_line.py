"""Parts of the command line that benchmarks with named cases share."""

import argparse
import json
import sys
from collections.abc import Callable, Iterable
from typing import Any

Rows = list[dict[str, Any]]


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the option `--json`."""
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else"
    )


def requested(
    parser: argparse.ArgumentParser, given: str, known: Iterable[str], noun: str
) -> list[str]:
    """Return the names in a list with commas; an unknown one ends the program with a message.

    Args:
        parser: parser of the command line, for its usage.
        given: names, separated by commas.
        known: all names.
        noun: name of one of them, for the message.
    """
    names, known = [name.strip() for name in given.split(",")], list(known)
    for name in names:
        if name not in known:
            parser.error(f"there is no {noun} {name!r}; there are {', '.join(known)}")
    return names


def print_rows(rows: Rows, origin: str, table: Callable[[Rows], str], as_json: bool) -> None:
    """Print rows with a `status`, "measured" or "skipped", as a table or as one JSON object.

    Args:
        rows: one for each case.
        origin: source of the records.
        table: function that returns the table.
        as_json: True for the JSON object.
    """
    status = "measured" if any(one["status"] == "measured" for one in rows) else "no data"
    content = {"status": status, "origin": origin, "rows": rows}
    print(json.dumps(content, indent=1) if as_json else table(rows))


def report_progress(words: str) -> None:
    """Print a step on standard error."""
    print(words, file=sys.stderr, flush=True)
