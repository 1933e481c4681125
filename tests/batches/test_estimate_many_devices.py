"""Cases of several records, distributed over four devices, equal estimates on one device."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import xarray as xr
from many_lags import chosen, lag_pairs, model

from jaxid.data import stack
from jaxid.estimation import OutputError, estimate

HELPERS = Path(__file__).resolve().parent.parent / "helpers"
PAIRS = 24
SCRIPT = """
import os
import sys
import jax
import jaxid
jaxid.configure(cache=False)
import numpy as np
from jax.sharding import Mesh
from many_lags import chosen, lag_pairs, model
from jaxid.batches import estimate_many
from jaxid.estimation import OutputError

assert len(jax.devices()) == 4
mesh = Mesh(np.array(jax.devices()), ("device",))
for name, devices in (("list", jax.devices()), ("mesh", mesh)):
    many = estimate_many(model(), chosen(), lag_pairs({pairs}), OutputError(), devices=devices)
    many.to_zarr(sys.argv[1] + "/" + name, zarr_format=2, consolidated=False)
os.environ["NPROC"] = "15"  # as if the user had a smaller pool
try:
    estimate_many(model(), chosen(), lag_pairs({pairs}), OutputError(), devices=mesh)
except jaxid.InputError as error:
    assert "4 CPU devices share 15 threads" in str(error)
else:
    raise AssertionError("a pool of 15 threads is not refused")
"""


def test_four_host_devices_give_the_results_of_one(tmp_path):
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=4"
    environment = os.environ | {
        "XLA_FLAGS": flags,
        "JAX_PLATFORMS": "cpu",
        "PYTHONPATH": os.pathsep.join([str(HELPERS), *sys.path]),
    }
    command = [sys.executable, "-c", SCRIPT.format(pairs=PAIRS), str(tmp_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    alone = [
        estimate(model(), chosen(), stack(pair, 60), OutputError()) for pair in lag_pairs(PAIRS)
    ]
    for name in ("list", "mesh"):
        many = xr.open_zarr(tmp_path / name, consolidated=False, chunks=None).load()
        assert many.own.shape == (PAIRS, 2, 1)
        assert str(many.name[1].values) == "lag 2, lag 3"
        assert (many.status == "successful").all()
        for i, one in enumerate(alone):
            case = {name: values[i] for name, values in many.items()}
            for name in ("values", "standard_errors", "covariance", "own_errors", "cost", "noise"):
                np.testing.assert_allclose(case[name], getattr(one, name), rtol=1e-10)
            assert (np.abs(case["own"] - one.own) < 1e-10 * np.asarray(one.own_errors)).all()
            assert case["iterations"] == one.iterations
