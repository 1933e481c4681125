"""Figure of a frequency response: gain, phase and coherence of records and model."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._foundation.checks import require_known
from .style import AFTER, MEASURED, canvas, key, plain

# Chosen: relative standard error of the gain, above which it is drawn thin and the phase left out.
LARGEST_ERROR = 0.3


def bode(response: Any, output: str | None = None, channel: str | None = None) -> Figure:
    """Return a figure of gain, phase and coherence over frequency.

    Args:
        response: a `FrequencyResponse`.
        output, channel: names of output and input; the first ones by default.

    Returns:
        Three panels: gain with a band of one standard error, phase in degrees, coherence.

    Raises:
        InputError: when there is no such channel.
    """
    output = str(response.outputs[0] if output is None else output)
    channel = str(response.inputs[0] if channel is None else channel)
    require_known("output", [output], response.outputs)
    require_known("input", [channel], response.inputs)
    k, j = response.outputs.index(output), response.inputs.index(channel)
    figure, panels = canvas(5.6, 3, 1, sharex=True, height_ratios=(3, 2, 1.4))
    (gain,), (phase,), (coherence,) = panels
    H, error = response.measured[:, k, j], response.errors[:, k, j]
    size = np.abs(H)
    low = size * np.clip(1.0 - error, 0.02, None)
    gain.fill_between(response.w, low, size * (1.0 + error), color=MEASURED, alpha=0.25, lw=0)
    entries = [("records, ± 1 standard error", MEASURED)]
    certain = error < LARGEST_ERROR
    _draw(gain, phase, response.w, np.where(certain, H, np.nan), MEASURED, 2.2)
    gain.plot(response.w, size, color=MEASURED, linewidth=0.5)
    if response.model is not None:
        _draw(gain, phase, response.w, response.model[:, k, j], AFTER, 1.0)
        entries.append(("model", AFTER))
    coherence.plot(response.w, response.coherence[:, k], color=MEASURED, linewidth=1.2)
    gain.set_xscale("log")
    gain.set_yscale("log")
    coherence.set_ylim(0.0, 1.05)
    units = response.output_units[k], response.input_units[j]
    label = f"gain [{units[0] or '1'} per {units[1] or '1'}]" if any(units) else "gain"
    plain(gain, "", label)
    plain(phase, "", "phase [deg]")
    plain(coherence, "frequency [rad/s]", "coherence")
    key(figure, entries, title=f"{output} from {channel}")
    return figure


def _draw(gain: Axes, phase: Axes, w: np.ndarray, H: np.ndarray, colour: str, width: float) -> None:
    """Draw gain and phase of a response, NaN where it is not certain."""
    known = np.isfinite(H)
    angle = np.full(len(w), np.nan)
    angle[known] = np.degrees(np.unwrap(np.angle(H[known])))
    gain.plot(w, np.abs(H), color=colour, linewidth=width)
    phase.plot(w, angle, color=colour, linewidth=width)
