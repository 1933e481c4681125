"""The search over hypotheses on a spring: effects, pairs and noise models, each planted."""

import dataclasses
import re

import jax.numpy as jnp
import numpy as np
import pytest
from searched_spring import fly, problem

from jaxid import DiagonalNoise, OutputError
from jaxid._foundation.types import Array
from jaxid.effects import (
    Effect,
    EffectCard,
    Location,
    LocationKind,
    SensorBias,
    SensorDelay,
    SensorScale,
    Term,
)
from jaxid.loop import Coloured, Hypothesis, Outcome, RandomForces, White, search_effects
from jaxid.loop.assess import Check
from jaxid.loop.evidence import Comparison, Decision
from jaxid.loop.fit import fit
from jaxid.loop.moves import Move, MoveKind
from jaxid.loop.search_tree import SearchTree, Step
from jaxid.loop.wording import next_best_words
from jaxid.models import FixedNoise

CUBIC = Term("v", "x^3", jnp.array(-0.3))
LATE = SensorDelay("x", jnp.array(0.1))
BIASED = SensorBias("v", jnp.array(0.1))
SCALED = SensorScale("v", jnp.array(0.1))


def test_cubic_term_is_named_as_the_cause():
    found = search_effects(problem(1, CUBIC), test={"test": fly(99, CUBIC)})
    assert found.outcome is Outcome.EXPLAINED
    assert found.effects == ("x^3 in v",)
    gain, error = found.estimates["x^3 in v.gain"]
    assert abs(gain + 0.3) < 4.0 * error
    hypothesis, worse = found.next_best
    assert hypothesis.effects != found.effects
    assert worse > 25.0
    assert "The model lacked: x^3 in the equation of v" in str(found)


def test_nothing_is_added_where_nothing_is_missing():
    found = search_effects(problem(2))
    assert found.outcome is Outcome.NOTHING_MISSING
    assert found.effects == ()
    assert isinstance(found.hypothesis.noise, White)


def test_absent_effect_is_not_named():
    """`assess.noise_like` decides alone: no other candidate imitates a scale of the sensor."""
    found = search_effects(problem(3, SCALED).without("scale of v"))
    assert found.outcome in (Outcome.UNEXPLAINED, Outcome.PROXIES)
    assert [objection.check for objection in found.assessment.objections] == [Check.NOISE_LIKE]


@pytest.mark.parametrize("effect", [LATE, BIASED])
def test_error_of_a_sensor_is_named(effect):
    found = search_effects(problem(4, effect))
    assert (found.outcome, found.effects) == (Outcome.EXPLAINED, (effect.name,))


def test_two_effects_are_named():
    texts: list[str] = []
    found = search_effects(problem(5, CUBIC, BIASED), progress=texts.append)
    assert found.outcome is Outcome.EXPLAINED
    assert set(found.effects) == {CUBIC.name, BIASED.name}
    assert any(re.search(r"^round 1: refit with .* \(1/\d+\)$", text) for text in texts)
    assert any(re.search(r"^round \d: .* \(2/\d+, about \d+ s left\)$", text) for text in texts)


def test_coloured_noise_of_sensors_is_told():
    found = search_effects(problem(6, memory=0.8))
    assert found.outcome is Outcome.COLOURED_NOISE
    assert isinstance(found.hypothesis.noise, Coloured)
    assert found.effects == ()


def test_random_forces_are_told_with_their_size():
    found = search_effects(problem(7, gust=0.3))
    assert found.outcome is Outcome.PROCESS_NOISE
    assert isinstance(found.hypothesis.noise, RandomForces)
    assert found.hypothesis.noise.equations == ("v",)
    for name, true in (("process.v", 0.3), ("k", 1.5), ("sensor.x", 0.02)):
        value, error = found.estimates[name]
        assert 0.0 < error < 0.3 * true
        assert abs(value - true) < 4.0 * error


def test_constant_force_is_not_taken_for_noise():
    """No candidate is constant; a random force that never changes is no noise."""
    found = search_effects(problem(9, Term("v", "1", jnp.array(0.1))))
    assert found.outcome in (Outcome.UNEXPLAINED, Outcome.PROXIES)


