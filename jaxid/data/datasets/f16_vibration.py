"""F-16 ground vibration: a complete aircraft on a shaker, with payloads at loose mountings."""

import tempfile
import zipfile
from pathlib import Path

import numpy as np

from ..._foundation.checks import InputError, require_known
from ..build import record
from ..io.mat import mat_variables
from ..record import Record
from .base import DataSet, locate

F16_CITATION = (
    "J. P. Noel, M. Schoukens, F-16 aircraft benchmark based on ground vibration test data, "
    "Workshop on Nonlinear System Identification Benchmarks 2017, pp. 19-23."
)
F16_SOURCE = (
    f"The data set is F-16 (F16GVT_Files.zip) at https://www.nonlinearbenchmark.org. {F16_CITATION}"
)
F16_FILE = "F16GVT_Files.zip"
F16_SHA256 = "2278429b1f15f15448e6f101d395a5587d58ac23d32052fd42f8b33a894c0afa"
F16_FOLDER = "F16GVT_Files/BenchmarkData/"
F16_OUTPUTS = ("excitation", "wing", "payload")
F16_WINDOW = 400  # samples, one second (chosen; the split has no window)
# Ten realisations in one file; not part of the split of nonlinear-benchmarks 1.0.1.
LEFT_OUT = "SpecialOddMSine"
F16_VARIABLES = ("Force", "Acceleration", "Fs")


def f16_vibration(path: str | Path | None = None) -> DataSet:
    """Load the F-16 on the ground: input "force" [N] under the right wing, outputs "excitation",
    "wing" and "payload", accelerations at the shaker and on both sides of the mounting [m/s^2],
    400 Hz.

    The records are sine sweeps and multisines of increasing level; the archive is not unpacked.
    Files with "Validation" in their names are the test records, the others are fitted.

    Args:
        path: the archive or a folder that holds it; the environment variable `JAXID_DATA` when left
            out.

    Returns:
        The set; the first second of each test record is for the initial state.

    Raises:
        InputError: when the archive is missing or its SHA-256 differs.
    """
    archive = locate(path, "f16_vibration", F16_FILE, F16_SOURCE, digest=F16_SHA256)
    records = _records(archive)
    test = {name: one for name, one in records.items() if "Validation" in name}
    return DataSet(
        "f16_vibration",
        tuple(one for name, one in records.items() if name not in test),
        test,
        dict.fromkeys(test, F16_WINDOW),
        F16_CITATION,
    )


def _records(archive: Path) -> dict[str, Record]:
    """Return the records of an archive by name, in the order of the names."""
    records = {}
    with zipfile.ZipFile(archive) as files, tempfile.TemporaryDirectory() as folder:
        for member in sorted(files.namelist()):
            name = Path(member).stem
            if member.startswith(F16_FOLDER) and member.endswith(".mat") and LEFT_OUT not in name:
                file = Path(folder, "record.mat")
                file.write_bytes(files.read(member))
                records[name] = _record(mat_variables(file), name)
    if not records:
        raise InputError(f"{archive} has no record in {F16_FOLDER}. {F16_SOURCE}")
    return records


def _record(variables: dict[str, np.ndarray], name: str) -> Record:
    """Return one file as a record."""
    require_known(f"variable in {name}", F16_VARIABLES, variables)
    force, step = np.ravel(variables["Force"]), 1.0 / float(np.ravel(variables["Fs"])[0])
    acceleration = np.reshape(variables["Acceleration"], (len(F16_OUTPUTS), -1)).T
    units = {"force": "N"} | dict.fromkeys(F16_OUTPUTS, "m/s^2")
    channels = {"inputs": ("force",), "outputs": F16_OUTPUTS, "units": units}
    return record(step * np.arange(len(force)), force, acceleration, **channels, name=name)
