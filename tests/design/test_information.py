"""Information of planned inputs: against finite differences, and against realised scatter."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import SIGMA, Spring

from jaxid import FixedNoise, OutputError, estimate, free, simulate
from jaxid._foundation.checks import InputError
from jaxid.design import information, signals
from jaxid.design.measures import Trace

SPRING = Spring(jnp.array(1.5), jnp.array(0.2))
KNOWN = OutputError(FixedNoise(jnp.array([SIGMA**2])))
T = signals.sample_times(12.0, 0.1)
START = jnp.array([0.3, 0.0])
DRAWS = 500


@pytest.fixture(scope="module")
def record():
    pulses = signals.alternating_pulses(T, (1.2, 0.8, 0.4, 0.4), 1.0)
    signal = signals.combine(T, {"force": pulses}, ("force",), name="3-2-1-1")
    return information.planned_record(SPRING, signal, KNOWN, initial_state=START)


@pytest.fixture(scope="module")
def chosen():
    return free(SPRING, "k", "c", per_record=("initial_state",))


@pytest.fixture(scope="module")
def planned(record, chosen):
    return information.information_of(SPRING, chosen, record, KNOWN, initial_state=START)


def test_information_equals_finite_differences(record, planned):
    """Sensitivities by differences of simulations; the initial state is projected out by NumPy."""

    def outputs(theta):
        model = Spring(jnp.array(theta[0]), jnp.array(theta[1]))
        return np.asarray(simulate(model, T, record.u, jnp.array(theta[2:])).y).ravel()

    theta, h = np.array([1.5, 0.2, 0.3, 0.0]), 1e-6
    steps = h * np.eye(4)
    S = np.stack([(outputs(theta + d) - outputs(theta - d)) / (2 * h) for d in steps], 1) / SIGMA
    errors = np.sqrt(np.diagonal(np.linalg.inv(S.T @ S)))[:2]
    np.testing.assert_allclose(planned.standard_errors, errors, rtol=1e-6)


def test_predicted_standard_errors_equal_realised_scatter(record, chosen, planned):
    """500 flights; a standard deviation from so many draws is known to 3.2 % (one sigma)."""
    noise = SIGMA * jax.random.normal(jax.random.key(1974), (DRAWS, *record.z.shape))

    def fit(noise):
        noisy = eqx.tree_at(lambda r: r.z, record, record.z + noise)
        return estimate(SPRING, chosen, noisy, KNOWN).values

    values = eqx.filter_jit(jax.vmap(fit))(noise)
    ratio = jnp.std(values, axis=0) / planned.standard_errors
    np.testing.assert_allclose(ratio, 1.0, atol=3.3 * 0.032 + 0.01)


def test_earlier_flights_and_priors_add_information(record, chosen, planned):
    double = information.planned_information(
        SPRING, chosen, planned.values, np.concatenate([planned.factor] * 2), "two"
    )
    np.testing.assert_allclose(double.standard_errors, planned.standard_errors / np.sqrt(2))
    known = free(SPRING, "k", "c", prior={"k": (1.5, 1e-6)})
    np.testing.assert_allclose(information.prior_rows(known), np.diag([1e6, 0.0]))


def test_words_and_table_name_the_result(record, planned):
    assert "well, to" in str(planned)
    table = information.compare_inputs([planned, planned], Trace([1.0, 1.0]))
    assert table.splitlines()[0].split() == ["standard", "error", "3-2-1-1", "3-2-1-1"]
    assert table.splitlines()[-1].startswith("measure")


def test_input_at_rest_determines_nothing(chosen, record):
    rest = eqx.tree_at(lambda r: r.u, record, jnp.zeros_like(record.u))
    shown = information.information_of(SPRING, chosen, rest, KNOWN, initial_state=jnp.zeros(2))
    assert shown.undetermined == ("k", "c")
    assert str(shown).splitlines()[1].split() == ["k", "1.5", "inf", "not"]


def test_unknown_noise_and_other_channels_are_refused(chosen, record):
    with pytest.raises(InputError, match="noise covariance is unknown"):
        information.information_of(SPRING, chosen, record, OutputError())
    wrong = signals.combine(T, {"torque": T}, ("torque",))
    with pytest.raises(InputError, match=r"moves \(torque\)"):
        information.planned_record(SPRING, wrong, KNOWN)


def test_given_initial_state_fills_the_first_states(record):
    shared = free(SPRING, "k", "c")

    def errors(state):
        planned = information.information_of(SPRING, shared, record, KNOWN, initial_state=state)
        return planned.standard_errors.tolist()

    assert errors(jnp.array([1.0])) == errors(jnp.array([1.0, 0.0]))
    assert errors(jnp.array([1.0])) != errors(jnp.array([0.0, 1.0]))
    with pytest.raises(InputError, match=r"has 3 values, and the model has 2 states"):
        errors(jnp.array([9.0, 1.0, 0.0]))
