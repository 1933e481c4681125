"""Smoothers: exact cases, noise estimates, and estimated cut-offs."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from jaxid._foundation.checks import InputError
from jaxid.data.smoothing import Fourier, LocalPolynomial, SmoothingSpline
from jaxid.data.smoothing.fourier import _score
from jaxid.data.smoothing.method import cross_validation
from jaxid.data.smoothing.spline import _bands, _fit, _gains, _penalty

STEP = 0.02
METHODS = (LocalPolynomial, SmoothingSpline, Fourier)
SIGMA = 0.1


def manoeuvre(t):
    """Signal similar to a pitch rate after a step, and its derivative."""
    fall, turn = np.exp(-0.4 * t), 2.5 * t
    value = 0.2 * t + 2 * fall * np.sin(turn)
    return value, 0.2 + 2 * fall * (2.5 * np.cos(turn) - 0.4 * np.sin(turn))


def noisy(t, seed):
    return manoeuvre(t)[0] + SIGMA * np.random.default_rng(seed).normal(size=len(t))


def rms(x):
    return float(np.sqrt(np.mean(x**2)))


T = np.arange(600) * STEP


def test_local_polynomial_passes_polynomial_of_its_order():
    x = (T - 3.0) / 3.0
    result = LocalPolynomial(window=31, order=3)(T, 1 + x - 2 * x**2 + x**3)
    # rounding of numbers up to 20
    np.testing.assert_allclose(result.value, 1 + x - 2 * x**2 + x**3, atol=1e-11)
    np.testing.assert_allclose(result.derivative, (1 - 4 * x + 3 * x**2) / 3.0, atol=1e-10)
    assert result.noise < 1e-11


@pytest.mark.parametrize("method", METHODS)
def test_straight_line_passes_every_smoother(method):
    result = method(2.0)(T, 3.0 - 2.0 * T)
    # rounding of numbers up to 20
    np.testing.assert_allclose(result.value, 3.0 - 2.0 * T, atol=1e-10)
    np.testing.assert_allclose(result.derivative, -2.0, atol=1e-8)  # the same, divided by the step


def test_spline_on_uneven_times_equals_scipy():
    rng = np.random.default_rng(0)
    t, z = np.cumsum(rng.uniform(0.01, 0.03, 200)), rng.normal(size=200)
    step = np.mean(np.diff(t))
    reference = make_smoothing_spline(t, z, lam=_penalty(4.0 * step) * step**3)
    result = SmoothingSpline(4.0)(t, z)
    # scipy works in B-splines, with their condition
    np.testing.assert_allclose(result.value, reference(t), atol=1e-9)
    np.testing.assert_allclose(result.derivative, reference.derivative()(t), atol=1e-7)


def test_sine_of_series_is_scaled_by_wiener_filter():
    length = T[-1]
    wave, frequency = 9 * np.pi / length, 9 / (2 * length)
    share = 1 / (1 + (frequency / 1.1) ** 6)
    result = Fourier(1.1)(T, np.sin(wave * T))
    # The line fits a part of a sine with a mean: 6 parts in 1,000, and 12 of the slope, at the
    # ends.
    np.testing.assert_allclose(result.value, share * np.sin(wave * T), atol=1e-2)
    np.testing.assert_allclose(result.derivative, share * wave * np.cos(wave * T), atol=5e-2)


@pytest.mark.parametrize("method", METHODS)
def test_half_of_amplitude_passes_at_cutoff(method):
    cutoff = method(3.0)(T, noisy(T, 0)).cutoff_hz
    assert cutoff == pytest.approx(3.0, rel=0.1)  # windows come in steps of two samples
    wave = 2 * np.pi * cutoff
    result = method(3.0)(T, np.cos(wave * T))
    middle = slice(200, 400)  # two seconds from the ends
    np.testing.assert_allclose(result.value[middle], 0.5 * np.cos(wave * T[middle]), atol=1e-5)
    # The slope of the local polynomial passes slightly more than one half.
    assert np.max(np.abs(result.derivative[middle])) < 1.4 * 0.5 * wave


@pytest.mark.parametrize("method", METHODS)
def test_gains_and_trace_equal_those_of_smoothing_matrix(method):
    t = T[:61]
    results = [method(4.0).linear(t, row) for row in np.eye(len(t))]
    H, D = (
        np.stack([getattr(result, name) for result in results], axis=1)
        for name in ("value", "derivative")
    )
    np.testing.assert_allclose(results[0].value_gain, np.sum(H**2, axis=1), rtol=1e-10)
    np.testing.assert_allclose(results[0].derivative_gain, np.sum(D**2, axis=1), rtol=1e-10)
    # a central difference for the spline
    np.testing.assert_allclose(results[0].trace, np.trace(H), rtol=1e-6)


def test_gains_of_long_spline_equal_those_of_one_block():
    # three blocks, and weights that reach over 40 samples
    steps = np.random.default_rng(0).uniform(0.5, 1.5, 699)
    full = _fit(np.eye(700), 1.0, _bands(steps))
    for gain, weights in zip(_gains(steps, 1.0), full, strict=True):
        np.testing.assert_allclose(gain, np.sum(weights**2, axis=1), rtol=1e-9)


def test_score_of_fourier_filter_equals_cross_validation_of_its_result():
    z, result = noisy(T, 0), Fourier(1.5).linear(T, noisy(T, 0))
    direct = cross_validation(float(np.sum((z - result.value) ** 2)), len(z), result.trace)
    np.testing.assert_allclose(_score(z, STEP)(1.5), direct, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_noise_estimates_equal_scatter_of_repeated_smoothing(method):
    t, draws = T[:200], 300
    truth, rate = manoeuvre(t)
    results = [method(3.0)(t, noisy(t, seed)) for seed in range(draws)]
    band = 3.29 * np.sqrt(2 / draws)  # 99.9 % for a variance of normal numbers
    # Band for 300 draws of 200 samples, 3.29 sqrt(2 / (300 * 170)), and 2 % because the smoother
    # changes the signal a little.
    assert np.mean([result.noise**2 for result in results]) == pytest.approx(
        SIGMA**2, rel=0.02 + 0.021
    )
    clean = method(3.0)(t, truth)
    for row in (0, 20, 100):
        value = [result.value[row] - clean.value[row] for result in results]
        derivative = [result.derivative[row] - clean.derivative[row] for result in results]
        assert np.mean(np.square(value)) == pytest.approx(
            np.mean([result.value_noise[row] ** 2 for result in results]), rel=band
        )
        claimed = np.mean([result.derivative_noise[row] ** 2 for result in results])
        assert np.mean(np.square(derivative)) == pytest.approx(claimed, rel=band)
    # At this cut-off the noise is larger than the bias.
    assert rms(clean.derivative - rate) < rms(results[0].derivative_noise)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", range(3))
def test_estimated_cutoff_has_nearly_least_error(method, seed):
    z, (truth, rate) = noisy(T, seed), manoeuvre(T)
    result = method()(T, z)
    candidates = [method(cutoff)(T, z) for cutoff in np.geomspace(0.5, 4.0, 10)]
    assert rms(result.value - truth) < 1.3 * min(rms(other.value - truth) for other in candidates)
    assert rms(result.derivative - rate) < 0.1 * rms(np.gradient(z, T) - rate)  # naive differences
    assert result.noise == pytest.approx(SIGMA, rel=3.29 / np.sqrt(2 * 560) + 0.01)


@pytest.mark.parametrize("seed", range(4))
def test_fourier_cutoff_is_where_signal_and_noise_are_equal(seed):
    rng, sine, n = np.random.default_rng(seed), 40, 1000
    k = np.arange(1, n - 1)
    # the spectrum for which the filter is optimal
    amplitudes = SIGMA * (sine / k) ** 3 * rng.normal(size=n - 2)
    t = np.arange(n) * STEP
    signal = np.sqrt(2 / (n - 1)) * np.sin(np.pi * np.outer(np.arange(n), k) / (n - 1)) @ amplitudes
    result = Fourier()(t, signal + 0.3 * t + SIGMA * rng.normal(size=n))
    # With 40 sines the corner is known to about a sixth.
    assert result.cutoff_hz == pytest.approx(sine / (2 * t[-1]), rel=0.35)
    assert result.noise == pytest.approx(SIGMA, rel=0.1)


REFUSALS = {
    "uneven": (
        Fourier(),
        np.sort(np.append(T[:-1], 0.001)),
        {},
        ["Fourier needs evenly", "row 0", "SmoothingSpline"],
    ),
    "backwards": (Fourier(), T[::-1], {}, ["do not increase"]),
    "too few": (Fourier(), T[:5], {}, ["5 samples", "at least 8"]),
    "above Nyquist": (SmoothingSpline(30.0), T, {}, ["30.0 Hz", "to 25 Hz"]),
    "too low": (LocalPolynomial(0.01), T, {}, ["0.01 Hz", "Choose"]),
    "missing": (Fourier(), T, {3: np.nan}, ["nan at row 3", "Fill the gap"]),
    "high order": (LocalPolynomial(order=7), T[:8], {}, ["order 7", "at least 9", "has 8"]),
    "long window": (LocalPolynomial(window=601), T, {}, ["window is 601", "600"]),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_invalid_signals_and_cutoffs_are_refused_with_reason(case):
    method, t, changes, words = REFUSALS[case]
    z = np.sin(t)
    for row, value in changes.items():
        z[row] = value
    with pytest.raises(InputError) as caught:
        method(t, z)
    for word in words:
        assert word in str(caught.value), f"{word!r} is not in: {caught.value}"


@pytest.mark.parametrize(
    "options",
    [{"window": 10}, {"window": 5, "order": 4}, {"order": 0}, {"cutoff_hz": 1, "window": 9}],
)
def test_invalid_options_of_local_polynomial_are_refused(options):
    with pytest.raises(InputError, match="LocalPolynomial"):
        LocalPolynomial(**options)
