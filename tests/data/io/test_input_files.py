"""Inputs from a CSV file: units, interpolation, errors with file, line and column."""

import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.data import read_inputs

GOOD = "time [ms],aileron [deg],note,thrust [lbf]\n0,0,a,100\n100,10,b,200\n\n400,-20,c,200\n"
NAMES = ("thrust", "aileron")
EXPECT = {"aileron": "rad", "thrust": "N"}


def write(folder, text, name="inputs.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_inputs_are_in_requested_order_and_si(tmp_path):
    history = read_inputs(write(tmp_path, GOOD), inputs=NAMES, time="time", expect=EXPECT)
    np.testing.assert_allclose(history.t, [0.0, 0.1, 0.4], rtol=1e-15)
    np.testing.assert_allclose(history.u[:, 1], np.deg2rad([0.0, 10.0, -20.0]), rtol=1e-15)
    np.testing.assert_allclose(
        history.u[:, 0], 4.4482216152605 * np.array([100.0, 200.0, 200.0]), rtol=1e-15
    )
    assert (history.inputs, history.units) == (NAMES, ("N", "rad"))
    plain = write(tmp_path, "u\n1\n2\n")
    np.testing.assert_array_equal(read_inputs(plain, inputs=("u",), sample_time=0.5).t, [0.0, 0.5])
    with pytest.raises(InputError, match=r"`time` is 't' and `sample_time` is 0.5"):
        read_inputs(plain, inputs=("u",), time="t", sample_time=0.5)


def test_inputs_are_interpolated_only_with_hold(tmp_path):
    path = write(tmp_path, GOOD)
    same = read_inputs(path, [0.1 + 1e-12, 0.4], inputs=("aileron",), time="time")
    np.testing.assert_allclose(same.u[:, 0], np.deg2rad([10.0, -20.0]), rtol=1e-15)
    t = np.array([0.0, 0.05, 0.1, 0.25, 0.4])
    linear = read_inputs(path, t, inputs=("aileron",), time="time", hold="linear")
    np.testing.assert_allclose(
        linear.u[:, 0], np.deg2rad([0.0, 5.0, 10.0, -5.0, -20.0]), atol=1e-15
    )
    held = read_inputs(path, t, inputs=("aileron",), time="time", hold="zero_order")
    np.testing.assert_allclose(held.u[:, 0], np.deg2rad([0.0, 0.0, 10.0, 10.0, -20.0]), rtol=1e-15)
    np.testing.assert_array_equal(held.t, t)


REFUSALS = {
    "no hold": (
        GOOD,
        {"t": [0.0, 0.2]},
        ["inputs.csv", "no row at 0.2 s", "1 of the 2", "hold='linear'"],
    ),
    "beyond the end": (
        GOOD,
        {"t": [0.0, 0.5], "hold": "linear"},
        ["inputs.csv", "0 to 0.4 s", "0 to 0.5 s", "inside"],
    ),
    "time not finite": (GOOD, {"t": [0.0, np.nan]}, ["inputs.csv", "`t`", "not finite"]),
    "empty cell": (
        GOOD.replace("100,10", "100,"),
        {},
        ["inputs.csv, line 3, column 'aileron'", "empty", "fill in"],
    ),
    "infinite": (
        GOOD.replace("100,10", "100,inf"),
        {},
        ["inputs.csv, line 3, column 'aileron'", "infinite"],
    ),
    "no number": (
        GOOD.replace("-20", "x"),
        {},
        ["inputs.csv", "line 5", "column 'aileron'", "'x'"],
    ),
    "backwards": (
        GOOD.replace("400", "50"),
        {},
        ["inputs.csv, line 5, column 'time'", "0.05 s after 0.1 s", "sort"],
    ),
    "time in metres": (GOOD.replace("ms", "m"), {}, ["inputs.csv, column 'time'", "'m'", "'ms'"]),
    "no such column": (
        GOOD,
        {"inputs": ("ailron",)},
        ["column in inputs.csv", "'ailron'", "'aileron'"],
    ),
    "named twice": (GOOD, {"inputs": ("aileron", "aileron")}, ["'aileron'", "twice"]),
    "a string": (GOOD, {"inputs": "aileron"}, ["inputs.csv", "`inputs` is 'aileron'", "tuple"]),
    "other kind": (
        GOOD.replace("deg", "m"),
        {"expect": EXPECT},
        ["inputs.csv, column 'aileron'", "'m'", "'rad'"],
    ),
    "unit not stated": (
        GOOD.replace(" [deg]", ""),
        {"expect": EXPECT},
        ["inputs.csv, column 'aileron'", "no unit"],
    ),
    "unit of no column": (GOOD, {"units": {"rudder": "deg"}}, ["inputs.csv", "'rudder'"]),
    "no rows": ("time,aileron,thrust\n", {}, ["inputs.csv", "no row"]),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_invalid_input_files_are_refused_with_place(case, tmp_path):
    text, options, words = REFUSALS[case]
    with pytest.raises(InputError) as caught:
        read_inputs(write(tmp_path, text), **({"inputs": NAMES, "time": "time"} | options))
    for word in words:
        assert word in str(caught.value), f"{word!r} is not in: {caught.value}"
