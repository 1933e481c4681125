"""Stepwise regression: the report's Gauss-Jordan sweeps give the same path; directions, levels, forcing, limits, refusals."""

import numpy as np
import pytest
import scipy.stats

from jaxid._foundation.checks import InputError
from jaxid.structure import (
    REPORT,
    LastStep,
    Minimum,
    SubsetOptions,
    choose,
    columns,
    stepwise,
    stepwise_each,
)
from jaxid.structure.criteria import critical_F

TERMS = ("alpha", "alpha^2", "alpha^3", "beta", "beta^2", "alpha beta", "q", "alpha q", "|beta| beta", "(alpha-0.1)+^2")
POWERS = (
    *(f"{name}^{n}" for name in ("alpha", "beta") for n in range(1, 7)),
    "alpha beta",
    "q",
    "alpha q",
    "|beta| beta",
)


def planted(seed, noise, samples=120):
    """Correlated signals of a manoeuvre, and a response of three of the terms."""
    draw = np.random.default_rng(seed)
    signals = {name: np.cumsum(draw.normal(size=samples)) * 0.03 for name in ("alpha", "beta", "q")}
    X = columns(TERMS, signals, {name: value.mean() for name, value in signals.items()})
    y = 0.3 + 2.0 * X[:, 0] - 4.0 * X[:, 4] + 1.5 * X[:, 6]
    return X, y + noise * np.std(y) * draw.normal(size=samples)


def steep(seed, noise):
    """Powers, which are nearly combinations of each other, and a response that none of them makes up."""
    draw = np.random.default_rng(seed)
    signals = {name: np.cumsum(draw.normal(size=120)) * 0.05 for name in ("alpha", "beta", "q")}
    X = columns(POWERS, signals, {name: value.mean() for name, value in signals.items()})
    y = np.sin(4 * signals["alpha"]) + np.abs(signals["beta"]) * signals["alpha"] + signals["q"]
    return X, y + noise * np.std(y) * draw.normal(size=120)


def sweep(A, k):
    """A Gauss-Jordan pivot on the k-th diagonal element (section B.3)."""
    B = A - np.outer(A[:, k], A[k]) / A[k, k]
    B[k], B[:, k], B[k, k] = A[k] / A[k, k], -A[:, k] / A[k, k], 1 / A[k, k]
    return B


def by_gauss_jordan(X, y, options):
    """(action, column, F) of the report's algorithm: sweeps of the matrix of correlations, in and out."""
    data = np.column_stack([X, y])
    A = np.corrcoef(data, rowvar=False)
    samples, terms = X.shape
    inside, steps = [], []
    while True:
        dof = samples - len(inside) - 1
        ratio = A[:terms, -1] ** 2 / np.diagonal(A)[:terms]
        if inside:
            F = {k: ratio[k] * dof / A[-1, -1] for k in inside}
            worst = min(inside, key=F.get)
            if F[worst] < options.F_out:
                A, _ = sweep_out(A, worst), inside.remove(worst)
                steps.append(("remove", worst, F[worst]))
                continue
        if 1 - A[-1, -1] >= options.R2_stop:
            return steps, A[:terms, -1][inside] * np.std(y) / np.std(X[:, inside], axis=0)
        open_ = [k for k in range(terms) if k not in inside and A[k, k] >= options.tolerance]
        F = {k: ratio[k] * (dof - 1) / (A[-1, -1] - ratio[k]) for k in open_}
        best = max(open_, key=F.get, default=None)
        if best is None or F[best] < options.F_in:
            return steps, A[:terms, -1][inside] * np.std(y) / np.std(X[:, inside], axis=0)
        A, _ = sweep(A, best), inside.append(best)
        steps.append(("enter", best, F[best]))


def sweep_out(A, k):
    """The pivot undone: the signs of the pivot's row and column change places."""
    B = A - np.outer(A[:, k], A[k]) / A[k, k]
    B[k], B[:, k], B[k, k] = -A[k] / A[k, k], A[:, k] / A[k, k], 1 / A[k, k]
    return B


@pytest.mark.parametrize("case", range(12))
@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_the_path_is_that_of_gauss_jordan_sweeps(case, noise):
    """The report's levels and tolerance. 1e-8: sweeps lose digits with each column near that tolerance."""
    X, y = steep(case, noise)
    steps, values = by_gauss_jordan(X, y, REPORT)
    found = stepwise(X, y, POWERS, options=REPORT)
    assert [(step.action, POWERS.index(step.name)) for step in found.models[1:]] == [step[:2] for step in steps]
    np.testing.assert_allclose([step.partial_F for step in found.models[1:]], [F for *_, F in steps], rtol=1e-8)
    np.testing.assert_allclose(choose(found, LastStep()).values, values, rtol=1e-8)


