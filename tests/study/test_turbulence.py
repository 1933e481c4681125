"""Turbulence, which moves an aircraft's vane as well as its wing, is told as such."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import OutputError, close_loop, free, record, simulate
from jaxid.aircraft.longitudinal_flight import (
    NOISE_DEG,
    NOISE_SI,
    SAMPLE_TIME,
    SPEED,
    declared,
    level_trim,
    manoeuvres,
    true_aircraft,
)
from jaxid.models import Augmented

SAMPLES, WINDOW = 300, 50
GUST, MEMORY = 1.0, 1.0  # standard deviation [m/s] and correlation time [s] of the vertical gusts


def flown(seed):
    """Five manoeuvres in vertical gusts that nobody records."""
    rng = np.random.default_rng(seed)
    aircraft = true_aircraft()
    state, elevator, thrust = level_trim(aircraft, SPEED)
    aircraft = eqx.tree_at(lambda model: model.thrust, aircraft, thrust)
    gusty, t = aircraft.gusty(), SAMPLE_TIME * jnp.arange(SAMPLES)
    noise = np.array([np.radians(NOISE_DEG[name]) if name in NOISE_DEG else NOISE_SI[name] for name in gusty.outputs])
    keep, records = np.exp(-SAMPLE_TIME / MEMORY), []
    for index, moved in enumerate(list(manoeuvres(t).values())[:5]):
        gust = np.zeros((SAMPLES, 2))
        gust[0, 1] = GUST * rng.normal()
        for i in range(1, SAMPLES):
            gust[i, 1] = keep * gust[i - 1, 1] + np.sqrt(1 - keep**2) * GUST * rng.normal()
        u = np.asarray(elevator + moved)[:, None]
        y = np.asarray(simulate(gusty, t, np.hstack([u, gust]), state).y)
        z, units = y + noise * rng.normal(size=y.shape), {name: gusty.units()[name] for name in gusty.outputs}
        units |= {"elevator": "rad"}
        records.append(
            record(t, u, z, inputs=("elevator",), outputs=gusty.outputs, units=units, name=f"record {index}")
        )
    return declared(Augmented(aircraft, ())), records


def test_turbulence_is_told_as_such_although_the_vane_feels_it(seed):
    model, records = flown(seed)
    found = close_loop(
        model,
        free(model, "CX", "CZ", "Cm", per_record=("initial_state",)),
        OutputError(),
        train=records[:3],
        check=records[3],
        test=records[4],
        effects=tuple(one for one in model.effects() if one.product in ("alpha^2", "alpha^3", "alpha elevator")),
        window=WINDOW,
    )
    assert (found.outcome, found.effects) == ("process noise", ())
    assert found.process_noise.places == ("gust_w",)
    # From 36 s of records, or about 36 independent stretches of gust: a quarter is two standard deviations.
    assert found.process_noise.force["gust_w"] == pytest.approx(GUST, rel=0.25)
    assert "m/s in gust_w" in found.verdict
