"""Which candidates of a round are refitted, and which need not be."""

import jax.numpy as jnp
import numpy as np
import pytest
from jaxid.diagnosis.scores import Scores
from jaxid.study.shortlist import HOPELESS, has_no_shape, shortlist

from jaxid.effects.equation import StateLimit, Term
from jaxid.effects.sensor import SensorSaturation
from jaxid.study.rounds import Candidate, Decision

EFFECTS = {
    effect.name: effect
    for effect in (Term("v", "x^3"), Term("v", "x^2"), Term("v", "x"), StateLimit("x", "v"))
}
GAINS = {name: column for column, name in enumerate(EFFECTS)}


def _listed(scores: dict[str, float], overlap=0.0, limit=8, threshold=10.0):
    """Shortlist of candidates with given scores; the first two candidates overlap."""
    names = sorted(scores, key=lambda name: -scores[name])
    alike = np.eye(len(GAINS))
    alike[0, 1] = alike[1, 0] = overlap
    zero = jnp.zeros(len(GAINS))
    result = Scores(zero, zero + 1.0, zero, zero, jnp.asarray(alike))
    candidates = tuple(
        Candidate(name, name, (), "", scores[name], scores[name], 0.0, 1.0) for name in names
    )
    return shortlist(candidates, result, EFFECTS, GAINS, {}, threshold, limit), {
        candidate.name: candidate for candidate in candidates
    }


def _decision(listed, candidate: Candidate, best_fall: float):
    return listed.decision_without_refit(candidate, EFFECTS[candidate.name], best_fall)


def test_best_scored_candidates_above_threshold_are_refitted():
    listed, candidates = _listed({"x^3 in v": 50.0, "x^2 in v": 40.0, "x in v": 9.0})
    assert listed.chosen == ("x^3 in v", "x^2 in v")
    assert [_decision(listed, candidate, 0.0) for candidate in candidates.values()] == [
        None,
        None,
        Decision.NOT_REFITTED,
    ]
    listed, _ = _listed({"x^3 in v": 50.0, "x^2 in v": 40.0}, limit=1)
    assert listed.chosen == ("x^3 in v",)


def test_simpler_of_collinear_candidates_is_refitted():
    listed, candidates = _listed({"x^3 in v": 50.0, "x^2 in v": 49.9}, overlap=1.0)
    assert listed.chosen == ("x^2 in v",)
    assert _decision(listed, candidates["x^3 in v"], 0.0) is Decision.COLLINEAR
    assert listed.twins == {"x^3 in v": "x^2 in v"}


@pytest.mark.parametrize(("share", "refitted"), [(1.01 * HOPELESS, True), (0.99 * HOPELESS, False)])
def test_score_far_below_best_fall_is_not_refitted(share, refitted):
    listed, candidates = _listed({"x^3 in v": 1000.0, "x^2 in v": 1000.0 * share})
    assert (_decision(listed, candidates["x^2 in v"], 1000.0) is None) == refitted


def test_refits_of_shapes_are_limited_and_evident_ones_come_first():
    levels = [StateLimit("x", "v", fraction) for fraction in (0.6, 0.75, 0.9)]
    stop = SensorSaturation("x")
    effects = {effect.name: effect for effect in (*levels, stop)}
    candidates = tuple(
        Candidate(name, name, (), "", 9.0 - i, 9.0 - i, 0.0, 1.0) for i, name in enumerate(effects)
    )
    zero = jnp.zeros(len(effects))
    scores = Scores(zero, zero + 1.0, zero, zero, jnp.eye(len(effects)))
    measured = {"x": np.minimum(np.linspace(0.0, 2.0, 101), 1.0)}
    columns = {name: column for column, name in enumerate(effects)}
    listed = shortlist(candidates, scores, effects, columns, measured, 10.0, limit=2)
    assert listed.unseen == {stop.name, levels[0].name}


def test_shape_is_refitted_at_any_score():
    (limit,) = (name for name, effect in EFFECTS.items() if not has_no_shape(effect))
    listed, candidates = _listed({"x^3 in v": 1e6, limit: 20.0})
    assert _decision(listed, candidates[limit], 1e6) is None
