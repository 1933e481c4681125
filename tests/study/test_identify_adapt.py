"""Changes of the terms between estimates: scores, deletion, addition, and the rank."""

import numpy as np
import pytest
from test_identify import CANDIDATES, EMPTY, TRUE, measured

import jaxid
from jaxid import OutputError, identify
from jaxid.estimation.estimate import checked_case
from jaxid.estimation.shared_programs import estimate_case
from jaxid.models import Polynomial
from jaxid.models.noise import FixedNoise
from jaxid.models.replace import with_polynomials
from jaxid.structure import SubsetOptions
from jaxid.study import IdentifyOptions
from jaxid.study.terms.adaptation import Kind, _scores, adapted

KNOWN = OutputError(FixedNoise([0.004**2, 0.01**2, 0.05**2]))
UNSEEN = "(x-100)+"  # zero in all records
FEWER = IdentifyOptions(subset=SubsetOptions(F_in=3.0, F_out=3.0, max_terms=3), adapt=True)


@pytest.fixture(scope="module")
def record():
    return measured(3)


def fitted(record, names, likelihood=KNOWN):
    """Case and estimate of some free terms of a model that has all candidates."""
    terms = dict.fromkeys(("1", *CANDIDATES, UNSEEN), 0.0) | TRUE
    terms |= {name: 0.0 for name in TRUE if name not in names}
    model = with_polynomials(EMPTY.without(("drift",)), {"stiffness": Polynomial(terms)})
    free = jaxid.free(model, *(f"stiffness.{n}" for n in names), per_record=("initial_state",))
    case = checked_case(model, free, model.prepared(record), likelihood)
    return case, estimate_case(case)


def adaptation(record, names, candidates=CANDIDATES, likelihood=KNOWN):
    case, estimate = fitted(record, names, likelihood)
    return adapted(case, estimate, {"stiffness": candidates}, IdentifyOptions(), None)


def test_score_predicts_reduction_of_the_cost(record):
    """A term without effect in truth: near the optimum the cost is a parabola."""
    case, estimate = fitted(record, tuple(TRUE))
    for term in ("x^2", "x v", "v^2"):
        (gain,), (tolerance,) = _scores(case, estimate, [f"stiffness.{term}"])
        _, larger = fitted(record, (*TRUE, term))
        reduction = 2.0 * float(estimate.cost - larger.cost)
        np.testing.assert_allclose(gain, reduction, rtol=0.02, atol=1e-6)
        assert 0.0 < tolerance <= 1.0


def test_superfluous_terms_are_deleted_one_by_one(record):
    result = adaptation(record, (*TRUE, "x^2", "v^3", "x v"))
    assert set(result.terms({"stiffness": (*TRUE, "x^2", "v^3", "x v")})["stiffness"]) == set(TRUE)
    deleted = [change for change in result.changes if change.kind is Kind.DELETE]
    assert {change.term for change in deleted} >= {"x^2", "v^3", "x v"}


def test_absent_term_is_added(record):
    result = adaptation(record, ("x", "v", "force"))
    assert result.changes[0].kind is Kind.ADD
    assert result.changes[0].term == "x^3"
    assert "stiffness.x^3" in result.estimate.names
    before, after = result.changes[0].costs
    assert after < before - 100.0


def test_undetermined_term_is_held(record):
    result = adaptation(record, (*TRUE, UNSEEN), (*CANDIDATES, UNSEEN))
    (held,) = [change for change in result.changes if change.kind is Kind.FREEZE]
    assert held.term == UNSEEN
    assert f"stiffness.{UNSEEN}" not in result.estimate.names
    assert bool(np.all(np.isfinite(np.asarray(result.estimate.standard_errors))))


def test_identify_completes_a_truncated_regression(record):
    result = identify(EMPTY, record, options=FEWER, likelihood=KNOWN)
    assert len(result.equations["stiffness"].regression.names) == 3
    assert {*TRUE} <= {*result.model.stiffness.terms}
    assert "change: stiffness.v added (score" in str(result)
    assert list(result.changes) == result.to_dict()["changes"]
    value, error = (
        getattr(result.estimate, name)("stiffness.v") for name in ("value", "standard_error")
    )
    assert abs(value - TRUE["v"]) < 4.0 * error


def test_named_terms_stay(record):
    options = IdentifyOptions(terms={"stiffness": ("x", "v", "force")}, adapt=True)
    result = identify(EMPTY, record, options=options)
    assert result.changes == ()
    assert result.model.stiffness.terms == ("1", "x", "v", "force")


def test_status_states_an_undetermined_parameter(record):
    """The estimate of the first terms has an undetermined parameter."""
    _, estimate = fitted(record, (*TRUE, UNSEEN))
    assert "do not determine" in estimate.status
    assert bool(estimate.successful)
    assert estimate.weak_directions == (f"stiffness.{UNSEEN} is not determined",)
