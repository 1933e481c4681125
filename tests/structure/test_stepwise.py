"""Stepwise regression: path against Gauss-Jordan sweeps, directions, levels, limits, refusals."""

import numpy as np
import pytest
import scipy.stats

from jaxid._foundation.checks import InputError
from jaxid.structure import (
    REPORT,
    Action,
    Direction,
    LastStep,
    Minimum,
    SubsetOptions,
    choose,
    columns,
    stepwise,
    stepwise_each,
)
from jaxid.structure.criteria import critical_F

TERMS = (
    "alpha",
    "alpha^2",
    "alpha^3",
    "beta",
    "beta^2",
    "alpha beta",
    "q",
    "alpha q",
    "|beta| beta",
    "(alpha-0.1)+^2",
)
POWERS = (
    *(f"{name}^{n}" for name in ("alpha", "beta") for n in range(1, 7)),
    "alpha beta",
    "q",
    "alpha q",
    "|beta| beta",
)


def planted(seed, noise, samples=120):
    """Return terms of correlated signals, and a response that is a sum of three terms."""
    draw = np.random.default_rng(seed)
    signals = {name: np.cumsum(draw.normal(size=samples)) * 0.03 for name in ("alpha", "beta", "q")}
    X = columns(TERMS, signals, {name: value.mean() for name, value in signals.items()})
    y = 0.3 + 2.0 * X[:, 0] - 4.0 * X[:, 4] + 1.5 * X[:, 6]
    return X, y + noise * np.std(y) * draw.normal(size=samples)


def steep(seed, noise):
    """Return nearly collinear powers, and a response that is no combination of them."""
    draw = np.random.default_rng(seed)
    signals = {name: np.cumsum(draw.normal(size=120)) * 0.05 for name in ("alpha", "beta", "q")}
    X = columns(POWERS, signals, {name: value.mean() for name, value in signals.items()})
    y = np.sin(4 * signals["alpha"]) + np.abs(signals["beta"]) * signals["alpha"] + signals["q"]
    return X, y + noise * np.std(y) * draw.normal(size=120)


def sweep(A, k):
    """Return the matrix after a Gauss-Jordan pivot on the k-th diagonal element (section B.3)."""
    B = A - np.outer(A[:, k], A[k]) / A[k, k]
    B[k], B[:, k], B[k, k] = A[k] / A[k, k], -A[:, k] / A[k, k], 1 / A[k, k]
    return B


def by_gauss_jordan(X, y, options):
    """Return the steps (action, column, F) and the values of the report's algorithm.

    It sweeps the matrix of correlations for each entry and each removal.
    """
    A = np.corrcoef(np.column_stack([X, y]), rowvar=False)
    samples, terms = X.shape
    inside, steps = [], []
    while (step := next_sweep(A, inside, samples, options)) is not None:
        action, k, _ = step
        steps.append(step)
        if action == "remove":
            A, _ = sweep_out(A, k), inside.remove(k)
        else:
            A, _ = sweep(A, k), inside.append(k)
    return steps, A[:terms, -1][inside] * np.std(y) / np.std(X[:, inside], axis=0)


def next_sweep(A, inside, samples, options):
    """Return (action, column, F) of the next sweep, or None at the end."""
    terms, dof = len(A) - 1, samples - len(inside) - 1
    ratio = A[:terms, -1] ** 2 / np.diagonal(A)[:terms]
    if inside:
        F = {k: ratio[k] * dof / A[-1, -1] for k in inside}
        worst = min(inside, key=F.get)
        if F[worst] < options.F_out:
            return "remove", worst, F[worst]
    if 1 - A[-1, -1] >= options.R2_stop:
        return None
    admitted = [k for k in range(terms) if k not in inside and A[k, k] >= options.tolerance]
    F = {k: ratio[k] * (dof - 1) / (A[-1, -1] - ratio[k]) for k in admitted}
    best = max(admitted, key=F.get, default=None)
    return None if best is None or F[best] < options.F_in else ("enter", best, F[best])


def sweep_out(A, k):
    """Return the matrix after the inverse pivot: the signs of the row and the column exchange."""
    B = A - np.outer(A[:, k], A[k]) / A[k, k]
    B[k], B[:, k], B[k, k] = -A[k] / A[k, k], A[:, k] / A[k, k], 1 / A[k, k]
    return B


@pytest.mark.parametrize("case", range(12))
@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_path_equals_gauss_jordan_sweeps(case, noise):
    """Levels and tolerance of the report; sweeps of nearly collinear columns err by up to 1e-8."""
    X, y = steep(case, noise)
    steps, values = by_gauss_jordan(X, y, REPORT)
    result = stepwise(X, y, POWERS, options=REPORT)
    assert [(step.action.value, POWERS.index(step.name)) for step in result.models[1:]] == [
        step[:2] for step in steps
    ]
    np.testing.assert_allclose(
        [step.partial_F for step in result.models[1:]], [F for *_, F in steps], rtol=1e-8
    )
    np.testing.assert_allclose(choose(result, LastStep()).values, values, rtol=1e-8)


