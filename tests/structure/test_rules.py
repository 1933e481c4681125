"""Criteria against statsmodels and brute force, rules, best subsets, orthogonal functions."""

import itertools

import numpy as np
import pytest
import statsmodels.api as sm
import textbook

from jaxid._foundation.checks import InputError
from jaxid.structure import (
    CrossValidation,
    Direction,
    FirstMaximumF,
    LastStep,
    MaximumF,
    Minimum,
    SubsetOptions,
    best_subsets,
    choose,
    orthogonal_functions,
    stepwise,
)
from jaxid.structure.criteria import (
    overall_F,
    partial_correlation,
    partial_F,
    r_squared,
)

NAMES = tuple(f"x{i}" for i in range(8))
ALL = SubsetOptions(F_in=0.0, F_out=0.0)
BOUNDED = SubsetOptions(F_in=0.0, F_out=0.0, PSE_bound=0.64)  # the variance of the noise


def planted(seed, samples=60):
    draw = np.random.default_rng(seed)
    X = draw.normal(size=(samples, 8)) + draw.normal(size=(samples, 1))
    return X, 2.0 + X[:, 1] - 0.7 * X[:, 4] + 0.5 * X[:, 6] + 0.8 * draw.normal(size=samples)


@pytest.fixture
def path(seed):
    return stepwise(*planted(seed), NAMES, options=ALL)


@pytest.mark.parametrize("weighted", [False, True])
def test_criteria_equal_statsmodels_for_every_model(seed, weighted):
    """AIC and BIC are compared as differences between models, and PRESS by omitting each sample."""
    X, y = planted(seed, 20)
    weights = (
        np.random.default_rng(seed + 1).uniform(0.5, 2.0, size=20) if weighted else np.ones(20)
    )
    models = stepwise(X, y, NAMES, options=ALL, weights=weights).models
    weights, fits = weights / np.mean(weights), []
    for step in models:
        exog = np.column_stack([np.ones(20), *(X[:, NAMES.index(name)] for name in step.terms)])
        theirs = sm.WLS(y, exog, weights=weights).fit()
        fits.append((theirs.aic, theirs.bic))
        press = 0.0
        for i in range(20):
            others = np.arange(20) != i
            values = sm.WLS(y[others], exog[others], weights=weights[others]).fit().params
            press += weights[i] * (y[i] - exog[i] @ values) ** 2
        assert pytest.approx(press, rel=1e-9) == step.PRESS
        bound = theirs.centered_tss / 20
        assert (
            pytest.approx(theirs.ssr / 20 + 2 * bound * (len(step.terms) + 1) / 20, rel=1e-9)
            == step.PSE
        )
    ours = np.array([(step.AIC, step.BIC) for step in models])
    np.testing.assert_allclose(ours - ours[0], np.array(fits) - fits[0], rtol=1e-9, atol=1e-9)


def test_press_is_infinite_if_a_sample_alone_determines_a_term(seed):
    """The column is nonzero in one sample, an outlier: without it the column has no value."""
    X, y = planted(seed)
    X[:, 7] = np.arange(60) == 0
    y[0] += 50.0
    path = stepwise(X, y, NAMES, options=ALL)
    for step in path.models:
        assert np.isinf(step.PRESS) == ("x7" in step.terms)
    assert "x7" not in choose(path, Minimum("PRESS")).names


def test_formulas_of_F_and_correlation_are_consistent(path):
    """Equations B.20, B.28, B.29 and B.30, each from separate quantities."""
    for step in path.models[1:]:
        terms = len(step.terms)
        dof = 60 - terms - 1
        assert step.overall_F == pytest.approx((step.R2 / terms) / ((1 - step.R2) / dof), rel=1e-9)
        r2 = step.partial_correlation**2
        assert step.partial_F == pytest.approx(r2 * dof / (1.0 - r2), rel=1e-9)
        result = choose(path, LastStep())
        np.testing.assert_allclose(
            [partial_F(v, e) for v, e in zip(result.values, result.standard_errors, strict=True)],
            result.F,
            rtol=1e-12,
        )
    assert partial_correlation(float("inf"), 3) == 1.0
    assert overall_F(0.0, 1.0, 2, 5) == np.inf
    assert np.isnan(overall_F(1.0, 1.0, 0, 5))
    assert r_squared(0.25, 1.0) == 0.75


