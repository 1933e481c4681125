"""Polynomials through local estimates at trims: joint least squares, coverage, refusals."""

import numpy as np
import pytest
from scipy.stats import binom, kstest

from jaxid._foundation.checks import InputError
from jaxid.structure import columns, least_squares
from jaxid.uncertainty import combine_trims

TRUTH = np.array([0.02, -0.6, -1.5, 3.0])  # of Cm, by powers of alpha [rad]
TRIMS = np.radians([2.0, 6.0, 10.0, 15.0, 20.0, 26.0])
CM = np.polynomial.Polynomial(TRUTH)


def local_estimates(seed, draws):
    """Values and slopes with correlated errors that differ from trim to trim."""
    draw = np.random.default_rng(seed)
    factors = np.array([[2e-3, 0.0], [0.02, 0.03]]) * draw.uniform(0.5, 2.0, size=(6, 1, 1))
    true = np.stack([CM(TRIMS), CM.deriv()(TRIMS)], axis=1)
    errors = np.einsum("tij,ntj->nti", factors, draw.normal(size=(draws, 6, 2)))
    return true + errors, factors @ np.swapaxes(factors, 1, 2)


def test_values_at_trims_equal_joint_weighted_regression_of_all_samples(seed):
    """The local estimate of a trim is the mean of its samples, of variance r / t (C.68)."""
    draw = np.random.default_rng(seed)
    counts, sigma = np.array([5, 8, 20, 3, 9, 12]), np.array([0.01, 0.03, 0.02, 0.01, 0.02, 0.04])
    samples = [
        CM(at) + s * draw.normal(size=n) for at, n, s in zip(TRIMS, counts, sigma, strict=True)
    ]
    result = combine_trims(
        TRIMS,
        np.array([[np.mean(one)] for one in samples]),
        (sigma**2 / counts)[:, None, None],
        3,
        derivatives=(0,),
    )
    terms = ("alpha", "alpha^2", "alpha^3")
    joint = least_squares(
        columns(terms, {"alpha": np.repeat(TRIMS, counts)}),
        np.concatenate(samples),
        terms,
        deviations=np.repeat(sigma, counts),
    )
    assert result.table.names == ("1", *terms)
    assert result.table.units == ("", "1/rad", "1/rad^2", "1/rad^3")
    np.testing.assert_allclose(result.table.values, [joint.constant, *joint.values], rtol=1e-9)
    # `joint.s` is estimated, in units of a mean weight of one
    known = joint.covariance / (joint.s**2 * np.mean(np.repeat(sigma, counts) ** -2.0))
    np.testing.assert_allclose(np.asarray(result.table.covariance)[1:, 1:], known, rtol=1e-8)


def test_values_and_slopes_equal_dense_generalised_least_squares(seed):
    (estimates,), P = local_estimates(seed, 1)
    X = np.zeros((12, 4))
    W = np.zeros((12, 12))
    for k, at in enumerate(TRIMS):
        X[2 * k] = [1, at, at**2, at**3]
        X[2 * k + 1] = [0, 1, 2 * at, 3 * at**2]
        W[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.linalg.inv(P[k])
    M = X.T @ W @ X
    expected = np.linalg.solve(M, X.T @ W @ estimates.ravel())
    result = combine_trims(TRIMS, estimates, P, 3)
    np.testing.assert_allclose(result.table.values, expected, rtol=1e-8)
    np.testing.assert_allclose(result.table.covariance, np.linalg.inv(M), rtol=1e-7)
    v = estimates.ravel() - X @ expected
    np.testing.assert_allclose(result.table.misfit, v @ W @ v, rtol=1e-8)
    assert result.table.degrees_of_freedom == 8


def test_centre_changes_no_curve(seed):
    (estimates,), P = local_estimates(seed, 1)
    points = np.radians([0.0, 8.0, 25.0])
    about_zero = combine_trims(TRIMS, estimates, P, 3)
    about_mean = combine_trims(TRIMS, estimates, P, 3, centre=0.2)
    for order in (0, 1):
        one, other = about_zero.curve(points, order), about_mean.curve(points, order)
        np.testing.assert_allclose(one.value, other.value, rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(one.standard_errors, other.standard_errors, rtol=1e-7)
    assert about_mean.table.names[2] == "(alpha-0.2)^2"
    np.testing.assert_array_equal(about_zero.curve(points).valid, [False, True, True])


def test_bands_of_the_curve_and_its_slope_have_nominal_coverage(seed):
    """95 % bands at single points; the binomial limits have a probability of 99.9 %."""
    draws = 500
    estimates, P = local_estimates(seed, draws)
    results = [combine_trims(TRIMS, one, P, 3) for one in estimates]
    lower, upper = binom.ppf([0.0005, 0.9995], draws, 0.95)
    points = np.radians([4.0, 12.0, 24.0])
    for order, true in enumerate((CM(points), CM.deriv()(points))):
        bands = np.stack([np.asarray(one.curve(points, order).band(1.96)) for one in results])
        inside = np.sum((bands[..., 0] < true) & (true < bands[..., 1]), axis=0)
        assert (lower <= inside).all(), inside / draws
        assert (inside <= upper).all(), inside / draws
    p = [float(one.table.p_value) for one in results]
    assert kstest(p, "uniform").pvalue > 1e-3


def test_too_low_a_degree_has_a_small_p_value(seed):
    (estimates,), P = local_estimates(seed, 1)
    assert float(combine_trims(TRIMS, estimates, P, 1).table.p_value) < 1e-6


def test_slopes_alone_give_the_curve_up_to_its_constant():
    slopes, P = CM.deriv()(TRIMS)[:, None], np.full((6, 1, 1), 1e-4)
    result = combine_trims(TRIMS, slopes, P, 3, derivatives=(1,), centre=0.1, units=("N", "m"))
    assert result.table.units == ("N/m", "N/m^2", "N/m^3")
    assert result.table.names == ("(alpha-0.1)", "(alpha-0.1)^2", "(alpha-0.1)^3")
    np.testing.assert_allclose(result.curve(TRIMS).value, CM(TRIMS) - CM(0.1), atol=1e-10)
    np.testing.assert_allclose(result.curve(TRIMS, 1).value, slopes[:, 0], rtol=1e-10)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"estimates": np.zeros((6, 1)), "covariances": np.ones((6, 1, 1))}, "must have shape"),
        ({"covariances": np.zeros((6, 2, 2))}, "covariance of trim 0"),
        ({"covariances": np.tile([[1.0, 0.5], [0.4, 1.0]], (6, 1, 1))}, "not symmetric"),
        ({"estimates": np.full((6, 2), np.nan)}, "not finite"),
        ({"degree": 12}, "12 local estimates do not determine the 13"),
        ({"trims": np.full(6, 0.1)}, "do not determine"),
        ({"derivatives": (1, 1)}, "'1' occurs twice"),
        ({"derivatives": (1, 2), "degree": 0}, "higher degree"),
    ],
)
def test_wrong_arguments_are_refused(seed, change, words):
    (estimates,), P = local_estimates(seed, 1)
    given = {"trims": TRIMS, "estimates": estimates, "covariances": P, "degree": 3} | change
    with pytest.raises(InputError, match=words):
        combine_trims(**given)


