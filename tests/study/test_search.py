"""The search: second path if the first leaves more than noise; effects evident in the data."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import pytest
from jaxid.study.judge import Judge
from jaxid.study.search import Search
from jaxid.study.workbench import Workbench
from small_spring import Spring, fly

from jaxid import LoopOptions, OutputError, close_loop, free
from jaxid._foundation.types import Array
from jaxid.effects import EffectCard, Location, LocationKind, SensorSaturation, Term
from jaxid.effects.base import Effect
from jaxid.estimation.estimate import as_stack
from jaxid.loop.outcome import Outcome
from jaxid.study.close_loop import SOLVER
from jaxid.study.rounds import Decision


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


def declared_spring():
    model = Spring(1.0, 0.1)
    return model, free(model, "k", "c", per_record=("initial_state",))


def search(flown, library, **options):
    """A search with its declared fit."""
    train, check, _ = (as_stack(flown[part]) for part in PARTS)
    bench = Workbench(*declared_spring(), library, OutputError(), train, SOLVER)
    declared = bench.set_shapes(bench.base())
    return Search(Judge(bench, check, {}, 60, LoopOptions(**options)), lambda _: None), declared


def flights(seed, truth=CUBES):
    return [fly(1000 * seed + index, truth)[0] for index in range(7)]


@pytest.mark.parametrize("seed", [1, 2])
def test_search_restarts_with_other_effect_after_wrong_first_effect(seed):
    """The blend comes in first, and with it no other of its family, so that the second cube stays
    outside.
    """
    flown = flights(seed)
    train, check, test = (flown[part] for part in PARTS)
    parts = dict(train=train, check=check, test=test, window=60, effects=LIBRARY)
    result = close_loop(*declared_spring(), OutputError(), **parts)
    assert result.other_rounds[0].added == "blend"
    assert "v^3 in v" not in {entry.added for entry in result.other_rounds}
    assert set(result.effects) == {"x^3 in v", "v^3 in v"}
    assert result.outcome is Outcome.EXPLAINED
    passed = {candidate.name: candidate.decision for candidate in result.rounds[0].candidates}
    assert passed["blend"] is Decision.PASSED_OVER
    assert "another search path was abandoned: blend" in str(result)
    assert result.to_dict()["other_rounds"][0]["added"] == "blend"


def test_beam_width_one_follows_single_path():
    single_path, declared = search(flights(1), LIBRARY, beam_width=1)
    path, other = single_path.run(declared)
    assert (path.rounds[0].added, other) == ("blend", None)


def test_second_path_that_meets_first_is_stopped():
    """Both cubes and a force that the library does not know: whichever cube comes first, the other
    comes next.
    """
    result, declared = search(flights(1, Blend(0.1, -0.3, jnp.array(1.0))), LIBRARY[:2])
    path, other = result.run(declared)
    first, second, last = (entry.added for entry in path.rounds)
    assert {first, second} == {"x^3 in v", "v^3 in v"}
    assert last is None
    assert [entry.added for entry in other.rounds] == [second, first]


def test_second_path_that_falls_behind_is_abandoned():
    """Both cubes come in as one, and a square that the library does not know stays; one cube before
    them is too many.
    """
    hidden = Blend(0.1, gain=jnp.array(1.0))
    result, declared = search(flights(2, hidden), (Blend(0.0), Term("v", "x^3")))
    path, other = result.run(declared)
    assert [entry.added for entry in path.rounds] == ["blend", None]
    assert [entry.added for entry in other.rounds] == ["x^3 in v", "blend"]
    first_path = path._replace(worth=(5.0, 9.0, 10.0))
    behind = (4.0, 8.0), (4.0, 9.5, 9.9), (1.0, 9.5, 10.5, 9.9)
    assert all(map(first_path.is_ahead_of, behind))
    assert not any(map(first_path.is_ahead_of, ((4.0,), (4.0, 9.5), (4.0, 9.5, 10.0))))


def test_evident_effect_is_added_while_residual_is_coloured():
    """A significant stop needs no minimum gain on the check records, and their scatter does not
    exclude it.
    """
    flown = flights(5)
    level = 0.8 * max(float(jnp.max(record.z)) for record in flown[:3])
    stopped = [
        eqx.tree_at(lambda record: record.z, record, jnp.minimum(record.z, level))
        for record in flown
    ]
    stop, cube = SensorSaturation("x"), Term("v", "x^3")
    path_search, declared = search(stopped, (stop, cube), min_check_gain=0.9)
    first_round, judge = path_search.tried(declared, 1), path_search.judge
    candidates = {candidate.name: candidate for candidate in first_round.candidates}
    assert not any(
        judge.looks_like_noise(judge.predictable(refit)) for refit in first_round.refits.values()
    )
    assert candidates[stop.name].decision is Decision.ACCEPTABLE
    assert candidates[cube.name].decision is Decision.NOT_SIGNIFICANT


def test_evident_effect_is_not_removed(monkeypatch):
    """An absent square is removed, unless the data show it directly, as they show a stop."""
    square, cube = Term("v", "x^2"), Term("v", "x^3")
    path_search, declared = search(
        flights(2, Term("v", "x^3", jnp.array(-0.6))), (square, cube, Term("v", "v^3"))
    )
    fitted = path_search.bench.fit((square.name, cube.name), declared.values)
    candidates = path_search.candidates(fitted, path_search.bench.score(fitted))
    assert path_search.prune(fitted, keep=0)[1] == (square.name,)
    assert {out for *_, out in path_search.exchanges(fitted, candidates)} == {
        (square.name,),
        (cube.name,),
        fitted.effects,
    }
    monkeypatch.setattr(Term, "evident_in_data", lambda effect, _: effect.name == square.name)
    assert path_search.prune(fitted, keep=0)[1] == ()
    assert {out for *_, out in path_search.exchanges(fitted, candidates)} == {(cube.name,)}


def test_check_gain_without_significance_on_training_records_is_refused():
    cube = Term("v", "x^3")
    path_search, declared = search(flights(6), (cube,))
    first_round, judge = path_search.tried(declared, 1), path_search.judge
    (candidate,), refit = first_round.candidates, first_round.refits[cube.name]
    assert candidate.decision is Decision.ACCEPTABLE
    threshold = judge.threshold(first_round.candidates)
    for share, decision in ((1.1, Decision.ACCEPTABLE), (0.9, Decision.NOT_SIGNIFICANT)):
        colour = candidate.cost_fall / (share * threshold)
        coloured = dataclasses.replace(candidate, significance=candidate.score / colour)
        assert (
            judge.told(declared, refit, coloured, first_round.before, threshold).decision
            is decision
        )


def test_effect_is_added_only_if_check_records_stop_diverging():
    """The missing effect can stabilise a simulation that diverged before."""
    cube = Term("v", "x^3")
    path_search, declared = search(flights(6), (cube,))
    first_round, judge = path_search.tried(declared, 1), path_search.judge
    (candidate,), refit = first_round.candidates, first_round.refits[cube.name]
    away = eqx.tree_at(
        lambda node: node.y, first_round.before, jnp.full_like(first_round.before.y, jnp.inf)
    )
    rescued = judge.told(declared, refit, candidate, away, judge.threshold(first_round.candidates))
    assert (rescued.decision, rescued.check_fall) == (Decision.ACCEPTABLE, float("inf"))
    lost = eqx.tree_at(lambda node: node.values, refit, jnp.full(refit.values.shape, 1e200))
    assert judge.told(declared, lost, candidate, away, 10.0).decision is Decision.CHECK_WORSE
    assert (
        judge.told(declared, lost, candidate, first_round.before, 10.0).decision
        is Decision.CHECK_WORSE
    )


def test_added_effect_is_refitted_from_declared_values():
    """The better of the two is taken; where the fit leaves noise, there is no second."""
    path_search, declared = search(flights(2, Blend(0.1, gain=jnp.array(1.0))), (Term("v", "x^3"),))
    refit = path_search.tried(declared, 1).refits["x^3 in v"]
    stuck, best = (
        eqx.tree_at(lambda node: node.fit.cost, refit, refit.fit.cost + apart)
        for apart in (50.0, -50.0)
    )
    again = path_search.begun_again(stuck)
    # LITTLE: from elsewhere, to the same end
    assert again.cost == pytest.approx(refit.cost, abs=0.5)
    assert path_search.begun_again(best) is best
    quiet, declared = search(flights(2, Term("v", "x^3", jnp.array(-0.6))), (Term("v", "x^3"),))
    explained = quiet.tried(declared, 1).refits["x^3 in v"]
    assert quiet.begun_again(explained) is explained
