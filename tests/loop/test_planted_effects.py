"""Effects planted in a spring, each found among the candidates that resemble it."""

import jax.numpy as jnp
import pytest
from searched_spring import TRUTH, fly

from jaxid import OutputError, free
from jaxid.effects import (
    ParameterDrift,
    SensorBias,
    SensorCurve,
    SensorDelay,
    SensorScale,
    Term,
    parameter_effects,
)
from jaxid.loop import LoopProblem, Outcome, search_effects


def search(seed, library, *effects, parameters=("c",), model=TRUTH):
    """Return the result of a search on two records and a check with some effects."""
    flown = [fly(10 * seed + k, *effects) for k in range(3)]
    chosen = free(model, *parameters, per_record=("initial_state",))
    return search_effects(
        LoopProblem.of(model, library, chosen, OutputError(), flown[:2], flown[2:], window=20)
    )


def test_drift_from_declared_value_is_one_effect():
    """The stiffness is fixed: a drift about the middle would need a shift as well."""
    library = (*parameter_effects(TRUTH, ("k",), moments=(0.5,)), Term("v", "x^3"))
    planted = ParameterDrift(
        "k", from_start=True, gain=jnp.array(0.4), span=jnp.array(19.9), origin=jnp.array(0.0)
    )
    found = search(21, library, planted)
    assert found.outcome is Outcome.EXPLAINED
    assert found.effects == ("drift of k from its declared value",)
    gain, error = found.estimates["drift of k from its declared value.gain"]
    assert abs(gain - 0.4) < 4.0 * error < 0.2


CURVES = tuple(SensorCurve("x", curve) for curve in ("square", "absolute"))


@pytest.mark.parametrize("curve", CURVES, ids=["square", "absolute"])
def test_static_curve_of_sensor_is_named(curve):
    library = (*CURVES, SensorBias("x"), SensorScale("x"), SensorDelay("x"), Term("v", "x^2"))
    planted = SensorCurve("x", curve.curve, gain=jnp.array(0.1), range=jnp.array(2.0))
    found = search(22, library, planted, parameters=("k", "c"))
    assert found.effects == (curve.name,)
    _, error = found.estimates[f"{curve.name}.gain"]
    assert 0.0 < error < 0.02
