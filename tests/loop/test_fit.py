"""Fits with the complete library and with the reduced model are the same; continuation of fits."""

import dataclasses
from threading import Event, Timer

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring, fly

from jaxid import AbstractModel, OutputError, free
from jaxid.effects.augmented import Augmented
from jaxid.effects.equation import StateLimit, Term
from jaxid.effects.input import InputLag
from jaxid.effects.sensor import SensorBias
from jaxid.estimation import Clip, Damp
from jaxid.estimation.estimate import as_stack
from jaxid.loop import Hypothesis, LoopProblem, compilation, problem
from jaxid.loop import fit as fits
from jaxid.loop.fit import MIN_COST_FALL, fit, worth_continuing
from jaxid.loop.linear_motion import LinearMotion
from jaxid.loop.problem import SEARCH_SOLVER, operations, use_reduced_model
from jaxid.loop.search import with_shapes

LIBRARY = (Term("v", "x^3"), InputLag("force"), SensorBias("x"), StateLimit("x", "v"))
CUBIC = Term("v", "x^3", jnp.array(-0.3))


def _problem(monkeypatch, reduced: bool, solver=SEARCH_SOLVER) -> LoopProblem:
    monkeypatch.setattr(problem, "use_reduced_model", lambda model, samples: reduced)
    model = Spring(jnp.array(1.5), jnp.array(0.2))
    chosen = free(
        model,
        "k",
        "c",
        per_record=["initial_state"],
        bounds={"c": (0.0, None), "initial_state.v": (-5.0, 5.0)},
        prior={"k": (1.2, 0.5)},
    )
    records = as_stack([fly(70 + seed, CUBIC)[0] for seed in range(2)])
    return LoopProblem.of(model, LIBRARY, chosen, OutputError(), records, records, solver=solver)


def _both(monkeypatch, named, solver=SEARCH_SOLVER):
    """For each of two starts: the fit with the complete library, and with the reduced model."""
    fits = []
    for reduced in (False, True):
        declared = with_shapes(fit(_problem(monkeypatch, reduced, solver), Hypothesis()))
        given = declared.problem
        starts = ({}, {f"{name}.gain": 0.05 for name in named})
        fits.append([fit(given, Hypothesis(named), declared, start) for start in starts])
    return zip(*fits, strict=True)


@pytest.mark.parametrize("named", [(), ("x^3 in v",), ("lag of input force", "bias of x")])
def test_fit_in_reduced_model_equals_fit_in_complete_library(monkeypatch, named):
    for padded, fitted in _both(monkeypatch, named):
        assert padded.estimation.free.shared == fitted.estimation.free.shared
        assert fitted.solution.parameters.shared.size == len(fitted.estimation.free.shared)
        np.testing.assert_allclose(fitted.cost, padded.cost, rtol=1e-9)
        known = padded.estimates
        for name, (value, error) in fitted.estimates.items():
            # The steps differ by rounding, which an ill-determined direction magnifies, so the
            # limit is in standard errors.
            assert abs(value - known[name][0]) < 1e-6 * known[name][1]
            np.testing.assert_allclose(error, known[name][1], rtol=1e-5)
        assert fitted.motion.own == 2 + ("lag of input force" in named)
        np.testing.assert_allclose(fitted.motion.rows, padded.motion.rows, rtol=1e-6, atol=1e-9)


def test_reduced_and_padded_fits_of_effect_with_corner_take_same_first_steps(monkeypatch):
    """The two programs evaluate one function also at a corner.

    Rounding decides which of the later steps are rejected there, so that the ends of two iterations
    differ by more than rounding, on one processor less than on another.
    """
    monkeypatch.setattr(fits, "MAX_CONTINUATIONS", 0)
    first = dataclasses.replace(SEARCH_SOLVER, max_steps=8)
    for padded, fitted in _both(monkeypatch, (LIBRARY[3].name,), first):
        np.testing.assert_allclose(fitted.cost, padded.cost, rtol=1e-9)
        np.testing.assert_allclose(fitted.values, padded.values, rtol=1e-6, atol=1e-9)


def test_reduced_and_padded_fits_of_effect_with_corner_end_at_equal_evidence(monkeypatch):
    """The ends differ by less than the smallest fall for which a search continues a fit."""
    for padded, fitted in _both(monkeypatch, (LIBRARY[3].name,)):
        assert abs(fitted.cost - padded.cost) < MIN_COST_FALL


def test_fit_stopped_by_its_iteration_limit_is_continued(monkeypatch):
    """A search compares converged fits."""
    patient, brief = (
        _problem(monkeypatch, False, dataclasses.replace(SEARCH_SOLVER, max_steps=most))
        for most in (100, 4)
    )
    cubic = Hypothesis(("x^3 in v",))
    converged = fit(patient, cubic).cost
    assert abs(fit(brief, cubic).cost - converged) < SEARCH_SOLVER.least_fall
    monkeypatch.setattr(fits, "MAX_CONTINUATIONS", 0)
    assert fit(brief, cubic).cost > converged + 10.0


@pytest.mark.parametrize(
    ("costs", "continues"),
    [
        ([np.inf, 50.0], True),  # no fall is known yet
        ([60.0, 50.0, 50.0], True),  # the fall of a continuation by the first policy is not known
        ([60.0, 50.0, 20.0, 18.0], True),
        ([60.0, 50.0, 20.0, 18.0, 17.0], False),
        ([60.0, 50.0, 20.0, 18.0, 14.0], True),  # more than a tenth of all falls
        ([60.0, 50.0, 49.7, 49.4], False),
        ([0.0, *(-(2.0**k) for k in range(10))], True),
        ([0.0, *(-(2.0**k) for k in range(11))], False),  # the limit of continuations
    ],
)
def test_creeping_fit_is_continued_only_to_finish_it(costs, continues):
    assert worth_continuing(costs) is continues