def test_rules_select_extreme_of_their_criterion(path):
    for criterion in ("PSE", "PRESS", "AIC", "BIC"):
        values = [getattr(step, criterion) for step in path.models]
        assert choose(path, Minimum(criterion)).names == path.models[int(np.argmin(values))].terms
    F = [step.overall_F for step in path.models[1:]]
    assert choose(path, MaximumF()).names == path.models[1 + int(np.argmax(F))].terms
    assert choose(path, LastStep()).names == path.models[-1].terms


def test_first_maximum_of_F_differs_from_largest_for_hald():
    """Overall F 22.8, 176.6, 166.8, 229.5 along the path: the report's rule selects the second."""
    path = stepwise(
        textbook.HALD[:, :4],
        textbook.HALD[:, 4],
        textbook.HALD_NAMES,
        options=SubsetOptions(tolerance=1e-3),
    )
    assert choose(path, FirstMaximumF()).names == ("x4", "x1")
    assert choose(path, MaximumF()).names == ("x1", "x2")


def test_rules_select_last_model_for_rising_F_and_empty_model_for_noise(seed):
    draw = np.random.default_rng(seed)
    X = draw.normal(size=(50, 2))
    rising = stepwise(X, X @ [1.0, 1.0] + 0.01 * draw.normal(size=50), ("a", "b"))
    assert set(choose(rising, FirstMaximumF()).names) == {"a", "b"}
    nothing = stepwise(X, draw.normal(size=50), ("a", "b"), options=SubsetOptions(F_in=1e6))
    for rule in (
        FirstMaximumF(),
        MaximumF(),
        Minimum("BIC"),
        LastStep(),
        CrossValidation(np.arange(50) % 3),
    ):
        result = choose(nothing, rule)
        assert result.names == ()
        assert pytest.approx(0.0, abs=1e-12) == result.R2


@pytest.mark.parametrize("constant", [False, True])
def test_cross_validation_equals_separate_fits(seed, constant):
    X, y = planted(seed)
    weights = np.random.default_rng(seed + 1).uniform(0.5, 2.0, size=60)
    groups = np.repeat(["a", "b", "c"], [25, 15, 20])
    path = stepwise(X, y, NAMES, options=ALL, weights=weights, constant=constant)
    weights, expected = weights / np.mean(weights), []
    for step in path.models:
        use = [X[:, NAMES.index(name)] for name in step.terms]
        exog = (
            np.column_stack([np.ones(60)] * constant + use)
            if use or constant
            else np.zeros((60, 1))
        )
        error = 0.0
        for label in "abc":
            test = groups == label
            root = np.sqrt(weights[~test])
            values = np.linalg.lstsq(root[:, None] * exog[~test], root * y[~test])[0]
            error += np.sum(weights[test] * (y[test] - exog[test] @ values) ** 2)
        expected.append(error / 60)
    rule = CrossValidation(groups)
    np.testing.assert_allclose(rule.errors(path), expected, rtol=1e-9)
    assert choose(path, rule).names == path.models[int(np.argmin(expected))].terms


def test_scale_of_weights_changes_no_criterion(seed):
    """Only the ratios of weights matter, also with a given bound of the noise variance."""
    X, y = planted(seed)
    equal = stepwise(X, y, NAMES, options=BOUNDED)
    for options in ({"weights": np.full(60, 1e4)}, {"deviations": np.full(60, 0.3)}):
        other = stepwise(X, y, NAMES, options=BOUNDED, **options)
        for name in ("s", "PSE", "PRESS", "AIC", "BIC"):
            expected = [getattr(step, name) for step in equal.models]
            found = [getattr(step, name) for step in other.models]
            np.testing.assert_allclose(found, expected, rtol=1e-9)
    weighted = orthogonal_functions(X, y, NAMES, PSE_bound=0.64, weights=np.full(60, 1e4))
    assert weighted.kept == orthogonal_functions(X, y, NAMES, PSE_bound=0.64).kept