def test_compared_paths_contain_all_actions():
    """The comparison above covers entries, removals and barred terms."""
    paths = [
        stepwise(*steep(case, noise), POWERS, options=REPORT)
        for case in range(12)
        for noise in (0.02, 0.2)
    ]
    actions = [step.action for path in paths for step in path.steps]
    assert min(actions.count(action) for action in (Action.ENTER, Action.REMOVE, Action.BAR)) >= 1


def test_stepwise_regression_recovers_system_without_noise():
    X, y = planted(3, 0.0)
    X, names = X[:, [0, 2, 4, 5, 6, 8]], [TERMS[k] for k in (0, 2, 4, 5, 6, 8)]
    result = choose(stepwise(X, y, names, options=SubsetOptions(tolerance=1e-6)), LastStep())
    values = dict(zip(result.names, result.values, strict=True))
    np.testing.assert_allclose(
        [values.pop(n) for n in ("alpha", "beta^2", "q")], [2.0, -4.0, 1.5], rtol=1e-10
    )
    assert not values
    assert result.constant == pytest.approx(0.3, rel=1e-11)
    assert 1 - result.R2 < 1e-24


def test_forward_never_removes_and_backward_never_adds():
    X, y = planted(1, 0.3)
    forward = stepwise(
        X, y, TERMS, options=SubsetOptions(direction=Direction.FORWARD, tolerance=1e-6)
    )
    backward = stepwise(
        X, y, TERMS, options=SubsetOptions(direction=Direction.BACKWARD, tolerance=1e-6)
    )
    assert {step.action for step in forward.models} == {Action.START, Action.ENTER}
    assert {step.action for step in backward.models} == {Action.START, Action.REMOVE}
    assert set(backward.models[0].terms) == set(TERMS)
    assert min(backward.models[-1].F) >= 4.0


def test_path_there_and_back_adds_and_removes_all_terms():
    X, y = planted(1, 0.3)
    path = stepwise(
        X,
        y,
        TERMS,
        options=SubsetOptions(
            direction=Direction.FORWARD_THEN_BACKWARD, tolerance=1e-6, force_in=("q",)
        ),
    )
    sizes = [len(step.terms) for step in path.models]
    assert sizes == [*range(11), *range(10, 0, -1)]
    assert all("q" in step.terms for step in path.models[1:])
    assert "no term is left that may be removed" in path.steps[-1].reason


def test_path_there_and_back_contains_model_that_forward_path_misses(seed):
    """A term close to the sum of two others enters first, and leaves first in the backward pass."""
    draw = np.random.default_rng(seed)
    X = draw.normal(size=(80, 5))
    X[:, 4] = X[:, 0] + X[:, 1] + 0.3 * X[:, 4]
    y = X[:, 0] + X[:, 1] + 0.1 * draw.normal(size=80)
    path = stepwise(
        X,
        y,
        ("a", "b", "c", "d", "sum"),
        options=SubsetOptions(direction=Direction.FORWARD_THEN_BACKWARD),
    )
    assert path.models[1].terms == ("sum",)
    assert set(choose(path, Minimum("BIC")).names) == {"a", "b"}


def test_partial_correlation_equals_correlation_of_residuals():
    X, y = planted(2, 0.3)
    path = stepwise(X, y, TERMS, options=SubsetOptions(F_in=0.5))
    step = path.models[2]
    k, inside = TERMS.index(step.name), TERMS.index(path.models[1].name)
    ones = np.column_stack([np.ones(len(y)), X[:, inside]])
    column, response = (v - ones @ np.linalg.lstsq(ones, v, rcond=None)[0] for v in (X[:, k], y))
    correlation = np.corrcoef(column, response)[0, 1]
    assert step.partial_correlation == pytest.approx(abs(correlation), rel=1e-9)
    assert step.tolerance == pytest.approx(column @ column / np.var(X[:, k]) / len(y), rel=1e-9)


def test_levels_as_probabilities_depend_on_degrees_of_freedom():
    for dof in (3, 30, 3000):
        for terms in (1, 4):
            for level in (0.2, 0.01, 1e-9):
                assert critical_F(level, dof, terms) == pytest.approx(
                    scipy.stats.f.isf(level, terms, dof), rel=1e-7
                )
    # Table 6.2 has 3.0
    assert SubsetOptions(level_in=0.01).F_to_enter(98) == pytest.approx(6.9, abs=0.03)
    X, y = planted(4, 0.8, samples=14)
    path = stepwise(X, y, TERMS, options=SubsetOptions(level_in=0.05))
    last = path.models[-1]
    assert (np.asarray(last.F) >= scipy.stats.f.isf(0.05, 1, 14 - len(last.terms) - 1)).all()


