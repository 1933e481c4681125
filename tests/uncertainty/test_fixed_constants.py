"""Errors from fixed constants: against refits and a closed form, and their coverage."""

import numpy as np
import pytest
from reference_estimation import Pendulum, as_records, pendulum_rhs, rk4
from scipy.stats import binom

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.data import record
from jaxid.models import LinearModel
from jaxid.uncertainty import consider, propagate

DRAWS, ROWS, SIGMA, WIDTH = 2000, 60, 0.2, 1.959963984540054
TRUTH = np.array([1.0, -2.0, 0.5])  # a and b are free, c is a constant
C_DEVIATION = 0.1


def regression():
    """`y = a u1 + b u2 + c u3`: model, inputs, likelihood."""
    names = ("u1", "u2", "u3")
    D = [[0.0, 0.0, TRUTH[2]]]
    model = LinearModel(
        [[-1.0]], [[0.0] * 3], [[0.0]], D, states=("x",), inputs=names, outputs=("y",)
    )
    u = np.random.default_rng(7).normal(size=(ROWS, 3))
    u[:, 2] += 0.7 * u[:, 0]
    return model, u, jaxid.OutputError(jaxid.FixedNoise([SIGMA**2]))


@pytest.fixture(scope="module")
def considered():
    model, u, likelihood = regression()
    z = u @ TRUTH + SIGMA * np.random.default_rng(1).normal(size=ROWS)
    data = record(np.arange(ROWS * 1.0), u, z, inputs=model.inputs, outputs=("y",))
    fit = jaxid.estimate(model, jaxid.free(model, "D[0,0]", "D[0,1]"), data, likelihood)
    return fit, consider(fit, data, likelihood, {"D[0,2]": C_DEVIATION})


def test_widened_covariance_equals_closed_form_and_covers(considered):
    """2,000 draws in NumPy, each with its own true constant and noise."""
    fit, result = considered
    _, u, _ = regression()
    free, fixed = u[:, :2], u[:, 2]
    inverse = np.linalg.inv(free.T @ free)
    K = -inverse @ free.T @ fixed
    P = SIGMA**2 * inverse + C_DEVIATION**2 * np.outer(K, K)
    np.testing.assert_allclose(result.gain[:, 0], K, rtol=1e-9)
    np.testing.assert_allclose(result.covariance, P, rtol=1e-9)
    rng = np.random.default_rng(1974)
    c = TRUTH[2] + C_DEVIATION * rng.normal(size=DRAWS)
    noise = SIGMA * rng.normal(size=(ROWS, DRAWS))
    z = free @ TRUTH[:2, None] + fixed[:, None] * c + noise
    errors = inverse @ free.T @ (z - fixed[:, None] * TRUTH[2]) - TRUTH[:2, None]
    low, high = binom.ppf([0.00025, 0.99975], DRAWS, 0.95) / DRAWS

    def covered(deviation):
        return np.mean(np.abs(errors) < WIDTH * np.asarray(deviation)[:, None], axis=1)

    together = covered(result.standard_errors)
    assert (low <= together).all(), together
    assert (together <= high).all(), together
    assert covered(fit.standard_errors)[0] < 0.7  # without the constant
    # A function of parameter and constant: their errors are correlated.
    total = propagate(fit, lambda model: model.D[0, 0] + model.D[0, 2], considered=result)
    variance = SIGMA**2 * inverse[0, 0] + (C_DEVIATION * (K[0] + 1)) ** 2
    np.testing.assert_allclose(total.standard_errors, np.sqrt(variance), rtol=1e-9)
    assert "by D[0,2]" in str(result)


@pytest.fixture(scope="module")
def swings():
    """Two records of a pendulum without noise, and its model."""
    model, made = Pendulum(stiffness=4.0, damping=0.3, torque=1.5), []
    for x0 in ((0.4, 0.0), (-0.2, 1.0)):
        t = 0.05 * np.arange(110)
        u = 2.0 * np.sin(0.9 * t) + (t > 2.0)
        theta = np.array([4.0, 0.3, 1.5])
        made.append((t, u, rk4(pendulum_rhs, t, u, np.array(x0), theta)))
    return model, as_records(made, model)


def test_gain_equals_difference_of_refits(swings):
    """The torque is fixed; the initial states of both records are free. Step 1e-4: the
    difference is right to 1e-7 of the curvature.
    """
    model, records = swings
    likelihood = jaxid.OutputError(jaxid.FixedNoise([0.02**2, 0.06**2]))
    chosen = jaxid.free(model, "stiffness", "damping", per_record=("initial_state",))

    def fitted(torque):
        start = Pendulum(stiffness=4.0, damping=0.3, torque=torque)
        return jaxid.estimate(start, chosen, records, likelihood)

    result = consider(fitted(1.5), records, likelihood, {"torque": 0.05})
    step = 1e-4
    high, low = fitted(1.5 + step), fitted(1.5 - step)
    np.testing.assert_allclose(
        result.gain[:, 0], (high.values - low.values) / (2 * step), rtol=1e-5, atol=1e-7
    )
    total = np.asarray(result.own_gain[..., 0]) + np.einsum(
        "cop,p->co", _reaction(fitted(1.5)), np.asarray(result.gain[:, 0])
    )
    np.testing.assert_allclose(total, (high.own - low.own) / (2 * step), rtol=1e-5, atol=1e-7)


def _reaction(fit):
    own = fit.information.own
    return -np.asarray(own.inverse) @ np.asarray(own.coupling)


def test_faulty_constants_are_refused(considered):
    fit, _ = considered
    model, u, likelihood = regression()
    data = record(np.arange(ROWS * 1.0), u, u @ TRUTH, inputs=model.inputs, outputs=("y",))
    with pytest.raises(InputError, match="is free"):
        consider(fit, data, likelihood, {"D[0,0]": 0.1})
    with pytest.raises(InputError, match="must be positive"):
        consider(fit, data, likelihood, {"D[0,2]": 0.0})
    with pytest.raises(InputError, match="no fixed constant 'mass'"):
        consider(fit, data, likelihood, {"mass": 1.0})
