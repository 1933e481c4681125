"""Records that begin in motion: the memory of an effect at the first sample is unknown."""

import numpy as np
import pytest
from scipy.signal import lsim
from small_spring import Spring

from jaxid import OutputError, close_loop, free, record
from jaxid.effects import InputDelay, InputLag, SensorLag, Term
from jaxid.loop.outcome import Outcome
from jaxid.simulation.hold import ZeroOrder

STEP, SAMPLES, SKIPPED = 0.1, 200, 150
LAG, SIGMA = 0.6, 0.003  # s, m
FREQUENCIES = 2 * np.pi * np.array([0.05, 0.11, 0.19, 0.31])


def flown(number):
    """The last samples of a longer run of a spring whose force lags by `LAG`, by SciPy, and the
    lagged force at the first of them.
    """
    rng = np.random.default_rng([3, number])
    t = STEP * np.arange(SKIPPED + SAMPLES)
    phases = rng.uniform(0, 2 * np.pi, FREQUENCIES.size)
    u = np.sum(np.sin(FREQUENCIES * t[:, None] + phases), axis=1)
    A = [[0, 1, 0], [-2.0, -0.4, 1.0], [0, 0, -1 / LAG]]
    system = (A, [[0], [0], [1 / LAG]], [[1.0, 0, 0]], [[0.0]])
    _, y, states = lsim(system, u, t, interp=False)
    z = y + SIGMA * rng.standard_normal(y.shape)
    names = {"inputs": ("force",), "outputs": ("x",)}
    return record(t[:SAMPLES], u[SKIPPED:], z[SKIPPED:], **names), states[SKIPPED, 2]


@pytest.fixture(scope="module")
def studied():
    model = Spring(1.6, 0.5)
    records = [flown(number)[0] for number in range(4)]

    def study(*effects):
        return close_loop(
            model,
            free(model, "k", "c", per_record=("initial_state",)),
            OutputError(hold=ZeroOrder()),
            train=records[:2],
            check=records[2],
            test=records[3],
            effects=effects,
            window=40,
            progress=False,
        )

    return study


def test_lag_in_motion_is_found_with_its_state_at_first_sample(studied):
    study = studied(InputLag("force"), InputDelay("force"), Term("v", "x^3"), Term("v", "1"))
    assert study.effects == ("lag of input force",)
    assert study.outcome is Outcome.EXPLAINED
    fit = study.after.estimate
    name = "lag of input force.time"
    assert abs(fit.value(name) - LAG) < 4 * fit.standard_error(name)
    assert fit.free.per_record[2:] == ("initial_state.lagged force",)
    own = np.array([flown(number)[1] for number in range(2)])
    off = np.asarray(fit.own)[:, 2] - own
    assert np.all(np.abs(off) < 4 * np.asarray(fit.own_errors)[:, 2])


def test_lags_of_input_and_only_sensor_are_not_distinguished(studied):
    """In a linear system they differ by nothing once both begin as the record does."""
    study = studied(InputLag("force"), SensorLag("x"), Term("v", "x^3"))
    assert study.outcome is Outcome.PROXIES
    (other,) = {"lag of input force", "lag of x"} - set(study.effects)
    assert other in study.verdict