# Over alpha and Mach number: values and slopes of Cm at twelve trims.
GRID = np.array([(alpha, mach) for alpha in (0.0, 0.1, 0.2, 0.3) for mach in (0.4, 0.6, 0.9)])


def over_both(alpha, mach):
    return 0.02 - 0.6 * alpha + 0.5 * alpha**2 + (mach - 0.6) * (0.03 - 0.2 * alpha)


def slope_over_alpha(alpha, mach):
    return -0.6 + alpha - 0.2 * (mach - 0.6)


def with_mach(estimates, P, degree=(2, 1), **options):
    options = {"centre": (0.0, 0.6), "signal": ("alpha", "mach")} | options
    return combine_trims(GRID, estimates, P, degree, units=("", "rad", ""), **options)


def test_two_signals_recover_the_surface():
    exact = np.stack([over_both(*GRID.T), slope_over_alpha(*GRID.T)], axis=1)
    result = with_mach(exact, np.tile(np.diag([1e-6, 1e-4]), (len(GRID), 1, 1)))
    names = ("1", "(mach-0.6)", "alpha", "alpha (mach-0.6)", "alpha^2", "alpha^2 (mach-0.6)")
    assert result.table.names == names
    assert result.table.units[3:5] == ("1/rad", "1/rad^2")
    expected = (0.02, 0.03, -0.6, -0.2, 0.5, 0.0)
    np.testing.assert_allclose(result.table.values, expected, atol=1e-10)
    points = np.array([(0.05, 0.5), (0.15, 0.8), (0.15, 1.0), (0.4, 0.5)])
    curve, slope = result.curve(points), result.curve(points, 1)
    np.testing.assert_allclose(curve.value, over_both(*points.T), atol=1e-10)
    np.testing.assert_allclose(slope.value, slope_over_alpha(*points.T), atol=1e-9)
    np.testing.assert_array_equal(curve.valid, [True, True, False, False])


def test_two_signals_equal_dense_least_squares(seed):
    """Against the normal equations of the stacked rows, with a covariance of each trim."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(len(GRID), 2, 2))
    P = half @ half.transpose(0, 2, 1) + 0.1 * np.eye(2)
    y = rng.normal(size=(len(GRID), 2))
    alpha, mach = GRID[:, 0], GRID[:, 1] - 0.6
    powers = [(i, j) for i in range(3) for j in range(2)]
    value = np.stack([alpha**i * mach**j for i, j in powers], axis=1)
    slope = np.stack([i * alpha ** max(i - 1, 0) * mach**j for i, j in powers], axis=1)
    X = np.stack([value, slope], axis=1).reshape(-1, len(powers))
    W = np.zeros((X.shape[0], X.shape[0]))
    for k in range(len(GRID)):
        W[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.linalg.inv(P[k])
    covariance = np.linalg.inv(X.T @ W @ X)
    result = with_mach(y, P)
    np.testing.assert_allclose(result.table.values, covariance @ X.T @ W @ y.ravel(), rtol=1e-8)
    np.testing.assert_allclose(result.table.covariance, covariance, rtol=1e-7, atol=1e-10)


def test_numbers_of_signals_agree():
    y, P = np.zeros((len(GRID), 2)), np.tile(np.eye(2), (len(GRID), 1, 1))
    with pytest.raises(InputError, match="trims have 2 signals, and `degree` is for 1"):
        with_mach(y, P, degree=2)
    with pytest.raises(InputError, match="`centre` is for 3"):
        with_mach(y, P, centre=(0.0, 0.6, 0.0))
    exact = np.stack([over_both(*GRID.T), slope_over_alpha(*GRID.T)], axis=1)
    with pytest.raises(InputError, match="whole number of zero or more for each signal"):
        with_mach(y, P, degree=(2, -1))
    with pytest.raises(InputError, match="order of zero or more"):
        with_mach(exact, P).curve(GRID, -1)
    with pytest.raises(InputError, match="polynomial has 2 signals"):
        with_mach(exact, P).curve(np.array([0.1, 0.2]))
