"""Stability of a selection: frequencies of strong and chance terms, reproducibility, refusals."""

import numpy as np
import pytest
import scipy.stats

from jaxid._foundation.checks import InputError
from jaxid.structure import (
    CrossValidation,
    LastStep,
    Minimum,
    SubsetOptions,
    choose,
    stability,
    stepwise,
)

NAMES = ("strong", "weak", "chance", "pulse")


def planted(seed):
    draw = np.random.default_rng(seed)
    X = draw.normal(size=(120, 4))
    X[:, 3] = np.arange(120) == 60  # nonzero in one sample, which some draws do not contain
    return X, X[:, 0] + 0.25 * X[:, 1] + draw.normal(size=120)


def test_strong_term_is_chosen_in_every_draw(seed):
    X, y = planted(seed)
    result = stability(X, y, NAMES, generator=seed, draws=100, options=SubsetOptions(level_in=0.01))
    share = dict(zip(result.names, result.share, strict=True))
    assert share["strong"] == 1.0
    assert share["chance"] < share["strong"]
    assert sum(share for _, share in result.models) == pytest.approx(1.0)
    assert result.models[0][1] == max(share for _, share in result.models)
    assert "most frequent model" in str(result)


def test_stability_is_reproducible_by_seed(seed):
    X, y = planted(seed)
    first = stability(X, y, NAMES, generator=seed, draws=30, block=6)
    same = stability(X, y, NAMES, generator=np.random.default_rng(seed), draws=30, block=6)
    other = stability(X, y, NAMES, generator=seed + 1, draws=30, block=6)
    assert first.models == same.models
    assert first.models != other.models


def test_single_samples_are_drawn_with_binomial_frequency(seed):
    """The pulse explains the response if it is drawn, with probability 1 - (1 - 1/n)^n.

    The binomial band has a probability of 99.9 %.
    """
    X, _ = planted(seed)
    y = X[:, 3] + 1e-6 * np.random.default_rng(seed).normal(size=120)
    result = stability(X, y, NAMES, generator=seed, draws=400, block=1)
    expected = 1 - (1 - 1 / 120) ** 120
    lower, upper = scipy.stats.binom.ppf([0.0005, 0.9995], 400, expected) / 400
    assert lower <= result.share[3] <= upper


def test_manoeuvres_are_drawn_completely(seed):
    """A quarter of the draws lacks the manoeuvre with the pulse, so that its column is constant."""
    X, _ = planted(seed)
    y = X[:, 3] + 1e-6 * np.random.default_rng(seed).normal(size=120)
    result = stability(
        X, y, NAMES, generator=seed, draws=400, groups=np.repeat([0, 1], 60), rule=Minimum("BIC")
    )
    lower, upper = scipy.stats.binom.ppf([0.0005, 0.9995], 400, 0.75) / 400
    assert lower <= result.share[3] <= upper


def test_draw_of_all_manoeuvres_equals_selection(seed):
    X, y = planted(seed)

    class InOrder(np.random.Generator):
        def integers(self, high, size):
            return np.arange(size)

    result = stability(
        X, y, NAMES, generator=InOrder(np.random.PCG64(1)), draws=1, groups=np.arange(120) // 30
    )
    terms = choose(stepwise(X, y, NAMES), LastStep()).names
    assert set(result.models[0][0]) == set(terms)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"draws": 0}, "number of draws is 0"),
        ({"block": 61}, "Choose 1 to 60"),
        ({"block": 4, "groups": np.arange(120)}, "not both"),
        ({"groups": np.zeros(120)}, "one manoeuvre"),
        ({"rule": CrossValidation(np.arange(120))}, "holds labels of samples"),
    ],
)
def test_invalid_draws_are_refused(seed, change, words):
    with pytest.raises(InputError, match=words):
        stability(*planted(seed), NAMES, **{"generator": seed, **change})
