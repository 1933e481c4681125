"""Files of the store of a batch: lost and partial ones, locks, parts, a full and a read-only disk.

The results are made up, so that nothing is estimated.
"""

import contextlib
import errno
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
import zarr

from jaxid._foundation.checks import InputError
from jaxid.batches.locks import LOCK_FILE
from jaxid.batches.parts import CASES_PER_FILE, Part
from jaxid.batches.results import UNFINISHED, Layout
from jaxid.batches.store import BatchStore

CASES = 600
WHOLE = Part(0, 1)
LAYOUT = Layout(
    tuple(f"case {i}" for i in range(CASES)), ("a", "b"), ("", "m"), ("x0",), 1, ("y",), 1e-6
)
SETTINGS = {"version": "1"}

# Holds the locks of some files until its standard input ends.
HOLDER = """
import fcntl, sys
handle = open(sys.argv[1], "ab")
for number in sys.argv[2:]:
    fcntl.lockf(handle, fcntl.LOCK_EX, 1, int(number))
print("held", flush=True)
sys.stdin.read()
"""


@contextlib.contextmanager
def held_by_another_process(path, *files):
    command = [sys.executable, "-c", HOLDER, str(path / LOCK_FILE), *map(str, files)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        yield
        assert process.stdin is not None
        process.stdin.close()


def opened(path, part=WHOLE, settings=SETTINGS):
    return BatchStore(path, LAYOUT, settings, part)


def results():
    """Return results of all cases, most of whose texts and flags are empty or zero."""
    arrays = LAYOUT.empty()
    arrays["status"][:] = "successful"
    arrays["values"][:] = np.arange(2 * CASES).reshape(CASES, 2)
    return arrays


@pytest.fixture
def complete(tmp_path):
    store = opened(tmp_path / "store")
    with store.claimed():
        store.write(range(CASES), results())
    return store


def refused_claim(store, match):
    with pytest.raises(InputError, match=match), store.claimed():
        pass


def unfinished(store):
    return np.flatnonzero(store.load()["status"] == UNFINISHED)


def test_written_results_are_read_again(complete):
    read, expected = opened(complete.path).load(), results()
    for name, values in expected.items():
        np.testing.assert_array_equal(read[name], values)


@pytest.mark.parametrize("lost", ["status/1", "values/1.0", "on_bound/1.0", "reason/1"])
def test_cases_of_a_lost_file_are_unfinished(complete, lost):
    (complete.path / lost).unlink()
    rows = complete.rows
    assert rows == CASES // 3
    expected = np.arange(rows, 2 * rows)
    np.testing.assert_array_equal(unfinished(complete), expected)
    read = complete.load()
    assert np.isnan(read["values"][expected]).all()
    assert (read["values"][:rows] == results()["values"][:rows]).all()
    with complete.claimed():
        complete.write(expected.tolist(), results())
    assert not len(unfinished(complete))


def test_opening_keeps_partial_files_and_claiming_removes_own_ones(complete):
    partials = [complete.path / "cost" / f"{number}.0a1b.partial" for number in range(3)]
    for partial in partials:
        partial.touch()
    second = opened(complete.path, Part(1, 2))  # owns the file 1 of three
    assert all(partial.exists() for partial in partials)
    with second.claimed():
        assert [partial.exists() for partial in partials] == [True, False, True]


def test_store_in_use_by_another_process_is_refused_and_its_files_stay(complete):
    partial = complete.path / "cost" / "1.0a1b.partial"
    partial.touch()
    with held_by_another_process(complete.path, 1):
        refused_claim(complete, r"Another process writes.*its file 1")
        with opened(complete.path, Part(0, 2)).claimed():  # files 0 and 2 are free
            pass
        assert partial.exists()
    with complete.claimed():  # the other process has ended
        assert not partial.exists()


def test_claims_of_one_store_end_with_their_block(complete):
    for _ in range(2):
        with complete.claimed():
            pass


@pytest.mark.parametrize("count", [1, 2, 3, 7])
@pytest.mark.parametrize("cases", [1, 5, CASES, 1000])
def test_parts_divide_all_cases_by_whole_files(cases, count):
    rows = Part(0, count).rows(cases)
    assert 1 <= rows <= CASES_PER_FILE
    parts = [Part(number, count).cases(cases, rows) for number in range(count)]
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(cases))
    sizes = [len(part) for part in parts]
    assert max(sizes) - min(sizes) <= 2 * count if cases >= 100 else max(sizes) <= rows


