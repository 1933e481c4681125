"""Cascaded tanks: a pump fills the upper of two tanks, which overflows; the level of the lower tank
is measured.
"""

from pathlib import Path

from ..build import record
from ..io.csv import read_csv
from ..record import Record
from .base import DataSet, locate

TANKS_CITATION = (
    "M. Schoukens, P. Mattsson, T. Wigren, J. P. Noel, Cascaded tanks benchmark combining soft and "
    "hard nonlinearities, Workshop on Nonlinear System Identification Benchmarks 2016."
)
TANKS_SOURCE = (
    "The data set is Cascaded Tanks (dataBenchmark.csv) at https://www.nonlinearbenchmark.org. "
    f"{TANKS_CITATION}"
)
TANKS_FILE = "dataBenchmark.csv"
TANKS_SHA256 = "ef2388ed822f3aef4aa80d6b0f2b466dd80b361786b3eafc7a2957c31ea323a7"
TANKS_SAMPLE_TIME = 4.0  # [s]
TANKS_WINDOW = 5  # samples, of the official split


def cascaded_tanks(path: str | Path | None = None) -> DataSet:
    """Load the cascaded tanks: input "pump" [V], output "level" of the lower tank [V], with one
    sample every 4 s.

    Args:
        path: the file or a folder that holds it; the environment variable `JAXID_DATA` when left
            out.

    Returns:
        The set; the first 5 samples of the test record "validation" are for the initial states.

    Raises:
        InputError: when the file is missing or its SHA-256 differs.
    """
    file = locate(path, "cascaded_tanks", TANKS_FILE, TANKS_SOURCE, digest=TANKS_SHA256)
    train, test = _load(file, "Est", "estimation"), _load(file, "Val", "validation")
    return DataSet(
        "cascaded_tanks",
        (train,),
        {"validation": test},
        {"validation": TANKS_WINDOW},
        TANKS_CITATION,
    )


def _load(file: Path, suffix: str, name: str) -> Record:
    """The columns of one half of the file as a record."""
    raw = read_csv(
        file, inputs=(f"u{suffix}",), outputs=(f"y{suffix}",), sample_time=TANKS_SAMPLE_TIME
    )
    units = {"pump": "V", "level": "V"}
    return record(raw.t, raw.u, raw.z, inputs=("pump",), outputs=("level",), units=units, name=name)
