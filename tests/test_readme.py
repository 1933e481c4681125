"""The README's commands are there in the form that CI runs, and its quick start runs as printed."""

import re
from pathlib import Path

from printed_code import blocks, run_pages

README = (Path(__file__).resolve().parent.parent / "README.md").read_text(encoding="utf-8")


def commands() -> list[str]:
    return [line.strip() for block in blocks(README, "bash") for line in block.splitlines()]


def test_one_command_line_installs_and_runs_the_main_job():
    assert [line for line in commands() if re.fullmatch(r"pip install .+ && python -m jaxid", line)]


def test_one_command_line_installs_and_tests():
    """`.ci/run` takes this line out of the README, so there is one of it."""
    assert (
        len([line for line in commands() if re.fullmatch(r"pip install .+ && pytest", line)]) == 1
    )


def test_every_row_of_the_verification_names_a_test():
    names = re.findall(r"^\|.*`(test_\w+)` \|$", README, re.MULTILINE)
    sources = [
        path.read_text(encoding="utf-8") for path in Path(__file__).parent.rglob("test_*.py")
    ]
    defined = set(re.findall(r"^def (test_\w+)\(", "\n".join(sources), re.MULTILINE))
    assert len(names) > 10
    assert set(names) <= defined, set(names) - defined


def test_the_quick_start_runs_as_printed(tmp_path, user_environment):
    """In a fresh interpreter, so that it stands by itself: imports, float64 and data included."""
    pages = {"README.md": blocks(README, "python")[:1]}
    printed = run_pages(pages, tmp_path, user_environment)["README.md"]
    assert not printed.error, printed.error