def test_part_is_read_from_text_and_refused_in_words():
    assert Part.read("3/8") == (3, 8)
    for wrong in ("8/8", "3", "-1/2", "a/b", "1/0"):
        with pytest.raises(InputError, match="number of this process"):
            Part.read(wrong)


def test_store_keeps_its_files_for_another_number_of_parts(tmp_path):
    """The first process makes the store; a later run with fewer parts shares its files."""
    path = tmp_path / "store"
    assert opened(path, Part(0, 4)).rows == CASES // 4
    parts = [opened(path, Part(number, 2)).cases for number in range(2)]
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(CASES))


def test_store_made_by_another_process_in_the_meantime_is_used(tmp_path, monkeypatch):
    path, rename = tmp_path / "store", os.rename

    def late(source, target):
        monkeypatch.setattr(os, "rename", rename)
        store = opened(path)
        store.write([3], results())
        rename(source, target)

    monkeypatch.setattr(os, "rename", late)
    assert len(unfinished(opened(path))) == CASES - 1
    assert os.listdir(tmp_path) == ["store"]


def test_full_disk_at_creation_is_refused_in_words_and_leaves_nothing(tmp_path, monkeypatch):
    async def full(self, key, value):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(zarr.storage.LocalStore, "set", full)
        with pytest.raises(InputError, match=r"cannot be written.*No space left.*Make room"):
            opened(tmp_path / "store")
    assert os.listdir(tmp_path) == []
    assert len(unfinished(opened(tmp_path / "store"))) == CASES


def test_read_only_store_is_read_and_refuses_to_be_written(complete, monkeypatch):
    before = xr.open_zarr(complete.path, consolidated=False, chunks=None).load()
    open_file = pathlib.Path.open

    def read_only(path, mode="r", *args, **options):
        if mode.strip("bt") != "r":
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return open_file(path, mode, *args, **options)

    with monkeypatch.context() as patch:
        patch.setattr(pathlib.Path, "open", read_only)
        store = opened(complete.path)
        assert not len(unfinished(store))
        refused_claim(store, r"cannot be written.*Read-only.*cases already in it")
    xr.testing.assert_identical(
        xr.open_zarr(complete.path, consolidated=False, chunks=None).load(), before
    )


def test_full_disk_in_the_middle_of_a_write_keeps_earlier_cases(tmp_path, monkeypatch):
    """Each file in turn is the first one that the disk does not take."""
    store, put = opened(tmp_path / "store"), zarr.storage.LocalStore.set
    store.write(range(100), results())
    variables = len(results())
    for room in range(variables):
        taken = []

        async def full(self, key, value, room=room, taken=taken):
            taken.append(key)
            if len(taken) > room:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            await put(self, key, value)

        with monkeypatch.context() as patch:
            patch.setattr(zarr.storage.LocalStore, "set", full)
            with pytest.raises(InputError, match=r"No space left.*already in it\s+remain"):
                store.write(range(100, 200), results())
        assert taken[-1].startswith("status") == (room == variables - 1)
    read = store.load()
    np.testing.assert_array_equal(unfinished(store), np.arange(100, CASES))
    np.testing.assert_array_equal(read["values"][:100], results()["values"][:100])


def test_store_of_other_settings_or_version_is_refused(complete):
    with pytest.raises(InputError, match=r"its version is '1', that of this call '2'"):
        opened(complete.path, settings={"version": "2"})
    with pytest.raises(InputError, match=r"its solver is missing"):
        opened(complete.path, settings={"version": "1", "solver": "x"})
    assert not len(unfinished(complete))
