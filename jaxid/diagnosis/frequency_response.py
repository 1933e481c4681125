"""Frequency response and coherence of records, and of a model under the same inputs."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from .._foundation.checks import InputError, require
from .._foundation.grid import is_uniform
from .._foundation.notebook import Table
from .._foundation.types import Complex, Float
from ..data.record import Record
from ..data.stack import require_same_channels, single_records
from ..models.base import AbstractModel
from ..models.free import first_state
from ..simulation.hold import AbstractHold
from ..simulation.simulate import simulate
from ..simulation.steppers import AbstractStepper

# Chosen: segments of a record, overlapping by half, if their length is not given; and the fewest
# segments of all records. More give smaller errors, longer ones finer frequencies.
SEGMENTS = 8
# Chosen: relative deviation of a step up to which times count as uniform.
STEP_TOLERANCE = 1e-3
PRINTED_ROWS = 12  # chosen


class FrequencyResponse(eqx.Module):
    """Frequency response of records, and of a model under the same inputs.

        H = S_zu S_uu^-1,    coherence = S_zu S_uu^-1 S_uz / S_zz    (multiple coherence)

    from cross spectra averaged over segments (Welch). The relative standard error of a gain, and
    the error of a phase in rad, is

        sqrt((1 - coherence) S_zz (S_uu^-1)_jj / (2 n)) / |H_j|

    for input j and n segments: sqrt((1 - coherence) / (2 n coherence)) of a single input. (Bendat
    and Piersol, Random Data, 4th ed. 2010, chapters 6, 7 and 9.)

    Attributes:
        w: frequencies [rad/s].
        measured: H of the records, shape (frequency, output, input) [output unit per input unit].
        coherence: share of an output's power that all inputs together explain.
        errors: relative standard error of the gains; infinite where there is no input.
        model: H of the model, from simulated outputs by the same estimator; None without a model.
        segments: number n of segments.
        inputs, outputs: names of the channels.
        input_units, output_units: their units.
    """

    w: Float[np.ndarray, " frequency"]
    measured: Complex[np.ndarray, "frequency output input"]
    coherence: Float[np.ndarray, "frequency output"]
    errors: Float[np.ndarray, "frequency output input"]
    model: Complex[np.ndarray, "frequency output input"] | None
    segments: int = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)
    input_units: tuple[str, ...] = eqx.field(static=True)
    output_units: tuple[str, ...] = eqx.field(static=True)

    def to_xarray(self) -> Any:
        """Return the responses as an `xarray.Dataset` with labelled axes; complex numbers have two
        variables, gain and phase [rad], continuous over frequency; the phase of the records begins
        within pi of the model's.
        """
        import xarray as xr  # imported here because it is slow to import

        axes = ("w", "output", "input")
        responses = {"model": self.model, "measured": self.measured}
        variables: dict[str, Any] = {
            "coherence": (axes[:2], self.coherence),
            "errors": (axes, self.errors),
        }
        phase = np.zeros(self.measured.shape)
        for name, response in responses.items():
            if response is not None:
                phase = unwrapped_phase(response, phase)
                variables[f"{name}_gain"] = (axes, np.abs(response))
                variables[f"{name}_phase"] = (axes, phase)
        coordinates = {"w": self.w, "output": list(self.outputs), "input": list(self.inputs)}
        return xr.Dataset(variables, coords=coordinates, attrs={"segments": self.segments})

    def plot(self, output: str | None = None, input: str | None = None) -> Any:
        """Return a figure of gain, phase and coherence, by matplotlib (`jaxid[report]`).

        Args:
            output, input: names of the channels; the first ones by default.
        """
        from ..report.figures_frequency import bode

        return bode(self, output, input)

    def __str__(self) -> str:
        return "\n".join(
            line for title, table in self._tables() for line in (title, *table.lines())
        )

    def _repr_html_(self) -> str:
        return "".join(table.html(above=[title]) for title, table in self._tables())

    def _tables(self) -> Iterator[tuple[str, Table]]:
        """Return title and table of each pair of channels, at some of the frequencies."""
        heads = ("rad/s", "gain", "phase deg", "error %", "coherence")
        widths = (9, 10, 10, 8, 10)
        if self.model is not None:
            heads, widths = (*heads, "model gain", "model phase deg"), (*widths, 10, 15)
        rows = np.unique(np.geomspace(1, len(self.w), PRINTED_ROWS).astype(int)) - 1
        for k, output in enumerate(self.outputs):
            for j, channel in enumerate(self.inputs):
                cells = tuple(self._row(row, k, j) for row in rows.tolist())
                title = f"{output} from {channel}, {self.segments} segments"
                yield title, Table((*heads, ""), widths, cells)

    def _row(self, row: int, output: int, channel: int) -> tuple[str, ...]:
        """Return the numbers at one frequency in words."""
        return (
            f"{self.w[row]:.4g}",
            *_gain_and_phase(self.measured[row, output, channel]),
            f"{100 * self.errors[row, output, channel]:.3g}",
            f"{self.coherence[row, output]:.3f}",
            *(() if self.model is None else _gain_and_phase(self.model[row, output, channel])),
            "",
        )


def frequency_response(
    records: Record | Sequence[Record],
    model: AbstractModel | None = None,
    *,
    seconds: float | int | None = None,
    hold: AbstractHold | None = None,
    stepper: AbstractStepper | None = None,
) -> FrequencyResponse:
    """Return the frequency response and the coherence of records, and of a model.

    The model is simulated under the recorded inputs and goes through the same estimator, so that
    leakage and the response between samples are the same on both sides.

    Args:
        records: one record, several records, or a stack, with equal uniform steps and no missing
            samples; their segments are averaged.
        model: a model with the channels of the records, such as `fit.model`.
        seconds: length of a segment [s]; by default an eighth of the shortest record, twice.
        hold: interpolation of the inputs for the simulation.
        stepper: integration for the simulation.

    Raises:
        InputError: when there is no input, a sample is missing, the steps, the channels or their
            units differ between records, there are fewer segments than inputs plus one, or the
            simulation is not finite.
    """
    singles = single_records(records)
    step = _common_step(singles)
    first, shortest = singles[0], min(part.t.shape[0] for part in singles)
    size = 2 * shortest // (SEGMENTS + 1) if seconds is None else round(seconds / step)
    require(
        8 <= size <= shortest,
        f"A segment has {size} samples; 8 to {shortest} are possible. Give other `seconds`.",
    )
    pairs = [(np.asarray(part.u), np.asarray(part.z)) for part in singles]
    spectra = _spectra(pairs, size)
    count = spectra.count
    require(
        count > len(first.inputs),
        f"There are {count} segments for {len(first.inputs)} inputs. Give shorter `seconds`.",
    )
    measured, coherence, errors = _response(spectra)
    response = None
    if model is not None:
        simulated = [
            (u, _simulated(model, part, hold, stepper))
            for (u, _), part in zip(pairs, singles, strict=True)
        ]
        response, *_ = _response(_spectra(simulated, size))
    return FrequencyResponse(
        w=2 * np.pi * np.fft.rfftfreq(size, step)[1:],
        measured=measured,
        coherence=coherence,
        errors=errors,
        model=response,
        segments=count,
        inputs=first.inputs,
        outputs=first.outputs,
        input_units=first.input_units,
        output_units=first.output_units,
    )


def unwrapped_phase(
    response: Complex[np.ndarray, "frequency *channels"],
    reference: Float[np.ndarray, "frequency *channels"],
) -> Float[np.ndarray, "frequency *channels"]:
    """Return the phase of a response whose difference from a reference is continuous.

        phase = reference + unwrap(arg(H exp(-i reference)))

    Args:
        response: H at increasing frequencies.
        reference: a continuous phase [rad], from which the result differs by at most pi at the
            first frequency.
    """
    difference = np.angle(response * np.exp(-1j * reference))
    return reference + np.unwrap(difference, axis=0)


class _Spectra(NamedTuple):
    """Averaged cross spectra by frequency, without a common scale.

    Attributes:
        uu, zu, zz: shapes (frequency, input, input), (frequency, output, input) and
            (frequency, output).
        count: number of segments.
    """

    uu: np.ndarray
    zu: np.ndarray
    zz: np.ndarray
    count: int


def _spectra(pairs: Sequence[tuple[np.ndarray, np.ndarray]], size: int) -> _Spectra:
    """Return the spectra of segments that overlap by half (Hann window, each without its mean)."""
    window = np.hanning(size + 1)[:-1, None]
    U, Z = [], []
    for u, z in pairs:
        for start in range(0, len(u) - size + 1, size // 2):
            for values, transforms in ((u, U), (z, Z)):
                part = values[start : start + size]
                transforms.append(np.fft.rfft(window * (part - part.mean(axis=0)), axis=0)[1:])
    u, z = np.array(U), np.array(Z)
    return _Spectra(
        np.einsum("nfi,nfj->fij", u, u.conj()),
        np.einsum("nfi,nfj->fij", z, u.conj()),
        np.einsum("nfi,nfi->fi", z, z.conj()).real,
        len(u),
    )


def _response(spectra: _Spectra) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the response, the coherence, and the relative errors of the gains; response and
    coherence are zero where there is no input.
    """
    power = np.einsum("fii->fi", spectra.uu).real
    size = np.sqrt(np.where(power > 0, power, 1.0))  # inputs of different units
    scaled = spectra.uu / (size[:, :, None] * size[:, None])
    inverse = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True)
    H = (spectra.zu / size[:, None]) @ inverse / size[:, None]
    explained = np.einsum("fij,fij->fi", H, spectra.zu.conj()).real
    coherence = explained / np.where(spectra.zz > 0, spectra.zz, 1.0)
    coherence = np.clip(coherence, 0.0, 1.0)
    left = (1.0 - coherence) * spectra.zz
    of_input = np.einsum("fii->fi", inverse).real / size**2
    deviation = np.sqrt(left[..., None] * of_input[:, None] / (2 * spectra.count))
    known, gain = (power > 0)[:, None] & (np.abs(H) > 0), np.abs(H)
    errors = np.where(known, deviation / np.where(known, gain, 1.0), np.inf)
    return H, coherence, errors


