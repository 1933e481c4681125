"""SIDPAC's layout: columns, units, constants, thrust, signs; errors with file, column, row."""

import numpy as np
import pytest
from scipy.io import savemat

from jaxid._foundation.checks import InputError
from jaxid.data import read_sidpac

ROWS, STEP = 20, 0.02
FOOT, POUND, SLUG, G0 = 0.3048, 4.4482216152605, 4.4482216152605 / 0.3048, 9.80665
PSF, INCH = POUND / FOOT**2, 0.0254
DEG = np.pi / 180
# by output: column (from 0), and its unit in SI
OUTPUTS = {"V": (1, FOOT), "alpha": (3, DEG), "beta": (2, DEG)}
OUTPUTS |= {name: (4 + k, DEG) for k, name in enumerate(("p", "q", "r", "phi", "pitch", "psi"))}
OUTPUTS |= {name: (10 + k, G0) for k, name in enumerate(("ax", "ay", "az"))}
OUTPUTS |= {
    "qbar": (26, PSF),
    "mach": (27, 1.0),
    "density": (28, SLUG / FOOT**3),
    "altitude": (29, FOOT),
}
OUTPUTS |= {name: (41 + k, DEG) for k, name in enumerate(("pdot", "qdot", "rdot"))}
STEADY = {
    "xcg": (44, 280.0, INCH),
    "zcg": (46, 90.0, INCH),
    "mass": (47, 330.0, SLUG),
    "S": (76, 420.0, FOOT**2),
}
STEADY |= {
    name: (48 + k, 2e4 + k, SLUG * FOOT**2) for k, name in enumerate(("Ix", "Iy", "Iz", "Ixz"))
}
STEADY |= {"b": (77, 65.0, FOOT), "cbar": (78, 6.5, FOOT)}


def fdata(columns=90):
    """Random numbers in every column that is read, and in some other columns."""
    numbers = np.zeros((ROWS, 90))
    rng = np.random.default_rng(0)
    numbers[:, 0] = 5.0 + STEP * np.arange(ROWS)
    for k, _ in OUTPUTS.values():
        numbers[:, k] = rng.normal(size=ROWS)
    numbers[:, 13:17] = rng.normal(size=(ROWS, 4))
    numbers[:, 60:73] = 7.0
    for k, value, _ in STEADY.values():
        numbers[:, k] = value
    return numbers[:, :columns]


def save(folder, numbers, name="run.mat", variable="fdata"):
    path = folder / name
    if path.suffix == ".mat":
        savemat(path, {variable: numbers, "t": numbers[:, :1]})
    else:
        delimiter = "," if path.suffix == ".csv" else "  "
        path.write_text(
            "\n".join(delimiter.join(repr(float(x)) for x in row) for row in numbers),
            encoding="utf-8",
        )
    return path


@pytest.mark.parametrize("name", ["run.mat", "run.csv", "run.txt"])
def test_sidpac_channels_have_documented_column_and_unit(tmp_path, name):
    numbers = fdata()
    r = read_sidpac(save(tmp_path, numbers, name))
    assert set(r.outputs) == set(OUTPUTS)
    assert r.inputs == ("stabilator", "aileron", "rudder")
    for channel, (k, unit) in OUTPUTS.items():
        np.testing.assert_allclose(
            r.channel(channel), numbers[:, k] * unit, rtol=1e-12, err_msg=channel
        )
    np.testing.assert_allclose(r.u, numbers[:, 13:16] * DEG, rtol=1e-12)
    np.testing.assert_allclose(r.t, numbers[:, 0], rtol=1e-12)
    assert set(r.constants) == set(STEADY)  # ycg is zero, which means empty
    for constant, (_, value, unit) in STEADY.items():
        np.testing.assert_allclose(
            r.constants[constant], value * unit, rtol=1e-12, err_msg=constant
        )
    units = dict(zip(r.outputs, r.output_units, strict=True))
    assert (units["q"], units["qdot"], units["az"], units["qbar"]) == (
        "rad/s",
        "rad/s^2",
        "m/s^2",
        "Pa",
    )
    assert r.names == ("run",)


def test_empty_columns_are_left_out_except_surfaces(tmp_path):
    numbers = fdata()
    numbers[:, [2, 14, 26, 41, 42, 43, 47]] = 0.0
    r = read_sidpac(save(tmp_path, numbers), name="x")
    assert not {"beta", "qbar", "pdot", "qdot", "rdot"} & set(r.outputs)
    assert "mass" not in r.constants
    assert r.inputs == ("stabilator", "aileron", "rudder")
    assert not np.asarray(r.u[:, 1]).any()


def test_thrust_is_sum_of_its_columns_and_input_if_it_varies(tmp_path):
    numbers = fdata()
    numbers[:, 37:39] = [300.0, 310.0]
    r = read_sidpac(save(tmp_path, numbers))
    np.testing.assert_allclose(r.constants["thrust"], 610.0 * POUND, rtol=1e-12)
    r = read_sidpac(save(tmp_path, numbers), inputs=("stabilator", "thrust"))
    assert r.inputs == ("stabilator", "thrust")
    assert {"aileron", "rudder"} < set(r.outputs)
    numbers[:, 37] += np.arange(ROWS)
    r = read_sidpac(save(tmp_path, numbers))
    assert r.inputs[-1] == "thrust"
    assert "thrust" not in r.constants
    np.testing.assert_allclose(r.u[:, 3], (610.0 + np.arange(ROWS)) * POUND, rtol=1e-12)


