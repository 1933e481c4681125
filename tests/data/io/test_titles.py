"""Units in titles of columns are read, or refused with the remedy; never taken as SI in silence."""

import numpy as np
import pandas as pd
import pytest

import jaxid
from jaxid.data import read_hdf5, read_parquet
from jaxid.data.titles import parse_title

NAMES = {"inputs": ("u",), "outputs": ("x",)}


def read(folder, title, *, units=None, columns=None):
    """Read a file whose output, 3 in its second row, has this title."""
    (folder / "log.csv").write_text(f"t,u,{title}\n0,1,2\n1,1,3\n")
    columns = {"x": title} if columns is None else columns
    record = jaxid.read_csv(folder / "log.csv", **NAMES, columns=columns, units=units)
    return float(record.z[1, 0]), record.output_units[0]


@pytest.mark.parametrize(
    ("title", "number", "unit"),
    [
        ("alpha [deg]", np.radians(3.0), "rad"),
        ("alpha (deg)", np.radians(3.0), "rad"),
        ("AOA (°)", np.radians(3.0), "rad"),
        ("q (deg/s)", np.radians(3.0), "rad/s"),
        ("HP (ft)", 3 * 0.3048, "m"),
        ("TAS(kt)", 3 * 1852 / 3600, "m/s"),
        ("F (N)", 3.0, "N"),
        ("xyz[1]", 3.0, ""),
        ("speed (2)", 3.0, ""),
        ("AOA (left)", 3.0, ""),
        ("Cm", 3.0, ""),
        ("d_Cm", 3.0, ""),
        ("force_in", 3.0, ""),
        ("force_min", 3.0, ""),
        ("at_us", 3.0, ""),
        ("mass_g", 3.0, ""),
        ("I_MA", 3.0, ""),
        ("ratio [-]", 3.0, ""),
    ],
)
def test_unit_in_a_title_is_read(tmp_path, title, number, unit):
    assert read(tmp_path, title) == (
        pytest.approx(number, rel=1e-14),
        unit,
    )


@pytest.mark.parametrize(
    ("title", "unclear"),
    [
        ("alpha_deg", "deg"),
        ("ALPHA_DEG", "deg"),
        ("q_deg_s", "deg/s"),
        ("Q_DPS", "deg/s"),
        ("HP_FT", "ft"),
        ("TAS_KT", "kt"),
        ("pos mm", "mm"),
        ("t_us", "us"),
        ("TIME_US", "us"),
        ("log.time_min", "min"),
        ("nz_g", "g0"),
        ("AX_G", "g0"),
        ("imu_acc_g", "g0"),
        ("current_mA", "mA"),
        ("p kPa", "kPa"),
        ("speed (R)", "R"),
        ("force (min)", "min"),
    ],
)
def test_title_that_seems_to_hold_a_unit_is_refused_until_units_decides(tmp_path, title, unclear):
    with pytest.raises(jaxid.InputError, match=r"seems to hold the unit") as error:
        read(tmp_path, title)
    assert f"units={{{title!r}: {unclear!r}}}" in str(error.value)
    assert read(tmp_path, title, units={title: ""}) == (3.0, "")
    assert read(tmp_path, title, units={"x": ""}) == (3.0, "")
    assert read(tmp_path, title, units={title: "mm"}) == (0.003, "m")


@pytest.mark.parametrize(
    ("title", "words"), [("x [raw]", "'raw' is not known"), ("nz (g)", "'g0'")]
)
def test_unit_in_brackets_that_is_not_clear_is_refused(tmp_path, title, words):
    with pytest.raises(jaxid.InputError, match=words):
        read(tmp_path, title)


def test_name_without_its_unit_names_the_column(tmp_path):
    assert read(tmp_path, "x (mm)", columns={}) == (0.003, "m")
    assert read(tmp_path, "x [mm]", columns={}) == (0.003, "m")


@pytest.mark.parametrize("time", ["Time", "Time (ms)"])
def test_unit_of_time_is_read_from_its_title(tmp_path, time):
    path = tmp_path / "log.csv"
    path.write_text("Time (ms),u,x\n0,1,2\n100,1,3\n")
    record = jaxid.read_csv(path, **NAMES, time=time)
    np.testing.assert_allclose(record.t, [0, 0.1], rtol=1e-15)


def test_unit_of_time_by_the_name_t_decides_a_doubtful_title(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("TIME_MS,u,x\n0,1,2\n100,1,3\n")
    with pytest.raises(jaxid.InputError, match="TIME_MS"):
        jaxid.read_csv(path, **NAMES, time="TIME_MS")
    record = jaxid.read_csv(path, **NAMES, time="TIME_MS", units={"t": "ms"})
    np.testing.assert_allclose(record.t, [0, 0.1], rtol=1e-15)


def test_row_and_file_of_units_come_before_the_title(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,u,x_mm\ns,,cm\n0,1,2\n1,1,3\n")
    record = jaxid.read_csv(path, inputs=("u",), outputs=("x_mm",), units_row=True)
    assert record.z[1, 0] == 0.03
    (tmp_path / "log.units.json").write_text('{"x_mm": "m"}')
    record = jaxid.read_csv(path, inputs=("u",), outputs=("x_mm",), units_row=True)
    assert record.z[1, 0] == 3.0


def frame(title):
    return pd.DataFrame({"Time (ms)": [0.0, 100.0], "u": [1.0, 1.0], title: [2.0, 3.0]})


def of_frame(path, title, **options):
    return jaxid.record(frame(title), **options)


def of_parquet(path, title, **options):
    frame(title).to_parquet(path)
    return read_parquet(path, **options)


def of_hdf5(path, title, **options):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, column in frame(title).items():
            file[str(name)] = column
    return read_hdf5(path, **options)


@pytest.mark.parametrize("of", [of_frame, of_parquet, of_hdf5])
def test_other_tables_have_the_same_rule(of, tmp_path):
    def made(title, **options):
        names = {"inputs": ("u",), "outputs": (title,), "time": "Time (ms)"}
        return of(tmp_path / "log", title, **names, **options)

    record = made("x [mm]")
    np.testing.assert_allclose(record.t, [0, 0.1], rtol=1e-15)
    assert record.z[1, 0] == 0.003
    with pytest.raises(jaxid.InputError, match=r"'x_mm' seems to hold the unit 'mm'"):
        made("x_mm")
    assert made("x_mm", units={"x_mm": ""}).z[1, 0] == 3.0


def test_arrays_have_the_names_that_the_user_gives():
    """Numbers in a script are no log: a model in degrees may call its channel so."""
    record = jaxid.record([0.0, 1.0], None, [2.0, 3.0], inputs=(), outputs=("x_deg",))
    assert record.z[1, 0] == 3.0


def test_all_titles_have_a_name():
    for title in ("[deg]", "(deg)", "_deg", "", "a (", "a ]"):
        name, unit, unclear = parse_title(title)
        assert isinstance(name, str)
        assert not (unit and unclear)
