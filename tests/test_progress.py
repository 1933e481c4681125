"""Progress of a long computation on a terminal, in a notebook and elsewhere."""

import os
import pty
import subprocess
import sys

import nbformat
import pytest
from nbclient import NotebookClient

from jaxid._foundation.progress import shown_progress, text_progress

CODE = """
from jaxid._foundation.progress import text_progress
with text_progress({progress}) as show:
    show("round 1 [/b]")
    show("assessment")
print("done")
"""


def on_terminal(progress):
    """Standard output, and the text at standard error, which is a terminal."""
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", CODE.format(progress=progress)]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=theirs, env=environment, check=True, text=True
    )
    os.set_blocking(ours, False)
    os.close(theirs)
    shown = b""
    try:
        while part := os.read(ours, 65536):
            shown += part
    except OSError:  # the end of a terminal
        pass
    finally:
        os.close(ours)
    return done.stdout, shown.decode()


def test_terminal_shows_steps_on_standard_error():
    output, shown = on_terminal(True)
    assert output == "done\n"
    assert "assessment" in shown


def test_terminal_shows_nothing_if_not_wanted():
    assert on_terminal(False) == ("done\n", "")


def test_pipe_shows_nothing(capfd):
    with text_progress(True) as show:
        show("round 1")
    assert capfd.readouterr() == ("", "")


def test_function_receives_texts():
    texts = []
    with text_progress(texts.append) as show:
        show("round 1")
        show("assessment")
    assert texts == ["round 1", "assessment"]


def test_error_passes():
    with pytest.raises(ZeroDivisionError), shown_progress():
        raise ZeroDivisionError


def executed(progress):
    cells = [nbformat.v4.new_code_cell(CODE.format(progress=progress))]
    notebook = nbformat.v4.new_notebook(cells=cells)
    return NotebookClient(notebook, timeout=120, kernel_name="python3").execute()


def test_notebook_shows_one_line_that_is_emptied(monkeypatch):
    shown = []
    monkeypatch.setattr(
        NotebookClient,
        "_update_display_id",
        lambda self, display_id, message: shown.append(message["content"]["data"]["text/plain"]),
    )
    cell = executed(True)["cells"][0]
    assert [output["output_type"] for output in cell["outputs"]] == ["display_data", "stream"]
    assert [" ".join(line.split()[2:]) for line in shown] == ["", "round 1 [/b]", "assessment", ""]
    assert [output["output_type"] for output in executed(False)["cells"][0]["outputs"]] == [
        "stream"
    ]
