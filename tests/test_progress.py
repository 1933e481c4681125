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


@pytest.fixture(scope="module")
def notebook():
    """Cells of a notebook after its run, and the lines of each output that a cell updates.

    A cell that shows its progress, one that does not, and one with a long step.
    """
    setting = "import time\nimport jaxid._foundation.progress as of\nof.REFRESH = 0.1\n"
    long = setting + CODE.replace('show("assessment")', "time.sleep(0.6)")
    codes = (CODE.format(progress=True), CODE.format(progress=False), long.format(progress=True))
    lines = {}

    def update(self, display_id, message):
        lines.setdefault(display_id, []).append(message["content"]["data"]["text/plain"])

    book = nbformat.v4.new_notebook(cells=list(map(nbformat.v4.new_code_cell, codes)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(NotebookClient, "_update_display_id", update)
        NotebookClient(book, timeout=120, kernel_name="python3").execute()
    return book["cells"], list(lines.values())


def output_types(cell):
    return [output["output_type"] for output in cell["outputs"]]


def test_notebook_shows_one_line_that_is_emptied(notebook):
    (shown, silent, _), lines = notebook
    assert output_types(shown) == ["display_data", "stream"]
    words = [" ".join(line.split()[2:]) for line in lines[0]]
    assert [text for text, _ in groupby(words)] == ["", "round 1 [/b]", "assessment", ""]
    assert output_types(silent) == ["stream"]


def test_notebook_counts_the_seconds_of_a_long_step(notebook):
    (*_, long), lines = notebook
    assert len(lines) == 2  # of the first cell and of this one
    assert sum("round 1" in line for line in lines[1]) > 2
    assert output_types(long) == ["display_data", "stream"]