def test_old_version_is_read_with_signs_sample_time_and_gaps(tmp_path):
    numbers = fdata(79)
    numbers[:, 0] = 0.0
    numbers[4, 3] = np.nan
    numbers[:, 47] = np.linspace(331.0, 329.0, ROWS)
    path = save(tmp_path, numbers, variable="old")
    r = read_sidpac(path, variable="old", sample_time=0.04, signs={"aileron": -1, "ay": -1, "q": 1})
    np.testing.assert_allclose(r.u, numbers[:, 13:16] * DEG * [1, -1, 1], rtol=1e-12)
    np.testing.assert_allclose(r.channel("ay"), -numbers[:, 11] * G0, rtol=1e-12)
    np.testing.assert_allclose(r.t, 0.04 * np.arange(ROWS), rtol=1e-12)
    assert np.flatnonzero(np.isnan(r.channel("alpha"))).tolist() == [4]
    np.testing.assert_allclose(r.constants["mass"], 330.0 * SLUG, rtol=1e-12)


def changed(*changes):
    numbers = fdata()
    for row, column, value in changes:
        numbers[row, column] = value
    return numbers


REFUSALS = {
    "columns": (np.ones((30, 12)), {}, ["run.mat has 12 columns", "90", "read_columns"]),
    "too many": (np.ones((30, 91)), {}, ["run.mat has 91 columns"]),
    "wrong way": (fdata().T, {}, ["run.mat has 20 columns", "transposed"]),
    "old text": (fdata(79), {"name": "run.csv"}, ["run.csv has 79 columns"]),
    "input": (
        changed((3, 13, np.nan)),
        {},
        ["run.mat, row 3 (from 0), column 14 ('stabilator'): nan"],
    ),
    "thrust": (
        changed((3, 37, np.nan)),
        {},
        ["row 3 (from 0), column 38 and 39 and 40 and 41 ('thrust')"],
    ),
    "constant": (changed((3, 47, np.nan)), {}, ["row 3 (from 0), column 48 ('mass'): nan"]),
    "line": (
        changed((3, 15, np.nan)),
        {"name": "run.csv"},
        ["run.csv, line 4, column 16 ('rudder')"],
    ),
    "time": (changed((3, 0, np.inf)), {}, ["row 3 (from 0), column 1 ('t'): inf"]),
    "clock": (changed((3, 0, 5.0)), {}, ["row 3 (from 0): time does not increase, 5 after 5.04"]),
    "drop-out": (
        changed((slice(9, 20), 0, 6.0 + STEP * np.arange(11))),
        {},
        ["row 9 (from 0), column 1", "even samples"],
    ),
    "no time": (
        changed((slice(None), 0, 0.0)),
        {},
        ["column 1 (time) is not filled in", "sample_time"],
    ),
    "mass": (changed((3, 47, 340.0)), {}, ["column 48 ('mass') goes from 330 to 340 slug"]),
    "variable": (
        fdata(),
        {"variable": "fdat"},
        ["variable in run.mat 'fdat'", "Did you mean 'fdata'", "variable='fdata'"],
    ),
    "no numbers": (np.array([["a", "b"]], object), {}, ["'fdata' is not a matrix of real numbers"]),
    "sign": (fdata(), {"signs": {"aileron": 0}}, ["sign of 'aileron' is 0"]),
    "sign of nothing": (fdata(), {"signs": {"elevator": -1}}, ["in `signs`", "'elevator'"]),
    "input of nothing": (fdata(), {"inputs": ("elevator",)}, ["in `inputs`", "'elevator'"]),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_invalid_sidpac_files_are_refused_with_place(case, tmp_path):
    numbers, options, words = REFUSALS[case]
    options = dict(options)
    path = save(tmp_path, numbers, options.pop("name", "run.mat"))
    with pytest.raises(InputError) as caught:
        read_sidpac(path, **options)
    for word in words:
        assert word in str(caught.value), f"{word!r} is not in: {caught.value}"


def test_sidpac_array_without_outputs_is_refused(tmp_path):
    numbers = np.zeros((ROWS, 90))
    numbers[:, 0] = STEP * np.arange(ROWS)
    with pytest.raises(InputError, match="no output"):
        read_sidpac(save(tmp_path, numbers))


def test_outputs_are_chosen_by_name(tmp_path):
    path = save(tmp_path, fdata())
    whole, part = read_sidpac(path), read_sidpac(path, outputs=("q", "alpha", "az"))
    assert part.outputs == ("q", "alpha", "az")
    assert part.inputs == whole.inputs
    assert set(part.constants) == set(whole.constants)
    for name in part.outputs:
        np.testing.assert_array_equal(part.channel(name), whole.channel(name))
    numbers = fdata()
    numbers[:, 4] = 0.0  # p
    empty = save(tmp_path, numbers, name="empty.mat")
    with pytest.raises(InputError, match=r"output in empty\.mat that is filled in 'p'"):
        read_sidpac(empty, outputs=("p", "q"))
    with pytest.raises(InputError, match=r"\(in `outputs`\) 'alfa'"):
        read_sidpac(path, outputs=("alfa",))