def test_some_of_those_paths_remove_and_some_bar():
    """So that the comparison above is one of all kinds of moves."""
    paths = [stepwise(*steep(case, noise), POWERS, options=REPORT) for case in range(12) for noise in (0.02, 0.2)]
    actions = [step.action for path in paths for step in path.steps]
    assert min(actions.count(action) for action in ("enter", "remove", "bar")) >= 1


def test_a_system_without_noise_is_found_exactly():
    X, y = planted(3, 0.0)
    X, names = X[:, [0, 2, 4, 5, 6, 8]], [TERMS[k] for k in (0, 2, 4, 5, 6, 8)]
    found = choose(stepwise(X, y, names, options=SubsetOptions(tolerance=1e-6)), LastStep())
    values = dict(zip(found.names, found.values, strict=True))
    np.testing.assert_allclose([values.pop(n) for n in ("alpha", "beta^2", "q")], [2.0, -4.0, 1.5], rtol=1e-10)
    assert not values
    assert found.constant == pytest.approx(0.3, rel=1e-11)
    assert 1 - found.R2 < 1e-24


def test_forward_never_removes_and_backward_never_adds():
    X, y = planted(1, 0.3)
    forward = stepwise(X, y, TERMS, options=SubsetOptions(direction="forward", tolerance=1e-6))
    backward = stepwise(X, y, TERMS, options=SubsetOptions(direction="backward", tolerance=1e-6))
    assert {step.action for step in forward.models} == {"start", "enter"}
    assert {step.action for step in backward.models} == {"start", "remove"}
    assert set(backward.models[0].terms) == set(TERMS)
    assert min(backward.models[-1].F) >= 4.0


def test_the_whole_path_goes_there_and_back():
    X, y = planted(1, 0.3)
    path = stepwise(X, y, TERMS, options=SubsetOptions(direction="there and back", tolerance=1e-6, force_in=("q",)))
    sizes = [len(step.terms) for step in path.models]
    assert sizes == [*range(11), *range(10, 0, -1)]
    assert all("q" in step.terms for step in path.models[1:])
    assert "no term is left that may be removed" in path.steps[-1].why


def test_the_whole_path_finds_what_a_path_that_only_adds_misses(seed):
    """A term that follows the sum of two others enters first; on the way back it is the first to leave."""
    draw = np.random.default_rng(seed)
    X = draw.normal(size=(80, 5))
    X[:, 4] = X[:, 0] + X[:, 1] + 0.3 * X[:, 4]
    y = X[:, 0] + X[:, 1] + 0.1 * draw.normal(size=80)
    path = stepwise(X, y, ("a", "b", "c", "d", "sum"), options=SubsetOptions(direction="there and back"))
    assert path.models[1].terms == ("sum",)
    assert set(choose(path, Minimum("BIC")).names) == {"a", "b"}


def test_partial_correlation_ranks_as_partial_F_and_is_that_of_residuals():
    X, y = planted(2, 0.3)
    path = stepwise(X, y, TERMS, options=SubsetOptions(F_in=0.5))
    step = path.models[2]
    k, inside = TERMS.index(step.name), TERMS.index(path.models[1].name)
    ones = np.column_stack([np.ones(len(y)), X[:, inside]])
    rest = [v - ones @ np.linalg.lstsq(ones, v, rcond=None)[0] for v in (X[:, k], y)]
    assert step.partial_correlation == pytest.approx(abs(np.corrcoef(*rest)[0, 1]), rel=1e-9)
    assert step.tolerance == pytest.approx(rest[0] @ rest[0] / np.var(X[:, k]) / len(y), rel=1e-9)


def test_levels_as_probabilities_follow_the_degrees_of_freedom():
    for dof in (3, 30, 3000):
        for terms in (1, 4):
            for level in (0.2, 0.01, 1e-9):
                assert critical_F(level, dof, terms) == pytest.approx(scipy.stats.f.isf(level, terms, dof), rel=1e-7)
    assert SubsetOptions(level_in=0.01).F_to_enter(98) == pytest.approx(6.9, abs=0.03)  # not 3.0, as Table 6.2 has it
    X, y = planted(4, 0.8, samples=14)
    path = stepwise(X, y, TERMS, options=SubsetOptions(level_in=0.05))
    last = path.models[-1]
    assert (np.asarray(last.F) >= scipy.stats.f.isf(0.05, 1, 14 - len(last.terms) - 1)).all()


