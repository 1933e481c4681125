"""Figure of all records of a set in small panels: a column for each record, a row for each
channel.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ..data.record import Record
from ..diagnosis.validation import Prediction
from .style import AFTER, FONT, MEASURED, NOISE, canvas, channel_label, key, plain
from .words import display_unit, unit_words

RECORDS_IN_FIGURE = 6  # chosen
PANEL_SAMPLES = 300  # that a small panel can resolve (chosen)
PANEL_HEIGHT = 0.75  # inches (chosen)


def small_panels(
    records: Record, cases: Sequence[int], predicted: Prediction | None = None
) -> Figure:
    """Return a figure of inputs and measured outputs of some records, in degrees where the unit is
    rad. All records share the scale of a channel; long ones are thinned to about `PANEL_SAMPLES`.

    Args:
        records: a stack.
        cases: the records to draw, `RECORDS_IN_FIGURE` at most.
        predicted: predictions of these records, drawn over the measured outputs.
    """
    names = (*records.inputs, *records.outputs)
    units = (*records.input_units, *records.output_units)
    figure, panels = canvas(
        0.8 + PANEL_HEIGHT * len(names), len(names), len(cases), sharex="col", sharey="row"
    )
    for column, case in enumerate(cases):
        record = records[case]
        shown = slice(None, None, -(-record.t.size // PANEL_SAMPLES))
        t = np.asarray(record.t)[shown]
        for row, (name, unit) in enumerate(zip(names, units, strict=True)):
            ax, (scale, display) = panels[row][column], display_unit(unit)
            measured = scale * np.asarray(record.channel(name))[shown]
            output = row - len(records.inputs)
            ax.plot(t, measured, color=MEASURED if output >= 0 else NOISE, linewidth=0.8)
            if predicted is not None and output >= 0:
                y = scale * np.asarray(predicted.y)[case, : record.t.size, output][shown]
                # A prediction that diverges must not hide the measurements.
                limits = ax.get_ylim()
                ax.plot(t, np.where(np.isfinite(y), y, np.nan), color=AFTER, linewidth=0.6)
                ax.set_ylim(limits)
            # The unit has a line of its own: a panel is shorter than name and unit together.
            label = "" if column else channel_label(name, unit_words(display)).replace(" [", "\n[")
            title = "" if row else record.names[0] or f"record {case + 1}"
            plain(ax, "time [s]" if row == len(names) - 1 else "", label, title)
            ax.tick_params(labelsize=FONT - 2)
    entries = [("inputs", NOISE)] * bool(records.inputs) + [("measured outputs", MEASURED)]
    key(figure, entries + [("predicted after", AFTER)] * (predicted is not None))
    return figure
