"""A parameter with the effect of a free initial state does not stop the fit."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxid
from jaxid.models.base import AbstractModel

SIGMA = 0.01


class Offset(AbstractModel):
    """A damped mass, or a chain of two integrators at zero damping, with a sensor offset.

    d(place)/dt = speed,  d(speed)/dt = gain u - damping speed,  y = place + offset
    """

    gain: jax.Array
    damping: jax.Array
    offset: jax.Array
    wind: jax.Array
    states, inputs, outputs = ("place", "speed"), ("u",), ("y",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1] + self.wind, self.gain * u[0] - self.damping * x[1]])

    def output(self, t, x, u):
        return x[:1] + self.offset


def mass(gain, damping, offset=0.0, wind=0.0):
    return Offset(*(jnp.asarray(value) for value in (gain, damping, offset, wind)))


def measured(seed, damping, records=2, count=200):
    rng, t = np.random.default_rng(seed), 0.05 * np.arange(count)
    made = []
    for start in rng.normal(size=(records, 2)):
        u = np.sign(np.sin(1.3 * t + start[0]))
        y = jaxid.simulate(mass(2.0, damping), t, u[:, None], jnp.asarray(start)).y
        z = np.asarray(y) + SIGMA * rng.normal(size=y.shape)
        made.append(jaxid.record(t, u, z, inputs=("u",), outputs=("y",)))
    return made


def test_offset_of_free_start_does_not_stop_fit(seed):
    """The determined parameters are those of the fit without the offset, which is reported."""
    data, model, likelihood = measured(seed, 0.7), mass(1.0, 1.0), jaxid.OutputError()
    start, kept = ("initial_state",), ("gain", "damping")
    alone = jaxid.estimate(model, jaxid.free(model, *kept, per_record=start), data, likelihood)
    both = jaxid.estimate(
        model, jaxid.free(model, *kept, "offset", per_record=start), data, likelihood
    )
    assert bool(alone.successful)
    assert bool(both.successful), both.status
    for name in kept:
        np.testing.assert_allclose(both.value(name), alone.value(name), rtol=1e-6)
        np.testing.assert_allclose(both.standard_error(name), alone.standard_error(name), rtol=1e-6)
    assert "offset is not determined" in both.weak_directions
    assert np.isinf(both.standard_error("offset"))
