"""Figure of a frequency response: gain, phase and coherence of records and model."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .._foundation.checks import require_known
from .style import AFTER, MEASURED, canvas, key, plain


def bode(response: Any, output: str | None = None, channel: str | None = None) -> Figure:
    """Return a figure of gain, phase and coherence over frequency.

    Args:
        response: a `FrequencyResponse`.
        output, channel: names of output and input; the first ones by default.

    Returns:
        Three panels: gain, phase in degrees, coherence with the band of one standard error of the
        gain in the first.

    Raises:
        InputError: when there is no such channel.
    """
    output = response.outputs[0] if output is None else output
    channel = response.inputs[0] if channel is None else channel
    require_known("output", [output], response.outputs)
    require_known("input", [channel], response.inputs)
    k, j = response.outputs.index(output), response.inputs.index(channel)
    figure, panels = canvas(5.6, 3, 1, sharex=True, height_ratios=(3, 2, 1.4))
    (gain,), (phase,), (coherence,) = panels
    H, error = response.measured[:, k, j], response.errors[:, k]
    size = np.abs(H)
    low = size * np.clip(1.0 - error, 0.02, None)
    gain.fill_between(response.w, low, size * (1.0 + error), color=MEASURED, alpha=0.25, lw=0)
    entries = [("records, ± 1 standard error", MEASURED)]
    lines = [(H, MEASURED, 2.2)]
    if response.model is not None:
        lines.append((response.model[:, k, j], AFTER, 1.0))
        entries.append(("model", AFTER))
    for values, colour, width in lines:
        gain.plot(response.w, np.abs(values), color=colour, linewidth=width)
        angle = np.degrees(np.unwrap(np.angle(values)))
        phase.plot(response.w, angle, color=colour, linewidth=width)
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