def test_forcing_in_and_out_limits_and_the_error_test():
    X, y = planted(5, 0.1)
    options = SubsetOptions(force_in=("|beta| beta",), force_out=("alpha",), max_terms=3, F_in=0.0)
    path = stepwise(X, y, TERMS, options=options)
    assert path.steps[1].action == "force"
    assert all("|beta| beta" in step.terms for step in path.steps[1:])
    assert not any("alpha" in step.terms for step in path.steps)
    assert len(path.models[-1].terms) == 3
    assert "max_terms = 3" in path.steps[-1].why
    path = stepwise(X, y, TERMS, options=SubsetOptions(R2_stop=0.8))
    assert path.models[-1].R2 >= 0.8 > path.models[-2].R2
    assert "R2 has reached 0.8" in path.steps[-1].why


def test_a_collinear_column_is_logged_and_does_not_enter():
    X, y = planted(6, 0.1)
    X = np.column_stack([X, X[:, 0] + 1e-5 * X[:, 3]])
    path = stepwise(X, y, (*TERMS, "double"), options=SubsetOptions(tolerance=1e-4, force_in=("alpha",)))
    (barred,) = (step for step in path.steps if step.name == "double")
    assert barred.action == "bar"
    assert "tolerance is below 0.0001" in barred.why
    assert barred.tolerance == pytest.approx(0, abs=1e-8)
    with pytest.raises(InputError, match="'double' shall be forced in"):
        stepwise(X, y, (*TERMS, "double"), options=SubsetOptions(force_in=("alpha", "double")))


def test_a_column_that_does_not_vary_is_logged_and_does_not_enter():
    X, y = planted(4, 0.8, samples=14)  # alpha stays below the knot
    (barred,) = (step for step in stepwise(X, y, TERMS).steps if step.name == "(alpha-0.1)+^2")
    assert (barred.action, barred.why) == ("bar", "does not vary in these samples")
    backward = stepwise(X, y, TERMS, options=SubsetOptions(direction="backward"))
    assert "(alpha-0.1)+^2" not in backward.models[0].terms


def test_several_responses_each_with_its_own_candidates(seed):
    draw = np.random.default_rng(seed)
    signals = {name: draw.normal(size=80) for name in ("alpha", "beta", "q")}
    responses = {"Cm": 0.1 + signals["alpha"] - 2 * signals["q"], "Cn": 3 * (signals["beta"] - 0.2) ** 2}
    candidates = {"Cm": ("alpha", "q", "alpha^2"), "Cn": ("beta", "beta^2", "1")[:2]}
    found = stepwise_each(responses, candidates, signals, centre={"beta": 0.2}, options={"Cn": REPORT})
    assert {name: set(path.models[-1].terms) for name, path in found.items()} == {
        "Cm": {"alpha", "q"},
        "Cn": {"beta^2"},
    }
    assert found["Cm"].problem.response == "Cm"
    with pytest.raises(InputError, match="list of candidates for response 'Cl'"):
        stepwise_each({"Cl": responses["Cm"]}, candidates, signals)


def test_the_log_prints_every_step():
    path = stepwise(*planted(1, 0.5), TERMS, options=REPORT)
    lines = str(path).splitlines()
    assert len(lines) == 2 + len(path.steps)
    assert all(step.why in line for step, line in zip(path.steps, lines[2:], strict=True))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"F_in": 3.0, "F_out": 4.0}, "stays at 4"),
        ({"F_in": 3.0, "level_in": 0.01}, "Give one kind"),
        ({"level_out": 0.01}, "without level_in"),
        ({"level_in": 0.01, "level_out": 0.001}, "must not be negative or the higher"),
        ({"level_in": 1.5}, "a probability lies between"),
        ({"tolerance": 0.0}, "tolerance is 0"),
        ({"R2_stop": 1.1}, "R2_stop is 1.1"),
        ({"max_terms": 0}, "max_terms is 0"),
        ({"PSE_bound": -1.0}, "a variance is positive"),
        ({"force_in": ("a",), "force_out": ("a",)}, "'a' occurs twice"),
    ],
)
def test_options_that_contradict_themselves_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        SubsetOptions(**change)


def test_forced_names_must_be_candidates():
    with pytest.raises(InputError, match=r"no candidate to force in 'alfa'.*alpha"):
        stepwise(*planted(1, 0.5), TERMS, options=SubsetOptions(force_in=("alfa",)))
