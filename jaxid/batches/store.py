"""`BatchStore`: results of a batch in one Zarr store, complete at any moment.

A file of the store is replaced as a whole, and the status of a case is written after its numbers. A
run that is killed therefore leaves a store in which every case that has a status has its numbers.
Every file exists from the beginning, so that the cases of a lost file count as unfinished.

Several processes write to one store, each the files of its own part.
"""

import contextlib
import itertools
import os
import shutil
import uuid
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._foundation.checks import InputError, require
from .locks import locked
from .parts import Part
from .results import STATUSES, VARIABLES, Arrays, Layout

if TYPE_CHECKING:
    import xarray as xr

# Version 2 of the format, as version 3 has no specification of strings of fixed length.
FORMAT: dict[str, Any] = {"zarr_format": 2, "consolidated": False}
# Files that hold only zeros or empty texts are written as well.
WITH_EMPTY_FILES = {"array.write_empty_chunks": True}


class BatchStore:
    """Results of a batch in a folder.

    Args:
        path: folder of the store. It is created if it does not exist.
        layout: names of cases and parameters.
        attributes: version and settings of this run. A store with other ones is refused.
        part: the part of this process.

    Attributes:
        rows: cases in a file of a variable.

    Raises:
        InputError: when the folder is not a store of a batch, belongs to another batch, or cannot
            be created.
    """

    def __init__(
        self, path: str | Path, layout: Layout, attributes: dict[str, str], part: Part
    ) -> None:
        _require_zarr()
        self.path, self.layout, self.part = Path(path), layout, part
        if not self.path.exists():
            self._create(attributes)
        self._check(attributes)
        with self._open() as dataset:
            self.rows = max(int(dataset["status"].encoding["chunks"][0]), 1)

    @property
    def cases(self) -> np.ndarray:
        """Indices of the cases of this process."""
        return self.part.cases(len(self.layout.cases), self.rows)

    def load(self) -> Arrays:
        """Return the results in the store as arrays; cases of a lost file are unfinished."""
        with self._open() as dataset:
            stored = {name: dataset[name].values for name in VARIABLES}
        arrays = {name: values.astype(VARIABLES[name].type) for name, values in stored.items()}
        arrays["reason"] = np.array([str(reason) for reason in stored["reason"]], object)
        lost = np.isin(np.arange(len(self.layout.cases)) // self.rows, self._lost_files())
        is_complete = np.isin(arrays["status"], STATUSES) & ~lost
        empty = self.layout.empty()
        for name, values in arrays.items():
            values[~is_complete] = empty[name][~is_complete]
        return arrays

    @contextlib.contextmanager
    def claimed(self) -> Iterator[None]:
        """Reserve the cases of this process for it, and remove partial files of a killed run.

        Raises:
            InputError: when another process holds them, or the store cannot be written.
        """
        files = self.part.files(len(self.layout.cases), self.rows).tolist()
        with contextlib.ExitStack() as held:
            with self._writing():
                if held.enter_context(locked(self.path, files)):
                    own = {str(number) for number in files}
                    for partial in self.path.glob("*/*.partial"):
                        if partial.name.split(".")[0] in own:
                            partial.unlink()
            yield

    def write(self, indices: Sequence[int], arrays: Arrays) -> None:
        """Write the results of some cases.

        Args:
            indices: positions of the cases.
            arrays: results of all cases.

        Raises:
            InputError: when the disk is full or the store cannot be written; it keeps the cases
                that were written before.
        """
        import zarr

        rows = np.sort(np.asarray(indices, int))
        if not rows.size:
            return
        with self._writing(), zarr.config.set(WITH_EMPTY_FILES):
            group = zarr.open_group(self.path, mode="r+", zarr_format=2)
            for name in sorted(VARIABLES, key=lambda name: name == "status"):  # status last
                variable: Any = group[name]
                variable.oindex[rows] = arrays[name][rows]

    def _open(self) -> "xr.Dataset":
        import xarray as xr

        return xr.open_zarr(self.path, chunks=None, **FORMAT)

    def _create(self, attributes: dict[str, str]) -> None:
        """Create the store without results under another name, then rename it."""
        import zarr

        dataset = self.layout.dataset(self.layout.empty(), attributes)
        partial = self.path.with_name(f"{self.path.name}.{uuid.uuid4().hex}.partial")
        rows = self.part.rows(len(self.layout.cases))
        encoding = {
            name: {"chunks": (rows, *dataset[name].shape[1:]), "_FillValue": None}
            for name in VARIABLES
        }
        with self._writing(), zarr.config.set(WITH_EMPTY_FILES):
            try:
                partial.parent.mkdir(parents=True, exist_ok=True)
                dataset.to_zarr(partial, mode="w", encoding=encoding, **FORMAT)
                self._rename(partial)
            finally:
                shutil.rmtree(partial, ignore_errors=True)

    def _rename(self, partial: Path) -> None:
        """Give the store its name, unless another process has made it in the meantime."""
        try:
            os.rename(partial, self.path)
        except OSError:
            if not self.path.exists():
                raise

    def _lost_files(self) -> list[int]:
        """Return the numbers of files that are missing for a variable."""
        count = -(-len(self.layout.cases) // self.rows)
        sizes = self.layout.sizes
        lost = set()
        for (name, variable), number in itertools.product(VARIABLES.items(), range(count)):
            zeros = ["0"] * len(variable.dimensions)
            is_stored = all(sizes[axis] for axis in variable.dimensions)
            if is_stored and not (self.path / name / ".".join([str(number), *zeros])).exists():
                lost.add(number)
        return sorted(lost)

    def _check(self, attributes: dict[str, str]) -> None:
        """Refuse a store of another batch, and name the difference."""
        try:
            with self._open() as dataset:
                known = {name: str(value) for name, value in dataset.attrs.items()}
        except Exception as error:  # xarray and zarr have many
            raise InputError(
                f"{str(self.path)!r} exists and is not the store of a batch ({error}). Choose "
                "another name."
            ) from error
        for name, value in attributes.items():
            require(
                known.get(name) == value,
                f"The store {str(self.path)!r} belongs to another batch: its {name} is "
                f"{_short(known.get(name))}, that of this call {_short(value)}. Call with the same "
                "records, model, code of the model, options and versions of jaxid and Python to "
                "continue it, or choose another name.",
            )

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Turn an error of the file system into an `InputError`."""
        try:
            yield
        except OSError as error:
            raise InputError(
                f"The store {str(self.path)!r} cannot be written: {error}. The cases already in it "
                "remain. Make room or permit writing, and call again with the same arguments "
                "to continue."
            ) from error


def _short(text: str | None) -> str:
    """Return a text in quotes, or its first 200 characters."""
    if text is None:
        return "missing (an earlier version of jaxid made the store)"
    return repr(text if len(text) <= 200 else f"{text[:200]}...")


def _require_zarr() -> None:
    """Refuse to work without zarr, an optional dependency."""
    try:
        import zarr  # noqa: F401
    except ImportError as error:
        raise InputError(
            "A store needs the package zarr. Install it with `pip install 'jaxid[batch]'`, or "
            "leave `store` out."
        ) from error
