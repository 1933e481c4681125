"""Silverbox: an electronic oscillator with a hardening spring."""

from pathlib import Path

import numpy as np

from ..build import record
from ..io.mat import mat_variables
from ..record import Record
from .base import DataSet, locate

SILVERBOX_CITATION = (
    "T. Wigren, J. Schoukens, Three free data sets for development and benchmarking in nonlinear "
    "system identification, European Control Conference 2013, pp. 2933-2938."
)
SILVERBOX_SOURCE = (
    "The data set is Silverbox (SNLS80mV.mat) at https://www.nonlinearbenchmark.org. "
    f"{SILVERBOX_CITATION}"
)
SILVERBOX_FILE = "SNLS80mV.mat"
SILVERBOX_SHA256 = "5c7413a52255af0cb4e2f93fb6903beb92b08965ba1e6ad0a6ffedfed8477ed4"
SILVERBOX_SAMPLE_TIME = 2**14 / 1e7  # [s]
ARROW, MULTISINE = slice(100, 40575), slice(40650, 127400)  # rows, of the official split
TRAIN_SHARE = 0.75  # of the multisine, of the official split
SILVERBOX_WINDOW = 50  # samples, of the official split


def silverbox(path: str | Path | None = None) -> DataSet:
    """Load the Silverbox: input "u" [V], output "y" [V], 610.35 Hz.

    The mean over the file is subtracted from both channels, as its authors recommend: the input was
    designed with zero mean. The training record is the first three quarters of the multisine. The
    test records are its last quarter, "multisine", and the "arrow", noise with an amplitude that
    grows beyond the amplitude of the multisine. Time starts at zero in each record.

    Args:
        path: the file or a folder that holds it; the environment variable `JAXID_DATA` when left
            out.

    Returns:
        The set; the first 50 samples of each test record are for the initial state.

    Raises:
        InputError: when the file is missing or its SHA-256 differs.
    """
    variables = mat_variables(
        locate(path, "silverbox", SILVERBOX_FILE, SILVERBOX_SOURCE, digest=SILVERBOX_SHA256)
    )
    u, y = (np.ravel(variables[name]) for name in ("V1", "V2"))
    u, y = u - u.mean(), y - y.mean()

    def part(rows: slice, name: str) -> Record:
        time = SILVERBOX_SAMPLE_TIME * np.arange(rows.stop - rows.start)
        return record(
            time,
            u[rows],
            y[rows],
            inputs=("u",),
            outputs=("y",),
            units={"u": "V", "y": "V"},
            name=name,
        )

    cut = MULTISINE.start + int(TRAIN_SHARE * (MULTISINE.stop - MULTISINE.start))
    return DataSet(
        name="silverbox",
        train=(part(slice(MULTISINE.start, cut), "multisine, first three quarters"),),
        test={
            "arrow": part(ARROW, "arrow"),
            "multisine": part(slice(cut, MULTISINE.stop), "multisine, last quarter"),
        },
        window={"arrow": SILVERBOX_WINDOW, "multisine": SILVERBOX_WINDOW},
        citation=SILVERBOX_CITATION,
    )
