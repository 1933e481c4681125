"""Decisions between two fits: train and check records together, and noises as slow as a drift."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2, norm
from searched_spring import problem

from jaxid.effects import Hinge, Placement, Term
from jaxid.loop import Coloured, Hypothesis, LoopOptions, evidence
from jaxid.loop.evidence import Decision, best_of_families, compare, improvement_chance
from jaxid.loop.fit import fit
from jaxid.loop.hypothesis import White


@pytest.fixture(scope="module")
def declared():
    return fit(problem(31, memory=0.98), Hypothesis())


def test_family_is_represented_by_its_lowest_minimum(declared):
    """Two hinges are one effect from different levels; a square is another effect."""
    place = Placement.equation("v")
    low, high, square = Hinge(place, "x", 0.3), Hinge(place, "x", 0.7), Term("v", "x^2")
    given = problem(31, library=(low, high, square))

    def ended(effect, cost, noise=White):
        solution = eqx.tree_at(lambda node: node.cost, declared.solution, jnp.array(cost))
        hypothesis = Hypothesis((effect.name,), noise())
        return dataclasses.replace(
            declared, problem=given, hypothesis=hypothesis, solution=solution
        )

    lowest, near, higher, other, coloured = fits = [
        ended(low, 10.0),
        ended(high, 12.9),
        ended(high, 13.1),
        ended(square, 50.0),
        ended(high, 50.0, Coloured),
    ]
    assert higher not in best_of_families(fits)
    assert best_of_families(fits) == [lowest, near, other, coloured]


@pytest.mark.parametrize(("fall", "check_fall"), [(9.0, 0.02), (20.0, 0.0), (3.0, 0.3)])
def test_chance_of_both_improvements_is_that_of_a_product(monkeypatch, declared, fall, check_fall):
    """The product c of two uniform numbers is smaller with a probability of c (1 - log c)."""
    monkeypatch.setattr(evidence, "inflation", lambda *_: 2.0)
    monkeypatch.setattr(evidence, "difference_error", lambda *_: 0.1)
    added = fit(declared.problem, Hypothesis(("x^2 in v",)), declared)
    product = chi2.sf(fall / 2.0, 1) * norm.sf(check_fall / 0.1)
    expected = product * (1.0 - np.log(product))
    assert improvement_chance(declared, added, fall, check_fall) == pytest.approx(
        expected, rel=1e-9
    )


def test_channel_of_few_samples_excuses_no_other(declared):
    """Twenty samples allow a large share by chance, two hundred in the other channel do not."""
    mask = np.array(declared.problem.train.mask)
    mask[:, 10:, 1] = False
    train = dataclasses.replace(declared.problem.train, mask=jnp.asarray(mask))
    few = dataclasses.replace(declared, problem=dataclasses.replace(declared.problem, train=train))
    assert few.predictable["x"] > 0.5
    assert not evidence.is_noise_like(few, LoopOptions())


def test_noise_as_slow_as_a_drift_is_refused(declared):
    """Its correlation time of 50 samples is a quarter of a record."""
    slow = fit(declared.problem, Hypothesis((), Coloured(1)), declared)
    comparison = compare(declared, slow, LoopOptions(), 1)
    assert comparison.fall > comparison.required
    assert comparison.decision is Decision.DRIFT
