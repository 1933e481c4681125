"""EMPS: an electro-mechanical positioning system, a carriage on a drive screw with strong dry
friction.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..build import record
from ..io.mat import mat_variables
from ..record import Record
from .base import DataSet, locate

EMPS_CITATION = (
    "A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, Workshop on Nonlinear "
    "System Identification Benchmarks 2019."
)
EMPS_SOURCE = f"The data set is EMPS at https://www.nonlinearbenchmark.org. {EMPS_CITATION}"
TRAIN_FILE, TRAIN_SHA256 = (
    "DATA_EMPS.mat",
    "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e",
)
PULSES_FILE, PULSES_SHA256 = (
    "DATA_EMPS_PULSES.mat",
    "0eab75bb1f6b16228ee78791343a88bf9bfd9a51036ac9807d7b5fc11c0e1704",
)
EMPS_WINDOW = 50  # samples, in closed loop (chosen)
Variables = dict[str, np.ndarray]


def emps(path: str | Path | None = None) -> DataSet:
    """Load EMPS: input "force" [N], the motor's command times its gain (`gtau * vir`), output
    "position" [m], 1 kHz.

    Both records were measured in closed loop. The scored quantity is the position over all samples
    of the record "pulses", simulated in open loop from the force, from rest at the first measured
    position; therefore there is no window.

    The variable `pulses_N` of the test file is not an input: its pulses of 5 (in volts, despite the
    name) are already part of the command. `vir` jumps by 5 V within two samples of each of their
    edges.

    Args:
        path: a folder that holds both files; the environment variable `JAXID_DATA` when left out.
            The path of one file is also accepted, if the other file is in the same folder.

    Returns:
        The set.

    Raises:
        InputError: when a file is missing or its SHA-256 differs.
    """
    return _set(path, "emps", None, _open_loop)


def emps_closed_loop(path: str | Path | None = None) -> DataSet:
    """Load EMPS in closed loop: inputs "reference" [m] and "pulse" [V], output "position" [m],
    1 kHz.

    Here the motor's command is not an input: the controller computes it from the reference and the
    position. The pulse is a signal added to the command: zero in the first file, `pulses_N` in the
    second. The carriage moves slowly at the start of the records, so that the initial state of the
    test record is fitted to its first 50 ms, which are excluded from the score.

    Args:
        path: as for `emps`.

    Returns:
        The set.

    Raises:
        InputError: when a file is missing or its SHA-256 differs.
    """
    return _set(path, "emps, closed loop", EMPS_WINDOW, _closed_loop)


def _set(
    path: str | Path | None,
    name: str,
    window: int | None,
    make_record: Callable[[Variables, str], Record],
) -> DataSet:
    """Both files as records; `make_record` makes a record from the variables of a file."""
    folder = Path(path).parent if path is not None and Path(path).is_file() else path
    train_file = locate(folder, "emps", TRAIN_FILE, EMPS_SOURCE, digest=TRAIN_SHA256)
    test_file = locate(folder, "emps", PULSES_FILE, EMPS_SOURCE, digest=PULSES_SHA256)
    train = make_record(_variables(train_file), "train")
    test = make_record(_variables(test_file), "pulses")
    return DataSet(name, (train,), {"pulses": test}, {"pulses": window}, EMPS_CITATION)


def _variables(file: Path) -> Variables:
    return {key: np.ravel(value).astype(float) for key, value in mat_variables(file).items()}


def _open_loop(data: Variables, name: str) -> Record:
    units = {"t": "s", "force": "N", "position": "m"}
    force = data["gtau"] * data["vir"]
    return record(
        data["t"],
        force,
        data["qm"],
        inputs=("force",),
        outputs=("position",),
        units=units,
        name=name,
    )


def _closed_loop(data: Variables, name: str) -> Record:
    units = {"t": "s", "reference": "m", "pulse": "V", "position": "m"}
    u = np.stack([data["qg"], data.get("pulses_N", np.zeros_like(data["qg"]))], axis=1)
    return record(
        data["t"],
        u,
        data["qm"],
        inputs=("reference", "pulse"),
        outputs=("position",),
        units=units,
        name=name,
    )
