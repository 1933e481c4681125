"""Odd arguments of `record` and `read_csv`, by the seed given: how each ends, as JSON."""

import json
import math
import random
import sys
import tempfile
import traceback
from pathlib import Path

import numpy as np

import jaxid


class Odd:
    """An object that is no number."""


ODD = [
    *(None, "force", b"x", 1, -1.5, math.nan, math.inf, True, 1j, [], (), {}, Odd(), set()),
    *(("u",), ("u", "u"), ("x",), ("",), (1,), ("t",), ["u", "x"], "t", object, np.float32(2)),
    *(np.zeros((0,)), np.zeros((8, 0)), np.zeros((8, 2)), np.zeros((2, 2, 2)), np.array("a")),
    *(np.arange(8.0), np.arange(8)[::-1], np.array([None] * 8), np.ma.masked_all(8), [[1], [1, 2]]),
    *({"x": "deg"}, {"x": "degs"}, {"y": "m"}, {"t": "m"}, {"x": None}, {1: "m"}, {"x": "1/0"}),
    *({"mass": 1.0}, {"mass": "heavy"}, {"mass": [1, 2]}, {"mass": math.nan}, 10**400),
]


def record_arguments(rng):
    arguments = {
        **{"t": 0.1 * np.arange(8), "u": np.ones(8), "z": np.arange(8.0)},
        **{"inputs": ("u",), "outputs": ("x",)},
    }
    names = ("t", "u", "z", "inputs", "outputs", "units", "constants", "name")
    for name in rng.sample(names, rng.randint(1, 3)):
        arguments[name] = rng.choice(ODD)
    return arguments


def check(record):
    """Refuse a record that breaks its promises."""
    assert record.t.shape == record.u.shape[:1] == record.z.shape[:1]
    assert np.all(np.diff(record.t) > 0)
    assert np.isfinite(record.u).all()
    assert np.isfinite(record.z).all()
    repr(record)


def main():
    rng, taken, failures = random.Random(int(sys.argv[1])), 0, []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        path.write_text("t,u,x\n0,1,2\n0.1,2,3\n0.2,2,3\n")

        def from_csv(rng):
            names = ("sample_time", "units", "name", "constants", "delimiter", "decimal")
            names += ("encoding", "skip", "time", "inputs", "outputs")
            arguments = {"path": path, "inputs": ("u",), "outputs": ("x",)}
            return arguments | {name: rng.choice(ODD) for name in rng.sample(names, 2)}

        for number in range(2000):
            make, function = (
                (record_arguments, jaxid.record) if number % 4 else (from_csv, jaxid.read_csv)
            )
            arguments = make(rng)
            try:
                check(function(**arguments))
                taken += 1
            except jaxid.InputError:
                pass
            except Exception as error:
                place = traceback.extract_tb(error.__traceback__)[-1]
                odd = {key: repr(value)[:60] for key, value in arguments.items()}
                failures.append(f"{type(error).__name__}: {error} {place.name} {odd}")
    print(json.dumps({"taken": taken, "failures": failures}))  # noqa: T201


main()
