"""Code that documents print: the blocks of a Markdown text, and their run as a reader runs them."""

import json
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

# Runs pages in one interpreter: the first page stands by itself, the others continue it.
DRIVER = """
import contextlib, io, json, sys, traceback

with open(sys.argv[1], encoding="utf-8") as file:
    pages = json.load(file)
first, results = {"__name__": "__main__"}, {}
for page, blocks in pages.items():
    names, output, error = dict(first), io.StringIO(), ""
    try:
        with contextlib.redirect_stdout(output):
            for number, block in enumerate(blocks, 1):
                exec(compile(block, f"{page}, block {number}", "exec"), names)
    except Exception:
        error = traceback.format_exc()
    first = first if results else names
    results[page] = {"output": output.getvalue(), "error": error}
print(json.dumps(results))
"""


class Printed(NamedTuple):
    """The output of a page's code, and its traceback; empty if it ran to its end."""

    output: str
    error: str


def blocks(text: str, language: str) -> list[str]:
    """Return the fenced blocks of a language in a Markdown text, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def run_pages(
    pages: Mapping[str, Sequence[str]], folder: Path, environment: Mapping[str, str]
) -> dict[str, Printed]:
    """Return the output of the blocks of each page, run in one fresh interpreter.

    Warnings are errors. Imports, float64 and data are those of the first page, which stands by
    itself; each other page starts with all names that the first one defines.

    Args:
        pages: blocks by the name of their page.
        folder: the working folder.
        environment: variables of the interpreter.
    """
    code, driver = folder / "pages.json", folder / "driver.py"
    code.write_text(json.dumps({name: list(page) for name, page in pages.items()}))
    driver.write_text(DRIVER)
    command = [sys.executable, "-W", "error", str(driver), str(code)]
    done = subprocess.run(
        command,
        cwd=folder,
        env=dict(environment),
        capture_output=True,
        text=True,
        timeout=900,  # a guard; a slow machine takes over 300
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    results = json.loads(done.stdout.splitlines()[-1])
    return {name: Printed(**result) for name, result in results.items()}
