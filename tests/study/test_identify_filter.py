"""`identify` by filter error: the random motion is in the bands, and not in the model."""

import numpy as np
import pytest
from polynomial_swing import SIGMA, swing

import jaxid
from jaxid.models.stochastic import StochasticModel
from jaxid.study import IdentifyOptions

TRUE = {"1": 0.0, "x": -2.0, "v": -0.4, "force": 1.0}
TERMS, PUSH, STEP, HOLD = ("x", "v", "force"), 0.8, 0.05, jaxid.hold.ZeroOrder()


@pytest.fixture(scope="module")
def flights():
    """Two records of an oscillator under random forces, constant between samples, and the response
    without the force.
    """
    rng = np.random.default_rng(0)
    t, model = STEP * np.arange(300), swing(TRUE)
    records, responses = [], []
    for _ in range(2):
        force = np.repeat(1.2 * rng.normal(size=(15, 1)), 20, axis=0)
        pushed = force + PUSH / np.sqrt(STEP) * rng.normal(size=force.shape)
        x = np.asarray(jaxid.simulate(model, t, pushed, np.array([0.1, 0.0]), hold=HOLD).x)
        responses.append(-2.0 * x[:, 0] - 0.4 * x[:, 1] + force[:, 0])
        z = np.column_stack([x, -2.0 * x[:, 0] - 0.4 * x[:, 1] + pushed[:, 0]])
        z = z + rng.normal(size=z.shape) * np.array([*SIGMA.values()])
        records.append(jaxid.record(t, force, z, inputs=("force",), outputs=tuple(SIGMA)))
    return records, np.stack(responses)


@pytest.fixture(scope="module")
def record(flights):
    return flights[0]


@pytest.fixture(scope="module")
def pushed(flights):
    return flights[1]


@pytest.fixture(scope="module")
def result(record):
    options = IdentifyOptions(terms={"stiffness": TERMS}, keep=("stiffness",), share=0.0)
    likelihood = jaxid.FilterError(process={"v": 0.5}, hold=HOLD)
    return jaxid.identify(swing({}), record, options=options, likelihood=likelihood)


def test_identified_model_has_no_process_noise(result):
    assert isinstance(result.estimate.model, StochasticModel)
    assert type(result.model) is type(swing({}))
    for term, true in TRUE.items():
        value, error = (
            getattr(result.estimate, of)(f"stiffness.{term}") for of in ("value", "standard_error")
        )
        assert value == pytest.approx(true, abs=4.0 * error)
        at = result.model.stiffness.terms.index(term)
        assert float(result.model.stiffness.coefficients[at]) == value
    assert result.estimate.value("process.v") == pytest.approx(PUSH, rel=0.15)


def test_prediction_is_a_simulation(result, record):
    """It starts at the measured state, and no measurement corrects it."""
    predicted = result.predict(record[0])
    start = np.array([record[0].channel(name)[0] for name in ("x", "v")])
    simulated = jaxid.simulate(result.model, record[0].t, record[0].u, start, hold=HOLD)
    np.testing.assert_allclose(predicted.y[0], simulated.y, rtol=1e-9, atol=1e-12)


def test_bands_hold_the_response_of_the_pushed_motion(result, record, pushed):
    """By output error the simulated motion leaves the true one, and few samples are inside."""
    options = IdentifyOptions(terms={"stiffness": TERMS}, keep=("stiffness",), share=0.0)
    by_output_error = jaxid.identify(
        swing({}), record, options=options, likelihood=jaxid.OutputError(hold=HOLD)
    )
    shares = []
    for one in (result, by_output_error):
        band = one.prediction_bands("stiffness").signals["stiffness"]
        shares.append(np.mean(np.abs(band.value - pushed) <= 2.0 * np.asarray(band.deviation)))
    assert shares[0] > 0.9
    assert shares[1] < 0.5
