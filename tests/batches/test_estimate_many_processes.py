"""Two processes of `jax.distributed` share a batch through its store, with the results of one."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from many_lines import chosen, line_records, model

from jaxid._foundation.checks import InputError
from jaxid.batches import estimate_many
from jaxid.estimation import OutputError

HELPERS = Path(__file__).resolve().parent.parent / "helpers"
CASES, FAILING = 30, (4, 20)
SCRIPT = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
jax.distributed.initialize(sys.argv[1], num_processes=2, process_id=int(sys.argv[2]))
import pytest
from many_lines import chosen, line_records, model
from jaxid.batches import estimate_many
from jaxid.estimation import OutputError
from jaxid._foundation.checks import InputError

assert len(jax.devices()) == 2 and len(jax.local_devices()) == 1
records, part = line_records({cases}, {failing}), (jax.process_index(), jax.process_count())
with pytest.raises(InputError, match="1 of the devices belong to another process"):
    estimate_many(model(), chosen(), records, OutputError(), devices=jax.devices())
counts = []
options = dict(store=sys.argv[3], part=part, progress=lambda state: counts.append(state[:3]))
many = estimate_many(model(), chosen(), records, OutputError(), **options)
own = slice(15 * part[0], 15 * part[0] + 15)
assert (many.status[own] != "unfinished").all()
assert counts[-1] == (15, 1, 15), counts
"""


def free_port() -> int:
    with socket.socket() as connection:
        connection.bind(("127.0.0.1", 0))
        return connection.getsockname()[1]


def test_two_processes_of_jax_distributed_give_the_results_of_one(tmp_path):
    """Each has one device, 15 cases and one failure; they exchange nothing but the store."""
    environment = os.environ | {
        "JAX_PLATFORMS": "cpu",
        "PYTHONPATH": os.pathsep.join([str(HELPERS), *sys.path]),
    }
    script = SCRIPT.format(cases=CASES, failing=FAILING)
    address, store = f"127.0.0.1:{free_port()}", str(tmp_path / "store")
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", script, address, str(number), store],
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )
        for number in range(2)
    ]
    errors = [process.communicate(timeout=300)[1] for process in processes]
    assert [process.returncode for process in processes] == [0, 0], "\n".join(errors)
    both = xr.open_zarr(store, consolidated=False, chunks=None).load()
    for number, one in enumerate(line_records(CASES, FAILING)):
        case = {name: values[number] for name, values in both.items()}
        assert case["status"] == ("refused" if number in FAILING else "successful")
        assert bool(case["reason"] != "")
        if number not in FAILING:  # linear least squares in closed form
            u, z = np.asarray(one.u), np.asarray(one.z)
            gain, length = np.sum(u * z) / np.sum(u**2), np.sqrt(np.sum(u**2))
            R = np.mean((z - gain * u) ** 2)
            np.testing.assert_allclose(case["values"], [gain], rtol=1e-10)
            np.testing.assert_allclose(case["standard_errors"], [np.sqrt(R) / length], rtol=1e-10)
            np.testing.assert_allclose(case["noise"], [[R]], rtol=1e-10)


def test_part_without_store_is_refused():
    with pytest.raises(InputError, match="needs a `store`"):
        estimate_many(model(), chosen(), line_records(2), OutputError(), part=(0, 2))
