"""Least squares against statsmodels, coverage, coloured residuals, and refusals."""

import numpy as np
import pytest
import scipy.linalg
import statsmodels.api as sm

from jaxid._foundation.checks import InputError
from jaxid.structure import Regression, columns, least_squares, strong_terms, with_coloured_errors

NAMES = ("a", "b", "c")


def design(seed, samples=40):
    draw = np.random.default_rng(seed)
    X = draw.normal(size=(samples, 3)) @ np.array(
        [[1.0, 0.6, 0.0], [0.0, 1.0, -0.3], [0.0, 0.0, 0.2]]
    ) + [
        5.0,
        0.0,
        -1.0,
    ]
    return draw, X


def agree(result: Regression, theirs, shift: int):
    np.testing.assert_allclose(result.values, theirs.params[shift:], rtol=1e-10)
    np.testing.assert_allclose(result.standard_errors, theirs.bse[shift:], rtol=1e-10)
    np.testing.assert_allclose(
        result.covariance, theirs.cov_params()[shift:, shift:], rtol=1e-9, atol=1e-14
    )
    np.testing.assert_allclose(result.F, theirs.tvalues[shift:] ** 2, rtol=1e-9)
    np.testing.assert_allclose(
        [result.R2, result.overall_F], [theirs.rsquared, theirs.fvalue], rtol=1e-9
    )
    np.testing.assert_allclose(result.s**2, theirs.scale, rtol=1e-10)
    np.testing.assert_allclose(result.residuals, theirs.resid, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("constant", [False, True])
def test_regression_equals_statsmodels(seed, weighted, constant):
    draw, X = design(seed)
    y = 2.0 + X @ [1.0, -2.0, 0.5] + draw.normal(size=40)
    weights = draw.uniform(0.2, 5.0, size=40) if weighted else None
    exog = sm.add_constant(X) if constant else X
    relative = np.ones(40) if weights is None else weights / np.mean(weights)
    theirs = sm.WLS(y, exog, weights=relative).fit()
    result = least_squares(X, y, NAMES, weights=weights, constant=constant)
    agree(result, theirs, int(constant))
    if constant:
        np.testing.assert_allclose(
            [result.constant, result.constant_error], [theirs.params[0], theirs.bse[0]], rtol=1e-10
        )
        np.testing.assert_allclose(
            result.constant_covariance, theirs.cov_params()[0, 1:], rtol=1e-8, atol=1e-12
        )
    np.testing.assert_allclose(result.predict(X), theirs.fittedvalues, rtol=1e-10)


def test_deviations_are_equivalent_to_weights(seed):
    draw, X = design(seed)
    y, deviations = X[:, 0] + draw.normal(size=40), draw.uniform(0.1, 3.0, size=40)
    by_deviations = least_squares(X, y, NAMES, deviations=deviations)
    by_weights = least_squares(X, y, NAMES, weights=7.0 / deviations**2)
    np.testing.assert_allclose(
        [*by_deviations.values, *by_deviations.standard_errors],
        [*by_weights.values, *by_weights.standard_errors],
        rtol=1e-12,
    )


def test_regression_without_noise_recovers_values(seed):
    _, X = design(seed)
    result = least_squares(X, 3.0 + X @ [1.0, -2.0, 0.5], NAMES)
    np.testing.assert_allclose([result.constant, *result.values], [3.0, 1.0, -2.0, 0.5], rtol=1e-12)
    assert result.s < 1e-13


def test_intervals_have_nominal_coverage(seed):
    """95 % intervals by Student's t over 2000 draws of 20 samples.

    The binomial band has a probability of 99.9 % for each of the four values.
    """
    _, X = design(seed, samples=20)
    truth, draws = np.array([1.0, -2.0, 0.5, 3.0]), 2000
    noise = np.random.default_rng(seed + 1).normal(size=(draws, 20))
    t = scipy.stats.t.isf(0.025, 16)
    inside = np.zeros(4)
    for e in noise:
        result = least_squares(X, truth[3] + X @ truth[:3] + 0.3 * e, NAMES)
        values, errors = (
            np.append(result.values, result.constant),
            np.append(result.standard_errors, result.constant_error),
        )
        inside += np.abs(values - truth) < t * errors
    lower, upper = scipy.stats.binom.ppf([0.0005, 0.9995], draws, 0.95)
    assert (lower <= inside).all(), inside / draws
    assert (inside <= upper).all(), inside / draws


def test_coloured_errors_agree_with_exact_covariance(seed):
    """Noise e_i = 0.8 e_(i-1) + w_i and slow columns in two manoeuvres.

    Standard errors for white residuals are too small by the square root of (1 - 0.8)/(1 + 0.8), a
    third. The corrected standard errors are too small by an eighth here, because the fit explains
    slow noise by the columns. The mean of 60 draws has an error of 2 %.
    """
    draw = np.random.default_rng(seed)
    half, rho = 1000, 0.8
    t = np.arange(half) / half
    slow = np.column_stack([np.sin(2 * np.pi * 3 * t), np.sign(np.sin(2 * np.pi * 5 * t)), t])
    X, runs = np.concatenate([slow, slow[::-1] + 1.0]), np.repeat([0, 1], half)
    exog = sm.add_constant(X)
    colour = scipy.linalg.block_diag(
        *2 * [scipy.linalg.toeplitz(rho ** np.arange(half)) / (1 - rho**2)]
    )
    inverse = np.linalg.pinv(exog)
    exact = np.sqrt(np.diagonal(inverse @ colour @ inverse.T))
    white, corrected = np.zeros(4), np.zeros(4)
    for _ in range(60):
        w = draw.normal(size=(2, half))
        w[:, 0] /= np.sqrt(1 - rho**2)
        e = scipy.signal.lfilter([1.0], [1.0, -rho], w, axis=1).ravel()
        plain = least_squares(X, 1.0 + X @ [1.0, 2.0, 3.0] + e, NAMES)
        coloured = with_coloured_errors(plain, X[:, ::-1], NAMES[::-1], runs=runs)
        np.testing.assert_array_equal(coloured.values, plain.values)
        white += np.array([plain.constant_error, *plain.standard_errors]) / 60
        corrected += np.array([coloured.constant_error, *coloured.standard_errors]) / 60
    assert (corrected > 0.8 * exact).all(), corrected / exact
    assert (corrected < 1.05 * exact).all(), corrected / exact
    np.testing.assert_allclose(white, exact / 3, rtol=0.1)


def test_strong_terms_follow_four_per_cent_rule_of_report(seed):
    draw, X = design(seed, samples=400)
    result = least_squares(X, X @ [1.0, -2.0, 0.1] + draw.normal(size=400), NAMES)
    expected = tuple(
        name for name, F in zip(NAMES, result.F, strict=True) if 0.04 * max(result.F) <= F
    )
    assert strong_terms(result) == expected
    assert "c" not in expected
    assert strong_terms(result, 0.0) == NAMES
    with pytest.raises(InputError, match="share is 4"):
        strong_terms(result, 4.0)


def test_regression_prints_as_table(seed):
    draw, X = design(seed)
    lines = str(least_squares(X, X[:, 0] + draw.normal(size=40), NAMES, response="Cm")).splitlines()
    assert lines[0] == "Cm: least squares"
    assert [line.split()[0] for line in lines[2:6]] == ["a", "b", "c", "constant"]
    assert "overall F(3, 36)" in lines[-1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda X, y: {"X": np.where(np.arange(120).reshape(40, 3) == 7, np.nan, X)},
            "'b' has 1 values .* row 2",
        ),
        (lambda X, y: {"y": np.append(y[:-1], np.inf)}, "'y' has 1 values .* row 39"),
        (lambda X, y: {"X": np.column_stack([X[:, :2], np.full(40, 0.1)])}, "'c' is constant"),
        (
            lambda X, y: {"X": np.column_stack([X[:, :2], X[:, 0] - 2 * X[:, 1]])},
            "'c' is a linear combination",
        ),
        (lambda X, y: {"y": np.full(40, 2.0)}, "response 'y' does not vary"),
        (lambda X, y: {"names": ("a", "b", "a")}, "'a' occurs twice"),
        (lambda X, y: {"names": ("a", "b")}, r"X has shape \(40, 3\)"),
        (
            lambda X, y: {"X": X[:4], "y": y[:4]},
            "4 samples of 'y' and 3 terms, which need at least 5",
        ),
        (
            lambda X, y: {"weights": np.append(np.ones(39), 0.0)},
            "weights must be positive .* row 39",
        ),
        (lambda X, y: {"weights": np.ones(40), "deviations": np.ones(40)}, "not both"),
    ],
)
def test_invalid_input_is_refused(seed, change, message):
    draw, X = design(seed)
    given = {"X": X, "y": X[:, 0] + draw.normal(size=40), "names": NAMES}
    with pytest.raises(InputError, match=message):
        least_squares(**{**given, **change(X, given["y"])})


def test_columns_equal_terms_of_polynomial(seed):
    draw = np.random.default_rng(seed)
    signals = {"alpha": draw.normal(size=9), "beta": draw.normal(size=9)}
    result = columns(
        ("1", "alpha^2 beta", "|beta| beta", "(alpha-0.1)+^2"), signals, {"alpha": 0.2}
    )
    alpha, beta = signals["alpha"] - 0.2, signals["beta"]
    expected = [np.ones(9), alpha**2 * beta, np.abs(beta) * beta, np.maximum(alpha - 0.1, 0) ** 2]
    np.testing.assert_allclose(result, np.column_stack(expected), rtol=1e-13)
    np.testing.assert_array_equal(columns(("1",), signals), np.ones((9, 1)))
    with pytest.raises(InputError, match="'alpha' occurs twice"):
        columns(("alpha", "alpha"), signals)
    with pytest.raises(InputError, match="no signal 'gamma'"):
        columns(("alpha", "gamma^2"), signals)
