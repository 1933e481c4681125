"""EMPS: an electro-mechanical positioning system, a carriage on a drive screw with strong dry friction."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..build import record
from ..io_mat import mat_variables
from ..record import Record
from .base import DataSet, locate

CITATION = (
    "A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, Workshop on Nonlinear System "
    "Identification Benchmarks 2019."
)
OFFERED = f"Its makers offer it as EMPS at https://www.nonlinearbenchmark.org. {CITATION}"
TRAIN, TRAIN_SHA256 = "DATA_EMPS.mat", "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e"
PULSES, PULSES_SHA256 = "DATA_EMPS_PULSES.mat", "0eab75bb1f6b16228ee78791343a88bf9bfd9a51036ac9807d7b5fc11c0e1704"
WINDOW = 50  # samples, in closed loop
Variables = dict[str, np.ndarray]


def emps(path: str | Path | None = None) -> DataSet:
    """Load EMPS: input "force" [N], the motor's command times its gain (`gtau * vir`), output "position" [m], 1 kHz.

    Both records were measured in closed loop; what is scored is the position simulated open loop from the force over
    the whole record "pulses", from rest at the first measured position, hence no window.

    The variable `pulses_N` of the test file is left out on purpose: its pulses of 5 (volts, whatever the name says) are
    part of the command already: `vir` jumps by 5 V within two samples of each of their edges.

    Args:
        path: a folder that holds both files; the environment variable `JAXID_DATA` when left out. The path of one file
            serves when the other lies beside it.

    Returns:
        The set.

    Raises:
        InputError: when a file is not found or is another one.
    """
    return _set(path, "emps", None, _open_loop)


def emps_closed_loop(path: str | Path | None = None) -> DataSet:
    """Load EMPS as it was controlled: inputs "reference" [m] and "pulse" [V], output "position" [m], 1 kHz.

    The command of the motor is then no input but what the controller makes of the reference and the position, and the pulse
    is what was added to it: none in the first file, `pulses_N` in the second. The carriage creeps as the records begin, so
    that the initial state of the test record is fitted in its first 50 ms, which are left out of the score.

    Args:
        path: as for `emps`.

    Returns:
        The set.

    Raises:
        InputError: when a file is not found or is another one.
    """
    return _set(path, "emps, closed loop", WINDOW, _closed_loop)


def _set(path: str | Path | None, name: str, window: int | None, made: Callable[[Variables, str], Record]) -> DataSet:
    """Both files as records, by the way in which these are made of the files' variables."""
    folder = Path(path).parent if path is not None and Path(path).is_file() else path
    train = made(_variables(locate(folder, "emps", TRAIN, TRAIN_SHA256, OFFERED)), "train")
    test = made(_variables(locate(folder, "emps", PULSES, PULSES_SHA256, OFFERED)), "pulses")
    return DataSet(name, (train,), {"pulses": test}, {"pulses": window}, CITATION)


def _variables(file: Path) -> Variables:
    return {key: np.ravel(value).astype(float) for key, value in mat_variables(file).items()}


def _open_loop(data: Variables, name: str) -> Record:
    units = {"t": "s", "force": "N", "position": "m"}
    force = data["gtau"] * data["vir"]
    return record(data["t"], force, data["qm"], inputs=("force",), outputs=("position",), units=units, name=name)


def _closed_loop(data: Variables, name: str) -> Record:
    units = {"t": "s", "reference": "m", "pulse": "V", "position": "m"}
    u = np.stack([data["qg"], data.get("pulses_N", np.zeros_like(data["qg"]))], axis=1)
    return record(
        data["t"], u, data["qm"], inputs=("reference", "pulse"), outputs=("position",), units=units, name=name
    )
