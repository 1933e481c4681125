"""Figure of a frequency response: gain, phase and coherence of records and model."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .._foundation.checks import require_known
from ..diagnosis.frequency_response import unwrapped_phase
from .style import AFTER, MEASURED, canvas, key, plain

# Chosen: relative standard error of the gain, above which it is drawn thin and the phase left out.
LARGEST_ERROR = 0.3


def bode(response: Any, output: str | None = None, channel: str | None = None) -> Figure:
    """Return a figure of gain, phase and coherence over frequency.

    Args:
        response: a `FrequencyResponse`.
        output, channel: names of output and input; the first ones by default.

    Returns:
        Three panels: gain with a band of one standard error, phase in degrees, coherence. The
        phase of the records begins within 180 degrees of the model's.

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
    model = None if response.model is None else response.model[:, k, j]
    zero, angle = np.zeros(len(size)), np.full(len(size), np.nan)
    reference = zero if model is None else unwrapped_phase(model, zero)
    angle[certain] = unwrapped_phase(H[certain], reference[certain])
    gain.plot(response.w, np.where(certain, size, np.nan), color=MEASURED, linewidth=2.2)
    gain.plot(response.w, size, color=MEASURED, linewidth=0.5)
    phase.plot(response.w, np.degrees(angle), color=MEASURED, linewidth=2.2)
    if model is not None:
        gain.plot(response.w, np.abs(model), color=AFTER, linewidth=1.0)
        phase.plot(response.w, np.degrees(reference), color=AFTER, linewidth=1.0)
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
