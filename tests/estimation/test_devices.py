"""`estimate` on a stack on two devices equals `estimate` on one device."""

import os
import subprocess
import sys

SCRIPT = """
import dataclasses
import jax, jax.numpy as jnp, numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
import jaxid
jaxid.configure(cache=False)

class Lag(jaxid.AbstractModel):
    p: jax.Array
    states, inputs, outputs = ("x",), ("u",), ("x",)
    def rhs(self, t, x, u): return self.p * (u - x)
    def output(self, t, x, u): return x

rng, t = np.random.default_rng(0), 0.05 * np.arange(120)
def fly():
    u = np.sign(np.sin(rng.uniform(0.5, 2.0) * t))[:, None]
    y = jaxid.simulate(Lag(1.3), t, u, jnp.zeros(1)).y
    return jaxid.record(t, u, y + 0.02 * rng.normal(size=y.shape), inputs=("u",), outputs=("x",))

stack = jaxid.stack([fly() for _ in range(4)])
model, likelihood = Lag(1.0), jaxid.OutputError()
chosen = jaxid.free(model, "p", per_record=("initial_state",))
alone = jaxid.estimate(model, chosen, stack, likelihood)
spread = jax.device_put(stack, NamedSharding(Mesh(jax.devices(), ("case",)), PartitionSpec("case")))
assert len(spread.z.sharding.device_set) == 2
both = jaxid.estimate(model, chosen, spread, likelihood)
np.testing.assert_allclose(both.values, alone.values, rtol=1e-9)
np.testing.assert_allclose(both.standard_errors, alone.standard_errors, rtol=1e-9)
np.testing.assert_allclose(both.own, alone.own, rtol=1e-7, atol=1e-9)
under_jit = jax.jit(
    lambda z: jaxid.estimate(model, chosen, dataclasses.replace(spread, z=z), likelihood).values
)
np.testing.assert_allclose(under_jit(spread.z), alone.values, rtol=1e-9)
import os
os.environ["NPROC"] = "7"  # as if the user had a smaller pool
try:
    jaxid.estimate(model, chosen, spread, likelihood)
except jaxid.InputError as error:
    assert "2 CPU devices share 7 threads" in str(error)
    print("two devices agree")
"""


def test_estimate_on_two_devices_equals_estimate_on_one():
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    environment = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "two devices agree" in done.stdout
