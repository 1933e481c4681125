"""Range of the check records: an effect that acts only beyond the fitted range cannot be found."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from searched_spring import TRUTH, fly

import jaxid
from jaxid.data.stack import stack
from jaxid.effects import Term
from jaxid.loop import Hypothesis, LoopProblem, Outcome
from jaxid.loop.fit import fit, rows_at_start
from jaxid.study.study_records import CHECK_BEYOND, channels_beyond, study_records

CUBIC = Term("v", "x^3", jnp.array(-0.3))
LIBRARY = (Term("v", "x^2"), Term("v", "x^3"))


def growing(seed):
    """A record whose last third alone has a large force, and its samples of motion."""
    small, large = fly(seed, CUBIC, size=0.3), fly(seed + 50, CUBIC, size=1.2)
    third = round(2 / 3 * small.t.size)
    u = np.concatenate([np.asarray(small.u)[:third], np.asarray(large.u)[third:]])
    truth = jaxid.effects.Augmented(TRUTH, (CUBIC,))
    clean = np.asarray(jaxid.simulate(truth, small.t, u, np.zeros(2)).y)
    noise = np.array([0.02, 0.03]) * np.random.default_rng(seed).normal(size=clean.shape)
    return jaxid.record(
        small.t, u, clean + noise, inputs=("force",), outputs=("x", "v"), name=f"{seed}"
    )


def test_range_counts_valid_samples_alone():
    used, other = fly(1), fly(1)
    z = np.array(other.z)
    z[10, 0] = 99.0
    spike = jaxid.record(other.t, other.u, z, inputs=other.inputs, outputs=other.outputs)
    assert channels_beyond(used, other, CHECK_BEYOND) == ()
    assert channels_beyond(used, spike, CHECK_BEYOND) == ("x",)
    z[10, 0] = np.nan
    hole = jaxid.record(other.t, other.u, z, inputs=other.inputs, outputs=other.outputs)
    assert channels_beyond(used, hole, CHECK_BEYOND) == ()


def test_channel_without_samples_has_no_range():
    used = fly(1)
    blind = dataclasses.replace(used, mask=used.mask.at[:, 1].set(False))  # as a part may be
    with np.errstate(all="raise"):
        assert channels_beyond(blind, blind, CHECK_BEYOND) == ()


@pytest.mark.parametrize("starts_free", [False, True])
def test_first_third_is_the_check_where_the_last_alone_is_large(starts_free):
    records = [growing(seed) for seed in (1, 2)]
    cut = study_records(records, None, None, None, starts_free=starts_free)
    third, rows = round(1 / 3 * records[0].t.size), np.asarray(cut.check.mask).all(axis=-1)
    assert cut.fitted.t.shape[1] in (2 * third, 2 * third - 1, records[0].t.size - third)
    if starts_free:
        assert cut.beyond == ()
        assert rows[:, :third].all()
        assert not rows[:, third:].any()
        np.testing.assert_array_equal(cut.fitted.u, stack(records).u[:, third:])
    else:  # a fitted record would start in motion, from an unknown state
        assert "force" in cut.beyond
        assert rows[:, -third:].all()
        assert rows[:, 0].all()  # from which the initial state is read
        assert not rows[:, 1:-third].any()


def test_check_starts_as_its_record():
    """The check of a spring that is released from 1 m begins there, and not where the samples that
    decide begin; so it does where the first positions are missing.
    """
    t, rng = 0.05 * np.arange(300), np.random.default_rng(4)
    clean = np.asarray(jaxid.simulate(TRUTH, t, np.zeros((300, 1)), np.array([1.0, 0.0])).y)
    z = clean + 0.01 * rng.normal(size=clean.shape)
    z[0, 0] = 1.0
    record = jaxid.record(t, np.zeros((300, 1)), z, inputs=("force",), outputs=("x", "v"))
    check = study_records(record, None, None, None).check
    starts = [np.asarray(TRUTH.initial_state(one)) for one in (record, check[0])]
    np.testing.assert_array_equal(*starts)
    prediction = jaxid.predict(TRUTH, check, jaxid.OutputError())
    assert np.asarray(prediction.rms) == pytest.approx([0.01, 0.01], rel=0.3)
    late = dataclasses.replace(record, mask=record.mask.at[:3, 0].set(False))
    check = study_records(late, None, None, None).check
    starts = [np.asarray(TRUTH.initial_state(one)) for one in (late, check[0])]
    np.testing.assert_array_equal(*starts)


def test_fit_on_complete_records_starts_at_their_first_state():
    """The initial states of the last two thirds, which were fitted, are none of the whole."""
    records = [growing(seed) for seed in (1, 2, 3)]
    cut = study_records(records, None, None, 20, starts_free=True)
    free = jaxid.free(TRUTH, "k", "c", per_record=("initial_state",))
    given = LoopProblem.of(TRUTH, (), free, jaxid.OutputError(), cut.fitted, cut.check, window=20)
    fitted = fit(given, Hypothesis())
    assert set(rows_at_start(given, fitted)) == {"initial_state.x", "initial_state.v"}
    assert rows_at_start(given.on(cut.complete), fitted) == {}


def test_study_tells_range_of_check_before_it_searches():
    records, texts = [growing(seed) for seed in (1, 2, 3)], []
    study = jaxid.close_loop(
        TRUTH,
        jaxid.free(TRUTH, "k", "c"),
        jaxid.OutputError(),
        train=records,
        effects=LIBRARY,
        progress=texts.append,
    )
    assert texts[0].startswith("The check records exceed the range of the fitted ones in force")
    assert texts[0] in study.verdict
    free = jaxid.free(TRUTH, "k", "c", per_record=("initial_state",))
    study = jaxid.close_loop(
        TRUTH, free, jaxid.OutputError(), train=records, effects=LIBRARY, window=20, progress=False
    )
    assert (study.outcome, study.effects) == (Outcome.EXPLAINED, ("x^3 in v",))
    assert "exceed the range" not in study.verdict