class Magnets(Effect):
    """Magnets that pull towards their poles: `dv/dt -= gain sin(2 pi x / 0.8)`."""

    gain: Array
    card = EffectCard(
        name="magnets",
        description="magnets",
        location=Location(LocationKind.EQUATION, "v"),
    )

    def equations(self, dx, signals):
        return {"v": -self.gain * jnp.sin(2 * jnp.pi * signals["x"] / 0.8)}


def test_force_that_follows_a_signal_is_not_random():
    """No candidate has the shape of the force, which random forces without effects would fit."""
    found = search_effects(problem(12, Magnets(jnp.array(0.4))))
    assert (found.outcome, found.effects) == (Outcome.UNEXPLAINED, ())
    assert "x" in found.assessment.objections[0].names
    assert "depends on x" in str(found)


def test_effect_under_coloured_noise_is_named():
    found = search_effects(problem(8, CUBIC, memory=0.8))
    assert found.outcome is Outcome.EXPLAINED
    assert found.effects == (CUBIC.name,)
    assert isinstance(found.hypothesis.noise, Coloured)


def test_interrupted_search_returns_its_best():
    """Ctrl-C in the second round keeps the effect of the first."""

    def stop_in_second_round(text):
        if "refit with" in text and text.count(" in v") + text.count(" of ") > 1:
            raise KeyboardInterrupt

    found = search_effects(problem(5, CUBIC, BIASED), progress=stop_in_second_round)
    assert found.tree.interrupted
    assert len(found.effects) == 1
    assert "The search was stopped" in str(found)


def test_search_interrupted_within_a_stage_keeps_its_accepted_refit():
    refits = []

    def stop_at_second_refit(text):
        if "refit with" in text:
            refits.append(text)
            if len(refits) == 2:
                raise KeyboardInterrupt

    found = search_effects(problem(5, CUBIC), progress=stop_at_second_refit)
    assert found.tree.interrupted
    (step,) = found.tree.path
    assert found.effects == step.fit.effects == (CUBIC.name,)


def test_next_best_hypothesis_is_told_with_the_reason():
    """One that fits better was refused, or was accepted and another one chosen."""
    declared = fit(problem(5, CUBIC), Hypothesis())
    cubic, biased = (
        fit(declared.problem, Hypothesis((n,)), declared) for n in (CUBIC.name, "bias of v")
    )
    move = Move(MoveKind.ADD, cubic.hypothesis, cubic.effects, 1.0, {}, {})
    for decision, words in (
        (Decision.BETTER, "in chi-square, but not chosen."),
        (Decision.CHECK_WORSE, "but refused (predicts the check records worse)."),
    ):
        comparison = Comparison(decision, 1.0, 0.5, 0.0)
        tree = SearchTree(declared, biased, [Step(declared, move, cubic, comparison)])
        assert next_best_words(tree).endswith(words)


def test_random_forces_elsewhere_are_an_alternative():
    """Two noises of one kind differ by their places."""
    declared = fit(problem(5), Hypothesis())
    here, there = (
        dataclasses.replace(declared, hypothesis=Hypothesis((), RandomForces({n: 1.0}, {}, 1.0)))
        for n in ("x", "v")
    )
    move = Move(MoveKind.NOISE, there.hypothesis, (), 1.0, {}, {})
    comparison = Comparison(Decision.NOT_SIGNIFICANT, 1.0, 0.5, 0.0)
    tree = SearchTree(declared, here, [Step(declared, move, there, comparison)])
    assert [other for other, _ in tree.alternatives()] == [declared, there]


def test_noise_that_replaces_a_given_one_also_determines_its_variances():
    """Two coefficients of the memory, one for each sensor, and two variances if they are given."""
    given, estimated = (
        dataclasses.replace(problem(5), likelihood=OutputError(noise))
        for noise in (FixedNoise(jnp.eye(2)), DiagonalNoise())
    )
    more = [
        Hypothesis((), Coloured(1)).count(one) - Hypothesis().count(one)
        for one in (given, estimated)
    ]
    assert more == [4, 2]


def test_problem_on_other_records_keeps_its_library():
    first = problem(1, CUBIC)
    other = first.on([fly(71, CUBIC), fly(72, CUBIC)])
    assert other.augmented.states == first.augmented.states
    assert not np.array_equal(other.train.z, first.train.z)
    assert fit(other, Hypothesis(("x^3 in v",))).cost < fit(other, Hypothesis()).cost
