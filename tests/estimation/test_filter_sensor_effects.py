"""A filter of a model whose sensors' errors are effects, on sampled outputs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring

import jaxid
from jaxid.effects import SensorBias, SensorDelay, SensorDrift, SensorScale

T = 0.05 * np.arange(200)
STARTS = {"k": 2.0, "c": 0.3}
NAMES = ("scale of x.gain", "bias of x.gain")
LIKELIHOODS = (
    jaxid.FilterError({"v": 0.05}, {"x": 0.01}),
    jaxid.FilterError(
        {"v": jaxid.FirstOrder(0.1, 0.5)}, {"x": (0.01, jaxid.FirstOrder(0.02, 1.0))}
    ),
    jaxid.InnovationForm({"v": ("x",)}),
)


class Written(Spring):
    """The spring with both errors of the sensor written in its output."""

    scale: jax.Array
    bias: jax.Array

    def output(self, t, x, u):
        return (1.0 + self.scale) * (x[:1] + self.bias)


WRITTEN = Written(**STARTS, scale=0.0, bias=0.0)
EFFECTS = jaxid.Augmented(Spring(**STARTS), (SensorScale("x"), SensorBias("x")))


@pytest.fixture(scope="module")
def flight():
    rng = np.random.default_rng(1974)
    force = np.repeat(rng.normal(size=(20, 1)), 10, axis=0)
    random = 0.2 * rng.normal(size=(200, 1))
    x = jaxid.simulate(Spring(2.0, 0.3), T, force + random, np.zeros(2)).y
    z = 1.1 * (x[:, :1] + 0.05) + 0.01 * rng.normal(size=(200, 1))
    return jaxid.record(T, force, z, inputs=("force",), outputs=("x",))


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=["white", "with memory", "innovation form"])
def test_sensor_effects_equal_errors_in_the_output(flight, likelihood):
    """The scale is determined, as the force has one."""
    written, effects = (
        jaxid.estimate(model, jaxid.free(model, "c", *names), flight, likelihood)
        for model, names in ((WRITTEN, ("scale", "bias")), (EFFECTS, NAMES))
    )
    np.testing.assert_allclose(effects.values, written.values, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(effects.standard_errors, written.standard_errors, rtol=1e-6)
    for kind in (likelihood, jaxid.OutputError()):
        of_effects, of_written = (
            jaxid.predict(fit.model, flight, kind).y for fit in (effects, written)
        )
        np.testing.assert_allclose(of_effects, of_written, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize(
    ("effect", "name"), [(SensorDelay("x"), "delay of x"), (SensorDrift("x"), "drift of x")]
)
@pytest.mark.parametrize("likelihood", LIKELIHOODS[::2])
def test_sensor_with_memory_is_refused(flight, effect, name, likelihood):
    model = jaxid.Augmented(Spring(**STARTS), (SensorBias("x"), effect))
    with pytest.raises(jaxid.InputError, match=f"^{name} acts on a history"):
        jaxid.estimate(model, jaxid.free(model, "c"), flight, likelihood)
    with pytest.raises(jaxid.InputError, match=f"^{name} acts on a history"):
        jaxid.predict(model, flight, likelihood)


def test_disturbance_that_acts_on_a_scaled_sensor(flight):
    """The white disturbance enters the output through the sensor's scale."""

    class Moved(Spring):
        inputs = ("force", "ground")

        def rhs(self, t, x, u):
            return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

        def output(self, t, x, u):
            return x[:1] + u[1:2]

    scaled = jaxid.Augmented(Moved(2.0, 0.3), (SensorScale("x", gain=jnp.array(0.5)),))
    noisy = jaxid.models.stochastic.StochasticModel(
        scaled, {"ground": jnp.ones(())}, {}, {"x": jnp.ones(())}, {}, ("force",)
    )
    t, x, u = jnp.zeros(()), jnp.zeros(2), jnp.zeros(1)
    np.testing.assert_allclose(noisy.feedthrough(t, x, u), [[1.5]], rtol=1e-12)
