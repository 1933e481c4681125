"""Energy-limited inputs of linear models: eigenvectors, closed forms, and the frequency domain."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring

from jaxid import AbstractModel, FixedNoise, LinearModel, OutputError, free
from jaxid._foundation.checks import InputError
from jaxid.design import (
    Combination,
    Determinant,
    InputSignal,
    Trace,
    energy_limited_input,
    information_of,
    optimal_spectrum,
    planned_record,
    sample_times,
)

A, B, SIGMA, STEP, ENERGY = 0.8, 2.0, 0.1, 0.1, 3.0
LAG = LinearModel([[-A]], [[B]], [[1.0]], [[0.0]], states=("x",), inputs=("u",), outputs=("y",))
KNOWN = OutputError(FixedNoise(jnp.array([SIGMA**2])))
SPRING = Spring(jnp.array(1.5), jnp.array(0.6))


class Cubic(AbstractModel):
    """A model that is not linear."""

    k: jnp.ndarray
    states, inputs, outputs = ("x",), ("force",), ("x",)

    def rhs(self, t, x, u):
        return u - self.k * x**3

    def output(self, t, x, u):
        return x


def test_input_for_one_parameter_is_the_singular_vector_of_a_dense_matrix():
    """The sensitivities to b of a lag from rest, by the unit responses of all samples."""
    t = sample_times(6.0, STEP)
    only = free(LAG, "B[0,0]")
    design = energy_limited_input(LAG, only, t, Combination([1.0]), KNOWN, ENERGY)
    units = np.eye(t.size)
    phi = np.exp(-A * STEP)
    gain = (1 - phi) / A
    columns = []
    for unit in units:  # linear between samples, exactly integrated
        x, row = 0.0, [0.0]
        for first, last in itertools.pairwise(unit):
            slope = (last - first) / STEP
            x = phi * x + gain * first + slope * (STEP - gain) / A
            row += [x]
        columns.append(row)
    dense = np.array(columns).T / SIGMA
    size = np.linalg.svd(dense, compute_uv=False)[0] * np.sqrt(ENERGY / STEP)
    np.testing.assert_allclose(design.cost, -2.0 * np.log(size), atol=1e-4)
    np.testing.assert_allclose(STEP * np.sum(np.square(design.signal.u)), ENERGY, rtol=1e-9)


def test_priors_count_in_the_design():
    """A prior far sharper than the record leaves its parameter at the prior's deviation, and the
    input is made for the other one.
    """
    t = sample_times(6.0, STEP)
    known = free(LAG, "A[0,0]", "B[0,0]", prior={"A[0,0]": (-A, 1e-4)})
    joint = energy_limited_input(LAG, known, t, Determinant(), KNOWN, ENERGY)
    alone = energy_limited_input(LAG, free(LAG, "B[0,0]"), t, Combination([1.0]), KNOWN, ENERGY)
    errors = joint.information.standard_errors
    np.testing.assert_allclose(errors, [1e-4, np.exp(0.5 * alone.cost)], rtol=1e-3)
    planned = information_of(LAG, known, joint.record, KNOWN)
    np.testing.assert_allclose(errors, planned.standard_errors, rtol=1e-6)


@pytest.mark.parametrize(
    ("model", "names"), [(LAG, ("A[0,0]", "B[0,0]")), (SPRING, ("k", "c"))], ids=["lag", "spring"]
)
def test_time_and_frequency_domain_agree_on_a_long_record(model, names):
    """First and second order; the ends of the record are 2 % of it, and free in time."""
    t, chosen = sample_times(120.0, STEP), free(model, *names)
    design = energy_limited_input(model, chosen, t, Determinant(), KNOWN, ENERGY)
    grid = np.linspace(0.005, 0.6, 240)
    spectrum = optimal_spectrum(model, chosen, grid, Determinant(), KNOWN, sample_time=STEP)
    predicted = spectrum.value - 2.0 * np.log(ENERGY)  # two parameters
    np.testing.assert_allclose(design.cost, predicted, atol=0.08)
    power = np.abs(np.fft.rfft(np.asarray(design.signal.u[:, 0]), 8 * t.size)) ** 2
    frequencies = np.fft.rfftfreq(8 * t.size, STEP)
    lines, shares = spectrum.lines
    mean = np.sum(frequencies * power) / np.sum(power)
    np.testing.assert_allclose(mean, np.sum(lines * shares), rtol=0.08)


def test_design_carries_its_own_information_and_is_best_of_random_inputs(seed):
    t, chosen = sample_times(10.0, STEP), free(SPRING, "k", "c")
    measure = Trace([1.0, 1.0])
    design = energy_limited_input(SPRING, chosen, t, measure, KNOWN, ENERGY)
    shown = information_of(SPRING, chosen, design.record, KNOWN, initial_state=jnp.zeros(2))
    np.testing.assert_allclose(np.log(shown.measure(measure)), design.cost, rtol=1e-6)
    u = np.random.default_rng(seed).normal(size=(20, t.size, 1))
    u *= np.sqrt(ENERGY / STEP) / np.linalg.norm(u, axis=1, keepdims=True)
    for one in u:
        signal = InputSignal(t, jnp.asarray(one), ("force",), "random")
        record = planned_record(SPRING, signal, KNOWN)
        random = information_of(SPRING, chosen, record, KNOWN, initial_state=jnp.zeros(2))
        assert np.log(random.measure(measure)) > design.cost + 0.5


def test_models_that_are_not_linear_and_free_starts_are_refused():
    t = sample_times(2.0, STEP)
    cubic = Cubic(jnp.array(1.0))
    with pytest.raises(InputError, match="not linear"):
        energy_limited_input(cubic, free(cubic, "k"), t, Combination([1.0]), KNOWN, ENERGY)
    blind = LinearModel(
        [[-A]], [[0.0]], [[1.0]], [[1.0]], states=("x",), inputs=("u",), outputs=("y",)
    )
    with pytest.raises(InputError, match="No input of these axes shows A"):
        energy_limited_input(blind, free(blind, "A[0,0]"), t, Determinant(), KNOWN, ENERGY)
    with pytest.raises(InputError, match="energy is -1"):
        energy_limited_input(SPRING, free(SPRING, "k"), t, Determinant(), KNOWN, -1.0)
    started = free(SPRING, "k", per_record=("initial_state",))
    with pytest.raises(InputError, match="at rest"):
        energy_limited_input(SPRING, started, t, Combination([1.0]), KNOWN, ENERGY)
    with pytest.raises(InputError, match="input"):
        energy_limited_input(
            SPRING, free(SPRING, "k"), t, Combination([1.0]), KNOWN, ENERGY, axes=("rudder",)
        )
