"""Weak form: closed forms, quadrature, whitening, coverage, and refusals."""

import functools

import numpy as np
import pytest
import scipy.integrate
import scipy.stats

from jaxid._foundation.checks import InputError
from jaxid.structure import Minimum, choose, least_squares, stepwise, weak_form

T = 0.05 * np.arange(300)
RADIUS = 2.0  # s
NO_TERMS = (0.0, 0.0, 1.0)  # x'' alone
# x = sin(t) + sin(2.3 t) of x'' + c x' + k x = u
STIFFNESS, DAMPING = 2.0, 0.3
NAMES = ("x", "v", "u")
TRUTH = np.array([-STIFFNESS, -DAMPING, 1.0])


def motion(t):
    return np.sin(t) + np.sin(2.3 * t)


def force(t):
    acceleration = -np.sin(t) - 2.3**2 * np.sin(2.3 * t)
    return acceleration + DAMPING * (np.cos(t) + 2.3 * np.cos(2.3 * t)) + STIFFNESS * motion(t)


@functools.cache
def form_without_terms():
    return weak_form(T, RADIUS, [NO_TERMS])


def regressions(x, repetitions, t=T):
    """Regressions of x'', each with the values of the previous one as coefficients of the noise."""
    form, results = form_without_terms() if t is T else weak_form(t, RADIUS, [NO_TERMS]), []
    for _ in range(repetitions):
        if results:
            form = weak_form(t, RADIUS, [(*-results[-1].values[:2], 1.0)])
        X = np.column_stack([form(x), form(x, 1), form(force(t))])
        results.append(least_squares(X, form(x, 2), NAMES, constant=False))
    return results


def estimated(x, repetitions, t=T):
    return regressions(x, repetitions, t)[-1]


def test_rows_of_derivatives_equal_rows_of_exact_derivatives():
    form = weak_form(T, RADIUS, [NO_TERMS])
    x, v, a = np.sin(2 * T), 2 * np.cos(2 * T), -4 * np.sin(2 * T)
    np.testing.assert_allclose(form(x, 1), form(v), rtol=0, atol=1e-6 * np.abs(form(v)).max())
    np.testing.assert_allclose(form(x, 2), form(a), rtol=0, atol=1e-6 * np.abs(form(a)).max())


def test_integrals_equal_adaptive_quadrature():
    form = weak_form(T, RADIUS, [NO_TERMS])
    centre = form.centres[7]

    def integrand(t):
        return (1 - ((t - centre) / RADIUS) ** 2) ** form.power * np.exp(0.1 * t)

    exact, _ = scipy.integrate.quad(integrand, centre - RADIUS, centre + RADIUS, epsabs=1e-13)
    rows = form.triangle @ form(np.exp(0.1 * T))
    np.testing.assert_allclose(rows[7], exact, rtol=1e-9)


@pytest.mark.parametrize(
    "noise", [[NO_TERMS], [(2.0, 0.3, 1.0)], [(1 + T**2, 0.3, 1.0)], [(0.2,), (0.1 + T, 0.5)]]
)
def test_white_noise_has_white_rows_of_the_same_variance(noise):
    """The map of each noisy signal is applied to single samples; the covariances add up to one."""
    form = weak_form(T, RADIUS, noise)
    maps = [
        sum(form(np.diag(np.broadcast_to(a, T.shape)), d) for d, a in enumerate(coefficients))
        for coefficients in noise
    ]
    covariance = sum(one @ one.T for one in maps)
    np.testing.assert_allclose(covariance, np.eye(len(form.centres)), atol=1e-8)


def test_exact_motion_recovers_the_equation():
    np.testing.assert_allclose(estimated(motion(T), 1).values, TRUTH, rtol=1e-4)


def test_uneven_times_recover_the_equation(seed):
    t = np.cumsum(np.random.default_rng(seed).uniform(0.01, 0.03, size=750))
    np.testing.assert_allclose(estimated(motion(t), 1, t).values, TRUTH, rtol=1e-3)


def draws_of_noise(seed, count, sigma):
    return sigma * np.random.default_rng(seed).normal(size=(count, len(T)))


def test_intervals_have_nominal_coverage_and_s_is_the_noise(seed):
    """95 % intervals over 500 draws of noise in the position, which is in two columns.

    The binomial band has a probability of 99.9 % for each of the three values.
    """
    draws, sigma = 500, 0.02
    results = [estimated(motion(T) + e, 3) for e in draws_of_noise(seed, draws, sigma)]
    critical, dof = scipy.stats.t.isf(0.025, results[0].dof), results[0].dof
    inside = sum(np.abs(one.values - TRUTH) < critical * one.standard_errors for one in results)
    lower, upper = scipy.stats.binom.ppf([0.0005, 0.9995], draws, 0.95)
    assert (lower <= inside).all(), inside / draws
    assert (inside <= upper).all(), inside / draws
    variance = np.mean([one.s**2 for one in results])
    np.testing.assert_allclose(variance / sigma**2, 1.0, atol=4 * (2 / (draws * dof)) ** 0.5)


def test_coefficients_of_the_noise_remove_the_bias(seed):
    """Noise in the columns biases rows that are whitened for x'' alone."""
    draws = draws_of_noise(seed, 400, 0.2)
    results = [regressions(motion(T) + e, 4) for e in draws]

    def significance(repetitions):
        errors = [each[repetitions - 1].values - TRUTH for each in results]
        return np.abs(np.mean(errors, axis=0)) / (np.std(errors, axis=0) / len(draws) ** 0.5)

    assert significance(1)[0] > 8
    assert (significance(4) < 4).all()


def test_stepwise_selects_the_true_terms(seed):
    x = motion(T) + 0.005 * np.random.default_rng(seed).normal(size=T.shape)
    form = weak_form(T, RADIUS, [(STIFFNESS, DAMPING, 1.0)])
    terms = {"x": form(x), "v": form(x, 1), "u": form(force(T)), "1": form(np.ones_like(T))}
    terms |= {"x^2": form(x**2), "x^3": form(x**3), "x v": form(x**2 / 2, 1)}
    X = np.column_stack([*terms.values()])
    chosen = choose(stepwise(X, form(x, 2), tuple(terms), constant=False), Minimum("BIC"))
    assert {*NAMES} <= {*chosen.names}
    assert len(chosen.names) <= len(NAMES) + 1  # BIC admits one false term of four in a sixth


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t": T[::-1]}, "increase strictly"),
        ({"radius": 8.0}, "at most half of the record"),
        ({"radius": 0.1}, "at least 0.2 s"),
        ({"spacing": 0.0}, "must be positive"),
        ({"spacing": 1e-3}, "linearly dependent"),
        ({"power": 3}, "Increase `power`"),
        ({"noise": []}, "empty"),
        ({"noise": [(0.0, 0.0, 0.0)]}, "linearly dependent"),
        ({"noise": [(np.ones(5), 1.0)]}, "derivative 0 in `noise` has shape"),
    ],
)
def test_wrong_arguments_are_refused(change, words):
    given = {"t": T, "radius": RADIUS, "noise": [NO_TERMS]} | change
    with pytest.raises(InputError, match=words):
        weak_form(**given)


def test_wrong_signals_are_refused():
    form = weak_form(T, RADIUS, [NO_TERMS])
    with pytest.raises(InputError, match="one row for each time"):
        form(T[1:])
    with pytest.raises(InputError, match="not finite"):
        form(np.where(T > 3, np.nan, T))
    with pytest.raises(InputError, match="up to order 4"):
        form(T, 5)
