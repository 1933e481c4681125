"""Wiener-Hammerstein: an electronic filter, a diode circuit and a second filter in series."""

from pathlib import Path

import numpy as np

from ..._foundation.checks import require
from ..build import record
from ..io.mat import mat_variables
from ..record import Record
from .base import DataSet, locate

WH_CITATION = (
    "J. Schoukens, J. Suykens, L. Ljung, Wiener-Hammerstein benchmark, 15th IFAC Symposium on "
    "System Identification, Saint-Malo 2009."
)
WH_SOURCE = (
    "The data set is Wiener-Hammerstein (WienerHammerBenchMark.mat) at "
    f"https://www.nonlinearbenchmark.org. {WH_CITATION}"
)
WH_FILE = "WienerHammerBenchMark.mat"
WH_BYTES = 1_707_601  # as stated by the package nonlinear-benchmarks 1.0.1
# Rows of the official split (nonlinear-benchmarks 1.0.1); the input rests before and after.
WH_TRAIN, WH_TEST = slice(5200, 105_200), slice(105_200, 184_000)
WH_WINDOW = 50  # samples, of the official split


def wiener_hammerstein(path: str | Path | None = None) -> DataSet:
    """Load the Wiener-Hammerstein circuit: input "u" [V], output "y" [V], 51.2 kHz.

    The file is checked by its size, as no SHA-256 of it is published. Time starts at zero in each
    record.

    Args:
        path: the file or a folder that holds it; the environment variable `JAXID_DATA` when left
            out.

    Returns:
        The set: 100,000 rows to fit and 78,800 to score; the first 50 of the latter are for the
        initial state.

    Raises:
        InputError: when the file is missing, of another size, or shorter than the split.
    """
    file = locate(path, "wiener_hammerstein", WH_FILE, WH_SOURCE, size=WH_BYTES)
    variables = mat_variables(file)
    u, y = (np.ravel(variables[name]) for name in ("uBenchMark", "yBenchMark"))
    step = 1.0 / float(np.ravel(variables["fs"])[0])
    require(
        len(u) == len(y) >= WH_TEST.stop,
        f"{file} has {len(u)} and {len(y)} rows, and its split needs {WH_TEST.stop}. {WH_SOURCE}",
    )

    def part(rows: slice, name: str) -> Record:
        time = step * np.arange(rows.stop - rows.start)
        units = {"u": "V", "y": "V"}
        channels = {"inputs": ("u",), "outputs": ("y",), "units": units}
        return record(time, u[rows], y[rows], **channels, name=name)

    return DataSet(
        "wiener_hammerstein",
        (part(WH_TRAIN, "train"),),
        {"test": part(WH_TEST, "test")},
        {"test": WH_WINDOW},
        WH_CITATION,
    )
