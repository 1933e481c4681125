"""`.ci/run` finds the interpreters on which it runs."""

import os
import re
import shutil
import subprocess
from pathlib import Path

SCRIPT = Path(__file__).resolve().parent.parent / ".ci" / "run"


def write_program(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(0o755)


def found(version: str, folder: Path) -> str:
    """What `find_python` prints where PATH has this folder and the shell's own tools only."""
    (functions,) = re.findall(
        r"^version_of.*?^}\n", SCRIPT.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL
    )
    for tool in ("sh", "grep", "bash"):
        path = shutil.which(tool)
        assert path is not None
        (folder / tool).symlink_to(path)
    command = [str(folder / "bash"), "-c", f"set -euo pipefail\n{functions}\nfind_python {version}"]
    environment = os.environ | {"PATH": str(folder)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_interpreter_on_path_is_found(tmp_path):
    write_program(tmp_path / "python3.12", "echo 3.12")
    assert found("3.12", tmp_path) == "python3.12"


def test_shim_that_does_not_run_is_skipped(tmp_path):
    write_program(tmp_path / "python3.12", "echo 'pyenv: command not found' >&2; exit 127")
    assert found("3.12", tmp_path) == ""


def test_interpreter_of_pyenv_is_found_behind_its_shim(tmp_path):
    write_program(tmp_path / "python3.12", "exit 127")
    write_program(tmp_path / "versions" / "3.12.1" / "bin" / "python", "echo 3.12")
    prefix = f"{tmp_path}/versions/$2"
    write_program(
        tmp_path / "pyenv",
        f'[ $1 = prefix ] && echo {prefix} || printf "3.11.7\\n3.12.1\\n3.13.0\\n"',
    )
    assert found("3.12", tmp_path) == f"{tmp_path}/versions/3.12.1/bin/python"
    assert (tmp_path / "versions").is_dir()


def test_absent_interpreter_is_an_empty_answer(tmp_path):
    assert found("3.13", tmp_path) == ""
