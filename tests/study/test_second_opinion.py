"""The second opinion: the score that chance alone reaches, by random signs of the residual."""

import json

import numpy as np
import pytest
from scipy.stats import binom, kstest
from small_spring import Spring, fly

import jaxid
from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.effects import Term
from jaxid.loop import Coloured, Hypothesis, LoopOptions, LoopProblem
from jaxid.loop.evidence import compare
from jaxid.loop.fit import fit
from jaxid.loop.moves import Move, MoveKind, Proposals
from jaxid.loop.search_tree import Step
from jaxid.study import Refusal, SecondOpinion
from jaxid.study.second_opinion import block_products, compared, second_opinion
from jaxid.study.wording import second_opinion_words

PRODUCTS = ("u^2", "u^3", "w", "w^2", "w^3", "u w", "u^2 w", "u w^2", "u^3 w", "u^4", "w^4")
LIBRARY = tuple(Term("y", product) for product in PRODUCTS)
SIGMA = 0.3
STUDIES = 200


class Line(jaxid.AbstractModel):
    """A linear regression: `y = slope u + offset`; an input w has no effect."""

    slope: Array
    offset: Array
    states, inputs, outputs = (), ("u", "w"), ("y",)

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return (self.slope * u[0] + self.offset)[None]


def measure(rng, cubic=0.0, memory=0.0, samples=200):
    """A record with smooth inputs, a cubic term and first-order noise of some correlation."""
    raw = rng.normal(size=(2, samples + 14))
    u = np.stack([np.convolve(row, np.ones(15) / 15**0.5, "valid") for row in raw], axis=1)
    noise = rng.normal(size=samples)
    for i in range(1, samples):
        noise[i] += memory * noise[i - 1]
    z = u[:, :1] + cubic * u[:, :1] ** 3 + SIGMA * noise[:, None]
    return jaxid.record(0.1 * np.arange(samples), u, z, inputs=Line.inputs, outputs=Line.outputs)


LINE = Line(1.0, 0.0)
FREE = jaxid.free(LINE, "slope", "offset")


def problem_of(record):
    return LoopProblem.of(LINE, LIBRARY, FREE, jaxid.OutputError(), record, record)


def declared_proposals(problem, hypothesis=None, **options):
    return Proposals(fit(problem, hypothesis or Hypothesis()), LoopOptions(**options))


# The null distribution. ---------------------------------------------------------------------------


def test_p_value_is_uniform_if_nothing_is_missing():
    """A null for one candidate in place of the best of eleven has about 40 % in place of 5 %."""
    rng = np.random.default_rng(1)
    problem, p_values = problem_of(measure(rng)), []
    for seed in range(STUDIES):
        proposals = declared_proposals(problem.on(measure(rng)), draws=199, seed=seed)
        opinion = second_opinion(proposals, None, proposals.fit)
        assert isinstance(opinion, SecondOpinion)
        p_values.append(opinion.p_value)
    low, high = binom.interval(0.999, STUDIES, 0.05)
    assert low <= np.sum(np.array(p_values) <= 0.05) <= high
    assert kstest(p_values, "uniform").pvalue > 0.001


def test_products_with_actual_signs_equal_scores():
    """Two records of unequal length, each with its own initial state."""
    records = [fly(1)[0], fly(2, samples=190)[0]]
    model = Spring(1.0, 0.1)
    free = jaxid.free(model, "k", "c", per_record=("initial_state",))
    library = (Term("v", "x^2"), Term("v", "x^3"), Term("v", "x^2 v"))
    problem = LoopProblem.of(model, library, free, jaxid.OutputError(), records, records)
    proposals = declared_proposals(problem)
    names, samples = proposals.candidates, problem.samples
    blocks = block_products(proposals.fit, proposals.fit, names)
    unbiased = samples / (samples - 2 - 4)  # two parameters and two initial states
    # The fit stops a little before its minimum; this fall is no part of the candidates'.
    scores = [proposals.score(name) - proposals.reduced.base for name in names]
    np.testing.assert_allclose(np.sum(blocks, axis=0) ** 2 / unbiased, scores, rtol=1e-6)


def test_p_value_and_threshold_are_those_of_the_ranks():
    chance = np.arange(1.0, 100.0)  # 99 draws
    beyond = compared(95.5, chance, level=0.05)
    assert (beyond.p_value, beyond.threshold) == (0.05, 95.0)
    assert compared(95.0, chance, level=0.05).p_value == 0.06
    assert compared(1000.0, chance, level=0.05).p_value == 0.01
    unresolved = compared(1000.0, chance, level=0.009)
    assert unresolved.threshold == np.inf
    assert "the draws require more of them" in second_opinion_words(unresolved, 12.0)


