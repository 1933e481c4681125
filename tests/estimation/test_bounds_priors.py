"""Bounds are honoured and told; a prior is one more measurement."""

import numpy as np
import pytest
from reference_estimation import Lag, lag_rhs, rk4

from jaxid.data import record
from jaxid.estimation import OutputError, estimate
from jaxid.models import FixedNoise, LinearModel, free

SIGMA = 0.05


def lag_record(seed, n=150, p=1.5, b=2.0, x0=0.3):
    t = 0.05 * np.arange(n)
    u = np.sign(np.sin(1.1 * t))
    z = rk4(lag_rhs, t, u, np.array([x0]), np.array([p, b]))
    z = z + SIGMA * np.random.default_rng(seed).normal(size=z.shape)
    return record(t, u, z, inputs=("u",), outputs=("x",))


KNOWN = OutputError(noise=FixedNoise([SIGMA**2]))


@pytest.mark.parametrize(("low", "high", "edge"), [(2.0, None, 2.0), (None, 1.2, 1.2)])
def test_a_parameter_on_its_bound_is_held_there_and_told(seed, low, high, edge):
    data, start = lag_record(seed), 2.5 if low else 1.0
    model = Lag(p=start, b=1.0)
    chosen = free(model, "p", "b", per_record=("initial_state",), bounds={"p": (low, high)})
    found = estimate(model, chosen, data, KNOWN)
    assert "on its bound" in found.status
    assert bool(found.successful)
    assert found.value("p") == edge
    assert np.isnan(found.standard_error("p"))
    fixed = Lag(p=edge, b=1.0)
    other = estimate(fixed, free(fixed, "b", per_record=("initial_state",)), data, KNOWN)
    np.testing.assert_allclose(found.value("b"), other.value("b"), rtol=1e-8)
    np.testing.assert_allclose(found.standard_error("b"), other.standard_error("b"), rtol=1e-8)
    np.testing.assert_allclose(found.own, other.own, rtol=1e-8)
    np.testing.assert_allclose(found.own_errors, other.own_errors, rtol=1e-8)


def test_a_bound_that_is_left_alone_changes_nothing(seed):
    data, model = lag_record(seed), Lag(p=1.0, b=1.0)
    inside = estimate(model, free(model, "p", "b", bounds={"p": (0.0, 5.0)}), data, KNOWN)
    without = estimate(model, free(model, "p", "b"), data, KNOWN)
    assert inside.status == "converged"
    np.testing.assert_allclose(inside.values, without.values, rtol=1e-9)
    np.testing.assert_allclose(inside.standard_errors, without.standard_errors, rtol=1e-9)


def test_a_start_on_the_bound_can_leave_it(seed):
    data, model = lag_record(seed), Lag(p=0.5, b=1.0)
    found = estimate(model, free(model, "p", "b", bounds={"p": (0.5, None)}), data, KNOWN)
    assert found.status == "converged"
    assert abs(found.value("p") - 1.5) < 5 * found.standard_error("p")


def static(gain):
    """`y = D u`: the state is there for form's sake and stays zero."""
    return LinearModel([[-1.0]], [[0.0]], [[0.0]], [[gain]], states=("x",), inputs=("u",), outputs=("y",))


def static_record(seed, gain=2.0):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=40)
    return (
        u,
        (z := gain * u + SIGMA * rng.normal(size=40)),
        record(np.arange(40.0), u, z, inputs=("u",), outputs=("y",)),
    )


def test_a_prior_is_a_measurement_of_the_parameter(seed):
    u, z, data = static_record(seed)
    mean, deviation = 2.1, 0.01
    model = static(0.0)
    found = estimate(model, free(model, "D", prior={"D[0,0]": (mean, deviation)}), data, KNOWN)
    information = u @ u / SIGMA**2 + 1 / deviation**2
    np.testing.assert_allclose(found.values, (u @ z / SIGMA**2 + mean / deviation**2) / information, rtol=1e-10)
    np.testing.assert_allclose(found.standard_errors, information**-0.5, rtol=1e-10)
    # The same as one more sample of unit input, seen with the prior's deviation.
    v = z - u * found.value("D[0,0]")
    prior = ((found.value("D[0,0]") - mean) / deviation) ** 2
    np.testing.assert_allclose(found.cost, 0.5 * v @ v / SIGMA**2 + 0.5 * prior + 40 * np.log(SIGMA), rtol=1e-10)


def test_a_prior_alone_determines_what_the_data_do_not(seed):
    """The input matrix of a state that is not seen: its prior comes back, and nothing is weak."""
    _, _, data = static_record(seed)
    model = static(0.0)
    found = estimate(model, free(model, "B", "D", prior={"B[0,0]": (0.7, 0.2)}), data, KNOWN)
    np.testing.assert_allclose(found.value("B[0,0]"), 0.7, rtol=1e-9)
    np.testing.assert_allclose(found.standard_error("B[0,0]"), 0.2, rtol=1e-9)


def test_a_prior_can_pull_a_parameter_off_the_bound_that_the_data_push_against(seed):
    u, z, data = static_record(seed, gain=-0.1)
    model = static(0.0)
    prior = {"D[0,0]": (0.5, 0.002)}
    found = estimate(model, free(model, "D", bounds={"D[0,0]": (0.0, None)}, prior=prior), data, KNOWN)
    information = u @ u / SIGMA**2 + 1 / 0.002**2
    expected = (u @ z / SIGMA**2 + 0.5 / 0.002**2) / information
    assert expected > 0
    assert found.status == "converged"
    np.testing.assert_allclose(found.values, expected, rtol=1e-9)


def test_a_bound_on_a_per_record_parameter_is_honoured(seed):
    data, model = lag_record(seed, x0=0.3), Lag(p=1.0, b=1.0)
    bounds = {"initial_state.x": (None, 0.0)}
    found = estimate(model, free(model, "p", "b", per_record=("initial_state",), bounds=bounds), data, KNOWN)
    assert float(found.own[0, 0]) == 0.0
    at_zero = estimate(_FromZero(p=1.0, b=1.0), free(model, "p", "b"), data, KNOWN)
    np.testing.assert_allclose(found.values, at_zero.values, rtol=1e-8)
    np.testing.assert_allclose(found.standard_errors, at_zero.standard_errors, rtol=1e-8)
    assert "on its bound" in found.status
    assert np.isnan(found.own_errors[0, 0])


class _FromZero(Lag):
    """The lag from rest."""

    def initial_state(self, record):
        return 0.0 * record.z[0]
