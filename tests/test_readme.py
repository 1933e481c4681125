"""The README's commands are there in the form that CI runs, and its quick start runs as printed."""

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).resolve().parent.parent / "README.md"


def blocks(language: str) -> list[str]:
    """The fenced blocks of a language, in order."""
    return re.findall(
        rf"^```{language}\n(.*?)^```",
        README.read_text(encoding="utf-8"),
        flags=re.MULTILINE | re.DOTALL,
    )


def commands() -> list[str]:
    return [line.strip() for block in blocks("bash") for line in block.splitlines()]


def test_one_command_line_installs_and_runs_the_main_job():
    assert [line for line in commands() if re.fullmatch(r"pip install .+ && python -m jaxid", line)]


def test_one_command_line_installs_and_tests():
    """`.ci/run` takes this line out of the README, so there is one of it."""
    assert (
        len([line for line in commands() if re.fullmatch(r"pip install .+ && pytest", line)]) == 1
    )


def test_the_quick_start_runs_as_printed(tmp_path, user_environment):
    """In a fresh interpreter, so that it stands by itself: imports, float64 and data included."""
    quick_start = tmp_path / "quick_start.py"
    quick_start.write_text(blocks("python")[0], encoding="utf-8")
    command = [sys.executable, "-W", "error", str(quick_start)]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=user_environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
