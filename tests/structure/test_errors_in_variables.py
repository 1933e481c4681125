"""Total least squares and instrumental variables: closed forms, bias and coverage."""

import numpy as np
import pytest
import scipy.stats

from jaxid._foundation.checks import InputError
from jaxid.structure import instrumental_variables, least_squares, total_least_squares

NAMES = ("a", "b", "c")
TRUTH, CONSTANT = np.array([1.0, -2.0, 0.5]), 4.0
NOISE = np.array([0.3, 0.0, 0.5])


def exact_columns(samples):
    mix = np.array([[1.0, 0.5, 0.2], [0.0, 1.0, 0.3], [0.0, 0.0, 1.0]])
    return np.random.default_rng(1).normal(size=(samples, 3)) @ mix + [1.0, 2.0, 3.0]


def test_total_least_squares_of_single_column_equals_deming_regression(seed):
    """Closed form (Deming, 1943): the root of a quadratic in the moments."""
    draw = np.random.default_rng(seed)
    x = draw.normal(size=50)
    y, x = 2.0 + 3.0 * x + 0.4 * draw.normal(size=50), x + 0.2 * draw.normal(size=50)
    sxx, sxy, _, syy = np.cov(x, y).ravel()[[0, 1, 2, 3]]
    ratio = (0.4 / 0.2) ** 2
    slope = (syy - ratio * sxx + np.sqrt((syy - ratio * sxx) ** 2 + 4 * ratio * sxy**2)) / (2 * sxy)
    result = total_least_squares(x[:, None], y, ("x",), noise=[0.2], response_noise=0.4)
    np.testing.assert_allclose(
        [*result.values, result.constant], [slope, y.mean() - slope * x.mean()], rtol=1e-12
    )


def test_total_least_squares_with_noise_in_all_columns_equals_singular_vector(seed):
    draw = np.random.default_rng(seed)
    X = exact_columns(60)
    y = X @ TRUTH + 0.1 * draw.normal(size=60)
    X = X + 0.1 * draw.normal(size=X.shape)
    vector = np.linalg.svd(np.column_stack([X, y]))[2][-1]
    result = total_least_squares(X, y, NAMES, noise=[0.1] * 3, response_noise=0.1, constant=False)
    np.testing.assert_allclose(result.values, -vector[:-1] / vector[-1], rtol=1e-11)


def test_total_least_squares_without_noise_in_columns_equals_least_squares(seed):
    draw = np.random.default_rng(seed)
    X = exact_columns(60)
    y = X @ TRUTH + 0.1 * draw.normal(size=60)
    result, plain = (
        total_least_squares(X, y, NAMES, noise=np.zeros(3), response_noise=0.1),
        least_squares(X, y, NAMES),
    )
    np.testing.assert_allclose(result.values, plain.values, rtol=1e-11)
    # The asymptotic moments are divided by 60 samples, as in the regression on centred columns.
    np.testing.assert_allclose(result.standard_errors, plain.standard_errors, rtol=1e-9)
    np.testing.assert_allclose(
        [result.constant_error, result.overall_F],
        [plain.constant_error, plain.overall_F],
        rtol=1e-9,
    )


def test_exact_data_are_recovered_by_both_methods():
    X = exact_columns(30)
    y = CONSTANT + X @ TRUTH
    total = total_least_squares(X, y, NAMES, noise=NOISE, response_noise=0.4)
    instrumental = instrumental_variables(X, y, NAMES, X + np.sin(np.arange(90.0)).reshape(30, 3))
    for result in (total, instrumental):
        np.testing.assert_allclose(
            [*result.values, result.constant], [*TRUTH, CONSTANT], rtol=1e-11
        )


