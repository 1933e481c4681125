"""Measured data sets: errors of the declared models before the loop, and the loop on the smallest
set.

The loop has only those effects of the library that tanks with a sensor may lack: with the full
library, or on the other sets, it takes minutes. `python -m jaxid dataset NAME PATH` prints the
results with the full library.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import StateSpace, lsim

from jaxid import FixedNoise, GaussNewton, LoopOptions, close_loop, estimate, predict
from jaxid.effects import InputDelay, SensorBias, SensorSaturation, SensorScale, StateLimit, Term
from jaxid.loop.outcome import Outcome
from jaxid.measured import emps, emps_closed_loop, silverbox, tanks
from jaxid.measured.emps import GTAU, KP, KV
from jaxid.study.candidates import candidates

# Held-out RMS of independent simple fits of the same models, as far as known. They agree within a
# few per cent, because their authors weighted the records differently. [V, V, m, V]
SIMPLE = {
    "silverbox": (silverbox, {"arrow": 14.21e-3, "multisine": 7.02e-3}),
    "emps": (emps, {"pulses": 93e-3}),
    "tanks": (tanks, {"validation": 0.671}),
}
TANKS_MAY_LACK = (StateLimit, SensorBias, SensorScale, SensorSaturation, Term, InputDelay)


@pytest.mark.parametrize("name", SIMPLE)
def test_declared_model_reaches_error_of_simple_fits(name, data_folder):
    load, known = SIMPLE[name]
    case = load(data_folder)
    fitted = estimate(
        case.model, case.free, case.data.train, case.likelihood, solver=GaussNewton(tolerance=1e-3)
    )
    assert bool(fitted.successful)
    likelihood = type(case.likelihood)(
        FixedNoise(fitted.noise), case.likelihood.hold, case.likelihood.stepper
    )
    for test, rms in known.items():
        prediction = predict(
            fitted.model, case.data.test[test], likelihood, window=case.data.window[test]
        )
        assert float(prediction.rms[0]) == pytest.approx(rms, rel=0.02)


@pytest.mark.parametrize("file", ["DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"])
def test_emps_controller_has_published_gains_and_command(file, data_folder):
    """The gains are those of the files, and the control law reproduces the recorded command.

    The error is below 0.08 V of 1.5 V (RMS). It is caused by the real controller's filter on the
    velocity, about half a millisecond, at accelerations of up to a few tenths of m/s^2: 240 V s/m x
    0.5 m/s^2 x 0.5 ms = 0.06 V. Without the pulses the error would be 2.5 V.
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
    # the command reaches no limit, so that the model has none
    assert np.max(np.abs(data["vir"])) < 9.1


def test_emps_closed_loop_equals_scipy_simulation(data_folder):
    """Fitted on 8 s, and compared with the same linear system in SciPy, which starts from rest. The
    closed loop forgets the initial state within 0.2 s.
    """
    case = emps_closed_loop(data_folder)
    train, test = case.data.train[0].window(0, 8000), case.data.test["pulses"].window(0, 8000)
    fitted = estimate(
        case.model, case.free, train, case.likelihood, solver=GaussNewton(tolerance=1e-3)
    )
    assert bool(fitted.successful)
    likelihood = type(case.likelihood)(
        FixedNoise(fitted.noise), case.likelihood.hold, case.likelihood.stepper
    )
    prediction = predict(fitted.model, test, likelihood, window=case.data.window["pulses"])
    mass, viscous = fitted.values
    motor = KV * GTAU / mass
    A = [[0.0, 1.0], [-motor * KP, -motor - viscous / mass]]
    system = StateSpace(
        np.array(A),
        np.array([[0.0, 0.0], [motor * KP, GTAU / mass]]),
        np.eye(1, 2),
        np.zeros((1, 2)),
    )
    _, y, _ = lsim(system, np.asarray(test.u), 1e-3 * np.arange(8000))
    # The tolerance is small against the error of 8e-6 m that effects should explain.
    np.testing.assert_allclose(prediction.y[0, 300:, 0], y[300:], atol=1e-7)
    assert float(prediction.rms[0]) < 1e-5


def test_loop_finds_overflow_of_tanks(data_folder):
    case = tanks(data_folder)
    library = tuple(
        effect
        for effect in candidates(case.model, case.free, case.data.train[0])
        if isinstance(effect, TANKS_MAY_LACK)
    )
    # The full search takes seven rounds and two minutes, and ends at 0.18 V.
    study = close_loop(**case.parts, effects=library, options=LoopOptions(max_rounds=1))
    assert any(name.startswith("overflow of upper into lower") for name in study.effects)
    assert study.before.rms["validation"]["level"] == pytest.approx(0.675, rel=0.02)
    assert study.after.rms["validation"]["level"] < 0.40
    assert study.outcome is Outcome.PROXIES
    assert bool(jnp.all(jnp.isfinite(study.after.estimate.values)))
