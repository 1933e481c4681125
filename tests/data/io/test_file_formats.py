"""CSV of other countries, dates, DataFrames, HDF5, Parquet and MATLAB 7.3."""

import numpy as np
import pytest
import scipy.io

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.data import read_columns, read_hdf5, read_parquet

T = 0.1 * np.arange(8)
U, X = np.sin(T), np.cos(T)
NAMES = {"inputs": ("u",), "outputs": ("x",)}


def assert_equal(record, t=T):
    np.testing.assert_allclose(record.t, t, atol=1e-12)
    np.testing.assert_allclose(record.u[:, 0], U, rtol=1e-15)
    np.testing.assert_allclose(record.z[:, 0], X, rtol=1e-15)


def rows(*columns, delimiter=","):
    return "".join(delimiter.join(map(str, row)) + "\n" for row in zip(*columns, strict=True))


# CSV. ---------------------------------------------------------------------------------------------


def test_decimal_comma_encoding_and_lines_above_the_header_are_read(tmp_path):
    text = "Prüfstand 7\n\nt;u;x\n" + rows(T, U, X, delimiter=";").replace(".", ",")
    path = tmp_path / "german.csv"
    path.write_bytes(text.encode("latin-1"))
    options = {"delimiter": ";", "decimal": ",", "encoding": "latin-1", "skip": 2}
    assert_equal(jaxid.read_csv(path, **NAMES, **options))
    with pytest.raises(InputError, match=r"not a CSV file in UTF-8.*or give `encoding`"):
        jaxid.read_csv(path, **NAMES, **{**options, "encoding": "utf-8-sig"})


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_dates_become_seconds_from_the_first_row(zone, tmp_path):
    stamps = [f"2026-01-31T23:59:59.{k}00000{zone}" for k in range(8)]
    path = tmp_path / "dated.csv"
    path.write_text("time,u,x\n" + rows(stamps, U, X))
    assert_equal(jaxid.read_csv(path, **NAMES, time="time"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"decimal": "x"}, "the decimal sign is 'x'"),
        ({"decimal": ","}, "both `decimal` and `delimiter`"),
        ({"skip": -1}, "`skip` is -1"),
        ({"skip": True}, "`skip` is True"),
        ({"skip": 99}, "is empty"),
        ({"encoding": "utf-99"}, "encoding 'utf-99' is not known"),
        ({"encoding": "utf-16"}, "not a CSV file in utf-16"),
    ],
)
def test_layouts_that_no_file_has_are_refused(options, words, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,u,x\n" + rows(T, U, X))
    with pytest.raises(InputError, match=words):
        jaxid.read_csv(path, **NAMES, **options)


def test_cells_of_another_layout_are_refused_with_their_line(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t;u;x\n0;1.234,5;1\n")
    with pytest.raises(InputError, match=r"line 2, column 'u': '1.234,5' is not a number"):
        jaxid.read_csv(path, **NAMES, delimiter=";", decimal=",")
    path.write_text("t,u,x\n2026-01-31,1,1\n0.5,1,1\n")
    with pytest.raises(InputError, match=r"line 3, column 't': '0.5' is not a date like the first"):
        jaxid.read_csv(path, **NAMES)
    path.write_text("t,u,x\n2026-01-31T00:00:00Z,1,1\n2026-01-31T00:00:01,1,1\n")
    with pytest.raises(InputError, match=r"line 3.* is not a date like the first"):
        jaxid.read_csv(path, **NAMES)


def test_writing_leaves_the_temporary_file_of_another_writer(tmp_path):
    record = jaxid.record(T, U, X, **NAMES)
    other = tmp_path / ".log.csv.part"
    other.write_text("another writer's")
    assert_equal(jaxid.read_csv(jaxid.write_csv(record, tmp_path / "log.csv"), **NAMES))
    assert other.read_text() == "another writer's"


@pytest.mark.parametrize("delimiter", ["", ",,", "\n"])
def test_delimiter_of_columns_is_one_character(delimiter, tmp_path):
    path = tmp_path / "log.txt"
    path.write_text("0 1 2\n1 1 2\n")
    columns = {"t": (1, "s"), "u": (2, ""), "x": (3, "")}
    with pytest.raises(InputError, match="Give one character"):
        read_columns(path, columns, **NAMES, delimiter=delimiter)


# DataFrame. ---------------------------------------------------------------------------------------


def test_data_frame_is_a_record():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"seconds": T, "u": U, "x": X})
    assert_equal(jaxid.record(frame, **NAMES, time="seconds"))
    assert_equal(jaxid.record(frame.set_index("seconds"), **NAMES, time="seconds"))
    dated = frame.assign(t=pandas.Timestamp("2026-01-31") + pandas.to_timedelta(T, unit="s"))
    assert_equal(jaxid.record(dated, **NAMES))
    assert_equal(jaxid.record(dated.set_index("t"), **NAMES))
    gap = frame.assign(x=[None, *X[1:]])
    assert not jaxid.record(gap, **NAMES, time="seconds").mask[0, 0]