@pytest.fixture(scope="module")
def monte_carlo():
    """Values and coverage of the 95 % interval by method, for 2000 records of 500 samples."""
    draw, X, draws = np.random.default_rng(1974), exact_columns(500), 2000
    values = {"ordinary": [], "total": [], "instrumental": []}
    inside = {name: np.zeros(4) for name in values}
    for _ in range(draws):
        y = CONSTANT + X @ TRUTH + 0.4 * draw.normal(size=500)
        noisy = X + NOISE * draw.normal(size=X.shape)
        again = X + 0.5 * draw.normal(size=X.shape)  # other sensors
        for name, result in (
            ("ordinary", least_squares(noisy, y, NAMES)),
            ("total", total_least_squares(noisy, y, NAMES, noise=2 * NOISE, response_noise=0.8)),
            (
                "instrumental",
                instrumental_variables(noisy, y, NAMES, np.column_stack([again, noisy[:, 1]])),
            ),
        ):
            value, error = (
                np.append(result.values, result.constant),
                np.append(result.standard_errors, result.constant_error),
            )
            values[name].append(value)
            inside[name] += np.abs(value - [*TRUTH, CONSTANT]) < 1.96 * error
    return {name: np.array(all_) for name, all_ in values.items()}, inside, draws


@pytest.mark.parametrize("method", ["total", "instrumental"])
def test_estimates_are_unbiased(monte_carlo, method):
    """Tolerance: 3.5 standard errors of the mean, and a second-order bias of 0.2 % of the value."""
    values = monte_carlo[0][method]
    bias = np.abs(values.mean(axis=0) - [*TRUTH, CONSTANT])
    assert (
        bias < 3.5 * values.std(axis=0) / np.sqrt(len(values)) + 0.002 * np.abs([*TRUTH, CONSTANT])
    ).all(), bias


def test_ordinary_least_squares_is_biased(monte_carlo):
    """The test above can fail: the bias of c is about 20 %, from a noise variance of 0.5^2.

    The variance of c that a and b do not explain is 1.
    """
    bias = monte_carlo[0]["ordinary"].mean(axis=0) - [*TRUTH, CONSTANT]
    assert bias[2] == pytest.approx(-0.5 * 0.25 / 1.25, rel=0.15)


@pytest.mark.parametrize("method", ["total", "instrumental"])
def test_intervals_have_nominal_coverage(monte_carlo, method):
    """The binomial band has a probability of 99.9 %.

    It is widened by 1 %, because the standard errors are asymptotic.
    """
    _, inside, draws = monte_carlo
    lower, upper = scipy.stats.binom.ppf([0.0005, 0.9995], draws, 0.95) / draws
    share = inside[method] / draws
    assert (lower - 0.01 <= share).all(), share
    assert (share <= upper + 0.01).all(), share


def test_instrumental_variables_with_equal_numbers_equal_classical_form(seed):
    draw = np.random.default_rng(seed)
    X, Z = exact_columns(60), exact_columns(60) + draw.normal(size=(60, 3))
    y, weights = X @ TRUTH + draw.normal(size=60), draw.uniform(0.5, 2.0, size=60)
    left, right = np.column_stack([Z, np.ones(60)]), np.column_stack([X, np.ones(60)])
    expected = np.linalg.solve(left.T @ (weights[:, None] * right), left.T @ (weights * y))
    result = instrumental_variables(X, y, NAMES, Z, weights=weights)
    np.testing.assert_allclose([*result.values, result.constant], expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda X, y: total_least_squares(X, y, NAMES, noise=[0.1], response_noise=1.0),
            "one number for each of the 3",
        ),
        (
            lambda X, y: total_least_squares(
                X, y, NAMES, noise=[-1.0, 0.0, 0.0], response_noise=1.0
            ),
            "none negative",
        ),
        (
            lambda X, y: total_least_squares(X, y, NAMES, noise=[1.0] * 3, response_noise=0.0),
            "must be positive",
        ),
        (
            lambda X, y: total_least_squares(0 * X, y, NAMES, noise=[1.0] * 3, response_noise=1.0),
            "'a' is constant",
        ),
        (lambda X, y: instrumental_variables(X, y, NAMES, X[:, :2]), "2 instruments for 3 columns"),
        (
            lambda X, y: instrumental_variables(X, y, NAMES, X[:, [0, 1, 1]]),
            "'instrument 2' is a linear combination",
        ),
    ],
)
def test_invalid_input_is_refused(seed, call, words):
    X = exact_columns(30)
    with pytest.raises(InputError, match=words):
        call(X, X @ TRUTH + np.random.default_rng(seed).normal(size=30))
