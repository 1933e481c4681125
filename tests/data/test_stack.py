"""Stack and unstack are exact inverses; a split has no record in two sets."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from record_strategies import alike, assert_same

from jaxid._foundation.checks import InputError
from jaxid.data import record, segment, split, split_at, stack, unstack
from jaxid.data.stack import single_records


def flight(name, rows=6, **changes):
    arguments = {
        "inputs": ("de",),
        "outputs": ("q",),
        "units": {"q": "rad/s"},
        "constants": {"mass": 2.0},
    } | changes
    return record(
        np.arange(float(rows)), np.ones(rows), np.arange(float(rows)), name=name, **arguments
    )


@settings(max_examples=50)
@given(alike(), st.none() | st.integers(9, 12))
def test_unstack_is_the_exact_inverse_of_stack(makes, pad_to):
    originals = [make() for make in makes]
    stacked = stack(originals, pad_to)
    assert stacked.t.shape == (len(originals), pad_to or max(r.t.shape[0] for r in originals))
    back = unstack(stacked)
    assert len(back) == len(originals)
    for a, b in zip(originals, back, strict=True):
        assert_same(a, b)
    assert_same(stacked, stack(back, stacked.t.shape[1]))


@settings(max_examples=50)
@given(alike(min_size=2))
def test_padding_repeats_last_row_and_is_masked(makes):
    originals = [make() for make in makes]
    stacked = stack(originals, pad_to=11)
    np.testing.assert_array_equal(stacked.samples, [r.t.shape[0] for r in originals])
    for i, r in enumerate(originals):
        n = r.t.shape[0]
        assert (np.asarray(stacked.t)[i, n:] == np.asarray(r.t)[-1]).all()
        assert (np.asarray(stacked.u)[i, n:] == np.asarray(r.u)[-1]).all()
        assert not np.asarray(stacked.mask)[i, n:].any()
        assert not np.asarray(stacked.z)[i, n:].any()
        assert (jnp.diff(stacked.t[i])[: n - 1] > 0).all()


def test_single_records_of_records_and_stacks_have_no_padding():
    a, b, c = (flight(name, rows) for name, rows in (("a", 4), ("b", 6), ("c", 5)))
    assert single_records(a) == [a]
    assert single_records([]) == []
    for one, other in zip(single_records((c, stack([a, b]))), (c, a, b), strict=True):
        assert_same(one, other)


DIFFERENT = {
    "channels": ({"outputs": ("r",), "units": {}}, ["Record 1 ('b')", "'q', 'r'", "same channels"]),
    "units": ({"units": {"q": "m"}}, ["Record 1 ('b')", "'q'", "[m]", "[rad/s]", "Give `units`"]),
    "constants": ({"constants": {}}, ["Record 1 ('b')", "'mass'", "Give them to all"]),
}


@pytest.mark.parametrize("case", DIFFERENT)
def test_records_with_different_layout_are_refused_by_stack(case):
    changes, words = DIFFERENT[case]
    with pytest.raises(InputError) as caught:
        stack([flight("a"), flight("b", **changes)])
    for word in words:
        assert word in str(caught.value)


def test_records_with_another_channel_order_are_refused_by_stack():
    a = record([0, 1], None, np.ones((2, 2)), inputs=(), outputs=("p", "q"))
    b = record([0, 1], None, np.ones((2, 2)), inputs=(), outputs=("q", "p"), name="b")
    with pytest.raises(InputError, match=r"Record 1 \('b'\).*another order"):
        stack([a, b])


def test_stack_of_no_records_or_stacks_or_short_padding_is_refused():
    with pytest.raises(InputError, match=r"Give at least one"):
        stack([])
    with pytest.raises(InputError, match=r"`unstack` it"):
        stack([stack([flight("a")])])
    with pytest.raises(InputError, match=r"longest record has 6 samples"):
        stack([flight("a")], pad_to=5)


def test_split_selects_records_by_name_and_index():
    records = [flight(n) for n in "abcd"]
    parts = split(records, train=["a", 1], check=[-2], test=["d"])
    assert [[r.names[0] for r in part] for part in parts] == [["a", "b"], ["c"], ["d"]]
    assert parts.check[0] is records[2]


SPLITS = {
    "overlap": (
        {"train": ["a", "b"], "test": [1]},
        ["Record 1 ('b')", "`train`", "`test`", "one of them"],
    ),
    "twice": ({"train": ["a", 0]}, ["Record 0 ('a')", "one of them"]),
    "unknown name": ({"train": ["a", "bb"]}, ["no record 'bb'", "Did you mean 'b'"]),
    "unknown index": ({"train": ["a"], "check": [3]}, ["no record 3", "`check`", "0 to 2"]),
    "nothing to fit": ({"train": [], "test": ["a"]}, ["`train` is empty", "at least one"]),
    "a string": ({"train": "ab"}, ["`train`", "'ab'", "list"]),
    "not unique": ({"train": ["c"]}, ["'c'", "not unique", "index"]),
}


@pytest.mark.parametrize("case", SPLITS)
def test_split_with_invalid_selection_is_refused(case):
    arguments, words = SPLITS[case]
    records = [flight("a"), flight("b"), flight("c")] + (
        [flight("c")] if case == "not unique" else []
    )
    with pytest.raises(InputError) as caught:
        split(records, **arguments)
    for word in words:
        assert word in str(caught.value)


def test_split_at_fraction_or_row_keeps_all_rows():
    r = flight("a", rows=9)
    first, last = split_at(r, 2 / 3)
    np.testing.assert_array_equal(first.t, np.arange(6))
    np.testing.assert_array_equal(last.t, np.arange(6, 9))
    assert [part.t.shape[0] for part in split_at(r, 2)] == [2, 7]
    for where in (1, 8, 0.0, 1.0, 12, -3):
        with pytest.raises(InputError, match=r"Record 'a'.*at least 2"):
            split_at(r, where)
    with pytest.raises(InputError, match=r"stack\[i\]"):
        split_at(stack([r]), 0.5)


def test_segment_keeps_all_samples_and_makes_equal_pieces():
    r = flight("a", rows=11)  # 10 s, one sample a second
    pieces = segment(r, 4)
    assert [piece.names for piece in pieces] == [("a (1 of 3)",), ("a (2 of 3)",), ("a (3 of 3)",)]
    assert [piece.t.shape[0] for piece in pieces] == [4, 3, 4]
    for key in ("t", "u", "z", "mask"):
        np.testing.assert_array_equal(
            np.concatenate([getattr(piece, key) for piece in pieces]), getattr(r, key)
        )
    assert all(piece.constants == r.constants for piece in pieces)
    (single,) = segment(r, 10.0)
    np.testing.assert_array_equal(single.t, r.t)


@pytest.mark.parametrize(("step", "seconds"), [(0.01, 2.0), (0.1, 0.7), (1 / 3, 1.0)])
def test_segments_of_uneven_division_have_at_most_requested_length(step, seconds):
    t = step * np.arange(1000)
    pieces = segment(
        record(t, np.zeros((1000, 1)), np.zeros((1000, 1)), inputs=("u",), outputs=("z",)), seconds
    )
    sizes = [piece.t.shape[0] for piece in pieces]
    assert sum(sizes) == 1000
    assert max(sizes) - min(sizes) <= 1
    assert all(float(piece.t[-1] - piece.t[0]) <= seconds for piece in pieces)


def test_segment_of_invalid_length_or_stack_is_refused():
    r = flight("a", rows=9)
    for seconds in (0, -1.0):
        with pytest.raises(InputError, match="positive number of seconds"):
            segment(r, seconds)
    with pytest.raises(
        InputError, match=r"Record 'a': in 8 pieces of at most 1 s one has 1 samples"
    ):
        segment(r, 1)
    with pytest.raises(InputError, match=r"stack\[i\]"):
        segment(stack([r]), 2.0)


def test_single_record_and_stack_serve_as_lists():
    r = flight("a", rows=9)
    assert unstack(r) == [r]
    parts = split(stack([r, flight("b", rows=9)]), train=["a"], test=[1])
    assert [part[0].names for part in (parts.train, parts.test)] == [("a",), ("b",)]
    row = np.searchsorted(np.asarray(r.t), 4.0)  # a NumPy integer
    assert [part.t.shape[0] for part in split_at(r, row)] == [4, 5]
