"""The code in CONTRIBUTING.md runs as printed: a model, an effect, a noise hypothesis, a
likelihood, and their tests.
"""

import sys
import types
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from printed_code import blocks

import jaxid
from jaxid.effects import Term
from jaxid.estimation import likelihoods
from jaxid.loop import LoopOptions, LoopProblem, White, search_effects

GUIDE = Path(__file__).resolve().parent.parent / "CONTRIBUTING.md"


def section(title: str) -> list[str]:
    """The Python blocks of a section, in order."""
    text = GUIDE.read_text(encoding="utf-8").split(f"\n## {title}\n")[1].split("\n## ")[0]
    return blocks(text, "python")


def run(code: str, inside: str, **known) -> dict:
    """The names that a block defines, run as if it stood in a module of the package."""
    names = {"__name__": f"{inside}.printed", "__package__": inside, **known}
    exec(compile(code, str(GUIDE), "exec"), names)
    return names


def _defined(names: dict) -> dict:
    return {name: value for name, value in names.items() if not name.startswith("__")}


@pytest.fixture(scope="module")
def model():
    return run(section("Add a model")[0], "jaxid.models")["Pendulum"]


@pytest.fixture(scope="module")
def pendulum(model):
    return model(jnp.array(4.0), jnp.array(0.5))


@pytest.fixture
def t():
    return 0.05 * jnp.arange(200)


@pytest.fixture
def torque(t):
    return jnp.sin(t**1.5)[:, None]


@pytest.fixture
def measure():
    """Ten seconds of pushes that turn the pendulum by a radian and more, with noise of 2 mrad on
    its angle.
    """

    def record(model, seed):
        rng, t = np.random.default_rng(seed), 0.05 * jnp.arange(200)
        torque = jnp.asarray(np.repeat(4.0 * rng.normal(size=20), 10)[:, None])
        angle = jaxid.simulate(model, t, torque, jnp.zeros(2)).y + 0.002 * rng.normal(size=(200, 1))
        return jaxid.record(t, torque, angle, inputs=("torque",), outputs=("angle",))

    return record


def test_the_test_of_the_model_passes(model, monkeypatch):
    module = types.ModuleType("jaxid.models.pendulum")
    module.Pendulum = model
    monkeypatch.setitem(sys.modules, module.__name__, module)
    run(section("Add a model")[1], "tests")["test_its_own_parameters_are_recovered"]()


def test_the_effect_is_ten_lines_and_its_tests_pass(pendulum, measure, t, torque):
    effect, tests = section("Add an effect")
    lines = effect[effect.index("class ") :].splitlines()
    assert len([line for line in lines if line.strip()]) <= 10
    told = run(tests, "tests", **_defined(run(effect, "tests")), Term=Term)
    told["test_it_is_absent_at_zero_gain"](pendulum, t, torque)
    told["test_its_derivative_is_finite_there"](pendulum, t, torque)
    told["test_it_is_found"](pendulum, measure)


@pytest.fixture
def search():
    """Result of a search on two records of a falling mass whose two sensors share their noise."""

    class Falling(jaxid.AbstractModel):
        drag: jax.Array
        states, inputs, outputs = ("z", "w"), ("thrust",), ("z", "w")

        def rhs(self, t, x, u):
            return jnp.stack([x[1], u[0] - self.drag * x[1]])

        def output(self, t, x, u):
            return x

    def found(correlation, options):
        rng, t = np.random.default_rng(5), 0.1 * np.arange(150)
        R = 0.02**2 * np.array([[1.0, correlation], [correlation, 1.0]])
        flown = []
        for _ in range(2):
            u = np.repeat(rng.normal(size=15), 10)[:, None]
            y = np.asarray(jaxid.simulate(Falling(jnp.array(0.5)), t, u, jnp.zeros(2)).y)
            z = y + rng.multivariate_normal(np.zeros(2), R, size=150)
            flown.append(jaxid.record(t, u, z, inputs=("thrust",), outputs=("z", "w")))
        model = Falling(jnp.array(0.4))
        chosen = jaxid.free(model, "drag", per_record=("initial_state",))
        library, train, check = (Term("w", "w^2"),), flown[:1], flown[1:]
        problem = LoopProblem.of(model, library, chosen, jaxid.OutputError(), train, check)
        return search_effects(problem, options=options)

    return found


def test_the_noise_hypothesis_is_thirty_lines_and_its_test_passes(search):
    noise, test = section("Add a noise hypothesis")
    assert len([line for line in noise.splitlines() if line.strip()]) <= 30
    known = _defined(run(noise, "tests")) | {"LoopOptions": LoopOptions, "White": White}
    run(test, "tests", **known)["test_it_is_named_where_it_is_true"](search)


def test_the_test_of_the_likelihood_passes(pendulum, measure):
    likelihood, test = section("Add a likelihood")
    # The block stands in that module, and uses what it imports.
    known = _defined(vars(likelihoods))
    told = run(likelihood, "jaxid.estimation", **known)
    run(
        test, "tests", jaxid=jaxid, np=np, jnp=jnp, KnownAutoregression=told["KnownAutoregression"]
    )["test_no_memory_is_output_error"](pendulum, measure)
