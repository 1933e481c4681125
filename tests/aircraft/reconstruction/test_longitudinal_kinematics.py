"""Consistency of the instruments in symmetric flight, from a motion in closed form.

pitch = 0.1 + 0.12 sin(1.1 t),  u = 100 + 3 sin(0.4 t),  w = 9 + 5 sin(1.1 t + 0.6) + sin(2.3 t)
"""

import numpy as np
import pytest
from scipy.stats import chi2

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.aircraft import Instruments, Kinematics, kinematics_of
from jaxid.estimation import OutputError
from jaxid.models import FixedNoise
from jaxid.simulation import Cubic

G0 = 9.80665
VANE = 6.0  # m, ahead of the centre of gravity
NOISE = {"V": 0.1, "alpha": 0.001, "pitch": 0.0005}
KNOWN = OutputError(FixedNoise([sigma**2 for sigma in NOISE.values()]), Cubic())
PLANTED = {"input_bias.q": 0.002, "input_bias.az": -0.15, "instruments.bias.alpha": 0.01}


def flight(seed=0, place=0.0, planted=PLANTED, names=("ax", "az", "q")):
    t = 0.05 * np.arange(400)
    rng = np.random.default_rng(seed)
    pitch, q = 0.1 + 0.12 * np.sin(1.1 * t), 0.132 * np.cos(1.1 * t)
    u, udot = 100.0 + 3.0 * np.sin(0.4 * t), 1.2 * np.cos(0.4 * t)
    w = 9.0 + 5.0 * np.sin(1.1 * t + 0.6) + np.sin(2.3 * t)
    wdot = 5.5 * np.cos(1.1 * t + 0.6) + 2.3 * np.cos(2.3 * t)
    true = {"q": q, "ax": udot + q * w + G0 * np.sin(pitch)}
    true |= {"az": wdot - q * u - G0 * np.cos(pitch)}
    true |= dict.fromkeys(("ay", "p", "r"), np.zeros(400))
    true |= {"V": np.hypot(u, w), "alpha": np.arctan2(w - q * place, u), "pitch": pitch}
    z = {name: true[name] + rng.normal(scale=sigma, size=400) for name, sigma in NOISE.items()}
    z["alpha"] = z["alpha"] + planted.get("instruments.bias.alpha", 0.0)
    inputs = {name: true[name] + planted.get(f"input_bias.{name}", 0.0) for name in names}
    return jaxid.record(
        t,
        np.column_stack([*inputs.values()]),
        np.column_stack([*z.values()]),
        inputs=tuple(inputs),
        outputs=tuple(z),
    )


def test_errors_are_longitudinal_and_the_planted_ones_are_found():
    record = flight()
    model = kinematics_of(record)
    assert model.longitudinal
    assert model.states == ("u", "w", "pitch")
    result = jaxid.consistency(model, record, likelihood=KNOWN)
    errors = {error.name: error for error in result.errors}
    assert set(errors) == {
        *("input_bias.ax", "input_bias.az", "input_bias.q", "instruments.scale.V"),
        *("instruments.scale.alpha", "instruments.bias.alpha"),
    }
    for name, error in errors.items():
        assert abs(error.value - PLANTED.get(name, 0.0)) < 4.0 * error.standard_error, name
        assert error.significant == (name in PLANTED), name


def test_lateral_channels_are_ignored_where_the_flight_is_called_longitudinal():
    names = ("ax", "ay", "az", "p", "q", "r")
    record = flight(names=names)
    assert not kinematics_of(record).longitudinal
    model = kinematics_of(record, longitudinal=True)
    some = flight(names=("ax", "az", "q"))
    one, other = (jaxid.consistency(model, each, likelihood=KNOWN) for each in (record, some))
    assert [e.name for e in one.errors] == [e.name for e in other.errors]
    np.testing.assert_allclose(one.estimate.values, other.estimate.values, rtol=1e-12)


def test_standard_error_of_the_place_of_a_vane_is_its_scatter():
    """Twenty flights with a vane 6 m ahead of its declared place."""
    model, errors = kinematics_of(flight()), ("instruments.position.alpha.x", *PLANTED)
    deviations = []
    for seed in range(20):
        record = flight(seed, place=VANE)
        result = jaxid.consistency(model, record, errors, likelihood=KNOWN)
        (place,) = (error for error in result.errors if error.name == errors[0])
        assert place.standard_error < 0.5  # m
        deviations.append((place.value - VANE) / place.standard_error)
    low, high = chi2.ppf([0.0005, 0.9995], 20)
    assert low < np.sum(np.square(deviations)) < high, deviations


def test_lateral_outputs_are_refused():
    with pytest.raises(InputError, match="'beta'"):
        Kinematics(Instruments(("V", "beta")), longitudinal=True)
