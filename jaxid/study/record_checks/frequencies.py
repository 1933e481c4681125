"""Checks of frequencies: modes of the model, samples, length of the record, power of the inputs."""

from collections.abc import Iterator

import numpy as np

from ...data.excitation import power_shares
from .channels import Measured
from .findings import Excitation, Finding, FindingKind
from .response import Response
from .thresholds import LARGEST_STEP, MILLISECONDS_STEP, MODE_BAND, MODE_POWER

PERIOD = 2.0 * np.pi


def excitations(record: Measured) -> Iterator[Excitation]:
    """Size and frequency band of each input."""
    for name, values in zip(record.inputs, record.u.T, strict=True):
        w, power = power_shares(record.t, values)
        share = np.cumsum(power)
        low, high = (float(w[np.searchsorted(share, level)]) for level in (0.05, 0.95))
        unit = record.units[name]
        size = float(np.std(values)), float(np.ptp(values))
        yield Excitation(record.name, name, unit, *size, *((low, high) if size[0] else (0.0, 0.0)))


def modes(record: Measured, model: Response) -> Iterator[Finding]:
    """Findings on samples and length of a record, and on modes that no input excites."""
    rates = model.rates
    if not rates.size:
        return
    step, duration = record.step, record.t[-1] - record.t[0]
    fastest = float(rates[-1])
    integers = np.all(record.t == np.round(record.t))
    if integers and fastest * step > MILLISECONDS_STEP:
        yield Finding(FindingKind.MILLISECONDS, record.name, (), {"step": step})
        return
    if fastest * step > LARGEST_STEP * model.substeps:
        numbers = {"rate": fastest, "samples": PERIOD / (fastest * step)}
        numbers["substeps"] = max(float(np.ceil(fastest * step / LARGEST_STEP)), 2.0)
        yield Finding(FindingKind.SLOW_SAMPLING, record.name, (), numbers)
    for pole in unique_poles(model):
        rate, length = abs(pole), PERIOD if pole.imag else 1.0
        if rate * duration < length:
            numbers = {"rate": float(rate), "periods": float(rate * duration / length)}
            yield Finding(FindingKind.SHORT_RECORD, record.name, (), numbers)
        elif rate * step < LARGEST_STEP:
            yield from unexcited(record, float(rate))


def unique_poles(model: Response) -> list[complex]:
    """Return one pole of each pair, integrators left out."""
    slowest = (1.0 - 1e-9) * model.rates[0]
    poles = map(complex, model.poles)
    return [pole for pole in poles if pole.imag >= 0 and abs(pole) >= slowest]


def unexcited(record: Measured, rate: float) -> Iterator[Finding]:
    """Finding on a mode near which no input has power."""
    shares = []
    for values in record.u.T[np.ptp(record.u, axis=0) > 0]:
        w, power = power_shares(record.t, values)
        # One line of the spectrum to each side, as a mode may be slower than their distance.
        near = (w > rate / MODE_BAND - w[1]) & (w < rate * MODE_BAND + w[1])
        shares.append(float(power[near].sum()))
    if shares and max(shares) < MODE_POWER:
        numbers = {"rate": rate, "share": max(shares)}
        yield Finding(FindingKind.UNEXCITED_MODE, record.name, (), numbers)
