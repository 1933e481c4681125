"""Text files of numbers: channels by column number, sums of columns, errors with line."""

import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.data import ATTAS, ATTAS_STALL, HFB320, read_columns

ROWS = 12


def text(numbers, delimiter=" "):
    return "\n".join(delimiter.join(repr(float(x)) for x in row) for row in numbers) + "\n"


def grid(columns, step, seed=0):
    """Random numbers: time in the first column, noise in the others."""
    numbers = np.random.default_rng(seed).normal(size=(ROWS, columns))
    numbers[:, 0] = step * np.arange(ROWS)
    return numbers


def write(folder, content, name="run.asc"):
    path = folder / name
    path.write_text(content, encoding="utf-8")
    return path


def test_hfb320_layout_reads_published_columns(tmp_path):
    numbers = grid(20, 0.1)
    path = write(tmp_path, text(numbers, "   "), "hfb320_1_10.asc")
    outputs = ("V", "alpha", "pitch", "q", "qdot", "ax", "ay", "az")
    r = read_columns(path, HFB320, inputs=("stabilator", "thrust"), outputs=outputs)
    np.testing.assert_allclose(r.z, numbers[:, [4, 5, 6, 7, 8, 9, 11, 10]], rtol=1e-12)
    np.testing.assert_allclose(r.u, numbers[:, [1, 3]], rtol=1e-12)
    np.testing.assert_allclose(r.t, 0.1 * np.arange(ROWS), rtol=1e-12)
    assert (r.names, r.outputs, r.input_units) == (("hfb320_1_10",), outputs, ("rad", "N"))


def test_attas_layout_reads_published_columns(tmp_path):
    numbers = grid(45, 0.04)
    path = write(tmp_path, text(numbers), "fAttasElv1.asc")
    inputs = ("stabilator", "aileron", "rudder", "thrust")
    r = read_columns(
        path, ATTAS, inputs=inputs, outputs=("q", "alpha", "altitude", "az", "density")
    )
    degrees = np.stack(
        [numbers[:, 21], 0.5 * (numbers[:, 28] - numbers[:, 27]), numbers[:, 29]], axis=1
    )
    np.testing.assert_allclose(r.u[:, :3], np.deg2rad(degrees), rtol=1e-12)
    np.testing.assert_allclose(r.u[:, 3], numbers[:, 36] + numbers[:, 37], rtol=1e-12)
    np.testing.assert_allclose(r.z[:, :2], np.deg2rad(numbers[:, [7, 12]]), rtol=1e-12)
    np.testing.assert_allclose(r.z[:, 2:], numbers[:, [15, 3, 33]] * [0.3048, 1.0, 1.0], rtol=1e-12)
    assert r.output_units == ("rad/s", "rad", "m", "m/s^2", "kg/m^3")


def test_attas_stall_layout_has_altitude_in_metres(tmp_path):
    numbers = grid(45, 0.04)
    path = write(tmp_path, text(numbers), "fAttas_qst01.asc")
    r = read_columns(path, ATTAS_STALL, inputs=("thrust",), outputs=("altitude", "V"))
    np.testing.assert_allclose(r.z, numbers[:, [15, 14]], rtol=1e-12)


MAP = {"t": (1, "ms"), "q": (3, "deg/s"), "de": ({2: -1.0}, "deg")}
OPTIONS = {"inputs": ("de",), "outputs": ("q",)}


def test_custom_columns_are_read_with_header_comments_and_delimiter(tmp_path):
    content = "written on a day\ntime;de;q\n% comment\n0;1;10\n\n20;2;NaN\n# more\n40;3D0;3.0d+1\n"
    r = read_columns(
        write(tmp_path, content),
        MAP,
        **OPTIONS,
        skip=2,
        delimiter=";",
        name="x",
        constants={"mass": 5.0},
    )
    np.testing.assert_allclose(r.t, [0, 0.02, 0.04], rtol=1e-12)
    np.testing.assert_allclose(r.u[:, 0], -np.deg2rad([1, 2, 3]), rtol=1e-12)
    np.testing.assert_allclose(r.channel("q"), np.deg2rad([10, np.nan, 30]), rtol=1e-12)
    assert r.names == ("x",)
    assert float(r.constants["mass"]) == 5.0
    r = read_columns(write(tmp_path, "7 1 10\n7 2 20\n"), MAP, **OPTIONS, sample_time=0.5)
    np.testing.assert_array_equal(r.t, [0.0, 0.5])


REFUSALS = {
    "word": ("0 1 10\n20 x 20\n", {}, ["run.asc, line 2, column 2: 'x'", "skip"]),
    "header": ("t de q\n0 1 10\n", {}, ["run.asc, line 1, column 1: 't'", "skip"]),
    "ragged": ("0 1 10\n\n20 2\n", {}, ["run.asc, line 3: 2 numbers", "line 1 has 3"]),
    "too few columns": ("0 1\n20 2\n", {}, ["run.asc: channel 'q' is column 3", "there are 2"]),
    "commas": ("0,1,10\n20,2,20\n", {}, ["line 1, column 1: '0,1,10'", "delimiter"]),
    "missing input": (
        "0 1 10\n\n20 NaN 20\n",
        {},
        ["run.asc, line 3, column 2 ('de'): nan", "Time, inputs"],
    ),
    "missing time": ("0 1 10\nnan 1 20\n", {}, ["line 2, column 1 ('t')"]),
    "time stands": (
        "0 1 10\n% x\n0 2 20\n",
        {},
        ["run.asc, line 3: time does not increase", "sample_time"],
    ),
    "nothing": ("% only words\n", {}, ["run.asc has no line of numbers"]),
    "no such channel": (
        "0 1 10\n20 2 20\n",
        {"outputs": ("p",)},
        ["among `columns` 'p'", "t, q, de"],
    ),
    "column 0": (
        "0 1 10\n20 2 20\n",
        {"columns": MAP | {"q": (0, "")}},
        ["'q' is column 0, counted from 1"],
    ),
    "unit": (
        "0 1 10\n20 2 20\n",
        {"columns": MAP | {"q": (3, "degs/")}},
        ["'q'", "'degs/'", "not known"],
    ),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_invalid_column_files_are_refused_with_place(case, tmp_path):
    content, changes, words = REFUSALS[case]
    path = write(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_columns(path, **({"columns": MAP} | OPTIONS | changes))
    for word in words:
        assert word in str(caught.value), f"{word!r} is not in: {caught.value}"


def test_missing_file_or_file_without_text_is_refused(tmp_path):
    with pytest.raises(InputError, match="no file"):
        read_columns(tmp_path / "none.asc", MAP, **OPTIONS)
    (tmp_path / "odd.asc").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"odd\.asc is not a text file"):
        read_columns(tmp_path / "odd.asc", MAP, **OPTIONS)
