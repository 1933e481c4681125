"""Shares of samples whose true coefficient lies in the two-sigma bands of `identify`.

Three bands of each coefficient along a flight: of the parameters, corrected for coloured residuals;
with the misfit of the polynomials; with the errors of instruments, of the standard deviations from
which the flights draw them.
"""

from typing import NamedTuple

import numpy as np

from benchmarks.report_tables.cases import CaseResult, record_of
from jaxid.aircraft.flight.report_cases import CASES
from jaxid.aircraft.instruments.noise_levels import NoiseLevel
from jaxid.models.free import all_names
from jaxid.study import Identification

KINDS = ("scale", "bias", "position", "misalignment")
BANDS = ("parameters", "with misfit", "with instruments")


class Share(NamedTuple):
    """One coefficient of one flight.

    Attributes:
        coefficient: name of the coefficient.
        inside: share of samples with the true value inside two deviations, by band.
        error, parameters, misfit, instruments: root mean squares of the error and the deviations.
        bias: mean of the error.
    """

    coefficient: str
    inside: dict[str, float]
    error: float
    parameters: float
    misfit: float
    instruments: float
    bias: float


def deviations(identified: Identification, level: NoiseLevel | None) -> dict[str, float]:
    """Return the standard deviations of the instruments' constants that are not estimated.

    Args:
        identified: result of `identify`.
        level: level from which the flight draws its instruments; None for error-free ones.
    """
    chosen = {}
    if level is None:
        return chosen
    for name in all_names(identified.model):
        group, _, rest = name.partition(".")
        kind, _, channel = rest.partition(".")
        sizes = getattr(level, kind) if group == "instruments" and kind in KINDS else {}
        if channel.partition(".")[0] in sizes and name not in identified.estimate.free.shared:
            chosen[name] = float(sizes[channel.partition(".")[0]])
    return chosen


def shares(result: CaseResult) -> list[Share]:
    """Return the shares of each kept coefficient along the flight of a result.

    Args:
        result: of a case with one flight.
    """
    (flight,), identified = result.flights, result.identified
    bands = identified.combined_bands(
        record_of(flight, result.setting), deviations(identified, CASES[result.name].noise)
    )
    rows = []
    for name, band in bands.items():
        true = np.asarray(flight.truth.channel(name))
        value, parameters, instruments = (
            np.asarray(each)[0, : true.size]
            for each in (band.value, band.parameters, band.instruments)
        )
        misfit = float(band.misfit)
        parts = (parameters, np.full_like(parameters, misfit), instruments)
        widths = 2.0 * np.sqrt(np.cumsum(np.square(parts), axis=0))
        inside = np.mean(np.abs(value - true) <= widths, axis=1).tolist()
        error, of_parameters, of_instruments = (
            float(np.sqrt(np.mean(each**2))) for each in (value - true, parameters, instruments)
        )
        shown = dict(zip(BANDS, inside, strict=True))
        bias = float(np.mean(value - true))
        rows.append(Share(name, shown, error, of_parameters, misfit, of_instruments, bias))
    return rows
