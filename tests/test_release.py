"""Wheel and source archive hold the package, and the wheel works away from the source."""

import importlib.util
import os
import subprocess
import sys
import tarfile
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = """
import jaxid, jaxid.aircraft, jaxid.report.html
assert jaxid.aircraft.f16().name
print(jaxid.__file__)
"""


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    if not all(importlib.util.find_spec(name) for name in ("build", "hatchling")):
        pytest.skip('build and hatchling are not installed: pip install -e ".[test]"')
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return next(folder.glob("*.whl")), next(folder.glob("*.tar.gz"))


def test_both_archives_hold_every_file_of_the_package(archives):
    wheel, source = archives
    files = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "jaxid").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    with zipfile.ZipFile(wheel) as archive:
        assert files <= set(archive.namelist())
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert files | {"LICENSE", "README.md", "CHANGELOG.md", "pyproject.toml"} <= names


def test_the_version_has_one_place(archives):
    wheel, source = archives
    (line,) = (
        line
        for line in (ROOT / "pyproject.toml").read_text(encoding="utf-8").splitlines()
        if line.startswith("version = ")
    )
    number = line.split('"')[1]
    assert wheel.name.startswith(f"jaxid-{number}-")
    assert source.name == f"jaxid-{number}.tar.gz"
    assert version("jaxid") == number


def test_the_wheel_works_away_from_the_source(archives, tmp_path):
    with zipfile.ZipFile(archives[0]) as archive:
        archive.extractall(tmp_path)
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "JAX_ENABLE_X64": "1"}
    command = [sys.executable, "-c", PROGRAM]
    options = {"cwd": tmp_path, "env": environment, "capture_output": True, "text": True}
    done = subprocess.run(command, check=False, **options)
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()).is_relative_to(tmp_path)
