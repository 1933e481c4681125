"""Optimal spectra against closed forms and an independent minimisation, and against time domain."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from jaxid import FixedNoise, LinearModel, OutputError, free
from jaxid._foundation.checks import InputError
from jaxid.design import information, signals
from jaxid.design.linear import frequency
from jaxid.design.measures import Combination, Determinant

A, B, SIGMA, STEP = 0.8, 2.0, 0.1, 0.05
LAG = LinearModel([[-A]], [[B]], [[1.0]], [[0.0]], states=("x",), inputs=("u",), outputs=("y",))
KNOWN = OutputError(FixedNoise(jnp.array([SIGMA**2])))
GRID = np.linspace(0.002, 0.5, 250)
BOTH = free(LAG, "A[0,0]", "B[0,0]")


@pytest.fixture(scope="module")
def spectrum():
    return frequency.optimal_spectrum(LAG, BOTH, GRID, Determinant(), KNOWN, sample_time=STEP)


def information_matrix(omega):
    """Information per second of unit power for y = b/(s + a) u, from the derivatives by hand."""
    pole = 1j * omega + A
    derivative = np.array([B / pole**2, 1.0 / pole])  # by -a, which is A[0,0], and b
    return np.real(np.outer(derivative, derivative.conj())) / SIGMA**2 / STEP


def test_lag_has_one_line_at_the_frequency_of_an_independent_search(spectrum):
    """|M(omega)| of one line is largest at `omega^2 = a^2 / 3`; two lines do not beat it."""
    found = minimize(
        lambda w: -np.log(np.linalg.det(information_matrix(abs(w[0])))), [0.3], method="Nelder-Mead"
    )
    np.testing.assert_allclose(abs(found.x[0]), A / np.sqrt(3.0), rtol=1e-3)
    lines, shares = spectrum.lines
    np.testing.assert_allclose(lines, [A / np.sqrt(3.0) / 2 / np.pi], atol=2e-3)
    np.testing.assert_allclose(shares, [1.0], rtol=1e-6)
    assert spectrum.certificate < 1.001
    np.testing.assert_allclose(spectrum.value, found.fun, rtol=1e-4)


def test_gain_alone_is_best_shown_at_the_lowest_frequency():
    only = free(LAG, "B[0,0]")
    best = frequency.optimal_spectrum(LAG, only, GRID, Combination([1.0]), KNOWN, sample_time=STEP)
    np.testing.assert_allclose(best.lines[0], GRID[:1])


def test_realised_signal_gives_the_predicted_information_on_a_long_record(spectrum):
    """The predicted cost is that of one second of unit power; transients are 1 of 400 s."""
    t = signals.sample_times(400.0, STEP)
    signal = spectrum.realise(t, power=0.25)
    np.testing.assert_allclose(jnp.mean(signal.u[:-1] ** 2), 0.25, rtol=1e-6)
    record = information.planned_record(LAG, signal, KNOWN)
    flown = information.information_of(LAG, BOTH, record, KNOWN)
    predicted = spectrum.value - 2 * np.log(0.25 * 400.0)
    np.testing.assert_allclose(flown.measure(Determinant()), predicted, atol=0.03)


def test_unknown_noise_and_axis_are_refused():
    with pytest.raises(InputError, match="noise covariance is unknown"):
        frequency.optimal_spectrum(LAG, BOTH, GRID, Determinant(), OutputError(), sample_time=STEP)
    with pytest.raises(InputError, match="no input 'w'"):
        frequency.optimal_spectrum(
            LAG, BOTH, GRID, Determinant(), KNOWN, sample_time=STEP, axis="w"
        )
