"""Records and requests that are unusual and legitimate: a dead sensor, no candidates, nothing
shared, noise overstated.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import SIGMA, Spring, fly

from jaxid import OutputError, close_loop, estimate, free
from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.diagnosis.autoregression import autoregressive_r2
from jaxid.diagnosis.heldout_error import difference_error, mean_log, uncertainty
from jaxid.diagnosis.validation import Prediction, predict
from jaxid.effects import Effect, EffectCard, Location, LocationKind, Term
from jaxid.loop.outcome import Outcome
from jaxid.models import FixedNoise
from jaxid.report import html
from jaxid.report.tables import decided

CUBE = Term("v", "x^3", gain=jnp.array(-0.5))
LIBRARY = (Term("v", "x^2"), Term("v", "x^3"))


def spring():
    model = Spring(1.0, 0.1)
    return model, free(model, "k", "c", per_record=("initial_state",))


def flights(count, effect=CUBE, samples=150):
    return [fly(100 + index, effect, samples=samples)[0] for index in range(count)]


def prediction(v, mask):
    t = jnp.arange(v.shape[1], dtype=float)[None]
    names = tuple(f"y{number}" for number in range(v.shape[2]))
    channels = names, ("",) * len(names), ("",)
    return Prediction(t, v, jnp.zeros_like(v), mask, jnp.zeros((1, 2)), *channels)


class Infinite(Effect):
    """A root of its gain: its derivative at zero is infinite."""

    gain: Array = eqx.field(default_factory=lambda: jnp.zeros(()))
    card = EffectCard(
        name="root", description="a root of its gain", location=Location(LocationKind.EQUATION, "v")
    )

    def equations(self, dx, signals):
        return {"v": jnp.sqrt(self.gain) * signals["x"]}


def test_candidate_with_nonfinite_derivatives_raises_error_with_its_name():
    """The library has more columns than are computed at once, so that some of them are finite."""
    model, chosen = spring()
    train, check = flights(2)
    terms = tuple(Term("v", f"v^{power}") for power in range(4, 16))
    library = (*LIBRARY, *terms, Infinite())
    with pytest.raises(InputError, match="at zero gain of 'root' is not finite"):
        close_loop(model, chosen, OutputError(), train=train, check=check, effects=library)


class Rooted(Spring):
    """A spring whose declared damping acts by its root, which is zero at the start."""

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - jnp.sqrt(self.c) * x[1]])


def test_nonfinite_derivative_of_declared_model_raises_error_with_its_parameter():
    model = Rooted(1.0, 0.0)
    train, check = flights(2)
    with pytest.raises(InputError, match="derivative of the declared model by k, c is not finite"):
        close_loop(
            model, free(model, "k", "c"), OutputError(), train=train, check=check, effects=LIBRARY
        )


def test_error_omits_channel_without_samples():
    rng = np.random.default_rng(0)
    v = jnp.asarray(rng.normal(size=(1, 200, 2)))
    complete = jnp.ones(v.shape, bool)
    dead = complete.at[..., 1].set(False)
    both, single = prediction(v, dead), prediction(v[..., :1], complete[..., :1])
    assert np.isnan(both.rms[1])
    assert mean_log(both) == pytest.approx(mean_log(single), rel=1e-12)
    assert uncertainty(both) == pytest.approx(uncertainty(single), rel=1e-12)
    halves = prediction(0.5 * v, dead), prediction(0.5 * v[..., :1], complete[..., :1])
    assert difference_error(both, halves[0]) == pytest.approx(
        difference_error(single, halves[1]), rel=1e-12
    )
    assert mean_log(prediction(0.0 * v, complete)) == mean_log(prediction(0.0 * v, dead))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"check": 1}, "No output of the check records has a valid sample after the window"),
        ({"check": 2, "test": 1}, "No output of the test records 'test' has a valid sample"),
    ],
)
def test_held_out_records_without_samples_raise_error(given, words):
    model, chosen = spring()
    records = flights(3)
    records[1] = eqx.tree_at(lambda node: node.mask, records[1], jnp.zeros_like(records[1].mask))
    held_out = {use: records[number] for use, number in given.items()}
    with pytest.raises(InputError, match=words):
        close_loop(model, chosen, OutputError(), train=records[0], effects=LIBRARY, **held_out)


def test_loop_without_candidates_and_check_records_returns_declared_model():
    model, chosen = spring()
    result = close_loop(model, chosen, OutputError(), train=flights(2), effects=(), window=20)
    assert (result.effects, result.outcome) == ((), Outcome.UNEXPLAINED)
    assert "Something is missing" in str(result)
    assert result.runaways == ()


@pytest.fixture(scope="module")
def tested():
    """Two training and two test records, and a study of them."""
    model, chosen = spring()
    train, test = flights(4)[:2], flights(4)[2:]
    options = dict(effects=LIBRARY, window=20, test={"check": test})
    return train, test, close_loop(model, chosen, OutputError(), train=train, **options)


def test_diverging_test_record_is_reported_with_remedy(tested):
    _, records, result = tested
    complete = result.before.tests["check"]
    lost = dataclasses.replace(
        result.before,
        tests={
            "check": eqx.tree_at(lambda node: node.y, complete, complete.y.at[1, 100:].set(jnp.inf))
        },
    )
    diverged = dataclasses.replace(result, before=lost)
    (sentence,) = diverged.runaways
    assert sentence.startswith(f"The declared model diverges on {records[1].names[0]}. ")
    assert "jaxid.segment" in sentence
    assert sentence in str(diverged)


def test_records_of_final_estimate_are_predicted_by_search_estimate(tested):
    """Without check and test records the last third decides, and is reported as the fit to the
    first two thirds predicts it.
    """
    train, _, given = tested
    model, chosen = spring()
    alone = close_loop(model, chosen, OutputError(), train=train, effects=LIBRARY, window=20)
    assert alone.effects == given.effects == ("x^3 in v",)
    final = predict(alone.after.model, alone.tests["check"], OutputError(), window=20)
    assert alone.after.rms["check"]["x"] != pytest.approx(float(final.rms[0]), rel=1e-6)
    np.testing.assert_array_equal(alone.after.estimate.values, given.after.estimate.values)
    assert decided(alone) == ("check",)


def test_overstated_noise_yields_location_and_report():
    """The residual is smaller than the declared noise, and a cubic is still significant in it."""
    model, chosen = spring()
    records = flights(5, Term("v", "x^3", gain=jnp.array(-0.1)))
    noise = OutputError(FixedNoise([(1.5 * SIGMA) ** 2]))
    result = close_loop(
        model,
        chosen,
        noise,
        train=records[:3],
        check=records[3],
        test=records[4],
        effects=LIBRARY,
        window=20,
    )
    assert result.effects == ("x^3 in v",)
    assert all(location.near_best() for location in result.localisation.values())
    assert "<html" in html(result)


def test_estimate_without_shared_parameters_is_printed():
    model = Spring(1.5, 0.2)
    result = estimate(
        model, free(model, per_record=("initial_state",)), flights(1, None)[0], OutputError()
    )
    assert "Converged" in str(result) or "converged" in str(result)


@pytest.mark.parametrize("rows", [5, 10, 11])
def test_the_predictable_share_of_a_short_record(rows):
    v = jnp.asarray(np.random.default_rng(1).normal(size=(1, rows, 1)))
    assert np.all(np.isfinite(autoregressive_r2(v, jnp.ones(v.shape, bool))))


def test_candidate_in_declared_model_raises_error():
    model, chosen = spring()
    with pytest.raises(InputError, match=r"The candidate 'x\^3 in v' has a gain of -0\.5"):
        close_loop(model, chosen, OutputError(), train=flights(2), effects=(CUBE,))
