"""Loaders of measured data sets: official splits, verified files, errors for missing files."""

import hashlib
import io
import shutil
import sys
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from jaxid._foundation.checks import InputError
from jaxid.data import (
    cascaded_tanks,
    emps,
    emps_closed_loop,
    f16_vibration,
    from_benchmarks,
    silverbox,
    wiener_hammerstein,
)

FILES = {
    silverbox: ("silverbox", "SNLS80mV.mat"),
    emps: ("emps", "DATA_EMPS.mat"),
    cascaded_tanks: ("cascaded_tanks", "dataBenchmark.csv"),
}
ARCHIVE = ("f16_vibration", "F16GVT_Files.zip")


def sizes(ds):
    return [r.t.shape[0] for r in ds.train], {name: r.t.shape[0] for name, r in ds.test.items()}


def test_silverbox_has_official_split_without_mean(data_folder):
    ds = silverbox(data_folder)
    assert sizes(ds) == ([65062], {"arrow": 40475, "multisine": 21688})
    assert ds.window == {"arrow": 50, "multisine": 50}
    raw = loadmat(data_folder / "silverbox" / "SNLS80mV.mat")["V2"].ravel()
    y = raw - raw.mean()
    np.testing.assert_allclose(ds.test["arrow"].z[:, 0], y[100:40575], rtol=1e-12)
    np.testing.assert_allclose(ds.train[0].z[:, 0], y[40650:105712], rtol=1e-12)
    np.testing.assert_allclose(ds.test["multisine"].z[:, 0], y[105712:127400], rtol=1e-12)
    np.testing.assert_allclose(1 / np.diff(ds.train[0].t), 610.3515625, rtol=1e-8)
    assert (ds.train[0].inputs, ds.train[0].outputs) == (("u",), ("y",))
    assert ds.train[0].input_units == ds.train[0].output_units == ("V",)


def test_emps_has_force_as_input_and_position_as_output(data_folder):
    ds = emps(data_folder)
    assert sizes(ds) == ([24841], {"pulses": 24841})
    assert ds.window == {"pulses": None}
    raw = loadmat(data_folder / "emps" / "DATA_EMPS_PULSES.mat")
    test = ds.test["pulses"]
    np.testing.assert_allclose(test.u[:, 0], 35.15065188248547 * raw["vir"].ravel(), rtol=1e-15)
    np.testing.assert_array_equal(test.z[:, 0], raw["qm"].ravel())
    np.testing.assert_array_equal(test.t, raw["t"].ravel())
    assert test.input_units + test.output_units == ("N", "m")


def test_emps_in_closed_loop_has_reference_and_pulses_as_inputs(data_folder):
    ds = emps_closed_loop(data_folder / "emps" / "DATA_EMPS.mat")
    assert sizes(ds) == ([24841], {"pulses": 24841})
    assert ds.window == {"pulses": 50}
    raw = loadmat(data_folder / "emps" / "DATA_EMPS_PULSES.mat")
    train, test = ds.train[0], ds.test["pulses"]
    assert (test.inputs, test.input_units, test.outputs) == (
        ("reference", "pulse"),
        ("m", "V"),
        ("position",),
    )
    np.testing.assert_array_equal(
        test.u, np.stack([raw["qg"].ravel(), raw["pulses_N"].ravel()], axis=1)
    )
    np.testing.assert_array_equal(test.z[:, 0], raw["qm"].ravel())
    np.testing.assert_array_equal(train.u[:, 1], 0.0)


def test_emps_pulses_are_part_of_the_command(data_folder):
    """The command jumps by 5 V at each edge, so that `pulses_N` is not a separate input."""
    raw = loadmat(data_folder / "emps" / "DATA_EMPS_PULSES.mat")
    pulse, command = raw["pulses_N"].ravel().astype(float), raw["vir"].ravel()
    edges = np.flatnonzero(np.diff(pulse))
    edges = edges[edges < len(command) - 4]
    jumps = np.array([command[k + 2] - command[k] for k in edges])
    rising = np.sign(pulse[edges + 1] - pulse[edges])
    assert len(edges) > 40
    np.testing.assert_allclose(np.median(jumps * rising), 5.0, atol=0.3)


