"""Cases distributed over devices give the results of one device."""

import os
import subprocess
import sys
from pathlib import Path

HELPERS = Path(__file__).resolve().parent.parent / "helpers"
SCRIPT = """
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
from jax.sharding import Mesh
from many_lags import chosen, lag_records, model
from jaxid.batches import estimate_many
from jaxid.estimation import OutputError

assert len(jax.devices()) == 2
records = lag_records(90, seed=11, silent=(4, 50))
one = estimate_many(model(), chosen(), records, OutputError())
assert (one.status != "successful").sum() == 2
for devices in (jax.devices(), Mesh(np.array(jax.devices()), ("case",))):
    many = estimate_many(model(), chosen(), records, OutputError(), devices=devices)
    for name in ("values", "standard_errors", "own_errors", "covariance", "cost", "noise"):
        np.testing.assert_allclose(many[name], one[name], rtol=1e-10)
    assert (np.abs(many.own - one.own) < 1e-10 * one.own_errors).all()
    for name in ("status", "reason", "iterations"):
        np.testing.assert_array_equal(many[name], one[name])
print("two devices agree")
"""


def test_two_host_devices_give_the_results_of_one():
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    environment = os.environ | {
        "XLA_FLAGS": flags,
        "JAX_PLATFORMS": "cpu",
        "PYTHONPATH": os.pathsep.join([str(HELPERS), *sys.path]),
    }
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "two devices agree" in done.stdout
