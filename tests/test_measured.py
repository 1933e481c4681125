"""The measured sets: what their declared models reach before the loop, and the loop itself on the smallest of them.

It is given a part of the library there, what tanks with an instrument may lack: the whole one takes minutes, as do the other
sets. `python -m jaxid dataset NAME PATH` prints the figures of the whole.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import StateSpace, lsim

from jaxid import FixedNoise, GaussNewton, LoopOptions, close_loop, estimate, predict
from jaxid.measured import emps, emps_closed_loop, silverbox, tanks
from jaxid.measured.emps import GTAU, KP, KV
from jaxid.models import InputDelay, SensorBias, SensorSaturation, SensorScale, StateLimit, Term
from jaxid.study.close_loop import candidates

# Held-out RMS of independent simple fits of the same models, as far as known: within a few per cent, since their authors
# weighted the records in their own way. [V, V, m, V]
SIMPLE = {
    "silverbox": (silverbox, {"arrow": 14.21e-3, "multisine": 7.02e-3}),
    "emps": (emps, {"pulses": 93e-3}),
    "tanks": (tanks, {"validation": 0.671}),
}
TANKS_MAY_LACK = (StateLimit, SensorBias, SensorScale, SensorSaturation, Term, InputDelay)


@pytest.mark.parametrize("name", SIMPLE)
def test_the_declared_model_reaches_what_simple_fits_reach(name, data_folder):
    load, known = SIMPLE[name]
    case = load(data_folder)
    fitted = estimate(case.model, case.free, case.data.train, case.likelihood, solver=GaussNewton(tolerance=1e-3))
    assert bool(fitted.successful)
    likelihood = type(case.likelihood)(FixedNoise(fitted.noise), case.likelihood.hold, case.likelihood.stepper)
    for test, rms in known.items():
        found = predict(fitted.model, case.data.test[test], likelihood, window=case.data.window[test])
        assert float(found.rms[0]) == pytest.approx(rms, rel=0.02)


@pytest.mark.parametrize("file", ["DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"])
def test_the_controller_of_the_emps_is_the_published_one(file, data_folder):
    """Its gains are those of the files, and its law gives the command that was recorded.

    Within 0.08 V of 1.5 V (RMS): what stays is the real controller's filter on the velocity, about half a millisecond, at
    accelerations of up to a few tenths of m/s^2: 240 V s/m x 0.5 m/s^2 x 0.5 ms = 0.06 V. The pulses left out would leave 2.5 V.
    """
    data = {
        name: np.ravel(value).astype(float)
        for name, value in loadmat(data_folder / "emps" / file).items()
        if name[0] != "_"
    }
    assert (data["kp"][0], data["kv"][0], data["gtau"][0]) == (KP, KV, GTAU)
    velocity = 1000.0 * np.diff(data["qm"], prepend=data["qm"][0])
    command = KV * (KP * (data["qg"] - data["qm"]) - velocity) + data.get("pulses_N", 0.0)
    assert np.sqrt(np.mean((command - data["vir"])[1:] ** 2)) < 0.08
    assert np.max(np.abs(data["vir"])) < 9.1  # no limit of the command is reached, so that the model has none


def test_the_closed_loop_of_the_emps_is_what_scipy_makes_of_it(data_folder):
    """Fitted on 8 s; a linear system in a second code, from rest, which the loop forgets within 0.2 s."""
    case = emps_closed_loop(data_folder)
    train, test = case.data.train[0].window(0, 8000), case.data.test["pulses"].window(0, 8000)
    fitted = estimate(case.model, case.free, train, case.likelihood, solver=GaussNewton(tolerance=1e-3))
    assert bool(fitted.successful)
    likelihood = type(case.likelihood)(FixedNoise(fitted.noise), case.likelihood.hold, case.likelihood.stepper)
    found = predict(fitted.model, test, likelihood, window=case.data.window["pulses"])
    mass, viscous = fitted.values
    motor = KV * GTAU / mass
    A = [[0.0, 1.0], [-motor * KP, -motor - viscous / mass]]
    system = StateSpace(np.array(A), np.array([[0.0, 0.0], [motor * KP, GTAU / mass]]), np.eye(1, 2), np.zeros((1, 2)))
    _, y, _ = lsim(system, np.asarray(test.u), 1e-3 * np.arange(8000))
    np.testing.assert_allclose(found.y[0, 300:, 0], y[300:], atol=1e-7)  # of an error of 8e-6 m that is to be explained
    assert float(found.rms[0]) < 1e-5


def test_the_loop_finds_the_overflow_of_the_tanks(data_folder):
    case = tanks(data_folder)
    library = tuple(
        one for one in candidates(case.model, case.free, case.data.train[0]) if isinstance(one, TANKS_MAY_LACK)
    )
    # The whole search takes seven rounds and two minutes, and ends at 0.18 V.
    study = close_loop(**case.parts, effects=library, options=LoopOptions(max_rounds=3))
    assert any(name.startswith("overflow of upper into lower") for name in study.effects)
    assert study.before.rms["validation"]["level"] == pytest.approx(0.675, rel=0.02)
    assert study.after.rms["validation"]["level"] < 0.40
    assert study.outcome == "proxies"
    assert bool(jnp.all(jnp.isfinite(study.after.estimate.values)))
