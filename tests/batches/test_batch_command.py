"""`python -m jaxid batch`: one estimate per record, continued, and refused."""

import contextlib
import importlib
import io
import json

import numpy as np
import pytest
import xarray as xr
from many_lags import lag_records

from jaxid._foundation.checks import InputError

# The command as a function; typer converts its arguments.
COMMAND = importlib.import_module("jaxid.__main__").batch

CASES = 7
STUDY = """
title = "Lags"

[model]
use = "many_lags:Hardening"
parameters = {{ p = 1.0, b = 0.7, cubic = 0.05 }}

[free]
parameters = ["p", "b"]
bounds = {{ p = [0.1, 10.0] }}

[records]
inputs = ["u"]
outputs = ["x"]
train = {files}
"""


def write_study(folder, name="study.toml", count=CASES):
    """Write records, the last of which diverges, and a study file."""
    files = []
    for i, one in enumerate(lag_records(count, seed=21)):
        u = 1e6 * np.ones(len(one.t)) if i == CASES - 1 else np.asarray(one.u[:, 0])
        columns = np.column_stack([one.t, u, one.z[:, 0]])
        files.append(f"lag{i}.csv")
        header = "t,u,x"
        np.savetxt(folder / files[-1], columns, delimiter=",", header=header, comments="")
    (folder / name).write_text(STUDY.format(files=json.dumps(files)))
    return folder / name


def printed(study, **options):
    """Return the standard output of the command."""
    with contextlib.redirect_stdout(io.StringIO()) as output:
        COMMAND(study, **options)
    return output.getvalue()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("lags")


@pytest.fixture(scope="module")
def study(folder):
    return write_study(folder)


@pytest.fixture(scope="module")
def alone(study, folder):
    """Table of the command in one process, and its store."""
    table = printed(study, store=folder / "alone.zarr")
    return table, xr.open_zarr(folder / "alone.zarr", consolidated=False, chunks=None).load()


def test_table_has_means_and_failures(alone):
    table, results = alone
    good = results.status.values == "successful"
    assert good.sum() == CASES - 1
    row = next(line for line in table.splitlines() if line.startswith("p "))
    values = results["values"].values[good, 0]
    mean, deviation, error, lowest, highest = map(float, row.split()[1:6])
    expected = (values.mean(), values.std(ddof=1), values.min(), values.max())
    np.testing.assert_allclose((mean, deviation, lowest, highest), expected, rtol=1e-4)
    errors = results.standard_errors.values[good, 0]
    np.testing.assert_allclose(error, np.sqrt(np.mean(errors**2)), rtol=1e-4)
    assert f"{CASES} cases: {CASES - 1} successful, 1 start_diverges" in table
    assert f"lag{CASES - 1}: " in table
    assert "diverges at the starting values" in table


def test_second_call_reads_the_store(study, folder, alone):
    assert printed(study, store=folder / "alone.zarr") == alone[0]


def test_store_of_another_study_is_refused(folder, alone):
    fewer = write_study(folder, "fewer.toml", count=3)
    with pytest.raises(InputError, match="belongs to another batch"):
        printed(fewer, store=folder / "alone.zarr")
