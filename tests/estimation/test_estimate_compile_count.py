"""A first estimate compiles its fit and little more, and its print compiles nothing.

Programs are counted in a new process by the events that JAX records at each compilation. Before
the numbers around the fit were computed by NumPy, the counts of this problem were: record 3,
selection of parameters 2, estimate 42, print 31.
"""

import json
import subprocess
import sys

MOST_OF_ESTIMATE = 4  # the fit and the flat vectors of the model, with two to spare (chosen)

PROGRAM = """
import json
import jax
import jax.numpy as jnp
import numpy as np
import jaxid

jaxid.configure()
compiled = []

def listen(event, duration, *, fun_name="", **_):
    if event == "/jax/core/compile/backend_compile_duration":
        compiled.append(fun_name)

class Spring(jaxid.AbstractModel):
    k: jax.Array
    c: jax.Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return x[:1]

def first_estimate():
    rng, t = np.random.default_rng(0), 0.05 * np.arange(100)
    x = np.exp(-0.1 * t) * np.cos(t) + 0.01 * rng.normal(size=100)
    jax.monitoring.register_event_duration_secs_listener(listen)
    record = jaxid.record(t, np.sin(t), x, inputs=("force",), outputs=("x",))
    yield "record"
    spring = Spring(1.2, 0.1)
    free = jaxid.free(spring, "k", "c", per_record=("initial_state",), bounds={"c": (0.0, None)})
    yield "free"
    fit = jaxid.estimate(spring, free, record, jaxid.OutputError())
    yield "estimate"
    str(fit), fit.interval(), fit.correlation, fit.value("k"), fit.successful
    yield "print"
    records = (record, record.window(0, 60), record.window(10, 80))
    list(jaxid.stack(records)), record.channel("x")
    yield "records"

programs = {}
for step in first_estimate():
    programs[step] = list(compiled)
    compiled.clear()
print(json.dumps(programs))
"""


def test_first_estimate_compiles_its_fit_and_little_more(user_environment):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM],
        env=user_environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    programs = json.loads(done.stdout)
    estimate = programs.pop("estimate")
    assert "jit(fit_problem)" in estimate
    assert len(estimate) <= MOST_OF_ESTIMATE, estimate
    assert programs == {"record": [], "free": [], "print": [], "records": []}
