"""Figures of a study: predictions, residuals, errors, and the ranking of the candidates."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..diagnosis.residuals import autocorrelation
from ..diagnosis.thresholds import BAND
from ..study.rounds import Candidate, Round
from ..study.study import Study
from .style import (
    AFTER,
    BEFORE,
    FONT,
    INK,
    MEASURED,
    NOISE,
    OTHER,
    canvas,
    channel_label,
    key,
    plain,
)
from .views import View, view
from .words import display_unit, number, raised, unit_words

MOST_CANDIDATES = 12  # largest number of bars in a ranking (chosen)
PLOTTED_LAGS = 40  # samples (chosen)
RIGHT_PART = 0.7  # of a panel's width, from which a note is written to the left (chosen)
# Ratio of the longest to the shortest bar above which the axis is logarithmic (chosen).
LARGE_RATIO = 30.0
BAR = 0.36  # height of a bar, in rows (chosen)
AFTER_WORDS = {False: "after", True: "the model (nothing was added)"}


def prediction(study: Study, test: str, case: int = 0) -> Figure:
    """Return a figure of the measured and predicted outputs of a test record.

    The band is two standard deviations of the noise.

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
        plain(
            ax,
            shown.time_label if last else "",
            channel_label(shown.channels[channel], shown.units[channel]),
        )
        _unscored(ax, shown, with_label=channel == 0)
    entries = [
        ("measured", MEASURED),
        ("before", BEFORE),
        (f"{AFTER_WORDS[shown.same]}, ± 2 sigma of the noise", AFTER),
    ]
    key(
        figure,
        [entry for entry in entries if not (shown.same and entry[1] == BEFORE)],
        title=_title(shown),
    )
    return figure


