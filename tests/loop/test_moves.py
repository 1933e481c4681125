"""Proposals of moves: groups, swaps, removals, and noise models, from the linear model of a fit."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from searched_spring import problem

from jaxid._foundation.results import RESULTS
from jaxid.effects import InputDelay, SensorBias, Term
from jaxid.loop import Coloured, Hypothesis, LoopOptions, RandomForces, search_effects
from jaxid.loop import search as loop_search
from jaxid.loop.evidence import Comparison, Decision, compare, least_expected_fall
from jaxid.loop.fit import fit
from jaxid.loop.moves import Move, MoveKind, Proposals
from jaxid.loop.noise import noise_moves, without_slow
from jaxid.loop.search import _new, refit, second_steps, with_shapes
from jaxid.loop.search_tree import SearchTree, Step

OPTIONS = LoopOptions()
SQUARE, CUBIC = Term("v", "x^2", jnp.array(0.1)), Term("v", "x^3", jnp.array(-0.1))


def test_powers_of_one_signal_are_a_group():
    given = problem(21, SQUARE, CUBIC)
    proposals = Proposals(fit(given, Hypothesis()), OPTIONS)
    (group,) = proposals.groups()
    assert set(group.into) == {"x^2 in v", "x^3 in v"}
    single = max(map(proposals.score, proposals.candidates))
    assert group.expected > single
    assert set(search_effects(given).effects) == set(group.into)


def test_one_cause_replaces_two_effects():
    """Two late sensors stand for a late input until the exchange is proposed."""
    given = problem(22, InputDelay("force", jnp.array(0.1)))
    both = fit(given, Hypothesis(("delay of x", "delay of v")))
    best = Proposals(both, OPTIONS).swaps(np.inf)[0]
    assert best.hypothesis.effects == ("delay of input force",)
    new = fit(given, best.hypothesis, both, best.start)
    assert compare(both, new, OPTIONS, 9).decision is Decision.BETTER


def test_superfluous_effect_is_dropped():
    given = problem(23, CUBIC)
    wide = fit(given, Hypothesis(("x^3 in v", "bias of v")))
    drops = Proposals(wide, OPTIONS).drops()
    assert [move.hypothesis.effects for move in drops] == [("x^3 in v",)]
    new = fit(given, drops[0].hypothesis, wide)
    assert compare(wide, new, OPTIONS, 9).accepted
    # The linear model predicts the rise of chi-square by the removal.
    assert 2.0 * (wide.cost - new.cost) == pytest.approx(drops[0].expected, rel=0.05, abs=0.05)


def test_best_candidate_of_every_place_is_proposed():
    """Seven effects act on the motion, one is a small bias of a sensor."""
    given = problem(24, Term("v", "x^3", jnp.array(-0.3)), SensorBias("v", jnp.array(0.05)))
    moves = Proposals(fit(given, Hypothesis()), LoopOptions(refits=1)).additions()
    places = {given.effects[move.into[0]].card.location for move in moves}
    assert len(places) > 1


def test_addition_that_cannot_compete_waits_for_the_next_round():
    """A bias whose score is a small part of the fall by a cubic is refitted after the cubic."""
    given = problem(24, Term("v", "x^3", jnp.array(-0.3)), SensorBias("v", jnp.array(0.05)))
    tree = search_effects(given).tree
    first, second = (
        {step.move.into for step in tree.steps if step.parent is parent}
        for parent in (tree.declared, tree.path[0].fit)
    )
    proposals = Proposals(tree.declared, OPTIONS)
    assert proposals.score("bias of v") > proposals.threshold
    assert ("bias of v",) in second - first
    assert set(tree.best.effects) == {"x^3 in v", "bias of v"}


def test_addition_that_cannot_be_accepted_is_not_refitted():
    """While the residual is coloured, a small fall of the cost neither ends that nor can lower the
    error on the check records by the least gain.
    """
    coloured, strict = fit(problem(25, memory=0.8), Hypothesis()), LoopOptions(min_check_gain=0.5)
    few, many = (
        {move.into[0]: move for move in Proposals(coloured, options).additions()}
        for options in (strict, OPTIONS)
    )
    left = set(many) - set(few)
    assert left
    for name in left:
        assert not compare(coloured, refit(coloured, many[name]), strict, 9).accepted
    assert least_expected_fall(fit(problem(25), Hypothesis()), strict) == 0.0


def test_noise_is_proposed_where_it_explains_the_residual():
    white, coloured = (fit(problem(25, memory=m), Hypothesis()) for m in (0.0, 0.8))
    assert list(noise_moves(white, white, None, OPTIONS)) == []
    (((move,), _),) = noise_moves(coloured, coloured, None, OPTIONS)
    assert isinstance(move.hypothesis.noise, Coloured)
    new = fit(coloured.problem, move.hypothesis, coloured)
    assert 2.0 * (coloured.cost - new.cost) == pytest.approx(move.expected, rel=0.1)


def test_forces_as_slow_as_a_drift_are_left_out():
    white = fit(problem(25), Hypothesis())
    slow, noise = white.problem.longest_memory, RandomForces({"x": 0.1, "v": 0.2}, {}, 0.5)

    def refused(x, v):
        fitted = dataclasses.replace(white, hypothesis=Hypothesis((), noise))
        times = {"correlation_time.x": (x, 0.1), "correlation_time.v": (v, 0.1)}
        fitted.__dict__["estimates"] = white.estimates | times  # of a fit that ended there
        return fitted

    move = without_slow(white, refused(slow, 0.4 * slow))
    assert move is not None
    assert move.hypothesis == Hypothesis((), RandomForces({"v": 0.2}, {}, 0.5))
    assert move.start["correlation_time.v"] == 0.4 * slow
    for times in ((slow, slow), (0.1 * slow, 0.4 * slow)):
        assert without_slow(white, refused(*times)) is None
    assert without_slow(white, white) is None


def test_wider_beam_finds_the_same_pair():
    given = problem(5, Term("v", "x^3", jnp.array(-0.3)), SensorBias("v", jnp.array(0.1)))
    found = search_effects(given, options=LoopOptions(beam_width=2))
    assert set(found.effects) == {"x^3 in v", "bias of v"}


@pytest.fixture(scope="module")
def refused_cubic():
    """A search that has refused the cubic term, one of two missing effects."""
    given = problem(5, CUBIC, SensorBias("v", jnp.array(0.1)))
    declared = with_shapes(fit(given, Hypothesis()))
    cubic = Proposals(declared, OPTIONS).additions()[0]
    alone = refit(declared, cubic)
    fall = 2.0 * (declared.cost - alone.cost)
    refused = Comparison(Decision.NOT_SIGNIFICANT, fall, np.inf, 0.0)
    return SearchTree(declared, declared, [Step(declared, cubic, alone, refused)])


def test_refused_effect_is_proposed_together_with_another(refused_cubic):
    """Each of two effects leaves the other in the residual, which may hide it; both at once do
    not.
    """
    tree, declared = refused_cubic, refused_cubic.declared
    (step,) = tree.steps
    cubic, alone, refused = step.move, step.fit, step.comparison
    fall = refused.fall
    moves = second_steps(tree, declared, OPTIONS)
    pair = moves[0]
    assert (pair.kind, pair.into) == (MoveKind.PAIR, ("x^3 in v", "bias of v"))
    assert pair.start["x^3 in v.gain"] == alone.estimates["x^3 in v.gain"][0]
    assert fall < pair.expected
    assert compare(declared, refit(declared, pair), OPTIONS, 36).accepted
    # Without evidence, of a cubic that is not there, no pair is proposed.
    white = with_shapes(fit(problem(6), Hypothesis()))
    steps = [Step(white, cubic, refit(white, cubic), refused)]
    assert second_steps(SearchTree(white, white, steps), white, OPTIONS) == []


def test_hypothesis_that_two_moves_reach_is_refitted_once(refused_cubic):
    """A pair may be proposed by its joint score and after a refused addition, whose values it then
    starts from.
    """
    declared = refused_cubic.declared
    pair = second_steps(refused_cubic, declared, OPTIONS)[0]
    scored = dataclasses.replace(pair, start={}, expected=2.0 * pair.expected)
    assert _new(refused_cubic, declared, [scored, pair]) == [pair]
    (step,) = refused_cubic.steps
    assert _new(refused_cubic, declared, [step.move, pair]) == [pair]


def test_refinement_of_refused_effect_replaces_it(refused_cubic, monkeypatch):
    finer = Move(MoveKind.ADD, Hypothesis(("bias of v",)), ("bias of v",), 1.0, {}, {})
    monkeypatch.setattr(Proposals, "additions", lambda _: [finer])
    (move,) = second_steps(refused_cubic, refused_cubic.declared, OPTIONS)
    assert (move.into, move.hypothesis.effects) == (("bias of v",), ("bias of v",))


@pytest.mark.parametrize(
    ("expected", "cost", "target", "fits"),
    [
        (8.0, -0.9, -31.5, 3),  # it stalls; as expected in each of ten runs, it reaches its target
        (8.0, -0.9, -32.5, 1),
        (8.0, -1.1, -31.5, 1),  # more than a quarter of the expected fall
        (60.0, -1.0, -25.0, 3),  # it stalls, and much more was expected
        (-4.0, 20.0, -15.0, 3),  # an exchange: far from the expected cost, slightly above
        (4.0, np.inf, -25.0, 3),  # its simulation fails
        (8.0, -0.9, np.inf, 3),
    ],
)
def test_refit_is_repeated_if_it_stalls_within_reach_of_its_target(
    monkeypatch, expected, cost, target, fits
):
    parent, tried = fit(problem(6), Hypothesis()), []
    solution = dataclasses.replace(
        parent.solution, cost=parent.solution.cost + cost, result=RESULTS.steps_exhausted
    )
    unfinished = dataclasses.replace(parent, solution=solution)

    def recorded(*arguments):
        tried.append(arguments)
        return unfinished

    monkeypatch.setattr(loop_search, "fit", recorded)
    move = Move(MoveKind.ADD, Hypothesis(("x^3 in v",)), ("x^3 in v",), expected, {}, {})
    refit(parent, move, parent.cost + target)
    assert len(tried) == fits
