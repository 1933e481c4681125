"""The measured sets: what their declared models reach before the loop, and the loop itself on the smallest of them.

It is given a part of the library there, what tanks with an instrument may lack: the whole one takes minutes, as do the other
sets. `python -m jaxid dataset NAME PATH` prints the figures of the whole.
"""

import jax.numpy as jnp
import pytest

from jaxid import FixedNoise, GaussNewton, close_loop, estimate, predict
from jaxid.measured import emps, silverbox, tanks
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


def test_the_loop_finds_the_overflow_of_the_tanks(data_folder):
    case = tanks(data_folder)
    library = tuple(
        one for one in candidates(case.model, case.free, case.data.train[0]) if isinstance(one, TANKS_MAY_LACK)
    )
    study = close_loop(
        case.model, case.free, case.likelihood, train=case.data.train, test=case.data.test, effects=library, window=5
    )
    assert any(name.startswith("overflow of upper into lower") for name in study.effects)
    assert study.before.rms["validation"]["level"] == pytest.approx(0.675, rel=0.02)
    assert study.after.rms["validation"]["level"] < 0.40
    assert study.outcome == "proxies"
    assert bool(jnp.all(jnp.isfinite(study.after.estimate.values)))
