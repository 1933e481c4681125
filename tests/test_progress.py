"""Progress of a long computation on a terminal, in a notebook and elsewhere."""

import os
import pty
import subprocess
import sys
from itertools import groupby

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

from jaxid._foundation.evicting_jit import EvictingJit, compile_together
from jaxid._foundation.progress import report_part, shown_progress, text_progress

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


def test_function_receives_the_part_of_a_step():
    texts = []
    with text_progress(texts.append) as show:
        report_part("1 of 2")
        show("compilation")
        report_part("2 of 2")
    report_part("later")
    assert texts == ["1 of 2", "compilation", "compilation: 2 of 2"]


def test_inner_progress_does_not_reach_the_outer_one():
    outer = []
    with text_progress(outer.append) as show:
        show("study")
        with text_progress(False):
            report_part("inner")
        report_part("outer")
    assert outer == ["study", "study: outer"]


def test_compilation_reports_its_programs():
    texts, function = [], EvictingJit(lambda x: 2.0 * x)
    programs = [(function, (np.zeros(count),)) for count in (3, 4, 3)]  # two different ones
    with text_progress(texts.append):
        compile_together(programs)
        compile_together(programs)  # known: nothing to report
    assert texts == [
        f"{done} of 2 programs {stage}" for stage in ("traced", "compiled") for done in (0, 1)
    ]


def test_error_passes():
    with pytest.raises(ZeroDivisionError), shown_progress():
        raise ZeroDivisionError


def executed(progress):
    cells = [nbformat.v4.new_code_cell(CODE.format(progress=progress))]
    notebook = nbformat.v4.new_notebook(cells=cells)
    return NotebookClient(notebook, timeout=120, kernel_name="python3").execute()


@pytest.fixture
def shown(monkeypatch):
    """The lines of the output that a notebook updates."""
    lines = []
    monkeypatch.setattr(
        NotebookClient,
        "_update_display_id",
        lambda self, display_id, message: lines.append(message["content"]["data"]["text/plain"]),
    )
    return lines


def test_notebook_shows_one_line_that_is_emptied(shown):
    cell = executed(True)["cells"][0]
    assert [output["output_type"] for output in cell["outputs"]] == ["display_data", "stream"]
    words = [" ".join(line.split()[2:]) for line in shown]
    assert [text for text, _ in groupby(words)] == ["", "round 1 [/b]", "assessment", ""]
    assert [output["output_type"] for output in executed(False)["cells"][0]["outputs"]] == [
        "stream"
    ]


def test_notebook_counts_the_seconds_of_a_long_step(shown):
    code = CODE.replace('show("assessment")', "time.sleep(0.6)").format(progress=True)
    setting = "import time\nimport jaxid._foundation.progress as of\nof.REFRESH = 0.1\n"
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(setting + code)])
    cell = NotebookClient(notebook, timeout=120, kernel_name="python3").execute()["cells"][0]
    assert sum("round 1" in line for line in shown) > 2
    assert [output["output_type"] for output in cell["outputs"]] == ["display_data", "stream"]
