"""Damaged files and odd arguments, by fixed seeds: each is refused in words, or read as it stands.

An exception of another kind, a warning, or a CSV cell that is read as another number fails.
"""

import json
import math
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import scipy.io

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.data import read_columns
from jaxid.data.io.study import read_study

TOKENS = [
    *(b"nan", b"inf", b"-inf", b"1e999", b"", b'"', b";", b",", b"\n", b"\r\n", b"\x00", b"\xff"),
    *(
        b"1_0",
        b"0x1f",
        b"1,5",
        b"--1",
        b"\xd9\xa1",
        b"\xef\xbb\xbf",
        b"t",
        b"[deg]",
        b"]",
        b"[",
        b"=",
    ),
    *(b"{}", b"[records]", b"true", b"-1", b"0", b"1e308", b"''", b"\\u0000", b" ", b"\t"),
]
CSV = b"t,u,x [deg]\n" + b"".join(b"%g,%g,%g\n" % (0.1 * k, k % 3, k * k) for k in range(12))
STUDY = b"""
title = "A study"
[model]
use = "module:Model"
parameters = { k = 1.0 }
[free]
parameters = ["k"]
bounds = { k = [0.0, inf] }
[records]
inputs = ["u"]
outputs = ["x"]
units = { x = "deg" }
delimiter = ","
train = ["a.csv"]
cut = 0.6
[noise]
x = "0.1 deg"
[loop]
window = 3
"""


def mutated(content, rng):
    """The content with one to four mutations."""
    data = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(data) + 1)
        stop = min(len(data), at + rng.choice([0, 1, 1, 2, 5, 20]))
        kind = rng.randrange(5)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del data[at:stop]
        elif kind == 2:
            data[at:at] = rng.choice(TOKENS)
        elif kind == 3:
            data[at:stop] = rng.choice(TOKENS)
        else:
            data[at:at] = data[at:stop]
    return bytes(data)


def attempt(function):
    """The result of a function, or None if it refuses in words."""
    try:
        return function()
    except InputError as error:
        assert len(str(error)) > 20, error  # noqa: PT017
        return None


def independent(content):
    """Cells by column of a CSV file without quotes, by splitting alone."""
    lines = [line for line in content.decode("utf-8-sig").splitlines() if line.strip(" ,\t")]
    return list(zip(*(line.split(",") for line in lines[1:]), strict=True))


def number(cell):
    return float(cell) if cell.strip() else math.nan


def test_damaged_csv_is_refused_or_read_cell_by_cell(tmp_path):
    rng, path, accepted = random.Random(1), tmp_path / "a.csv", 0
    for _ in range(800):
        content = mutated(CSV, rng)
        path.write_bytes(content)
        options = {"inputs": ("u",), "outputs": ("x",), "units": {"x": ""}}
        record = attempt(lambda options=options: jaxid.read_csv(path, **options))
        plain = b'"' not in content and b"\r" not in content
        if record is None or not plain or b"\n\n" in content.strip():
            continue
        accepted += 1
        t, u, x = independent(content)[:3]
        np.testing.assert_array_equal(record.t, list(map(number, t)))
        np.testing.assert_array_equal(record.u[:, 0], list(map(number, u)))
        np.testing.assert_array_equal(record.channel("x"), list(map(number, x)))
    assert 50 < accepted < 700


def test_damaged_columns_are_refused_or_read(tmp_path):
    rng, path = random.Random(2), tmp_path / "a.txt"
    columns = {"t": (1, "s"), "u": ({2: 1.0, 3: -1.0}, "deg"), "x": (3, "m")}
    content = CSV.split(b"\n", 1)[1].replace(b",", b" ")
    for _ in range(500):
        path.write_bytes(mutated(content, rng))
        attempt(lambda: read_columns(path, columns, inputs=("u",), outputs=("x",)))


def test_damaged_matlab_files_are_refused_or_read(tmp_path):
    rng, path = random.Random(3), tmp_path / "a.mat"
    t = 0.1 * np.arange(12)
    scipy.io.savemat(path, {"y": t, "u": t, "x": np.stack([t, t]), "s": "text", "c": {"a": 1}})
    content, read = path.read_bytes(), 0
    for _ in range(300):
        path.write_bytes(mutated(content, rng))
        options = {"inputs": ("u",), "outputs": ("y",), "sample_time": 0.1}
        read += attempt(lambda options=options: jaxid.read_mat(path, **options)) is not None
    assert 5 < read < 280


def test_damaged_study_files_are_refused_or_read(tmp_path):
    rng, path = random.Random(4), tmp_path / "study.toml"
    (tmp_path / "a.csv").write_bytes(CSV)
    read = 0
    for _ in range(500):
        path.write_bytes(mutated(STUDY, rng))
        read += attempt(lambda: read_study(path)) is not None
    assert 20 < read < 480


def test_odd_arguments_are_refused_or_taken(user_environment):
    """In a program of its own, as the tests' checks of annotations would refuse them first."""
    program = Path(__file__).parents[2] / "helpers" / "odd_arguments.py"
    done = subprocess.run(
        [sys.executable, "-W", "error", str(program)],
        env=user_environment | {"JAX_ENABLE_X64": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["failures"] == []
    assert 5 < result["taken"] < 600