# In a study. --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def study():
    rng = np.random.default_rng(2)
    train, check, test = (measure(rng, cubic=0.2) for _ in range(3))
    return jaxid.close_loop(
        LINE, FREE, jaxid.OutputError(), train=train, check=check, test=test, effects=LIBRARY
    )


def test_strong_effect_has_the_smallest_p_value(study):
    first, last = (entry.second_opinion for entry in study.rounds)
    assert study.effects == ("u^3 in y",)
    assert first.p_value == 1 / 1000
    assert first.score == study.rounds[0].winner.score > first.threshold
    assert last.p_value > last.level == 0.01


def test_correlation_of_candidates_lowers_the_threshold(study):
    for entry in study.rounds:
        assert 6.6 < entry.second_opinion.threshold < entry.threshold  # 6.6: one candidate alone


def test_study_states_both_thresholds(study):
    lines = [line.strip() for line in str(study).splitlines() if "second opinion" in line]
    opinion, required = study.rounds[0].second_opinion, study.rounds[0].required
    assert len(lines) == len(study.rounds)
    assert "with p = 0.001 (999 draws" in lines[0]
    assert f"draws require {opinion.threshold:.1f}, the search {required:.1f}" in lines[0]
    written = json.loads(study.to_json())["rounds"][0]["second_opinion"]
    assert written["words"] == lines[0]
    assert written["threshold"] == opinion.threshold


# Refusals. ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def coloured():
    """Noise of a correlation of 0.9."""
    return problem_of(measure(np.random.default_rng(3), memory=0.9, samples=400))


def test_noise_with_memory_is_refused_unless_its_model_whitens_it(coloured):
    white = declared_proposals(coloured)
    autoregressive = declared_proposals(coloured, Hypothesis(noise=Coloured(1)))
    assert second_opinion(white, None, white.fit) is Refusal.PREDICTABLE
    assert second_opinion(white, None, autoregressive.fit) is Refusal.OTHER_NOISE
    opinion = second_opinion(autoregressive, None, autoregressive.fit)
    assert isinstance(opinion, SecondOpinion)
    assert opinion.p_value > 0.01
    words = second_opinion_words(Refusal.PREDICTABLE, 12.0)
    assert words.startswith("no second opinion: the residual that remains is predictable")


def step(proposals, kind, into, out=()):
    """A change that was made, as if its fit were that of its parent."""
    fitted = proposals.fit
    move = Move(kind, fitted.hypothesis.changed(out, into), into, 30.0, {}, {})
    return Step(fitted, move, fitted, compare(fitted, fitted, proposals.options, 1))


def test_pair_is_compared_with_the_best_of_all_pairs():
    proposals = declared_proposals(problem_of(measure(np.random.default_rng(4))))
    singles = second_opinion(proposals, None, proposals.fit)
    added = step(proposals, MoveKind.PAIR, ("u^2 in y", "w in y"))
    pairs = second_opinion(proposals, added, proposals.fit)
    assert pairs.score == 30.0
    # A pair with the best single candidate falls at least as far.
    assert pairs.threshold > singles.threshold


def test_changes_without_a_null_are_refused():
    inside = declared_proposals(
        problem_of(measure(np.random.default_rng(5))), Hypothesis(("u^2 in y",))
    )
    swap = step(inside, MoveKind.SWAP, ("w in y",), ("u^2 in y",))
    group = step(inside, MoveKind.GROUP, ("w in y", "w^2 in y"))
    assert second_opinion(inside, swap, inside.fit) is Refusal.EXCHANGE
    assert second_opinion(inside, group, inside.fit) is Refusal.GROUP


def test_effect_that_its_score_does_not_show_is_refused(monkeypatch):
    proposals = declared_proposals(problem_of(measure(np.random.default_rng(7))))
    added = step(proposals, MoveKind.ADD, ("w in y",))
    assert isinstance(second_opinion(proposals, added, proposals.fit), SecondOpinion)
    monkeypatch.setattr(Term, "score_blind", lambda effect, measured: True)
    assert second_opinion(proposals, added, proposals.fit) is Refusal.SCORE_BLIND


def test_number_of_draws():
    record = measure(np.random.default_rng(6))
    without = declared_proposals(problem_of(record), draws=0)
    assert second_opinion(without, None, without.fit) is None
    with pytest.raises(InputError, match="draws is -1; it must not be negative"):
        LoopOptions(draws=-1)
    more = declared_proposals(problem_of(record), draws=1999, seed=7)
    again = [second_opinion(more, None, more.fit) for _ in range(2)]
    assert again[0] == again[1]
    assert again[0].draws == 1999
