"""Files: an exact round trip, units from four places, errors with file, line and column."""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from record_strategies import assert_same, records
from scipy.io import savemat

from jaxid._foundation.checks import InputError
from jaxid.data import read_csv, read_mat, record, stack, write_csv


@settings(max_examples=40)
@given(records())
def test_csv_round_trip_is_exact(make):
    r = make()
    with tempfile.TemporaryDirectory() as folder:
        path = write_csv(r, Path(folder) / "run.csv")
        constants = {key: float(value) for key, value in r.constants.items()}
        back = read_csv(
            path, inputs=r.inputs, outputs=r.outputs, name=r.names[0], constants=constants
        )
        assert [p.name for p in Path(folder).iterdir()] == ["run.csv"]
    assert_same(back, r)


def write(folder, text, name="log.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


GOOD = "time,de,alpha,note\n0,1,10,x\n20,2,,y\n40,3,30,z\n"


def test_csv_units_come_from_header_row_units_file_or_call(tmp_path):
    def check(path, **options):
        r = read_csv(path, inputs=("de",), outputs=("alpha",), time="time", **options)
        np.testing.assert_allclose(r.t, [0, 0.02, 0.04], rtol=1e-15)
        np.testing.assert_allclose(r.channel("alpha"), np.deg2rad([10, np.nan, 30]), rtol=1e-15)
        assert (r.input_units, r.output_units, r.names) == (("rad",), ("rad",), ("log",))

    units = {"time": "ms", "de": "deg", "alpha": "deg"}
    path = write(tmp_path, GOOD)
    check(path, units=units)
    check(write(tmp_path, GOOD.replace("time,de,alpha", "time [ms], de [deg] ,alpha[deg]")))
    check(write(tmp_path, GOOD.replace("note\n", "note\nms,deg,deg,\n")), units_row=True)
    path = write(tmp_path, GOOD)
    units_file = write(tmp_path, json.dumps(units | {"note": "furlong"}), "log.units.json")
    check(path)
    # the units file has precedence over the header
    check(write(tmp_path, GOOD.replace("alpha", "alpha [m]")))
    write(tmp_path, GOOD)
    units_file.unlink()
    write(tmp_path, 'time = "ms"\nde = "deg"\nalpha = "m"\n', "log.units.toml")
    check(path, units={"alpha": "deg"})  # the call has precedence over the file


def test_units_of_columns_that_do_not_exist_are_refused(tmp_path):
    path = write(tmp_path, GOOD)
    write(tmp_path, json.dumps({"Alpha": "deg"}), "log.units.json")
    with pytest.raises(InputError, match=r"'Alpha'.*'alpha'.*log\.units\.json names it"):
        read_csv(path, inputs=("de",), outputs=("alpha",), time="time")


@pytest.mark.parametrize("key", ["alpha", "AOA"])
def test_csv_columns_are_renamed_with_units_and_signs(key, tmp_path):
    path = write(tmp_path, GOOD.replace("time,de,alpha", "TIME [ms],DE_1 [deg],AOA"))
    r = read_csv(
        path,
        inputs=("de",),
        outputs=("alpha",),
        columns={"t": "TIME", "de": "DE_1", "alpha": "AOA"},
        units={key: "deg"},
        signs={"alpha": -1},
    )
    np.testing.assert_allclose(r.t, [0, 0.02, 0.04], rtol=1e-15)
    np.testing.assert_allclose(r.channel("de"), np.deg2rad([1, 2, 3]), rtol=1e-15)
    np.testing.assert_allclose(r.channel("alpha"), -np.deg2rad([10, np.nan, 30]), rtol=1e-15)
    assert (r.inputs, r.outputs, r.output_units) == (("de",), ("alpha",), ("rad",))


def test_csv_accepts_sample_time_blank_lines_and_delimiter(tmp_path):
    path = write(tmp_path, "\ufeffu;y\n1;2\n\n3;4\n5;6\n\n")
    r = read_csv(path, inputs=("u",), outputs=("y",), sample_time=0.5, delimiter=";", name="x")
    np.testing.assert_array_equal(r.t, [0, 0.5, 1])
    np.testing.assert_array_equal(r.z[:, 0], [2, 4, 6])
    assert r.names == ("x",)


CSV_REFUSALS = {
    "bad cell": (
        GOOD.replace("30,z", "3O,z"),
        {},
        ["log.csv", "line 4", "column 'alpha'", "'3O'", "Correct the cell"],
    ),
    "decimal comma": (
        GOOD.replace("40,3,", "40,3,5,"),
        {},
        ["log.csv", "line 4", "5 cells", "4", "decimal comma", "`delimiter=';'"],
    ),
    "no such column": (
        GOOD,
        {"outputs": ("alfa",)},
        ["column in log.csv", "'alfa'", "Did you mean 'alpha'", "`columns`"],
    ),
    "no column of time": (GOOD, {"time": "t"}, ["'t'", "`time` names", "`sample_time`"]),
    "columns of no channel": (
        GOOD,
        {"columns": {"de": "de", "time": "time", "alfa": "alpha"}},
        ["channel in `columns` of log.csv 'alfa'", "Did you mean 'alpha'", "{channel: column}"],
    ),
    "columns reversed": (GOOD, {"columns": {"AOA": "alpha"}}, ["'AOA'", "{channel: column}"]),
    "unit given twice": (
        GOOD.replace("alpha", "AOA"),
        {"columns": {"alpha": "AOA"}, "units": {"AOA": "deg", "alpha": "rad"}},
        ["unit in log.csv", "'alpha'", "twice"],
    ),
    "sign of no channel": (GOOD, {"signs": {"beta": -1}}, ["`signs` of log.csv 'beta'"]),
    "sign of two": (GOOD, {"signs": {"alpha": -2}}, ["the sign of 'alpha' is -2", "1 or -1"]),
    "column twice": (GOOD.replace("note", "alpha"), {}, ["log.csv", "'alpha'", "twice", "Rename"]),
    "empty input": (GOOD.replace("20,2", "20,"), {}, ["log", "input 'de'", "row 1", "interpolate"]),
    "empty file": ("\n", {}, ["log.csv", "empty", "names of the columns"]),
    "forgotten units row": (
        GOOD.replace("note\n", "note\nms,deg,deg,\n"),
        {},
        ["line 2", "'ms'", "units_row=True"],
    ),
    "no units row": ("time,de,alpha\n", {"units_row": True}, ["log.csv", "no row of units"]),
    "unknown unit": (GOOD, {"units": {"alpha": "degs/"}}, ["'alpha'", "'degs/'", "not known"]),
    "unit of no column": (GOOD, {"units": {"beta": "deg"}}, ["'beta'"]),
    "backwards": (GOOD, {"time": None, "sample_time": -1.0}, ["`sample_time`", "-1.0", "positive"]),
}


@pytest.mark.parametrize("case", CSV_REFUSALS)
def test_invalid_csv_files_are_refused_with_place(case, tmp_path):
    text, options, words = CSV_REFUSALS[case]
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_csv(path, **({"inputs": ("de",), "outputs": ("alpha",), "time": "time"} | options))
    for word in words:
        assert word in str(caught.value), f"{word!r} is not in: {caught.value}"


def test_missing_and_undecodable_files_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"no file .*nowhere\.csv.*Check the folder"):
        read_csv(tmp_path / "nowhere.csv", inputs=(), outputs=("y",))
    latin = tmp_path / "latin.csv"
    latin.write_bytes("t,\xe4\n0,1\n".encode("latin-1"))
    with pytest.raises(InputError, match=r"latin\.csv.*UTF-8.*Save it again"):
        read_csv(latin, inputs=(), outputs=("y",))
    path = write(tmp_path, GOOD)
    for text in ("[1, 2]", "{not json"):
        write(tmp_path, text, "log.units.json")
        with pytest.raises(InputError, match=r"log\.units\.json"):
            read_csv(path, inputs=("de",), outputs=("alpha",), time="time")