def test_fit_is_continued_by_the_other_policy(monkeypatch):
    """Where steps of one kind creep, those of the other may not."""
    policies, by_steps = [], fits.fit_by_steps

    def recorded(estimation, parameters, solver, S):
        policies.append(type(solver.policy))
        return by_steps(estimation, parameters, solver, S)

    monkeypatch.setattr(fits, "fit_by_steps", recorded)
    brief = _problem(monkeypatch, False, dataclasses.replace(SEARCH_SOLVER, max_steps=3))
    fit(brief, Hypothesis(("x^3 in v",)))
    assert len(policies) > 2
    assert policies == [Clip, Damp, *policies[:-2]]


def test_fit_that_cannot_reach_its_target_is_not_continued():
    falling = [120.0, 100.0, 80.0, 60.0]  # by 20 in the first two of ten continuations
    assert worth_continuing(falling, -99.0)
    assert not worth_continuing(falling, -100.0)
    assert worth_continuing([120.0, 110.0], 11.0)  # by 10 in its first run
    assert not worth_continuing([120.0, 110.0], 10.0)
    assert worth_continuing([np.inf, 110.0], 10.0)


@pytest.mark.parametrize("effects", [(), ("x^3 in v", "bias of x")])
def test_columns_with_linearised_steps_equal_those_of_forward_mode(monkeypatch, effects):
    """On long records the columns of all candidates come from one pass, in reverse mode."""
    found = []
    for least in (problem.LINEARISED_FROM, 10):
        monkeypatch.setattr(problem, "LINEARISED_FROM", least)
        given = _problem(monkeypatch, True)
        values = given.initial_values + 0.01
        rows = fit(given, Hypothesis()).motion.rows
        found.append(LinearMotion(given, effects, values, rows).sensitivities)
        assert given.is_long is (least == 10)
    (v, S), (expected_v, expected) = found
    np.testing.assert_allclose(v, expected_v, rtol=0, atol=1e-10)
    scale = np.max(np.abs(expected), axis=(0, 1, 2))
    assert np.count_nonzero(scale) > 4
    assert np.max(np.abs(S - expected) / np.where(scale > 0, scale, 1.0)) < 1e-10


def test_padding_of_a_shorter_record_is_no_part_of_the_motion(monkeypatch):
    given = _problem(monkeypatch, reduced=False)
    flown = [fly(70 + seed, samples=samples)[0] for seed, samples in enumerate((300, 60))]
    motion = fit(given.on(flown), Hypothesis()).motion
    assert motion.is_linear
    x = np.concatenate([motion.x[0], motion.x[1][:60]])[:, 0]
    usual = motion.usual(["initial_state.x"])[:, 0]
    np.testing.assert_allclose(usual, [np.mean(x), np.std(x)], rtol=1e-12)


def test_programs_that_are_not_waited_for_are_not_compiled(monkeypatch):
    """Refits that are passed over, or a search that ends by an error or Ctrl-C, leave no
    compilation behind.
    """
    made = []
    monkeypatch.setattr(compilation, "_compile", lambda _, hypothesis: made.append(hypothesis))
    given = _problem(monkeypatch, True)
    hypotheses = [Hypothesis((effect.name,)) for effect in LIBRARY]
    monkeypatch.setattr(compilation, "AHEAD", 2)
    assert len(hypotheses) == 4
    with compilation.compiled_ahead(given, hypotheses) as wait_for:
        for hypothesis in hypotheses:
            wait_for(hypothesis)
    assert made == hypotheses  # in their order
    with compilation.compiled_ahead(given, hypotheses) as wait_for:
        wait_for(hypotheses[1])
        wait_for(hypotheses[0])  # passed over: compiled at its use
        wait_for(Hypothesis())  # not among them

    def slow(_, hypothesis):
        begun.append(hypothesis)
        first.set()
        go_on.wait()

    begun, first, go_on = [], Event(), Event()
    monkeypatch.setattr(compilation, "_compile", slow)
    with compilation.compiled_ahead(given, hypotheses) as wait_for:
        first.wait()
        Timer(0.2, go_on.set).start()
        wait_for(hypotheses[-1])
    assert begun == [hypotheses[0], hypotheses[-1]]

    def interrupted():
        with compilation.compiled_ahead(given, hypotheses):
            first.wait()
            Timer(0.2, go_on.set).start()  # while the search ends
            raise KeyboardInterrupt

    begun, first, go_on = [], Event(), Event()
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert begun == hypotheses[:1]


def test_reduced_model_is_used_for_small_model_on_long_records():
    small = Augmented(Spring(jnp.array(1.5), jnp.array(0.2)), LIBRARY)
    assert not use_reduced_model(small, 300)
    assert use_reduced_model(small, 20_000)
    assert not use_reduced_model(small.only(()), 20_000)  # it has no absent effects


def test_skipped_effects_cost_their_branches():
    """The threshold is compared with the operations of a model that skips its absent effects."""
    terms = tuple(Term("v", f"x^{power}") for power in range(2, 9))
    all_of_them = Augmented(Spring(jnp.array(1.5), jnp.array(0.2)), terms)
    skipped, declared = operations(all_of_them.with_present(())), operations(all_of_them.model)
    assert declared < skipped < operations(all_of_them)


class Nested(AbstractModel):
    """A comparison, a product and a selection, which is a function of its own."""

    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return jnp.where(x > u, x * u, u)

    def output(self, t, x, u):
        return x


def test_operations_count_nested_equations():
    assert operations(Nested()) == 3
