"""The store of `estimate_many`: a stopped run continues to the same store, others are refused."""

import errno
import importlib
import os
import random
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from many_lags import Hardening, chosen, lag_records, model

from jaxid._foundation.checks import InputError
from jaxid.batches import estimate_many
from jaxid.batches.cases import read_cases
from jaxid.batches.identity import identity_of
from jaxid.data import record
from jaxid.estimation import GaussNewton, OutputError

HELPERS = Path(__file__).resolve().parent.parent / "helpers"
MODULE = importlib.import_module("jaxid.batches.estimate_many")
CASES = 220
SILENT = (9, 77)

KILLED = """
import importlib, os, sys
import jax
jax.config.update("jax_enable_x64", True)
from many_lags import chosen, lag_records, model
import jaxid
importlib.import_module("jaxid.batches.estimate_many").WRITE_SECONDS = 0.0
records = lag_records({cases}, seed=8, silent={silent})
options = dict(store=sys.argv[1], progress=lambda state: print(state.finished, flush=True))
jaxid.estimate_many(model(), chosen(), records, jaxid.OutputError(), **options)
"""


@pytest.fixture(autouse=True)
def write_at_once(monkeypatch):
    monkeypatch.setattr(MODULE, "WRITE_SECONDS", 0.0)


@pytest.fixture(scope="module")
def records():
    return lag_records(CASES, seed=8, silent=SILENT)


@pytest.fixture(scope="module")
def undisturbed(records, tmp_path_factory):
    path = tmp_path_factory.mktemp("undisturbed") / "store"
    run(records, path)
    return path


def run(records, path, **options):
    return estimate_many(model(), chosen(), records, OutputError(), store=path, **options)


def read(path):
    return xr.open_zarr(path, consolidated=False, chunks=None).load()


def require_identical(one, other):
    """Require equal words and counts, and numbers equal to rounding.

    The same programs made both, in other lanes of their groups; a processor may round differently
    in the last lanes of a vector.
    """
    assert one.attrs == other.attrs
    assert set(one.variables) == set(other.variables)
    for name in one.variables:
        first, second = one[name].values, other[name].values
        if first.dtype == float:
            np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-14)
        else:
            np.testing.assert_array_equal(first, second)


class StopError(Exception):
    """Raised by a callback."""


def test_run_stopped_three_times_continues_to_the_same_store(records, undisturbed, tmp_path):
    path, done = tmp_path / "store", []

    def stop(state):
        raise StopError

    for _ in range(3):
        with pytest.raises(StopError):
            run(records, path, progress=stop)
        done.append(int(np.sum(read(path).status != "unfinished")))
    assert 0 < done[0] < done[1] < done[2] < CASES
    progress = []
    run(records, path, progress=progress.append)
    assert progress[0].finished > done[2]  # continues and does not start again
    require_identical(read(path), read(undisturbed))
    finished = read(path)
    assert list(np.flatnonzero(finished.status == "undetermined")) == list(SILENT)


def test_run_killed_at_a_random_moment_continues_to_the_same_store(records, undisturbed, tmp_path):
    """SIGKILL, at most 30 ms after the first cases are reported: while files are being written."""
    path = tmp_path / "store"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HELPERS), *sys.path])}
    script = KILLED.format(cases=CASES, silent=SILENT)
    with subprocess.Popen(
        [sys.executable, "-c", script, str(path)], env=environment, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        threading.Event().wait(random.Random().uniform(0.0, 0.03))
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    before = read(path)
    complete = (before.status != "unfinished").values
    assert 0 < complete.sum() < CASES
    assert np.isfinite(before["values"].values[complete]).all()
    run(records, path)
    require_identical(read(path), read(undisturbed))
    assert not list(path.glob("*/*.partial"))


def test_finished_store_is_read_and_not_computed_again(records, undisturbed):
    progress = []
    again = run(records, undisturbed, progress=progress.append)
    assert progress == []
    require_identical(again, read(undisturbed))


def test_store_of_another_batch_is_refused_and_unchanged(records, tmp_path, monkeypatch):
    path, few = tmp_path / "store", records[:3]
    run(few, path)
    before = read(path)
    with pytest.raises(InputError, match="belongs to another batch: its data is"):
        run(records[:2], path)
    with pytest.raises(InputError, match=r"its solver is .*max_steps=50"):
        run(few, path, solver=GaussNewton(max_steps=50))
    with pytest.raises(InputError, match="its data is"):
        run(few, path, starts={"p": np.full(3, 1.1)})
    identity = importlib.import_module("jaxid.batches.identity")
    monkeypatch.setattr(identity, "version", lambda: "9.9")
    with pytest.raises(InputError, match=r"its version is '.*', that of this call '9.9'"):
        run(few, path)
    xr.testing.assert_identical(read(path), before)


def test_store_of_other_equations_is_refused(records, tmp_path, monkeypatch):
    path, few = tmp_path / "store", records[:2]
    run(few, path)
    before = read(path)
    monkeypatch.setattr(Hardening, "rhs", lambda self, t, x, u: 2.0 * u - self.p * x)
    with pytest.raises(InputError, match=r"belongs to another batch: its code is '.*same records"):
        run(few, path)
    xr.testing.assert_identical(read(path), before)
    monkeypatch.undo()
    del zarr.open_group(path, mode="r+", zarr_format=2).attrs["code"]
    with pytest.raises(InputError, match=r"its code is missing \(an earlier version of jaxid made"):
        run(few, path)


def test_folder_that_is_no_store_is_refused(records, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="is not the store of a batch"):
        run(records[:2], tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_folder_that_cannot_be_made_is_refused(records, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        run(records[:2], tmp_path / "file" / "store")


def test_full_disk_stops_the_run_and_keeps_finished_cases(
    records, undisturbed, tmp_path, monkeypatch
):
    """The third write of a chunk of the costs fails, in the middle of a group of variables."""
    path, written = tmp_path / "store", []
    store = zarr.storage.LocalStore
    put = store.set

    async def full(self, key, value):
        if key.startswith("cost/0"):
            written.append(key)
            if len(written) >= 3:
                raise OSError(errno.ENOSPC, "No space left on device")
        await put(self, key, value)

    monkeypatch.setattr(store, "set", full)
    with pytest.raises(InputError, match=r"No space left on device.*call again"):
        run(records, path)
    monkeypatch.setattr(store, "set", put)
    kept = read(path)
    complete = (kept.status != "unfinished").values
    assert 0 < complete.sum() < CASES
    run(records, path)
    require_identical(read(path), read(undisturbed))


def test_identity_of_records_is_that_of_earlier_stores():
    """The digest is of jaxid 0.1.0 at 72d4019; with another one its stores would not continue."""
    t = 0.5 * np.arange(4)
    pair = [
        record(t, t, z, inputs=("u",), outputs=("x",), name=name, constants={"mass": 2.0})
        for name, z in (("a", t), ("b", -t))
    ]
    cases = read_cases(model(), chosen(), [pair[0], pair], OutputError(), None, {"p": [1.0, 2.0]})
    identity = identity_of(model(), chosen(), OutputError(), GaussNewton(), cases)
    assert identity["data"] == "480e7703f482862a"
