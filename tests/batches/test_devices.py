"""Cases distributed over devices give the results of one device."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import xarray as xr
from many_lags import chosen, lag_records, model

from jaxid.batches import estimate_many
from jaxid.estimation import OutputError

HELPERS = Path(__file__).resolve().parent.parent / "helpers"
CASES, SILENT = 90, (4, 50)
SCRIPT = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
from jax.sharding import Mesh
from many_lags import chosen, lag_records, model
from jaxid.batches import estimate_many
from jaxid.estimation import OutputError

assert len(jax.devices()) == 2
records = lag_records({cases}, seed=11, silent={silent})
mesh = Mesh(np.array(jax.devices()), ("device",))
for name, devices in (("list", jax.devices()), ("mesh", mesh)):
    many = estimate_many(model(), chosen(), records, OutputError(), devices=devices)
    many.to_zarr(sys.argv[1] + "/" + name, zarr_format=2, consolidated=False)
"""


def test_two_host_devices_give_the_results_of_one(tmp_path):
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    environment = os.environ | {
        "XLA_FLAGS": flags,
        "JAX_PLATFORMS": "cpu",
        "PYTHONPATH": os.pathsep.join([str(HELPERS), *sys.path]),
    }
    script = SCRIPT.format(cases=CASES, silent=SILENT)
    command = [sys.executable, "-c", script, str(tmp_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    records = lag_records(CASES, seed=11, silent=SILENT)
    one = estimate_many(model(), chosen(), records, OutputError())
    assert list(np.flatnonzero(one.status != "successful")) == list(SILENT)
    for name in ("list", "mesh"):
        many = xr.open_zarr(tmp_path / name, consolidated=False, chunks=None)
        for variable in ("values", "standard_errors", "covariance", "own_errors", "cost", "noise"):
            np.testing.assert_allclose(many[variable], one[variable], rtol=1e-10)
        assert (np.abs(many.own - one.own) < 1e-10 * one.own_errors).all()
        for variable in ("status", "reason", "iterations"):
            np.testing.assert_array_equal(many[variable].values, one[variable].values)
