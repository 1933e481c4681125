"""The figures of a study: prediction, residuals, errors before and after, and the ranking of the candidates."""

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..diagnosis.residuals import BAND, autocorrelation
from ..study.study import Candidate, Round, Study
from .style import AFTER, BEFORE, FONT, INK, MEASURED, NOISE, OTHER, RIVAL, canvas, channel_label, key, plain
from .views import View, view
from .words import display_unit, number, raised, unit_words

MOST_CANDIDATES = 12
LAGS = 40
LARGE_RATIO = 30.0  # between the longest and the shortest bar, from which on the axis is logarithmic
BAR = 0.36
AFTER_WORDS = {False: "after", True: "the model (nothing was added)"}


def prediction(study: Study, test: str, case: int = 0) -> Figure:
    """Measured outputs of a test record against both models' predictions, with two standard deviations of the noise.

    Args:
        study: the study.
        test: name of the test set.
        case: which record of the set.

    Returns:
        One panel for each output channel.

    Raises:
        InputError: when there is no such test set or record.
    """
    shown = view(study, test, case)
    count = len(shown.channels)
    figure, panels = canvas(0.8 + 1.5 * count, count, sharex=True)
    for channel, (ax,) in enumerate(panels):
        _signals(ax, shown, channel)
        last = channel == count - 1
        plain(ax, shown.time_label if last else "", channel_label(shown.channels[channel], shown.units[channel]))
        _unscored(ax, shown, words=channel == 0)
    entries = [
        ("measured", MEASURED),
        ("before", BEFORE),
        (f"{AFTER_WORDS[shown.same]}, ± 2 sigma of the noise", AFTER),
    ]
    key(figure, [one for one in entries if not (shown.same and one[1] == BEFORE)], title=_title(shown))
    return figure


def residuals(study: Study, test: str, case: int = 0) -> Figure:
    """Residuals of a test record in time, before and after, and their autocorrelation over the whole test set.

    Args:
        study: the study.
        test: name of the test set.
        case: which record of the set is drawn in time.

    Returns:
        Three panels for each output channel.

    Raises:
        InputError: when there is no such test set or record.
    """
    shown = view(study, test, case)
    count = len(shown.channels)
    correlations, bands = zip(*(_correlation(side.tests[test]) for side in (study.before, study.after)), strict=True)
    figure, panels = canvas(0.8 + 1.4 * count, count, 3, width_ratios=(1, 1, 0.8))
    for channel, (left, middle, right) in enumerate(panels):
        first, last = channel == 0, channel == count - 1
        label = channel_label(shown.channels[channel], shown.units[channel])
        for ax, error, colour in ((left, shown.residual_before, BEFORE), (middle, shown.residual_after, AFTER)):
            _residual(ax, shown.t, error[:, channel], shown.sigma[channel], colour)
        _lags(right, [one[channel] for one in correlations], float(bands[1][channel]))
        plain(left, "time [s]" if last else "", label, "residual before" if first else "")
        plain(middle, "time [s]" if last else "", "", "residual after (own scale)" if first else "")
        plain(right, "lag [samples]" if last else "", "", "autocorrelation" if first else "")
    entries = [("before", BEFORE), ("after", AFTER), ("± 2 sigma of the noise; 95 % band of white noise", OTHER)]
    key(figure, entries, title=_title(shown, shown.note))
    return figure


