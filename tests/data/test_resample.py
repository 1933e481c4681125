"""Signals with clocks of their own on one clock: exact values, and the stated effect on noise."""

import numpy as np
import pytest

import jaxid
from jaxid.data import resample

NAMES = {"inputs": ("u",), "outputs": ("y",)}


def channel(result, name):
    return next(row for row in result.channels if row.name == name)


def test_samples_on_the_clock_are_copied_bit_for_bit():
    t = 0.1 * np.arange(50)
    result = resample({"u": (t, t**2), "y": (t, np.sin(t))}, step=0.1, **NAMES)
    np.testing.assert_array_equal(result.record.u[:, 0], t**2)
    np.testing.assert_array_equal(result.record.z[:, 0], np.sin(t))
    assert channel(result, "y")[1:] == (type(channel(result, "y").change).COPIED, 50, 50, 1.0, 0.0)


def test_inputs_run_in_straight_lines_or_are_held():
    slow, fast = np.arange(11.0), 0.25 * np.arange(41)
    signals = {"u": (slow, slow**2), "w": (slow, slow**2), "y": (fast, fast)}
    options = {"inputs": ("u", "w"), "outputs": ("y",), "held": ("w",)}
    record = resample(signals, step=0.25, **options).record
    np.testing.assert_allclose(record.u[:, 0], np.interp(fast, slow, slow**2), atol=1e-12)
    np.testing.assert_array_equal(record.u[:, 1], np.floor(fast) ** 2)


def test_slower_output_has_missing_samples_and_no_interpolated_ones():
    fast, slow = 0.01 * np.arange(1001), 0.05 + 0.1 * np.arange(95) + 0.003
    result = resample({"u": (fast, fast), "y": (slow, 2 * slow)}, step=0.01, **NAMES)
    mask = np.asarray(result.record.mask)[:, 0]
    assert mask.sum() == 94  # the last one has no later neighbour
    np.testing.assert_allclose(result.record.z[mask, 0], 2 * result.record.t[mask], atol=1e-12)
    moved = channel(result, "y")
    assert moved.change.value == "placed"
    assert moved.deviation == pytest.approx(np.hypot(0.97, 0.03))


@pytest.mark.parametrize(("ratio", "late"), [(2, 0.0), (3, 0.0), (4, 0.0), (10, 0.0), (4, 0.007)])
def test_faster_output_is_averaged_without_a_delay(ratio, late):
    """A ramp stays a ramp, wherever the samples stand; no mean reaches beyond the signal."""
    slow = 0.1 * np.arange(101)
    fast = 0.1 / ratio * np.arange(100 * ratio + 1) + late
    result = resample({"u": (slow, slow), "y": (fast, 3 * fast)}, step=0.1, **NAMES)
    z, mask = np.asarray(result.record.z), np.asarray(result.record.mask)
    assert list(np.flatnonzero(~mask)) == [0, 100]
    np.testing.assert_allclose(z[1:-1, 0], 3 * slow[1:-1], atol=1e-12)
    averaged = channel(result, "y")
    assert averaged.change.value == "averaged"
    assert averaged.deviation == pytest.approx(1 / np.sqrt(ratio), rel=0.15)
    if ratio == 4 and not late:  # the trapezoidal rule: 1/2, 1, 1, 1, 1/2
        assert averaged.deviation == pytest.approx(np.sqrt(3.5) / 4)
        assert averaged.correlation == pytest.approx(0.25 / 3.5)


def test_faster_input_is_averaged_and_has_no_missing_sample():
    slow, fast = 0.1 * np.arange(101), 0.025 * np.arange(401)
    signals = {"u": (fast, 2 * fast), "w": (slow + 0.007, slow), "y": (slow, slow)}
    result = resample(signals, step=0.1, inputs=("u", "w"), outputs=("y",))
    assert channel(result, "u").change.value == "averaged"
    np.testing.assert_allclose(result.record.u[:, 0], 2 * result.record.t, atol=1e-12)


def test_gap_of_a_faster_output_stays_a_gap():
    slow, fast = 0.1 * np.arange(101), 0.025 * np.arange(401)
    kept = (fast < 3.01) | (fast > 5.01)
    result = resample({"u": (slow, slow), "y": (fast[kept], fast[kept])}, step=0.1, **NAMES)
    missing = slow[~np.asarray(result.record.mask)[:, 0]]
    np.testing.assert_allclose(missing[1:-1], np.arange(31, 50) / 10.0)


@pytest.mark.parametrize(("slow", "fast"), [(0.07, 0.1), (0.013, 0.1), (0.27, 0.1), (0.1, 0.1)])
def test_stated_deviation_is_that_of_white_noise(slow, fast, seed):
    """Of 20,000 samples a deviation has an error of 0.5 %; five of them are allowed."""
    rng, t = np.random.default_rng(seed), slow * np.arange(int(2000 / slow)) + 0.004
    result = resample(
        {
            "u": (fast * np.arange(int(2000 / fast)), np.zeros(int(2000 / fast))),
            "y": (t, rng.normal(size=len(t))),
        },
        step=fast,
        **NAMES,
    )
    z = np.asarray(result.record.z)[np.asarray(result.record.mask)]
    allowed = 5 / np.sqrt(2 * len(z))
    assert np.sqrt(np.mean(z**2)) == pytest.approx(channel(result, "y").deviation, rel=allowed)


def test_table_names_every_channel_and_its_noise():
    t = 0.1 * np.arange(50)
    text = str(resample({"u": (t, t), "y": (t[::5], t[::5])}, step=0.05, **NAMES))
    for words in ("u ", "y ", "interpolated", "copied", "noise: deviation after over before"):
        assert words in text


def test_signals_that_make_no_record_are_refused():
    t = 0.1 * np.arange(20)
    good = {"u": (t, t), "y": (t, t)}
    cases = {
        "The step is 0": (good, {"step": 0}),
        "in seconds. Convert them": (good, {"units": {"t": "ms"}}),
        "There is no signal 'y'": ({"u": (t, t)}, {}),
        "There is no input that is held 'y'": (good, {"held": ("y",)}),
        "holds no numbers": ({**good, "y": (t, ["a"] * 20)}, {}),
        "one time for each value": ({**good, "y": (t[1:], t)}, {}),
        "has no valid sample": ({**good, "y": (t, np.full(20, np.nan))}, {}),
        "does not increase: 0 s after 0.1": ({**good, "y": (np.r_[t[:2], t[:18]], t)}, {}),
        "only 0 s in common": ({**good, "u": (t[:1], t[:1])}, {}),
    }
    for words, (signals, options) in cases.items():
        with pytest.raises(jaxid.InputError, match=words):
            resample(signals, **{"step": 0.1, **NAMES, **options})