def test_forced_terms_and_limits_are_respected():
    X, y = planted(5, 0.1)
    options = SubsetOptions(force_in=("|beta| beta",), force_out=("alpha",), max_terms=3, F_in=0.0)
    path = stepwise(X, y, TERMS, options=options)
    assert path.steps[1].action is Action.FORCE
    assert all("|beta| beta" in step.terms for step in path.steps[1:])
    assert not any("alpha" in step.terms for step in path.steps)
    assert len(path.models[-1].terms) == 3
    assert "max_terms = 3" in path.steps[-1].reason
    path = stepwise(X, y, TERMS, options=SubsetOptions(R2_stop=0.8))
    assert path.models[-1].R2 >= 0.8 > path.models[-2].R2
    assert "R2 has reached 0.8" in path.steps[-1].reason


def test_collinear_column_is_barred():
    X, y = planted(6, 0.1)
    X = np.column_stack([X, X[:, 0] + 1e-5 * X[:, 3]])
    path = stepwise(
        X, y, (*TERMS, "double"), options=SubsetOptions(tolerance=1e-4, force_in=("alpha",))
    )
    (barred,) = (step for step in path.steps if step.name == "double")
    assert barred.action is Action.BAR
    assert "tolerance is below 0.0001" in barred.reason
    assert barred.tolerance == pytest.approx(0, abs=1e-8)
    with pytest.raises(InputError, match="'double' shall be forced in"):
        stepwise(X, y, (*TERMS, "double"), options=SubsetOptions(force_in=("alpha", "double")))


def test_constant_column_is_barred():
    X, y = planted(4, 0.8, samples=14)  # alpha is below the knot
    (barred,) = (step for step in stepwise(X, y, TERMS).steps if step.name == "(alpha-0.1)+^2")
    assert (barred.action, barred.reason) == (Action.BAR, "does not vary in these samples")
    backward = stepwise(X, y, TERMS, options=SubsetOptions(direction=Direction.BACKWARD))
    assert "(alpha-0.1)+^2" not in backward.models[0].terms


def test_stepwise_each_uses_separate_candidates(seed):
    draw = np.random.default_rng(seed)
    signals = {name: draw.normal(size=80) for name in ("alpha", "beta", "q")}
    responses = {
        "Cm": 0.1 + signals["alpha"] - 2 * signals["q"],
        "Cn": 3 * (signals["beta"] - 0.2) ** 2,
    }
    candidates = {"Cm": ("alpha", "q", "alpha^2"), "Cn": ("beta", "beta^2", "1")[:2]}
    result = stepwise_each(
        responses, candidates, signals, centre={"beta": 0.2}, options={"Cn": REPORT}
    )
    assert {name: set(path.models[-1].terms) for name, path in result.items()} == {
        "Cm": {"alpha", "q"},
        "Cn": {"beta^2"},
    }
    assert result["Cm"].problem.response == "Cm"
    with pytest.raises(InputError, match="list of candidates for response 'Cl'"):
        stepwise_each({"Cl": responses["Cm"]}, candidates, signals)


def test_printed_log_contains_every_step():
    path = stepwise(*planted(1, 0.5), TERMS, options=REPORT)
    lines = str(path).splitlines()
    assert len(lines) == 2 + len(path.steps)
    assert all(step.reason in line for step, line in zip(path.steps, lines[2:], strict=True))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"F_in": 3.0, "F_out": 4.0}, "stays at 4"),
        ({"F_in": 3.0, "level_in": 0.01}, "Give one kind"),
        ({"level_out": 0.01}, "without level_in"),
        ({"level_in": 0.01, "level_out": 0.001}, "must not be negative or the higher"),
        ({"level_in": 1.5}, "a probability lies between"),
        ({"direction": "up"}, "no direction 'up'.*forward then backward"),
        ({"direction": "forward then backward", "F_in": 3.0}, "uses no level of F"),
        ({"tolerance": 0.0}, "tolerance is 0"),
        ({"R2_stop": 1.1}, "R2_stop is 1.1"),
        ({"max_terms": 0}, "max_terms is 0"),
        ({"max_terms": 2, "direction": "backward"}, "'backward' has models of all terms"),
        ({"max_terms": 2, "direction": "forward then backward"}, "has models of all terms"),
        ({"PSE_bound": -1.0}, "a variance is positive"),
        ({"force_in": ("a",), "force_out": ("a",)}, "'a' occurs twice"),
    ],
)
def test_contradictory_options_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        SubsetOptions(**change)


def test_forced_names_must_be_candidates():
    with pytest.raises(InputError, match=r"no candidate to force in 'alfa'.*alpha"):
        stepwise(*planted(1, 0.5), TERMS, options=SubsetOptions(force_in=("alfa",)))
