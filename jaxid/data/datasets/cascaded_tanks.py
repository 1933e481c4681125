"""Cascaded tanks: water pumped into the upper of two tanks, which overflows, and measured in the lower one."""

from pathlib import Path

from ..build import record
from ..io_csv import read_csv
from ..record import Record
from .base import DataSet, locate

CITATION = (
    "M. Schoukens, P. Mattsson, T. Wigren, J. P. Noel, Cascaded tanks benchmark combining soft and hard "
    "nonlinearities, Workshop on Nonlinear System Identification Benchmarks 2016."
)
OFFERED = f"Its makers offer it as Cascaded Tanks (dataBenchmark.csv) at https://www.nonlinearbenchmark.org. {CITATION}"
FILE = "dataBenchmark.csv"
SHA256 = "ef2388ed822f3aef4aa80d6b0f2b466dd80b361786b3eafc7a2957c31ea323a7"
SAMPLE_TIME, WINDOW = 4.0, 5


def cascaded_tanks(path: str | Path | None = None) -> DataSet:
    """Load the cascaded tanks: input "pump" [V], output "level" of the lower tank [V], a sample every 4 s.

    Args:
        path: the file or a folder that holds it; the environment variable `JAXID_DATA` when left out.

    Returns:
        The set; the first 5 samples of the test record "validation" are for the initial states.

    Raises:
        InputError: when the file is not found or is another one.
    """
    file = locate(path, "cascaded_tanks", FILE, SHA256, OFFERED)
    train, test = _load(file, "Est", "estimation"), _load(file, "Val", "validation")
    return DataSet("cascaded_tanks", (train,), {"validation": test}, {"validation": WINDOW}, CITATION)


def _load(file: Path, suffix: str, name: str) -> Record:
    """One half of the file as a record."""
    raw = read_csv(file, inputs=(f"u{suffix}",), outputs=(f"y{suffix}",), sample_time=SAMPLE_TIME)
    units = {"pump": "V", "level": "V"}
    return record(raw.t, raw.u, raw.z, inputs=("pump",), outputs=("level",), units=units, name=name)
