"""The search over hypotheses: ways past a wrong first effect, and effects that records show."""

import equinox as eqx
import jax.numpy as jnp
import pytest
from small_spring import Spring, fly

from jaxid import LoopOptions, OutputError, free
from jaxid._foundation.types import Array
from jaxid.effects import EffectCard, Location, LocationKind, SensorSaturation, Term
from jaxid.effects.base import Effect
from jaxid.loop import Hypothesis, LoopProblem, Outcome, search_effects
from jaxid.loop.evidence import Decision, compare, worth
from jaxid.loop.fit import fit
from jaxid.loop.moves import Proposals
from jaxid.loop.search import with_shapes


class Blend(Effect):
    """Both cubes at once and a square, of the family of the second cube."""

    square: float = eqx.field(static=True, default=0.15)
    cube: float = eqx.field(static=True, default=-0.1)
    gain: Array = eqx.field(default_factory=lambda: jnp.zeros(()))

    card = EffectCard(
        name="blend",
        description="blend",
        location=Location(LocationKind.MODEL, ""),
        family="v^3 in v",
    )

    def equations(self, dx, signals):
        x, v = signals["x"], signals["v"]
        return {"v": self.gain * (-0.6 * x**3 + self.cube * v**3 + self.square * x**2)}


LIBRARY = (Term("v", "x^3"), Term("v", "v^3"), Blend())
CUBES = Blend(0.0, gain=jnp.array(1.0))
PARTS = slice(0, 3), slice(3, 5), slice(5, 7)


def problem(flown, library):
    model = Spring(1.0, 0.1)
    chosen = free(model, "k", "c", per_record=("initial_state",))
    train, check = flown[:3], flown[3:5]
    return LoopProblem.of(model, library, chosen, OutputError(), train, check, window=60)


def flights(seed, truth=CUBES):
    return [fly(1000 * seed + index, truth)[0] for index in range(5)]


@pytest.mark.parametrize("seed", [1, 2])
def test_wider_beam_finds_two_effects_past_a_wrong_first_one(seed):
    """The blend comes in first, and with it no other of its family, so that the second cube stays
    outside.
    """
    given = problem(flights(seed), LIBRARY)
    found = search_effects(given, options=LoopOptions(beam_width=3))
    first = [step for step in found.tree.steps if step.parent is found.tree.declared]
    assert min(first, key=lambda step: step.fit.cost).fit.effects == ("blend",)
    assert set(found.effects) == {"x^3 in v", "v^3 in v"}
    assert found.outcome is Outcome.EXPLAINED


def test_evident_effect_is_added_while_residual_is_coloured():
    """A significant stop needs no minimum gain on the check records, and their scatter does not
    exclude it.
    """
    flown = flights(5)
    level = 0.5 * max(float(jnp.max(record.z)) for record in flown[:3])
    stopped = [
        eqx.tree_at(lambda record: record.z, record, jnp.minimum(record.z, level))
        for record in flown
    ]
    given = problem(stopped, (SensorSaturation("x"), Term("v", "x^3")))
    declared, options = fit(given, Hypothesis()), LoopOptions(min_check_gain=0.9)
    declared = with_shapes(declared)
    given = declared.problem
    decisions = {}
    for name, effect in given.effects.items():
        start = {f"{name}.gain": effect.card.initial_gain}
        refitted = fit(given, Hypothesis((name,)), declared, start)
        decisions[name] = compare(declared, refitted, options, 2).decision
    assert decisions == {
        "upper saturation of x": Decision.BETTER,
        "x^3 in v": Decision.NOT_SIGNIFICANT,
    }


def test_evident_effect_is_not_removed(monkeypatch):
    """An absent square is removed, unless the data show it directly, as they show a stop."""
    square, cube = Term("v", "x^2"), Term("v", "x^3")
    given = problem(flights(2, Term("v", "x^3", jnp.array(-0.6))), (square, cube, Term("v", "v^3")))
    both = fit(given, Hypothesis((square.name, cube.name)))

    def removed():
        proposals = Proposals(both, LoopOptions())
        return [
            tuple(name for name in both.effects if name not in move.hypothesis.effects)
            for move in proposals.drops()
        ]

    assert removed() == [(square.name,)]
    monkeypatch.setattr(Term, "evident_in_data", lambda effect, _: effect.name == square.name)
    assert removed() == []


def test_effect_is_added_if_check_records_stop_diverging():
    """The missing effect can stabilise a simulation that diverged before, and not the reverse."""
    given = problem(flights(6), (Term("v", "x^3"),))
    declared = fit(given, Hypothesis())
    found = fit(given, Hypothesis(("x^3 in v",)), declared)
    assert compare(declared, found, LoopOptions(), 1).decision is Decision.BETTER
    away = _diverged(declared)
    rescued = compare(away, found, LoopOptions(), 1)
    assert (rescued.decision, rescued.check_fall) == (Decision.BETTER, float("inf"))
    assert compare(declared, _diverged(found), LoopOptions(), 1).decision is Decision.CHECK_WORSE
    assert compare(away, _diverged(found), LoopOptions(), 1).decision is Decision.CHECK_WORSE
    for lost in (jnp.inf, jnp.nan):  # such a fit is no better than any other
        assert worth(_diverged(found, lost)) == -float("inf")


def _diverged(fitted, value=jnp.inf):
    """The same fit, whose simulation of the check records is not finite."""
    prediction = fitted.check_prediction
    lost = jnp.full_like(prediction.y, value)
    copied = type(fitted)(fitted.problem, fitted.hypothesis, fitted.estimation, fitted.solution)
    copied.__dict__["check_prediction"] = eqx.tree_at(lambda p: p.y, prediction, lost)
    return copied