def residuals(study: Study, test: str, case: int = 0) -> Figure:
    """Return a figure of the residuals of a test record, before and after.

    It shows them in time, and their autocorrelation over all records of the test set.

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
    correlations, bands = zip(
        *(_correlation(side.tests[test]) for side in (study.before, study.after)), strict=True
    )
    figure, panels = canvas(0.8 + 1.4 * count, count, 3, width_ratios=(1, 1, 0.8))
    for channel, (left, middle, right) in enumerate(panels):
        first, last = channel == 0, channel == count - 1
        label = channel_label(shown.channels[channel], shown.units[channel])
        for ax, error, colour in (
            (left, shown.residual_before, BEFORE),
            (middle, shown.residual_after, AFTER),
        ):
            _residual(ax, shown.t, error[:, channel], shown.sigma[channel], colour)
        _lags(
            right, [correlation[channel] for correlation in correlations], float(bands[1][channel])
        )
        plain(left, "time [s]" if last else "", label, "residual before" if first else "")
        plain(middle, "time [s]" if last else "", "", "residual after (own scale)" if first else "")
        plain(right, "lag [samples]" if last else "", "", "autocorrelation" if first else "")
    entries = [
        ("before", BEFORE),
        ("after", AFTER),
        ("± 2 sigma of the noise; 95 % band of white noise", OTHER),
    ]
    key(figure, entries, title=_title(shown, shown.note))
    return figure


def errors(study: Study) -> Figure:
    """Return a figure of the error before and after and the noise, by channel and test set.

    Args:
        study: the study.

    Returns:
        One panel for each channel, in its own unit, on a logarithmic axis where bars differ by more
        than 30 times.
    """
    channels, tests = len(study.outputs), list(study.before.rms)
    columns = min(channels, 3)
    rows = -(-channels // columns)
    figure, panels = canvas(0.9 + rows * (0.6 + 0.5 * len(tests)), rows, columns)
    flat = [ax for row in panels for ax in row]
    for ax in flat[channels:]:
        ax.remove()
    for index, (ax, name) in enumerate(zip(flat, study.outputs, strict=False)):
        _bars(ax, study, name, study.output_units[index], with_labels=index % columns == 0)
    key(
        figure,
        [("before", BEFORE), ("after", AFTER), ("noise", NOISE)],
        title="RMS error on records not used for fitting",
    )
    return figure


def ranking(search_round: Round) -> Figure:
    """Return a figure of the candidates of a round by score, the winner marked.

    Args:
        search_round: the round.

    Returns:
        One panel of horizontal bars on a logarithmic axis, for the best twelve at most; the winner
        replaces the last of them if its score is lower. A dot is the fall of chi-square by the
        refit; the line is the significance threshold.
    """
    best = _drawn(search_round.candidates)
    figure, ((ax,),) = canvas(1.15 + 0.24 * max(len(best), 2))
    scores = np.array([_positive(candidate.score) for candidate in best])
    falls = [candidate.cost_fall for candidate in best]
    dots = np.array([_positive(float("nan") if fall is None else fall) for fall in falls])
    known = np.concatenate([scores, dots, [search_round.threshold, 1.0]])
    low, high = 0.5 * min(np.nanmin(np.maximum(known, 0.1)), 1.0), 2.0 * np.nanmax(known)
    ax.set(xlim=(low, high), xscale="log")  # first: the axis cannot be scaled by scores of zero
    ax.barh(
        np.arange(len(best)),
        np.nan_to_num(scores),
        color=[_colour(candidate) for candidate in best],
        height=0.68,
    )
    ax.plot(
        dots,
        np.arange(len(best)),
        linestyle="",
        marker="o",
        markersize=4,
        color="white",
        markeredgecolor=INK,
    )
    ax.set(ylim=(len(best) - 0.4, -0.6))
    ax.set_yticks(
        range(len(best)),
        [raised(candidate.name + candidate.replacement) for candidate in best],
        parse_math=False,
    )
    plain(
        ax,
        "score: fall of chi-square in the linear model (bar);\nfall by the refit (dot)",
    )
    ax.grid(False, axis="y")
    ax.axvline(search_round.threshold, color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
    _note(ax, search_round.threshold, "significant beyond this line", above=True)
    roles = {_colour(candidate) for candidate in best}
    entries = [("added", AFTER), ("other", OTHER)]
    key(
        figure,
        [entry for entry in entries if entry[1] in roles],
        title=_number_drawn(best, search_round),
    )
    return figure


def _signals(ax: Axes, shown: View, channel: int) -> None:
    """Draw the measured signal and both predictions of one channel.

    The axis is scaled by the measurement, also where a prediction diverges.
    """
    z, before, after = (signal[:, channel] for signal in (shown.z, shown.before, shown.after))
    measured = z if np.any(np.isfinite(z)) else after
    low, high = _range(measured, 0.06)
    far_low, far_high = _range(measured, 0.8)
    before, after = (
        np.clip(signal, far_low - (high - low), far_high + (high - low))
        for signal in (before, after)
    )
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
    """Return the autocorrelation of a prediction's residuals and the white-noise band, by channel.

    The band is given by its half width.
    """
    scored = np.asarray(side.scored)
    lags = max(min(PLOTTED_LAGS, scored.shape[1] // 5), 1)
    error = np.nan_to_num(
        np.where(scored, np.asarray(side.residuals), 0.0), nan=0.0, posinf=0.0, neginf=0.0
    )
    r = np.asarray(autocorrelation(jnp.asarray(error), jnp.asarray(scored), lags))
    return r, BAND / np.sqrt(np.maximum(scored.sum(axis=(0, 1)), 1))


def _bars(ax: Axes, study: Study, name: str, unit: str, with_labels: bool) -> None:
    """Draw the bars of one channel, a pair for each test set, and a line for the noise."""
    scale, unit = display_unit(unit)
    tests = list(study.before.rms)
    noise = scale * study.noise[name]
    bars = _pairs_of_bars(study, name, scale)
    values = [*(bar.value for bar in bars), noise]
    scale_name, left, right = _bar_axis([value for value in values if _is_length(value)])
    ax.set(xscale=scale_name, xlim=(left, right), ylim=(len(tests) - 0.5, -0.5))
    for value, row, colour, without in bars:
        length = value if _is_length(value) else left
        ax.barh(row, length - left, left=left, height=BAR, color=colour)
        ax.annotate(
            number(value, 3) if np.isfinite(value) else without,
            (max(length, noise), row),
            (3, 0),
            textcoords="offset points",
            va="center",
            fontsize=FONT - 1,
            color=colour,
        )
    if _is_length(noise):
        ax.axvline(noise, color=NOISE, linewidth=1.2, linestyle=(0, (4, 2)))
    ax.set_yticks(range(len(tests)), tests if with_labels else [""] * len(tests), parse_math=False)
    plain(ax, "", "", channel_label(name, unit_words(unit)))
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)


class _Bar(NamedTuple):
    """An error as a bar, or as a word where there is none.

    Attributes:
        value: the error.
        row: position.
        colour: colour.
        without: word for an error that is not finite.
    """

    value: float
    row: float
    colour: str
    without: str


def _pairs_of_bars(study: Study, name: str, scale: float) -> list[_Bar]:
    """Return the errors of one channel before and after, for each test set in turn."""
    bars, channel = [], study.outputs.index(name)
    for row, test in enumerate(study.before.rms):
        measured = np.any(np.asarray(study.before.tests[test].scored)[..., channel])
        without = "diverged" if measured else "not measured"
        bars.append(_Bar(study.before.rms[test][name] * scale, row - BAR / 2, BEFORE, without))
        bars.append(_Bar(study.after.rms[test][name] * scale, row + BAR / 2, AFTER, without))
    return bars


class _BarAxis(NamedTuple):
    scale: str
    left: float
    right: float


def _bar_axis(lengths: list[float]) -> _BarAxis:
    """Return scale and ends of an axis of bars, logarithmic if they differ by a large ratio."""
    if not lengths:
        return _BarAxis("linear", 0.0, 1.0)
    least, most = min(lengths), max(lengths)
    if most <= LARGE_RATIO * least:
        return _BarAxis("linear", 0.0, 1.35 * most)
    left = 0.3 * least
    return _BarAxis("log", left, (most / left) ** 1.35 * left)


def _unscored(ax: Axes, shown: View, with_label: bool) -> None:
    """Shade the window in which the initial state was fitted."""
    if shown.scored_from is None or shown.t[0] >= shown.scored_from:
        return
    ax.axvspan(shown.t[0], shown.scored_from, color="#f0e442", alpha=0.18, linewidth=0)
    if with_label:
        _note(ax, shown.t[0], "start fitted here, not scored")


def _title(shown: View, note: str = "") -> str:
    name = f"record {shown.name}" if shown.name else ""
    return ": ".join(part for part in (name, note) if part)


def _note(ax: Axes, x: float, words: str, above: bool = False) -> None:
    """Write a few words at the top of a panel, inside it or above."""
    drop, side = (1, "bottom") if above else (-2, "top")
    right = ax.transAxes.inverted().transform(ax.transData.transform((x, 1.0)))[0] > RIGHT_PART
    shift, align = ((-3, drop), "right") if right else ((3, drop), "left")
    place = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "va": side}
    place |= {"ha": align}
    ax.annotate(words, (x, 1.0), shift, fontsize=FONT - 1.5, color=INK, **place)


def _range(x: np.ndarray, margin: float) -> tuple[float, float]:
    """Return the lowest and highest value with a margin, never an empty range."""
    finite = x[np.isfinite(x)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    width = high - low or max(abs(high), 1.0)
    return low - margin * width, high + margin * width


def _colour(candidate: Candidate) -> str:
    return AFTER if candidate.added else OTHER


def _drawn(candidates: tuple[Candidate, ...]) -> list[Candidate]:
    """Return the winner and the best of the other candidates, in the order of their scores."""
    ranks = sorted(range(len(candidates)), key=lambda rank: (not candidates[rank].added, rank))
    return [candidates[rank] for rank in sorted(ranks[:MOST_CANDIDATES])]


def _number_drawn(best: list[Candidate], search_round: Round) -> str:
    count, total = len(best), len(search_round.candidates)
    if count == total:
        return ""
    if best[-1] is search_round.candidates[count - 1]:
        return f"the best {count} of {total} candidates"
    return f"the best {count - 1} of {total} candidates, and the one that was added"


def _positive(value: float) -> float:
    return value if _is_length(value) else float("nan")


def _is_length(value: float) -> bool:
    return bool(np.isfinite(value)) and value > 0
