"""Intervals of filter error hold the truth: parameters, process noise and sensor noise."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from reference_estimation import Lag
from scipy.stats import binom

from jaxid.data import record
from jaxid.estimation import FilterError, estimate
from jaxid.models import free

TRUTH = {"p": 1.0, "b": 2.0, "sensor.x": 0.1, "process.x": 0.5}
STEP, ROWS, DRAWS, X0 = 0.1, 600, 500, 0.5


def flights(rng):
    """Times, input and measured outputs, exact for straight lines between the input's samples."""
    p, b, sensor, process = TRUTH.values()
    t = STEP * np.arange(ROWS)
    u = np.sign(np.sin(0.7 * t)) + 0.5 * np.sign(np.sin(1.9 * t))
    decay = np.exp(-p * STEP)
    whole = (1.0 - decay) / p  # integral of exp(-p s) over a sample
    late = (STEP - whole) / (p * STEP)  # the same, weighted with the share of the next input
    deviation = process * np.sqrt((1.0 - decay**2) / (2.0 * p))
    x, z = np.full(DRAWS, X0), np.zeros((DRAWS, ROWS))
    for i in range(ROWS):
        z[:, i] = x + sensor * rng.normal(size=DRAWS)
        if i + 1 < ROWS:
            driven = b * ((whole - late) * u[i] + late * u[i + 1])
            x = decay * x + driven + deviation * rng.normal(size=DRAWS)
    return t, u, z


def test_intervals_hold_parameters_and_noises(seed):
    t, u, z = flights(np.random.default_rng(seed))
    model = Lag(p=jnp.asarray(0.8), b=jnp.asarray(1.5))
    chosen = free(model, "p", "b", per_record=("initial_state",))
    template = record(t, u[:, None], z[0][:, None], inputs=["u"], outputs=["x"])

    def single(z):
        known = eqx.tree_at(lambda node: node.z, template, z[:, None])
        return estimate(model, chosen, known, FilterError(process={"x": 0.3}, noise={"x": 0.2}))

    fits = eqx.filter_jit(eqx.filter_vmap(single))(jnp.asarray(z))
    assert bool(jnp.all(fits.successful))
    assert fits.names == tuple(TRUTH)
    ends, truth = np.asarray(fits.interval()), np.array(list(TRUTH.values()))
    covered = np.sum((ends[..., 0] <= truth) & (ends[..., 1] >= truth), axis=0)
    low, high = binom.ppf([0.00025 / 2, 1 - 0.00025 / 2], DRAWS, 0.95)
    assert np.all((covered >= low) & (covered <= high)), covered / DRAWS
    spread = np.std(np.asarray(fits.values), axis=0)
    ratio = spread / np.median(np.asarray(fits.standard_errors), axis=0)
    assert np.all(np.abs(ratio - 1.0) < 0.12), ratio  # 3.5 standard errors of a deviation
