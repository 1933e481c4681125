"""Loaders of measured data sets: official splits, verified files, errors for missing files."""

import hashlib
import shutil

import numpy as np
import pytest
from scipy.io import loadmat

from jaxid._foundation.checks import InputError
from jaxid.data import cascaded_tanks, emps, emps_closed_loop, silverbox

FILES = {
    silverbox: ("silverbox", "SNLS80mV.mat"),
    emps: ("emps", "DATA_EMPS.mat"),
    cascaded_tanks: ("cascaded_tanks", "dataBenchmark.csv"),
}


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


@pytest.mark.parametrize("load", FILES, ids=lambda load: load.__name__)
def test_missing_and_wrong_files_are_refused(load, tmp_path, monkeypatch):
    folder, file = FILES[load]
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