def errors(study: Study) -> Figure:
    """Error before and after and the noise, by channel and test set.

    Args:
        study: the study.

    Returns:
        One panel for each channel, in its own unit, on a logarithmic axis where bars differ by more than 30 times.
    """
    channels, tests = len(study.outputs), list(study.before.rms)
    columns = min(channels, 3)
    rows = -(-channels // columns)
    figure, panels = canvas(0.9 + rows * (0.6 + 0.5 * len(tests)), rows, columns)
    flat = [ax for row in panels for ax in row]
    for ax in flat[channels:]:
        ax.remove()
    for index, (ax, name) in enumerate(zip(flat, study.outputs, strict=False)):
        _bars(ax, study, name, study.output_units[index], words=index % columns == 0)
    key(
        figure,
        [("before", BEFORE), ("after", AFTER), ("noise", NOISE)],
        title="RMS error on records not used for fitting",
    )
    return figure


def ranking(one: Round) -> Figure:
    """The candidates of one round by their score, the one that was kept and its rivals marked.

    Args:
        one: the round.

    Returns:
        One panel of horizontal bars on a logarithmic axis, at most the best twelve; a dot is the score with the
        colour of the residual accounted for, the line what it must exceed to be no accident.
    """
    best = one.candidates[:MOST_CANDIDATES]
    figure, ((ax,),) = canvas(1.15 + 0.24 * max(len(best), 2))
    scores = np.array([_positive(candidate.score) for candidate in best])
    dots = np.array([_positive(candidate.significance) for candidate in best])
    known = np.concatenate([scores, dots, [one.threshold, 1.0]])
    low, high = 0.5 * min(np.nanmin(np.maximum(known, 0.1)), 1.0), 2.0 * np.nanmax(known)
    ax.barh(
        np.arange(len(best)), np.nan_to_num(scores), color=[_colour(one, candidate) for candidate in best], height=0.68
    )
    ax.plot(dots, np.arange(len(best)), linestyle="", marker="o", markersize=4, color="white", markeredgecolor=INK)
    ax.set(xscale="log", xlim=(low, high), ylim=(len(best) - 0.4, -0.6))
    ax.set_yticks(range(len(best)), [raised(candidate.name) for candidate in best], parse_math=False)
    plain(
        ax,
        "score: chi-square that the candidate would explain (bar);\nthe same, colour of the residual allowed for (dot)",
    )
    ax.grid(False, axis="y")
    ax.axvline(one.threshold, color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
    _note(ax, one.threshold, "no accident beyond this line", above=True)
    roles = {_colour(one, candidate) for candidate in best}
    entries = [("added", AFTER), ("rival", RIVAL), ("other", OTHER)]
    key(figure, [entry for entry in entries if entry[1] in roles], title=_shown_of(best, one))
    return figure


def _signals(ax: Axes, shown: View, channel: int) -> None:
    """Measured, before and after of one channel; the axis follows what was measured, however far a model runs off."""
    z, before, after = (one[:, channel] for one in (shown.z, shown.before, shown.after))
    measured = z if np.any(np.isfinite(z)) else after
    low, high = _range(measured, 0.06)
    far_low, far_high = _range(measured, 0.8)
    before, after = (np.clip(one, far_low - (high - low), far_high + (high - low)) for one in (before, after))
    ax.plot(shown.t, z, color=MEASURED, linewidth=2.6, alpha=0.55, solid_capstyle="round")
    band = 2.0 * shown.sigma[channel]
    ax.fill_between(shown.t, after - band, after + band, color=AFTER, alpha=0.18, linewidth=0)
    if not shown.same:
        ax.plot(shown.t, before, color=BEFORE, linewidth=1.0)
    ax.plot(shown.t, after, color=AFTER, linewidth=1.0)
    lines = np.concatenate([before, after - band, after + band])
    lines = lines[np.isfinite(lines)]
    inside = np.clip(lines, far_low, far_high) if lines.size else np.array([low, high])
    ax.set_ylim(min(low, inside.min()), max(high, inside.max()))
    ax.set_xlim(shown.t[0], shown.t[-1])


def _residual(ax: Axes, t: np.ndarray, error: np.ndarray, sigma: float, colour: str) -> None:
    ax.axhspan(-2.0 * sigma, 2.0 * sigma, color=OTHER, alpha=0.45, linewidth=0)
    ax.plot(t, error, color=colour, linewidth=0.7)
    largest = np.nanmax(np.abs(error), initial=0.0) if np.any(np.isfinite(error)) else 0.0
    limit = 1.1 * max(largest, 2.0 * sigma)
    if np.isfinite(limit) and limit > 0:
        ax.set_ylim(-limit, limit)
    ax.set_xlim(t[0], t[-1])


def _lags(ax: Axes, correlations: list[np.ndarray], band: float) -> None:
    ax.axhspan(-band, band, color=OTHER, alpha=0.45, linewidth=0)
    for correlation, colour, size in zip(correlations, (BEFORE, AFTER), (1.0, 1.4), strict=True):
        ax.plot(np.arange(1, correlation.size), correlation[1:], color=colour, linewidth=size)
    ax.set_ylim(-1.05, 1.05)


def _correlation(side) -> tuple[np.ndarray, np.ndarray]:
    """Autocorrelation of a prediction's residuals, and the half width of the band of white noise, by channel."""
    scored = np.asarray(side.scored)
    lags = max(min(LAGS, scored.shape[1] // 5), 1)
    error = np.nan_to_num(np.where(scored, np.asarray(side.residuals), 0.0), nan=0.0, posinf=0.0, neginf=0.0)
    r = np.asarray(autocorrelation(jnp.asarray(error), jnp.asarray(scored), lags))
    return r, BAND / np.sqrt(np.maximum(scored.sum(axis=(0, 1)), 1))


def _bars(ax: Axes, study: Study, name: str, unit: str, words: bool) -> None:
    """Bars of one channel, a pair for each test set, and a line for the noise."""
    scale, unit = display_unit(unit)
    tests = list(study.before.rms)
    noise = scale * study.noise[name]
    pairs = [(side.rms[test][name] * scale, row + at, colour) for row, test in enumerate(tests) for side, at, colour in
             ((study.before, -BAR / 2, BEFORE), (study.after, BAR / 2, AFTER))]  # fmt: skip
    known = np.array([value for value, _, _ in pairs if _is_length(value)] + [noise] * _is_length(noise))
    logarithmic = known.size > 0 and known.max() > LARGE_RATIO * known.min()
    left = 0.3 * known.min() if logarithmic else 0.0
    right = (known.max() / left) ** 1.35 * left if logarithmic else 1.35 * known.max() if known.size else 1.0
    ax.set(xscale="log" if logarithmic else "linear", xlim=(left, right), ylim=(len(tests) - 0.5, -0.5))
    for value, row, colour in pairs:
        length = value if _is_length(value) else left
        ax.barh(row, length - left, left=left, height=BAR, color=colour)
        ax.annotate(number(value, 3) if np.isfinite(value) else "diverged", (max(length, noise), row), (3, 0),
                    textcoords="offset points", va="center", fontsize=FONT - 1, color=colour)  # fmt: skip
    if _is_length(noise):
        ax.axvline(noise, color=NOISE, linewidth=1.2, linestyle=(0, (4, 2)))
    ax.set_yticks(range(len(tests)), tests if words else [""] * len(tests), parse_math=False)
    plain(ax, "", "", channel_label(name, unit_words(unit)))
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)


def _unscored(ax: Axes, shown: View, words: bool) -> None:
    """Shade the window in which the initial state was fitted."""
    if shown.scored_from is None or shown.t[0] >= shown.scored_from:
        return
    ax.axvspan(shown.t[0], shown.scored_from, color="#f0e442", alpha=0.18, linewidth=0)
    if words:
        _note(ax, shown.t[0], "start fitted here, not scored")


def _title(shown: View, note: str = "") -> str:
    name = f"record {shown.name}" if shown.name else ""
    return ": ".join(part for part in (name, note) if part)


def _note(ax: Axes, x: float, words: str, above: bool = False) -> None:
    """A few words at the top of a panel, inside it or above."""
    shift, side = ((3, 1), "bottom") if above else ((3, -2), "top")
    place = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "va": side}
    ax.annotate(words, (x, 1.0), shift, fontsize=FONT - 1.5, color=INK, **place)


def _range(x: np.ndarray, margin: float) -> tuple[float, float]:
    """Lowest and highest value with a margin, never empty."""
    finite = x[np.isfinite(x)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    width = high - low or max(abs(high), 1.0)
    return low - margin * width, high + margin * width


def _colour(one: Round, candidate: Candidate) -> str:
    return AFTER if candidate.name == one.added else RIVAL if candidate.name in one.rivals else OTHER


def _shown_of(best, one: Round) -> str:
    return f"the best {len(best)} of {len(one.candidates)} candidates" if len(best) < len(one.candidates) else ""


def _positive(value: float) -> float:
    return value if _is_length(value) else float("nan")


def _is_length(value: float) -> bool:
    return bool(np.isfinite(value)) and value > 0