def test_cross_validation_refuses_invalid_groups(path):
    with pytest.raises(InputError, match="at least two"):
        choose(path, CrossValidation(np.zeros(60)))
    with pytest.raises(InputError, match=r"groups have shape \(59,\)"):
        choose(path, CrossValidation(np.arange(59)))
    with pytest.raises(InputError, match=r"Without the manoeuvre 0 .* too few"):
        choose(path, CrossValidation((np.arange(60) > 55).astype(int)))


# Best subsets and orthogonal functions ------------------------------------------------------------


def test_best_subsets_equal_exhaustive_search(seed):
    X, y = planted(seed, 30)
    X[:, 7] = X[:, 0] + X[:, 1] - 3.0  # linearly dependent
    result = best_subsets(X, y, NAMES)
    for size, step in enumerate(result.models[1:], start=1):
        every = [
            list(subset)
            for subset in itertools.combinations(range(8), size)
            if not {0, 1, 7} <= set(subset)
        ]
        SSE = [
            np.sum(sm.OLS(y, sm.add_constant(X[:, subset])).fit().resid ** 2) for subset in every
        ]
        assert step.s**2 * (30 - size - 1) == pytest.approx(min(SSE), rel=1e-9)
    assert len(result.models) == 8
    assert "any 8 columns are combinations" in result.steps[-1].reason
    assert choose(result, Minimum("BIC")).R2 > 0.5


def test_exchange_selects_pair_that_stepwise_regression_misses(seed):
    """The response is the small difference of two correlated columns.

    Neither column is useful alone, but a third column correlated with the response is.
    """
    draw = np.random.default_rng(seed)
    X = draw.normal(size=(100, 20))
    X[:, 1] = X[:, 0] + 0.2 * X[:, 1]
    y = X[:, 0] - X[:, 1]
    X[:, 2] = y + 0.3 * np.std(y) * X[:, 2]
    names = tuple(f"x{i}" for i in range(20))
    pair = best_subsets(X, y + 1e-3 * draw.normal(size=100), names, max_terms=2).models[2]
    assert set(pair.terms) == {"x0", "x1"}
    assert "by exchange" in pair.reason
    assert (
        "x2"
        in stepwise(X, y, names, options=SubsetOptions(max_terms=2, direction=Direction.FORWARD))
        .models[-1]
        .terms
    )


def test_exchange_equals_exhaustive_search_for_few_candidates(seed):
    X, y = planted(seed, 40)
    every, exchanged = best_subsets(X, y, NAMES), best_subsets(X, y, NAMES, exhaustive=2)
    assert [set(step.terms) for step in every.models] == [
        set(step.terms) for step in exchanged.models
    ]


def test_best_subsets_stop_at_exact_fit(seed):
    X, _ = planted(seed)
    result = best_subsets(X, X[:, 1] - X[:, 5], NAMES)
    assert set(result.models[-1].terms) == {"x1", "x5"}
    assert "rounding" in result.steps[-1].reason


def test_orthogonal_functions_equal_forward_path_at_least_PSE(seed):
    """Gram-Schmidt by largest reduction adds the term of the largest partial correlation.

    The values in ordinary terms are the same.
    """
    X, y = planted(seed)
    result = orthogonal_functions(X, y, NAMES)
    path = stepwise(
        X,
        y,
        NAMES,
        options=SubsetOptions(F_in=0.0, F_out=0.0, tolerance=1e-8, direction=Direction.FORWARD),
    )
    assert result.names == path.models[-1].terms
    np.testing.assert_allclose(
        np.cumsum(result.share), [step.R2 for step in path.models[1:]], rtol=1e-9
    )
    np.testing.assert_allclose(result.PSE, [step.PSE for step in path.models], rtol=1e-9)
    expected = choose(path, Minimum("PSE"))
    assert result.regression.names == expected.names
    np.testing.assert_allclose(result.regression.values, expected.values, rtol=1e-12)
    assert str(result).count("kept") == result.kept > 0


def test_orthogonal_functions_leave_out_linear_combinations(seed):
    X, y = planted(seed)
    result = orthogonal_functions(
        np.column_stack([X, X[:, 1] - X[:, 4]]), y, (*NAMES, "double"), PSE_bound=0.01
    )
    assert len(result.left_out) == 1
    assert result.left_out[0] in {"x1", "x4", "double"}
    assert "nearly combinations" in str(result)