def test_cascaded_tanks_have_official_split(data_folder):
    ds = cascaded_tanks(data_folder)
    assert sizes(ds) == ([1024], {"validation": 1024})
    assert ds.window == {"validation": 5}
    train, test = ds.train[0], ds.test["validation"]
    np.testing.assert_array_equal(
        [train.u[0, 0], test.u[0, 0], train.z[0, 0], test.z[0, 0]], [3.2567, 0.97619, 5.205, 4.9728]
    )
    np.testing.assert_array_equal(np.diff(train.t), 4.0)
    assert (train.inputs, train.outputs, train.input_units) == (("pump",), ("level",), ("V",))


@pytest.mark.parametrize("load", FILES, ids=lambda load: load.__name__)
def test_file_folder_and_environment_give_same_set(load, data_folder, monkeypatch):
    folder, file = FILES[load]
    monkeypatch.setenv("JAXID_DATA", str(data_folder))
    expected = load()
    monkeypatch.delenv("JAXID_DATA")
    for path in (data_folder / folder, data_folder / folder / file, str(data_folder)):
        np.testing.assert_array_equal(load(path).train[0].z, expected.train[0].z)


@pytest.mark.parametrize("load", [*FILES, f16_vibration], ids=lambda load: load.__name__)
def test_missing_and_wrong_files_are_refused(load, tmp_path, monkeypatch):
    folder, file = FILES.get(load, ARCHIVE)
    monkeypatch.delenv("JAXID_DATA", raising=False)
    with pytest.raises(InputError, match=rf"{file}.*JAXID_DATA.*nonlinearbenchmark\.org.*20\d\d"):
        load()
    with pytest.raises(InputError, match=rf"no {file}.*nonlinearbenchmark\.org"):
        load(tmp_path)
    (tmp_path / folder).mkdir()
    (tmp_path / folder / file).write_bytes(b"not the data")
    actual = hashlib.sha256(b"not the data").hexdigest()
    with pytest.raises(
        InputError,
        match=rf"{file}.*SHA-256 is {actual}, expected "
        rf"[0-9a-f]{{64}}.*Download it again",
    ):
        load(tmp_path)


def test_file_with_changed_byte_is_refused(data_folder, tmp_path):
    copy = tmp_path / "dataBenchmark.csv"
    shutil.copyfile(data_folder / "cascaded_tanks" / "dataBenchmark.csv", copy)
    assert cascaded_tanks(copy).name == "cascaded_tanks"
    text = copy.read_bytes()
    copy.write_bytes(text.replace(b"3.2567", b"3.2568", 1))
    with pytest.raises(InputError, match=r"SHA-256"):
        cascaded_tanks(copy)


def module_of(load):
    """The file of a loader, which has the same name."""
    return sys.modules[load.__module__]


def file_of(variables):
    """The bytes of a MATLAB file."""
    file = io.BytesIO()
    savemat(file, variables)
    return file.getvalue()


@pytest.fixture
def circuit(tmp_path, monkeypatch):
    """A file in the layout of the Wiener-Hammerstein set, whose values are the numbers of rows."""
    rows = np.arange(188_000.0)[:, None]
    content = file_of({"uBenchMark": rows, "yBenchMark": -rows, "fs": 51_200.0})
    (tmp_path / "WienerHammerBenchMark.mat").write_bytes(content)
    monkeypatch.setattr(module_of(wiener_hammerstein), "WH_BYTES", len(content))
    return tmp_path


def test_wiener_hammerstein_has_official_split(circuit):
    ds = wiener_hammerstein(circuit)
    assert sizes(ds) == ([100_000], {"test": 78_800})
    assert ds.window == {"test": 50}
    train, test = ds.train[0], ds.test["test"]
    assert (float(train.u[0, 0]), float(train.z[-1, 0])) == (5200.0, -105_199.0)
    assert (float(test.u[0, 0]), float(test.z[-1, 0])) == (105_200.0, -183_999.0)
    np.testing.assert_allclose(
        np.asarray(test.t)[[0, 1, -1]], np.array([0, 1, 78_799]) / 51_200, rtol=1e-12
    )
    assert train.input_units + train.output_units == ("V", "V")


def test_wiener_hammerstein_of_another_size_or_length_is_refused(circuit, monkeypatch):
    file = circuit / "WienerHammerBenchMark.mat"
    content = file.read_bytes()
    file.write_bytes(content + b"0")
    with pytest.raises(InputError, match=rf"size in bytes is {len(content) + 1}, expected"):
        wiener_hammerstein(circuit)
    short = file_of({"uBenchMark": np.ones(9), "yBenchMark": np.ones(9), "fs": 1.0})
    file.write_bytes(short)
    monkeypatch.setattr(module_of(wiener_hammerstein), "WH_BYTES", len(short))
    with pytest.raises(InputError, match=r"has 9 and 9 rows, and its split needs 184000"):
        wiener_hammerstein(circuit)


