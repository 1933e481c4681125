"""Gusts in several components of the wind: one alone would leave the others unexplained."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxid
from jaxid.effects import Term
from jaxid.loop import LoopProblem, RandomForces, search_effects
from jaxid.loop.outcome import Outcome

STEP, SAMPLES, MEMORY = 0.05, 250, 0.5  # s; correlation time of the gusts [s]
NOISE = np.array([0.3, 0.01, 0.3, 0.01])  # m/s


class Drift(jaxid.AbstractModel):
    """Lateral and vertical velocity, each with its inertial speed and its vane."""

    a: jax.Array
    b: jax.Array
    gusts: tuple[str, ...] = eqx.field(static=True, default=())
    states, outputs = ("v", "w"), ("vane_v", "v", "vane_w", "w")

    @property
    def inputs(self):
        return ("rudder", "elevator", *self.gusts)

    def rhs(self, t, x, u):
        return jnp.stack([self.a, self.b]) * self._through_air(x, u) + u[:2]

    def output(self, t, x, u):
        air = self._through_air(x, u)
        return jnp.stack([air[0], x[0], air[1], x[1]])

    def _through_air(self, x, u):
        return x - u[2:] if self.gusts else x

    def with_disturbance_inputs(self):
        return Drift(self.a, self.b, gusts=("gust_v", "gust_w"))


def flown(seed, sizes):
    """A record in gusts of these standard deviations, drawn outside of jaxid, and the gusts."""
    rng, t = np.random.default_rng(seed), STEP * np.arange(SAMPLES)
    pilot = np.repeat(rng.normal(size=(SAMPLES // 10, 2)), 10, axis=0)
    keep, gusts = np.exp(-STEP / MEMORY), [rng.normal(size=2)]
    for _ in range(SAMPLES - 1):
        gusts.append(keep * gusts[-1] + np.sqrt(1.0 - keep**2) * rng.normal(size=2))
    gusts = np.array(gusts) * sizes
    u = np.concatenate([pilot, gusts], axis=1)
    truth = Drift(jnp.array(-1.0), jnp.array(-2.0)).with_disturbance_inputs()
    y = jaxid.simulate(truth, t, u, np.zeros(2)).y + NOISE * rng.normal(size=(SAMPLES, 4))
    record = jaxid.record(t, pilot, y, inputs=("rudder", "elevator"), outputs=Drift.outputs)
    return record, gusts


@pytest.mark.parametrize(
    ("sizes", "found"), [((1.0, 0.5), ("gust_v", "gust_w")), ((1.0, 0.0), ("gust_v",))]
)
def test_all_gusts_that_blow_are_found_and_no_other(sizes, found):
    model = Drift(jnp.array(-0.8), jnp.array(-1.6))
    free = jaxid.free(model, "a", "b", per_record=("initial_state",))
    records, gusts = zip(*(flown(seed, sizes) for seed in (1, 2, 3)), strict=True)
    problem = LoopProblem.of(
        model, (Term("v", "v^3"),), free, jaxid.OutputError(), records[:2], records[2:]
    )
    search = search_effects(problem)
    assert search.outcome is Outcome.PROCESS_NOISE
    noise = search.tree.best.hypothesis.noise
    assert isinstance(noise, RandomForces)
    assert noise.air == found
    refitted = [step.move.hypothesis.noise for step in search.tree.steps]
    assert sum(isinstance(one, RandomForces) for one in refitted) == 1  # the best, and no other
    blown = np.sqrt(np.mean(np.square(gusts[:2]), axis=(0, 1)))
    for name, size in zip(found, blown, strict=False):
        estimate, error = search.estimates[f"process.{name}"]
        assert estimate == pytest.approx(size, abs=3.0 * error)
        assert error < 0.15 * size
