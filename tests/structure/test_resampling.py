"""Stability of a selection: strong terms always, chance terms as often as the level says, the same for the same seed."""

import numpy as np
import pytest
import scipy.stats

from jaxid._foundation.checks import InputError
from jaxid.structure import CrossValidation, LastStep, Minimum, SubsetOptions, choose, stability, stepwise

NAMES = ("strong", "weak", "chance", "pulse")


def planted(seed):
    draw = np.random.default_rng(seed)
    X = draw.normal(size=(120, 4))
    X[:, 3] = np.arange(120) == 60  # one sample: most draws hold it, some do not
    return X, X[:, 0] + 0.25 * X[:, 1] + draw.normal(size=120)


def test_a_strong_term_is_always_chosen(seed):
    X, y = planted(seed)
    found = stability(X, y, NAMES, generator=seed, draws=100, options=SubsetOptions(level_in=0.01))
    share = dict(zip(found.names, found.share, strict=True))
    assert share["strong"] == 1.0
    assert share["chance"] < share["strong"]
    assert sum(share for _, share in found.models) == pytest.approx(1.0)
    assert found.models[0][1] == max(share for _, share in found.models)
    assert "most frequent model" in str(found)


def test_the_seed_decides(seed):
    X, y = planted(seed)
    one = stability(X, y, NAMES, generator=seed, draws=30, block=6)
    same = stability(X, y, NAMES, generator=np.random.default_rng(seed), draws=30, block=6)
    assert one.models == same.models
    assert one.models != stability(X, y, NAMES, generator=seed + 1, draws=30, block=6).models


def test_single_samples_are_drawn_as_the_binomial_says(seed):
    """The pulse explains everything where it is drawn: in 1 - (1 - 1/n)^n of the draws; band of 99.9 %."""
    X, _ = planted(seed)
    y = X[:, 3] + 1e-6 * np.random.default_rng(seed).normal(size=120)
    found = stability(X, y, NAMES, generator=seed, draws=400, block=1)
    expected = 1 - (1 - 1 / 120) ** 120
    lower, upper = scipy.stats.binom.ppf([0.0005, 0.9995], 400, expected) / 400
    assert lower <= found.share[3] <= upper


def test_manoeuvres_are_drawn_whole(seed):
    """Of two, the one that holds the pulse is missing from a quarter of the draws, and then the column does not vary."""
    X, _ = planted(seed)
    y = X[:, 3] + 1e-6 * np.random.default_rng(seed).normal(size=120)
    found = stability(X, y, NAMES, generator=seed, draws=400, groups=np.repeat([0, 1], 60), rule=Minimum("BIC"))
    lower, upper = scipy.stats.binom.ppf([0.0005, 0.9995], 400, 0.75) / 400
    assert lower <= found.share[3] <= upper


def test_one_draw_of_everything_is_the_selection(seed):
    X, y = planted(seed)

    class InOrder(np.random.Generator):
        def integers(self, high, size):
            return np.arange(size)

    found = stability(X, y, NAMES, generator=InOrder(np.random.PCG64(1)), draws=1, groups=np.arange(120) // 30)
    terms = choose(stepwise(X, y, NAMES), LastStep()).names
    assert set(found.models[0][0]) == set(terms)


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
def test_what_makes_no_sense_is_refused(seed, change, words):
    with pytest.raises(InputError, match=words):
        stability(*planted(seed), NAMES, **{"generator": seed, **change})
