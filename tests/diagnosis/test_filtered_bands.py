"""Bands of filter error: the smoother's states, and coverage of the random motion."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from reference_estimation import Lag
from scipy.stats import binom

from jaxid.data import record
from jaxid.diagnosis import prediction_bands
from jaxid.estimation import FilterError, Fixed, estimate, smooth_states
from jaxid.models import free

P, B, SENSOR, PROCESS, X0 = 1.0, 2.0, 0.1, 0.5, 0.5
STEP, ROWS, DRAWS, WIDTH = 0.1, 200, 400, 1.959963984540054
AT = np.array([0, 20, 90, 199])  # the initial state, a rise, the middle, the end
LIKELIHOOD = FilterError(process={"x": Fixed(PROCESS)}, noise={"x": Fixed(SENSOR)})


def moved(rng):
    """Times, input, and the states of all draws, exact for straight lines of the input."""
    t = STEP * np.arange(ROWS)
    u = np.sign(np.sin(0.7 * t)) + 0.5 * np.sign(np.sin(1.9 * t))
    decay = np.exp(-P * STEP)
    integral = (1.0 - decay) / P  # of exp(-p s) over a sample
    late = (STEP - integral) / (P * STEP)  # the same, weighted with the share of the next input
    deviation = PROCESS * np.sqrt((1.0 - decay**2) / (2.0 * P))
    x = np.full((DRAWS, ROWS), X0)
    for i in range(ROWS - 1):
        driven = B * ((integral - late) * u[i] + late * u[i + 1])
        x[:, i + 1] = decay * x[:, i] + driven + deviation * rng.normal(size=DRAWS)
    return t, u, x


def test_bands_hold_the_random_motion(seed):
    """400 draws; the bounds belong to a right 95 % band at all places with 99.9 % probability."""
    rng = np.random.default_rng(seed)
    t, u, x = moved(rng)
    z = x + SENSOR * rng.normal(size=x.shape)
    model = Lag(p=jnp.asarray(0.8), b=jnp.asarray(1.5))
    chosen = free(model, "p", "b", per_record=("initial_state",))
    template = record(t, u[:, None], z[0][:, None], inputs=["u"], outputs=["x"])

    def single(z):
        known = eqx.tree_at(lambda node: node.z, template, z[:, None])
        fit = estimate(model, chosen, known, LIKELIHOOD)
        band = prediction_bands(fit, known, LIKELIHOOD).states["x"]
        return band.value[0, AT], band.deviation[0, AT]

    value, deviation = map(np.asarray, eqx.filter_jit(jax.vmap(single))(jnp.asarray(z)))
    covered = np.sum(np.abs(value - x[:, AT]) < WIDTH * deviation, axis=0)
    low, high = binom.ppf([0.0005 / AT.size, 1.0 - 0.0005 / AT.size], DRAWS, 0.95)
    assert np.all((covered >= low) & (covered <= high)), covered / DRAWS


def test_variance_is_of_the_smoother_and_of_the_parameter(seed):
    """The derivative by the parameter as a central difference of smoothed states."""
    rng = np.random.default_rng(seed)
    t, u, x = moved(rng)
    z = x[0] + SENSOR * rng.normal(size=ROWS)
    known = record(t, u[:, None], z[:, None], inputs=["u"], outputs=["x"])
    model = Lag(p=jnp.asarray(0.8), b=jnp.asarray(B))
    fit = estimate(model, free(model, "p"), known, LIKELIHOOD)
    band = prediction_bands(fit, known, LIKELIHOOD).states["x"]
    p, step = float(fit.value("p")), 1e-5

    def smoothed(p):
        return smooth_states(Lag(p=jnp.asarray(p), b=jnp.asarray(B)), known, LIKELIHOOD)

    slope = (smoothed(p + step).values - smoothed(p - step).values)[0, :, 0] / (2.0 * step)
    here = smoothed(p)
    np.testing.assert_allclose(band.value[0], here.values[0, :, 0], rtol=1e-9)
    expected = np.hypot(here.standard_deviations[0, :, 0], slope * fit.standard_error("p"))
    np.testing.assert_allclose(band.deviation[0], expected, rtol=1e-5, atol=1e-9)