def test_write_csv_never_overwrites_and_leaves_no_temporary_file(tmp_path):
    r = record([0, 1], [1, 2], [3, 4], inputs=("u",), outputs=("y",))
    path = write(tmp_path, "precious")
    with pytest.raises(InputError, match=r"log\.csv exists.*Choose another name"):
        write_csv(r, path)
    assert path.read_text() == "precious"
    with pytest.raises(InputError, match=r"folder .* does not exist"):
        write_csv(r, tmp_path / "no" / "run.csv")
    with pytest.raises(InputError, match=r"stack\[i\]"):
        write_csv(stack([r, r]), tmp_path / "run.csv")
    odd = record([0, 1], None, [3, 4], inputs=(), outputs=("a,b",))
    with pytest.raises(InputError, match=r"'a,b'.*Rename"):
        write_csv(odd, tmp_path / "run.csv")
    assert [p.name for p in tmp_path.iterdir()] == ["log.csv"]


def test_mat_file_is_read_with_time_or_sample_time(tmp_path):
    path = tmp_path / "log.mat"
    savemat(
        path,
        {
            "t": [[0.0], [1.0], [2.0]],
            "u": [1.0, 2.0, 3.0],
            "y": [4.0, np.nan, 6.0],
            "m": np.ones((3, 2)),
            "s": [1.0],
        },
    )
    r = read_mat(path, inputs=("u",), outputs=("y",), time="t", units={"t": "ms", "u": "mV"})
    np.testing.assert_allclose(r.t, [0, 1e-3, 2e-3], rtol=1e-15)
    np.testing.assert_allclose(r.u[:, 0], [1e-3, 2e-3, 3e-3], rtol=1e-15)
    np.testing.assert_array_equal(r.mask[:, 0], [True, False, True])
    r = read_mat(path, inputs=("u",), outputs=("y",), sample_time=0.5)
    np.testing.assert_array_equal(r.t, [0, 0.5, 1])
    assert r.names == ("log",)
    good = {"inputs": ("u",), "outputs": ("y",), "time": "t"}
    for change, words in (
        ({"time": None}, r"log\.mat.*`sample_time`"),
        ({"sample_time": 1.0}, r"one of the two"),
        ({"outputs": ("m",)}, r"log\.mat.*'m'.*\(3, 2\).*vector"),
        ({"outputs": ("s",)}, r"'s' has 1 samples and time 3"),
        ({"outputs": ("yy",)}, r"variable in log\.mat 'yy'.*Did you mean 'y'"),
    ):
        with pytest.raises(InputError, match=words):
            read_mat(path, **(good | change))


