"""Stepwise regression and least squares on textbook data: printed digits, and statsmodels."""

import numpy as np
import pytest
import statsmodels.api as sm
import textbook

from jaxid.structure import Action, FirstMaximumF, SubsetOptions, choose, least_squares, stepwise

HALD_X, HALD_Y = textbook.HALD[:, :4], textbook.HALD[:, 4]
LONGLEY_X, LONGLEY_Y = textbook.LONGLEY[:, :6], textbook.LONGLEY[:, 6]
LEVELS = SubsetOptions(F_in=4.0, F_out=4.0, tolerance=1e-6)


@pytest.fixture(scope="module")
def hald():
    return stepwise(HALD_X, HALD_Y, textbook.HALD_NAMES, options=LEVELS)


def test_hald_path_equals_textbook(hald):
    """The terms x4, x1 and x2 enter, then x4 leaves.

    Source: Draper & Smith, Applied Regression Analysis, 1981, section 6.4 and appendix B.
    """
    models = hald.models
    assert [(step.action.value, step.name) for step in models[1:]] == [
        ("enter", "x4"),
        ("enter", "x1"),
        ("enter", "x2"),
        ("remove", "x4"),
    ]
    np.testing.assert_allclose(
        [step.partial_F for step in models[1:]], [22.80, 108.22, 5.03, 1.86], atol=0.005
    )
    np.testing.assert_allclose(
        [step.R2 for step in models[1:]], [0.675, 0.972, 0.982, 0.979], atol=0.0005
    )
    np.testing.assert_allclose(
        [step.overall_F for step in models[1:]], [22.80, 176.63, 166.83, 229.50], atol=0.005
    )
    np.testing.assert_allclose(models[3].F, [1.86, 154.01, 5.03], atol=0.005)
    np.testing.assert_allclose(models[4].F, [146.52, 208.58], atol=0.005)
    assert hald.steps[-1].action is Action.STOP
    assert "1.863, of x4, below 4" in hald.steps[-1].reason


def test_hald_final_model_equals_textbook(hald):
    result = choose(hald, FirstMaximumF())
    # the report's rule stops before the first decrease of the overall F, and misses a larger F
    assert result.names == ("x4", "x1")
    last = least_squares(HALD_X[:, :2], HALD_Y, ("x1", "x2"))
    # printed values
    np.testing.assert_allclose([last.constant, *last.values], [52.5773, 1.4683, 0.6623], atol=5e-5)
    np.testing.assert_allclose([last.s**2, last.R2], [5.790, 0.97868], atol=5e-4)


@pytest.mark.parametrize(
    ("X", "y", "names"),
    [(HALD_X, HALD_Y, textbook.HALD_NAMES), (LONGLEY_X, LONGLEY_Y, textbook.LONGLEY_NAMES)],
    ids=["Hald", "Longley"],
)
@pytest.mark.parametrize("level", [1.0, 4.0])
def test_every_step_equals_statsmodels(X, y, names, level):
    """Compare the order of entry, the removal and F of each step.

    The tolerance is 1e-7, because statsmodels inverts products of uncentred columns.
    """
    expected, terms = textbook.stepwise_by_statsmodels(X, y, names, level, level)
    options = SubsetOptions(F_in=level, F_out=level, tolerance=1e-9)
    result = stepwise(X, y, names, options=options)
    assert [(step.action.value, step.name) for step in result.models[1:]] == [
        (action, name) for action, name, _ in expected
    ]
    np.testing.assert_allclose(
        [step.partial_F for step in result.models[1:]], [F for *_, F in expected], rtol=1e-7
    )
    assert list(result.models[-1].terms) == terms
    for step in result.models[1:]:
        theirs = sm.OLS(y, sm.add_constant(X[:, [names.index(name) for name in step.terms]])).fit()
        np.testing.assert_allclose(step.F, theirs.tvalues[1:] ** 2, rtol=1e-7)
        np.testing.assert_allclose(
            [step.R2, step.overall_F], [theirs.rsquared, theirs.fvalue], rtol=1e-7
        )


def test_longley_has_certified_digits():
    """Values and errors have ten correct digits at a condition number of 5e9.

    Products of the columns would lose all digits.
    """
    result = least_squares(LONGLEY_X, LONGLEY_Y, textbook.LONGLEY_NAMES)
    values, errors = textbook.LONGLEY_CERTIFIED.T
    np.testing.assert_allclose(result.values, values, rtol=1e-10)
    np.testing.assert_allclose(result.standard_errors, errors, rtol=1e-10)
    np.testing.assert_allclose(
        [result.constant, result.constant_error], textbook.LONGLEY_CONSTANT, rtol=1e-10
    )
    certified = (textbook.LONGLEY_S, textbook.LONGLEY_R2, textbook.LONGLEY_F)
    np.testing.assert_allclose([result.s, result.R2, result.overall_F], certified, rtol=1e-10)
    products = np.linalg.solve(
        *(_with_ones(LONGLEY_X).T @ b for b in (_with_ones(LONGLEY_X), LONGLEY_Y))
    )
    assert abs(products[2] / values[1] - 1) > 1e-8  # the bound above detects such an error


def _with_ones(X):
    return np.column_stack([np.ones(len(X)), X])
