"""Arguments of a wrong type: each message names the argument, and the remedy.

The tests execute annotations, which refuse these arguments first; a user has no such checks. So the
mistakes are made in another process.
"""

import json
import subprocess
import sys

import pytest

PROGRAM = """
import json
import jax.numpy as jnp
import numpy as np
import jaxid
import jaxid.aircraft
import jaxid.uncertainty
from jaxid.batches import estimate_many as many, update

jaxid.configure(cache=False)


class Spring(jaxid.AbstractModel):
    k: float
    c: float
    states, inputs, outputs = ("x", "v"), ("force",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])


t = 0.1 * np.arange(30)
record = jaxid.record(t, np.sin(t), np.cos(t), inputs=("force",), outputs=("x",))
spring, white = Spring(1.0, 0.1), jaxid.OutputError()
free = jaxid.free(spring, "k", "c")
fit = jaxid.estimate(spring, free, record, white)
MISTAKES = {
    "channel": lambda: record["x"],
    "window": lambda: record.window(0.0, 2.0),
    "file": lambda: jaxid.estimate(spring, free, "run.csv", white),
    "files": lambda: jaxid.close_loop(spring, free, white, train=["run.csv"]),
    "model class": lambda: jaxid.free(Spring, "k"),
    "predicted class": lambda: jaxid.predict(Spring, record, white),
    "likelihood class": lambda: jaxid.estimate(spring, free, record, jaxid.OutputError),
    "many, likelihood class": lambda: many(spring, free, [record], jaxid.OutputError),
    "many, model class": lambda: many(Spring, free, [record], white),
    "many, free": lambda: many(spring, ("k", "c"), [record], white),
    "updated, likelihood class": lambda: update(fit, record, jaxid.OutputError),
    "solver class": lambda: jaxid.estimate(spring, free, record, white, solver=jaxid.GaussNewton),
    "steps": lambda: jaxid.GaussNewton(max_steps=0),
    "process": lambda: jaxid.FilterError(0.01),
    "hold": lambda: jaxid.OutputError(hold="zoh"),
    "stepper": lambda: jaxid.OutputError(stepper=4),
    "effect": lambda: jaxid.close_loop(spring, free, white, train=record, effects=("Friction",)),
    "save": lambda: jaxid.save("x.json", record),
    "load": lambda: jaxid.load("x.json", like=Spring),
    "key": lambda: jaxid.uncertainty.posterior(None, record, white, key=0),
    "free": lambda: jaxid.estimate(spring, ("k", "c"), record, white),
    "smoothed": lambda: jaxid.smooth_states(spring, record, white),
    "coefficient": lambda: jaxid.aircraft.LiftDragAerodynamics({"CD": 0.03}),
}
messages = {}
for name, mistake in MISTAKES.items():
    try:
        mistake()
    except jaxid.InputError as error:
        messages[name] = str(error)
print(json.dumps(messages))
"""
WORDS = {
    "channel": ["numbers of its cases", "`record.channel('x')`"],
    "key": ("key is 0", "jax.random.key(0)"),
    "coefficient": ("CD is 0.03", "'1': 0.03"),
    "window": ("takes rows", "searchsorted"),
    "file": ("'run.csv'", "read_csv"),
    "files": ("'run.csv'", "read_csv"),
    "model class": ("Spring", "starting values"),
    "predicted class": ("Spring", "starting values"),
    "likelihood class": ("OutputError", "`jaxid.OutputError()`"),
    "many, likelihood class": ("OutputError", "`jaxid.OutputError()`"),
    "many, model class": ("Spring", "starting values"),
    "many, free": ("('k', 'c')", "`jaxid.free(model, ...)`"),
    "updated, likelihood class": ("OutputError", "`jaxid.OutputError()`"),
    "solver class": ("GaussNewton", "max_steps=50"),
    "steps": ("max_steps is 0", "at least 1"),
    "process": ("`process` is 0.01", "{'v': 0.01}"),
    "hold": ("`hold`", "'zoh'", "ZeroOrder()"),
    "stepper": ("`stepper`", "is 4", "RK4(4)"),
    "effect": ("'Friction' is not an effect", "DryFriction"),
    "save": ("Record", "save(path, fit)"),
    "load": ("Spring", "class with values"),
    "free": ("('k', 'c')", "`jaxid.free(model, ...)`"),
    "smoothed": ("OutputError", "`FilterError(...)`"),
}


@pytest.fixture(scope="module")
def messages():
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True
    )
    return json.loads(run.stdout)


@pytest.mark.parametrize("mistake", WORDS)
def test_argument_of_a_wrong_type_is_refused_with_its_remedy(mistake, messages):
    for words in WORDS[mistake]:
        assert words in messages[mistake]