def test_mat_variables_are_renamed_with_units_and_signs(tmp_path):
    path = tmp_path / "flight.mat"
    values = {"TIME": [0.0, 1.0, 2.0], "DE": [1.0, 2.0, 3.0], "AOA_DEG": [180.0, 0.0, -180.0]}
    savemat(path, values | {"NZ": [1.0, 1.5, 1.0]})
    names = {"inputs": ("elevator",), "outputs": ("alpha", "az"), "time": "TIME"}
    names["columns"] = {"elevator": "DE", "alpha": "AOA_DEG", "az": "NZ"}
    for unit in ({"alpha": "deg"}, {"AOA_DEG": "deg"}):
        r = read_mat(path, **names, units=unit | {"TIME": "ms"}, signs={"az": -1})
        np.testing.assert_allclose(r.t, [0, 1e-3, 2e-3], rtol=1e-15)
        np.testing.assert_allclose(r.z[:, 0], [np.pi, 0, -np.pi], rtol=1e-15)
        np.testing.assert_array_equal(r.z[:, 1], [-1.0, -1.5, -1.0])
        np.testing.assert_array_equal(r.u[:, 0], values["DE"])
    for change, words in (
        ({}, "title 'AOA_DEG' seems to hold the unit 'deg'"),
        ({"columns": {"alpha": "AOA"}, "units": {}}, "no variable.*'elevator'.*`columns`"),
        ({"columns": {"q": "Q"}, "units": {}}, "no channel in `columns` of flight.mat 'q'"),
        ({"units": {"alpha": "deg"}, "signs": {"az": 2}}, "sign of 'az' is 2"),
    ):
        with pytest.raises(InputError, match=words):
            read_mat(path, **(names | change))


def test_mat_file_of_version_73_or_other_format_is_refused(tmp_path):
    path = tmp_path / "new.mat"
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    path.write_bytes(header + b"\x00" * 512)
    with pytest.raises(InputError, match=r"new\.mat.*7\.3.*-v7"):
        read_mat(path, inputs=(), outputs=("y",), sample_time=1.0)
    with pytest.raises(InputError, match=r"log\.csv is not a MATLAB file"):
        read_mat(write(tmp_path, GOOD * 20), inputs=(), outputs=("y",), sample_time=1.0)
