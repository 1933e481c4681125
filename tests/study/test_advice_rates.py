"""Advice compares a channel with the integral of its rate: wrong units and signs show."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring
from written_flight import MASS, SIZE, SURFACES, flight

import jaxid
from jaxid._foundation.types import Array
from jaxid.aircraft import model_of
from jaxid.study import FindingKind, advice
from jaxid.study.record_checks.rates import likely_cause

TIME = 0.05 * np.arange(400)


class Both(Spring):
    """The spring with both states measured; they are not in the order of the states."""

    outputs = ("v", "x")

    def output(self, t, x, u):
        return x[::-1]

    def units(self):
        return {"x": "m", "v": "m/s"}


BOTH = Both(jnp.array(2.0), jnp.array(0.3))


def measured(x=1.0, v=1.0, drift=0.0, gap=None):
    """A record whose channels are multiplied by factors; `drift` is an error of the speed."""
    rng = np.random.default_rng(4)
    force = np.repeat(rng.normal(size=20), 20)[:, None]
    y = np.asarray(jaxid.simulate(BOTH, TIME, force, np.zeros(2)).y)
    y = y + 0.02 * rng.normal(size=y.shape)
    z = np.stack([v * (y[:, 0] + drift), x * y[:, 1]], axis=1)
    if gap is not None:
        z[gap] = np.nan
    return jaxid.record(
        TIME, force, z, inputs=("force",), outputs=("v", "x"), units=BOTH.units(), name="one"
    )


def ratios(record, model=BOTH):
    return {
        finding.names[0]: (finding.numbers["ratio"], finding.units[0])
        for finding in advice(record, model).of(FindingKind.RATE)
    }


@pytest.mark.parametrize(
    ("factors", "ratio", "cause"),
    [
        ({"x": 1000.0}, 1000.0, "it is in mm"),
        ({"x": 1 / 0.3048}, 1 / 0.3048, "it is in ft"),
        ({"v": 1 / 0.3048}, 0.3048, "its rate is in ft/s"),
        ({"v": -1.0}, -1.0, "opposite sign"),
        ({"x": 10.0}, 10.0, "another quantity"),
        ({"x": 1 / 0.3048, "drift": 0.5}, 1 / 0.3048, "it is in ft"),
        ({"x": 1 / 0.3048, "gap": slice(100, 108)}, 1 / 0.3048, "it is in ft"),
    ],
)
def test_wrong_unit_or_sign_is_found_with_its_ratio(factors, ratio, cause):
    found = ratios(measured(**factors))
    assert set(found) == {"x"}
    assert found["x"][0] == pytest.approx(ratio, rel=0.05)
    assert cause in found["x"][1]


@pytest.mark.parametrize("factors", [{}, {"drift": 0.5}, {"x": 1.3}, {"v": -1.3, "x": -1.0}])
def test_right_units_have_no_finding(factors):
    """A constant error of the rate is a trend of the channel, and 1.3 is an error of a sensor."""
    assert ratios(measured(**factors)) == {}


class Geared(Both):
    """The position is measured behind a gear, whose ratio is a parameter."""

    gear: Array = 0.1

    def rhs(self, t, x, u):
        return super().rhs(t, x, u) * jnp.stack([self.gear, jnp.ones(())])


def test_rate_with_a_parameter_is_not_compared():
    """Here the factor may be the parameter's, which is not yet estimated."""
    model = Geared(jnp.array(2.0), jnp.array(0.3), jnp.array(0.1))
    assert ratios(measured(), model) == {}


def test_rate_that_is_not_measured_is_not_compared():
    record = measured(x=1000.0)
    assert ratios(record.without("v"), Spring(jnp.array(2.0), jnp.array(0.3))) == {}


def test_cause_needs_the_unit_of_the_channel():
    assert likely_cause(57.3, "rad") == "it is in deg"
    assert "deg" not in likely_cause(57.3, "m")
    assert likely_cause(57.3, "") == "it is in deg"
    assert likely_cause(1e-3, "rad") == "time is in ms"


CONTROLS = (*SURFACES, "thrust")
OUTPUTS = ("V", "alpha", "beta", "p", "q", "r", "phi", "pitch", "psi", "ax", "ay", "az", "altitude")


def flown(channels, **factors):
    """A record of a flight whose channels are multiplied by factors."""
    channels = channels | {name: factor * channels[name] for name, factor in factors.items()}
    tables = (np.stack([channels[name] for name in names], 1) for names in (CONTROLS, OUTPUTS))
    return jaxid.record(channels["t"], *tables, inputs=CONTROLS, outputs=OUTPUTS, name="flight")


def test_altitude_in_feet_and_pitch_in_degrees_are_found_in_turbulence():
    channels = flight(seed=1, gusts="moderate")
    right = flown(channels)
    model = model_of(right, **MASS, **SIZE)
    assert "altitude" in model.inputs
    assert ratios(right, model) == {}
    high = flown(channels, altitude=1 / 0.3048)
    assert ratios(high, model)["altitude"][1] == "it is in ft"
    steep = flown(channels, pitch=180 / np.pi)
    assert ratios(steep, model)["pitch"][1] == "it is in deg"