def test_data_frames_without_the_channels_are_refused():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"seconds": T, "u": U, "x": X})
    with pytest.raises(InputError, match=r"no column 't' of time.*Give `time`"):
        jaxid.record(frame, **NAMES)
    with pytest.raises(InputError, match="no column of the DataFrame 'y'"):
        jaxid.record(frame, inputs=("u",), outputs=("y",), time="seconds")
    with pytest.raises(InputError, match="Leave out `u` and `z`"):
        jaxid.record(frame, U, **NAMES, time="seconds")
    with pytest.raises(InputError, match="'x' holds 'high'"):
        jaxid.record(frame.assign(x="high"), **NAMES, time="seconds")


# Binary files. ------------------------------------------------------------------------------------


def test_hdf5_datasets_are_read_with_their_units(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("flight")
        for name, values, unit in (("t", 1000 * T, "ms"), ("u", U, "N"), ("x", 1000 * X, "mm")):
            group.create_dataset(name, data=values[:, None]).attrs["units"] = unit
        group.create_dataset("note", data="text")
    record = read_hdf5(path, **NAMES, group="flight", time="t")
    assert_equal(record)
    assert (record.input_units, record.output_units) == (("N",), ("m",))
    with pytest.raises(InputError, match=r"no dataset in log\.h5 't'.*The names are"):
        read_hdf5(path, **NAMES, time="t")
    with pytest.raises(InputError, match=r"no group in log.h5 'fligth'.*Did you mean 'flight'"):
        read_hdf5(path, **NAMES, group="fligth", time="t")
    with pytest.raises(InputError, match="a channel is a vector of numbers"):
        read_hdf5(path, inputs=("u",), outputs=("note",), group="flight", time="t")
    with pytest.raises(InputError, match=r"`time`.* or `sample_time`"):
        read_hdf5(path, **NAMES, group="flight")
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes(path.read_bytes()[:600])
    with pytest.raises(InputError, match=r"damaged.h5 cannot be read as HDF5"):
        read_hdf5(damaged, **NAMES, time="t")


def test_parquet_columns_are_read(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "log.parquet"
    table = pyarrow.table({"t": T, "u": U, "x": [None, *X[1:].tolist()]})
    parquet.write_table(table, path)
    record = read_parquet(path, **NAMES, time="t")
    np.testing.assert_allclose(record.z[1:, 0], X[1:])
    assert not record.mask[0, 0]
    np.testing.assert_allclose(read_parquet(path, **NAMES, sample_time=0.1).t, T)
    with pytest.raises(InputError, match=r"no column in log.parquet 'y'"):
        read_parquet(path, inputs=(), outputs=("y",), time="t")
    path.write_bytes(b"PAR1 not really PAR1")
    with pytest.raises(InputError, match=r"log.parquet cannot be read as Parquet"):
        read_parquet(path, **NAMES, time="t")


def test_matlab_7_3_is_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "new.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", T), ("u", U), ("x", X)):
            file.create_dataset(name, data=values[:, None])
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    assert_equal(jaxid.read_mat(path, **NAMES, time="t"))


@pytest.mark.parametrize("at", [130, 140, 152, 160, 180, 200, 240])
def test_damaged_matlab_file_is_refused_in_words_or_read(at, tmp_path):
    """A damaged number is a number; damage to the structure is refused."""
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, {"t": T, "u": U, "x": X})
    content = bytearray(path.read_bytes())
    for value in (0x00, 0x7F, 0xFF):
        content[at] = value
        path.write_bytes(content)
        try:
            jaxid.read_mat(path, **NAMES, time="t")
        except InputError as error:
            assert "log.mat" in str(error) or "Record" in str(error)  # noqa: PT017