@pytest.fixture
def archive(tmp_path, monkeypatch):
    """A function that makes an archive in the layout of the F-16's, with the given files."""

    def make(**files):
        path = tmp_path / "F16GVT_Files.zip"
        with zipfile.ZipFile(path, "w") as writer:
            for name, variables in files.items():
                member = f"F16GVT_Files/BenchmarkData/{name}.mat"
                writer.writestr(member, file_of(variables))
                writer.writestr(member.replace(".mat", ".csv"), "Force\n1")
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        monkeypatch.setattr(module_of(f16_vibration), "F16_SHA256", digest)
        return path

    return make


def shaken(level, rows):
    force = level * np.arange(rows, dtype=float)
    accelerations = np.stack([force, 2 * force, 3 * force])
    return {"Force": force, "Voltage": force, "Acceleration": accelerations, "Fs": 400.0}


def test_f16_has_levels_to_fit_and_levels_to_score(archive):
    path = archive(
        F16Data_FullMSine_Level1=shaken(1, 30),
        F16Data_FullMSine_Level2_Validation=shaken(2, 20),
        F16Data_SineSw_Level3=shaken(3, 10),
        F16Data_SpecialOddMSine_Level1={"Force": np.ones((10, 5))},
    )
    ds = f16_vibration(path)
    assert [one.names[0] for one in ds.train] == [
        "F16Data_FullMSine_Level1",
        "F16Data_SineSw_Level3",
    ]
    name = "F16Data_FullMSine_Level2_Validation"
    assert sizes(ds) == ([30, 10], {name: 20})
    assert ds.window == {name: 400}
    test = ds.test[name]
    np.testing.assert_array_equal(test.z, test.u * np.array([[1.0, 2.0, 3.0]]))
    np.testing.assert_array_equal(test.u[:, 0], 2.0 * np.arange(20))
    np.testing.assert_allclose(test.t, np.arange(20) / 400, rtol=1e-12)
    assert (test.inputs, test.outputs) == (("force",), ("excitation", "wing", "payload"))
    assert test.input_units + test.output_units == ("N", *["m/s^2"] * 3)


def test_f16_archive_without_records_or_variables_is_refused(archive):
    with pytest.raises(InputError, match="has no record in F16GVT_Files/BenchmarkData/"):
        f16_vibration(archive())
    with pytest.raises(InputError, match=r"no variable in F16Data_Level1 'Acceleration'"):
        f16_vibration(archive(F16Data_Level1={"Force": np.ones(9), "Fs": 1.0}))


def benchmark(name, rows, window=None, step=0.5):
    """A record in the form of the package nonlinear_benchmarks."""
    signal = np.arange(float(rows))
    parts = {"u": signal, "y": np.stack([signal, -signal], axis=1), "name": name}
    return SimpleNamespace(**parts, sampling_time=step, state_initialization_window_length=window)


def test_sets_of_the_package_keep_their_split_and_windows():
    ds = from_benchmarks(
        benchmark("", 9),
        (benchmark("first", 7, 5), benchmark("second", 6, 3)),
        inputs=("u",),
        outputs=("a", "b"),
        units={"u": "V", "a": "mm"},
    )
    assert sizes(ds) == ([9], {"first": 7, "second": 6})
    assert ds.window == {"first": 5, "second": 3}
    assert ds.train[0].names == ("train 0",)
    test = ds.test["second"]
    np.testing.assert_allclose(test.z, np.arange(6.0)[:, None] * np.array([[1e-3, -1.0]]))
    np.testing.assert_array_equal(test.t, 0.5 * np.arange(6))
    assert (test.input_units, test.output_units) == (("V",), ("m", ""))


def test_set_of_the_package_without_a_sample_time_or_with_equal_names_is_refused():
    channels = {"inputs": ("u",), "outputs": ("a", "b")}
    with pytest.raises(InputError, match=r"train 0 has no sample time"):
        from_benchmarks(benchmark("", 9, step=None), benchmark("t", 9), **channels)
    twice = [benchmark("t", 9), benchmark("t", 9)]
    with pytest.raises(InputError, match=r"Two test records have the same name \(t, t\)"):
        from_benchmarks(benchmark("", 9), twice, **channels)
