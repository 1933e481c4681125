"""Smoothers: exact where the method is, the noise they claim to leave, cut-offs that they find."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from jaxid._foundation.checks import InputError
from jaxid.data import Fourier, LocalPolynomial, SmoothingSpline
from jaxid.data.smoothing_fourier import _score
from jaxid.data.smoothing_method import cross_validation
from jaxid.data.smoothing_spline import _bands, _fit, _gains, _penalty

STEP = 0.02
METHODS = (LocalPolynomial, SmoothingSpline, Fourier)
SIGMA = 0.1


def manoeuvre(t):
    """Something like a pitch rate after a step, and its derivative."""
    fall, turn = np.exp(-0.4 * t), 2.5 * t
    value = 0.2 * t + 2 * fall * np.sin(turn)
    return value, 0.2 + 2 * fall * (2.5 * np.cos(turn) - 0.4 * np.sin(turn))


def noisy(t, seed):
    return manoeuvre(t)[0] + SIGMA * np.random.default_rng(seed).normal(size=len(t))


def rms(x):
    return float(np.sqrt(np.mean(x**2)))


T = np.arange(600) * STEP


def test_a_local_polynomial_passes_its_own_order():
    x = (T - 3.0) / 3.0
    found = LocalPolynomial(window=31, order=3)(T, 1 + x - 2 * x**2 + x**3)
    np.testing.assert_allclose(found.value, 1 + x - 2 * x**2 + x**3, atol=1e-11)  # rounding of numbers up to 20
    np.testing.assert_allclose(found.derivative, (1 - 4 * x + 3 * x**2) / 3.0, atol=1e-10)
    assert found.noise < 1e-11


@pytest.mark.parametrize("method", METHODS)
def test_a_straight_line_passes(method):
    found = method(2.0)(T, 3.0 - 2.0 * T)
    np.testing.assert_allclose(found.value, 3.0 - 2.0 * T, atol=1e-10)  # rounding of numbers up to 20
    np.testing.assert_allclose(found.derivative, -2.0, atol=1e-8)  # the same, divided by the step


def test_the_spline_is_that_of_scipy_on_uneven_times():
    rng = np.random.default_rng(0)
    t, z = np.cumsum(rng.uniform(0.01, 0.03, 200)), rng.normal(size=200)
    step = np.mean(np.diff(t))
    reference = make_smoothing_spline(t, z, lam=_penalty(4.0 * step) * step**3)
    found = SmoothingSpline(4.0)(t, z)
    np.testing.assert_allclose(found.value, reference(t), atol=1e-9)  # scipy works in B-splines, with their condition
    np.testing.assert_allclose(found.derivative, reference.derivative()(t), atol=1e-7)


def test_a_sine_of_the_series_is_scaled_by_the_wiener_filter():
    length = T[-1]
    wave, frequency = 9 * np.pi / length, 9 / (2 * length)
    share = 1 / (1 + (frequency / 1.1) ** 6)
    found = Fourier(1.1)(T, np.sin(wave * T))
    # the line takes a little of a sine that has a mean: 6 parts in 1,000, and 12 of the slope, at the ends
    np.testing.assert_allclose(found.value, share * np.sin(wave * T), atol=1e-2)
    np.testing.assert_allclose(found.derivative, share * wave * np.cos(wave * T), atol=5e-2)


@pytest.mark.parametrize("method", METHODS)
def test_half_of_the_amplitude_passes_at_the_cutoff(method):
    cutoff = method(3.0)(T, noisy(T, 0)).cutoff_hz
    assert cutoff == pytest.approx(3.0, rel=0.1)  # windows come in steps of two samples
    wave = 2 * np.pi * cutoff
    found = method(3.0)(T, np.cos(wave * T))
    middle = slice(200, 400)  # two seconds from the ends
    np.testing.assert_allclose(found.value[middle], 0.5 * np.cos(wave * T[middle]), atol=1e-5)
    assert np.max(np.abs(found.derivative[middle])) < 1.4 * 0.5 * wave  # the slope of a polynomial passes a little more


@pytest.mark.parametrize("method", METHODS)
def test_the_weights_are_those_of_the_method(method):
    t = T[:61]
    whole = [method(4.0).linear(t, row) for row in np.eye(len(t))]
    H, D = (np.stack([getattr(one, name) for one in whole], axis=1) for name in ("value", "derivative"))
    np.testing.assert_allclose(whole[0].value_gain, np.sum(H**2, axis=1), rtol=1e-10)
    np.testing.assert_allclose(whole[0].derivative_gain, np.sum(D**2, axis=1), rtol=1e-10)
    np.testing.assert_allclose(whole[0].trace, np.trace(H), rtol=1e-6)  # a central difference for the spline


def test_the_weights_of_a_long_spline_come_in_blocks():
    steps = np.random.default_rng(0).uniform(0.5, 1.5, 699)  # three blocks, and weights that reach over 40 samples
    whole = _fit(np.eye(700), 1.0, _bands(steps))
    for gain, weights in zip(_gains(steps, 1.0), whole, strict=True):
        np.testing.assert_allclose(gain, np.sum(weights**2, axis=1), rtol=1e-9)


def test_the_score_of_a_fourier_filter_is_that_of_what_it_does():
    z, found = noisy(T, 0), Fourier(1.5).linear(T, noisy(T, 0))
    direct = cross_validation(float(np.sum((z - found.value) ** 2)), len(z), found.trace)
    np.testing.assert_allclose(_score(z, STEP)(1.5), direct, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_the_noise_is_what_it_says(method):
    t, draws = T[:200], 300
    truth, rate = manoeuvre(t)
    found = [method(3.0)(t, noisy(t, seed)) for seed in range(draws)]
    band = 3.29 * np.sqrt(2 / draws)  # 99.9 % for a variance of normal numbers
    # a signal that the smoother changes a little, and 200 samples: 3.29 sqrt(2 / (300 * 170)), and 2 % for the change
    assert np.mean([one.noise**2 for one in found]) == pytest.approx(SIGMA**2, rel=0.02 + 0.021)
    clean = method(3.0)(t, truth)
    for row in (0, 20, 100):
        value = [one.value[row] - clean.value[row] for one in found]
        derivative = [one.derivative[row] - clean.derivative[row] for one in found]
        assert np.mean(np.square(value)) == pytest.approx(
            np.mean([one.value_noise[row] ** 2 for one in found]), rel=band
        )
        claimed = np.mean([one.derivative_noise[row] ** 2 for one in found])
        assert np.mean(np.square(derivative)) == pytest.approx(claimed, rel=band)
    assert rms(clean.derivative - rate) < rms(found[0].derivative_noise)  # noise is what matters at this cut-off


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", range(3))
def test_the_estimated_cutoff_is_nearly_the_best(method, seed):
    z, (truth, rate) = noisy(T, seed), manoeuvre(T)
    found = method()(T, z)
    tried = [method(cutoff)(T, z) for cutoff in np.geomspace(0.5, 4.0, 10)]
    assert rms(found.value - truth) < 1.3 * min(rms(one.value - truth) for one in tried)
    assert rms(found.derivative - rate) < 0.1 * rms(np.gradient(z, T) - rate)  # naive differences
    assert found.noise == pytest.approx(SIGMA, rel=3.29 / np.sqrt(2 * 560) + 0.01)


@pytest.mark.parametrize("seed", range(4))
def test_fourier_finds_where_signal_and_noise_are_equal(seed):
    rng, sine, n = np.random.default_rng(seed), 40, 1000
    k = np.arange(1, n - 1)
    amplitudes = SIGMA * (sine / k) ** 3 * rng.normal(size=n - 2)  # the spectrum for which the filter is optimal
    t = np.arange(n) * STEP
    signal = np.sqrt(2 / (n - 1)) * np.sin(np.pi * np.outer(np.arange(n), k) / (n - 1)) @ amplitudes
    found = Fourier()(t, signal + 0.3 * t + SIGMA * rng.normal(size=n))
    assert found.cutoff_hz == pytest.approx(sine / (2 * t[-1]), rel=0.35)  # 40 sines tell a corner to about a sixth
    assert found.noise == pytest.approx(SIGMA, rel=0.1)


REFUSALS = {
    "uneven": (Fourier(), np.sort(np.append(T[:-1], 0.001)), {}, ["Fourier needs evenly", "row 0", "SmoothingSpline"]),
    "backwards": (Fourier(), T[::-1], {}, ["do not increase"]),
    "too few": (Fourier(), T[:5], {}, ["5 samples", "at least 8"]),
    "above Nyquist": (SmoothingSpline(30.0), T, {}, ["30.0 Hz", "to 25 Hz"]),
    "too low": (LocalPolynomial(0.01), T, {}, ["0.01 Hz", "Choose"]),
    "missing": (Fourier(), T, {3: np.nan}, ["nan at row 3", "Fill the gap"]),
    "long window": (LocalPolynomial(window=601), T, {}, ["window is 601", "600"]),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_refusals(case):
    method, t, changes, words = REFUSALS[case]
    z = np.sin(t)
    for row, value in changes.items():
        z[row] = value
    with pytest.raises(InputError) as caught:
        method(t, z)
    for word in words:
        assert word in str(caught.value), f"{word!r} is not in: {caught.value}"


@pytest.mark.parametrize(
    "options", [{"window": 10}, {"window": 5, "order": 4}, {"order": 0}, {"cutoff_hz": 1, "window": 9}]
)
def test_refused_options(options):
    with pytest.raises(InputError, match="LocalPolynomial"):
        LocalPolynomial(**options)