def _simulated(model: AbstractModel, record: Record, hold: Any, stepper: Any) -> np.ndarray:
    """Return the outputs of a model under the inputs of a record."""
    require(
        (model.inputs, model.outputs) == (record.inputs, record.outputs),
        f"Record {record.names[0]!r} has other channels than the model. Take "
        "`model.prepared(record)`.",
    )
    state = first_state(model, record)
    y = np.asarray(simulate(model, record.t, record.u, state, hold=hold, stepper=stepper).y)
    if not np.isfinite(y).all():
        raise InputError(
            f"Record {record.names[0]!r}: the simulation is not finite. Take a stable model, or "
            "pieces of the record (`segment`)."
        )
    return y


def _common_step(records: Sequence[Record]) -> float:
    """Return the step of records of the same channels, whose samples are uniform and complete."""
    require(len(records) > 0, "There is no record. Give at least one.")
    steps = []
    for number, record in enumerate(records):
        require_same_channels(records[0], record, f"Record {number} ({record.names[0]!r})")
        name, t = record.names[0], np.asarray(record.t)
        require(len(record.inputs) > 0, f"Record {name!r} has no input, and no frequency response.")
        require(
            is_uniform(t, STEP_TOLERANCE),
            f"Record {name!r}: its steps of time differ. Bring it onto uniform times by "
            "`jaxid.data.resample`.",
        )
        missing = int(np.sum(~np.asarray(record.mask)))
        require(
            missing == 0,
            f"Record {name!r}: {missing} samples are missing. Take a part without gaps: "
            "`record.window(start, stop)`.",
        )
        steps.append(float(np.median(np.diff(t))))
        require(
            abs(steps[-1] - steps[0]) <= STEP_TOLERANCE * steps[0],
            f"Record {name!r} has the step {steps[-1]:g} s, and the first record {steps[0]:g} s. "
            "Bring them onto one step by `jaxid.data.resample`.",
        )
    return steps[0]


def _gain_and_phase(response: complex) -> tuple[str, str]:
    return f"{abs(response):.4g}", f"{np.degrees(np.angle(response)):.1f}"
