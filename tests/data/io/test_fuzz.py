"""Damaged files and odd arguments, by fixed seeds: each is refused in words, or read as it stands.

An exception of another kind, a warning, a call of more than `LIMIT` seconds, or a cell of text that
is read as another number fails. The variable `JAXID_FUZZ` repeats the 4,400 cases of each round
with other seeds.
"""

import io
import json
import math
import os
import random
import signal
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.io

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.data import read_columns, read_sidpac
from jaxid.data.io.study import read_study

LIMIT = 10.0  # seconds (chosen)
every_round = pytest.mark.parametrize("turn", range(int(os.environ.get("JAXID_FUZZ", "1"))))
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
CELLS = [
    *(b"1e3", b"-0", b"+5", b" 7 ", b"1e-320", b".5", b"5.", b"nan", b"NaN", b"", b" ", b'"4"'),
    *(b"0x10", b"1_0", b"1d3", b"inf", b"1e999", b"1 2", b"\xd9\xa1", b"true", b"None", b"--1"),
]
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


def too_long(number, frame):
    raise TimeoutError(f"more than {LIMIT} s")


@pytest.fixture(autouse=True)
def alarm():
    """Calls that take too long are interrupted."""
    before = signal.signal(signal.SIGALRM, too_long)
    yield
    signal.signal(signal.SIGALRM, before)


def with_odd_cells(content, rng):
    """The content of a CSV file with one or two other cells below its titles."""
    rows = [line.split(b",") for line in content.splitlines()]
    for _ in range(rng.randint(1, 2)):
        row = rng.choice(rows[1:])
        row[rng.choice((0, 1, 2, 2, 2, 2))] = rng.choice(CELLS)  # mostly the output
    return b"\n".join(b",".join(row) for row in rows)


def attempt(function):
    """The result of a function, or None if it refuses in words."""
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    try:
        return function()
    except InputError as error:
        assert len(str(error)) > 20, error  # noqa: PT017
        return None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def cells_of(content):
    """Cells of a CSV file by title, read by pandas; without rows that have no cell with text."""
    table = pd.read_csv(
        io.BytesIO(content), header=None, dtype=str, keep_default_na=False, encoding="utf-8-sig"
    )
    rows = [row for row in table.to_numpy().tolist() if any(cell.strip() for cell in row)]
    return dict(zip(rows[0], zip(*rows[1:], strict=True), strict=True))


def numbers(cells, name, scales):
    """Numbers of the column of a channel, times the scale of the unit in its title."""
    (title,) = (title for title in cells if title.split("[")[0].strip() == name)
    scale = scales[title.partition("[")[2].strip(" ]")]
    return [scale * float(cell) if cell.strip() else math.nan for cell in cells[title]]


@every_round
def test_damaged_csv_is_refused_or_read_cell_by_cell(tmp_path, turn):
    rng, path, accepted = random.Random(1 + 10 * turn), tmp_path / "a.csv", 0
    for _ in range(800):
        content = rng.choice([mutated, with_odd_cells])(CSV, rng)
        path.write_bytes(content)
        options = {"inputs": ("u",), "outputs": ("x",), "units": {"x": ""}}
        record = attempt(lambda options=options: jaxid.read_csv(path, **options))
        if record is None:
            continue
        accepted += 1
        cells = cells_of(content)
        any_unit, no_unit = defaultdict(lambda: 1.0), {"": 1.0}
        radians = {"deg": np.pi / 180, "": 1.0}
        np.testing.assert_array_equal(record.t, numbers(cells, "t", no_unit))
        np.testing.assert_allclose(record.u[:, 0], numbers(cells, "u", radians), rtol=1e-15)
        np.testing.assert_array_equal(record.channel("x"), numbers(cells, "x", any_unit))
    assert 100 < accepted < 700


@every_round
def test_damaged_columns_are_refused_or_read_cell_by_cell(tmp_path, turn):
    rng, path, accepted = random.Random(2 + 10 * turn), tmp_path / "a.txt", 0
    columns = {"t": (1, "s"), "u": ({2: 1.0, 3: -1.0}, "m"), "x": (3, "m")}
    written = CSV.split(b"\n", 1)[1].replace(b",", b" ")
    for _ in range(500):
        content = mutated(written, rng)
        path.write_bytes(content)
        record = attempt(lambda: read_columns(path, columns, inputs=("u",), outputs=("x",)))
        if record is None:
            continue
        accepted += 1
        rows = [line.split() for line in content.decode("utf-8-sig").splitlines()]
        t, u, x = np.array([list(map(float, row[:3])) for row in rows if row]).T
        np.testing.assert_array_equal(record.t, t)
        np.testing.assert_allclose(record.u[:, 0], u - x, rtol=1e-14)
        np.testing.assert_array_equal(record.channel("x"), x)
    assert 20 < accepted < 480


@every_round
@pytest.mark.parametrize("ending", ["mat", "txt"])
def test_damaged_sidpac_files_are_refused_or_read(tmp_path, turn, ending):
    rng, path, read = random.Random(6 + 10 * turn), tmp_path / f"a.{ending}", 0
    rows, empty = np.arange(8), np.zeros((8, 90))
    empty[:, 0], empty[:, 1], empty[:, 3], empty[:, 13] = 0.1 * rows, 300.0, rows, 2.0 * rows
    if ending == "mat":
        scipy.io.savemat(path, {"fdata": empty})
    else:
        np.savetxt(path, empty, fmt="%g")
    written = path.read_bytes()
    for _ in range(150):
        content = mutated(written, rng)
        path.write_bytes(content)
        record = attempt(lambda: read_sidpac(path))
        if record is None:
            continue
        read += 1
        if ending == "txt":
            t = [float(line.split()[0]) for line in content.decode().splitlines() if line.strip()]
            np.testing.assert_array_equal(record.t, t)
    assert 5 < read < 145


@every_round
def test_damaged_matlab_files_are_refused_or_read(tmp_path, turn):
    rng, path = random.Random(3 + 10 * turn), tmp_path / "a.mat"
    t = 0.1 * np.arange(12)
    scipy.io.savemat(path, {"y": t, "u": t, "x": np.stack([t, t]), "s": "text", "c": {"a": 1}})
    content, read = path.read_bytes(), 0
    for _ in range(300):
        path.write_bytes(mutated(content, rng))
        options = {"inputs": ("u",), "outputs": ("y",), "sample_time": 0.1}
        read += attempt(lambda options=options: jaxid.read_mat(path, **options)) is not None
    assert 5 < read < 280


@every_round
def test_damaged_study_files_are_refused_or_read(tmp_path, turn):
    rng, path = random.Random(4 + 10 * turn), tmp_path / "study.toml"
    (tmp_path / "a.csv").write_bytes(CSV)
    read = 0
    for _ in range(500):
        path.write_bytes(mutated(STUDY, rng))
        read += attempt(lambda: read_study(path)) is not None
    assert 20 < read < 480


@every_round
def test_odd_arguments_are_refused_or_taken(user_environment, turn):
    """In a program of its own, as the tests' checks of annotations would refuse them first."""
    program = Path(__file__).parents[2] / "helpers" / "odd_arguments.py"
    done = subprocess.run(
        [sys.executable, "-W", "error", str(program), str(5 + 10 * turn)],
        env=user_environment | {"JAX_ENABLE_X64": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["failures"] == []
    assert 5 < result["taken"] < 600
