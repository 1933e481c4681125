"""`Record` and `record`: shapes, masks, units; errors with the channel and the remedy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from record_strategies import records

from jaxid._foundation.checks import InputError
from jaxid.data import Record, record, stack
from jaxid.data.arguments import channel_names
from jaxid.models.base import as_float


def simple(**changes):
    """A valid record of 4 samples, with some arguments changed."""
    arguments = {
        "t": [0.0, 0.1, 0.2, 0.3],
        "u": [[1.0], [2.0], [3.0], [4.0]],
        "z": [[1.0, 10.0], [2.0, np.nan], [3.0, 30.0], [4.0, 40.0]],
        "inputs": ("elevator",),
        "outputs": ("alpha", "q"),
        "name": "run 7",
    }
    arguments |= changes
    return record(arguments.pop("t"), arguments.pop("u"), arguments.pop("z"), **arguments)


def test_missing_samples_are_masked_and_zero():
    r = simple()
    np.testing.assert_array_equal(r.mask, [[True, True], [True, False], [True, True], [True, True]])
    np.testing.assert_array_equal(r.z[:, 1], [10, 0, 30, 40])
    np.testing.assert_array_equal(r.channel("q"), [10, np.nan, 30, 40])
    np.testing.assert_array_equal(r.channel("elevator"), [1, 2, 3, 4])
    assert r.z.dtype == r.u.dtype == r.t.dtype == jnp.float64


def test_channels_are_dropped_by_name():
    r = simple().without("elevator", "alpha")
    assert (r.inputs, r.outputs) == ((), ("q",))
    np.testing.assert_array_equal(r.channel("q"), simple().channel("q"))
    assert r.u.shape == (4, 0)
    both = stack([simple(), simple(name="run 8")])
    for one, name in zip(both.without("q"), ("run 7", "run 8"), strict=True):
        assert one.names == (name,)
        assert one.outputs == ("alpha",)
        np.testing.assert_array_equal(one.channel("alpha"), simple().channel("alpha"))
    with pytest.raises(InputError, match=r"no channel 'alfa'. Did you mean 'alpha'"):
        simple().without("alfa")


def test_units_of_arguments_are_converted_to_si():
    r = simple(
        t=[0.0, 100.0, 200.0, 300.0],
        units={"t": "ms", "elevator": "deg", "q": "deg/s", "mass": "slug"},
        constants={"mass": 2.0},
    )
    np.testing.assert_allclose(r.t, [0, 0.1, 0.2, 0.3], rtol=1e-15)
    np.testing.assert_allclose(r.u[:, 0], np.deg2rad([1, 2, 3, 4]), rtol=1e-15)
    np.testing.assert_allclose(r.z[2, 1], np.deg2rad(30), rtol=1e-15)
    assert (r.input_units, r.output_units) == (("rad",), ("", "rad/s"))
    np.testing.assert_allclose(r.constants["mass"], 29.187805874412728, rtol=1e-14)


def test_record_accepts_one_dimensional_channel_and_no_inputs():
    r = record([0, 1, 2], None, [1, 2, 3], inputs=(), outputs=("y",))
    assert r.u.shape == (3, 0)
    assert r.z.shape == (3, 1)
    flat = record(
        [0, 1, 2], [1, 2, 3], np.array([True, False, True]), inputs=("a",), outputs=("y",)
    )
    np.testing.assert_array_equal(flat.z[:, 0], [1, 0, 1])


def test_masked_arrays_keep_their_mask():
    z = np.ma.masked_array([1, 2, 3], mask=[False, True, False])
    r = record([0, 1, 2], None, z, inputs=(), outputs=("y",))
    np.testing.assert_array_equal(r.mask[:, 0], [True, False, True])


REFUSALS = {
    "time stands still": (
        {"t": [0, 0.1, 0.1, 0.3]},
        ["run 7", "'t'", "row 2", "0.1 s", "Remove repeated rows"],
    ),
    "time goes back": ({"t": [0, 0.2, 0.1, 0.3]}, ["'t'", "row 2", "sort by time"]),
    "time is not a number": (
        {"t": [0, np.nan, 0.2, 0.3]},
        ["'t'", "row 1", "nan", "Remove the row"],
    ),
    "time has two axes": ({"t": [[0, 1, 2, 3]]}, ["'t'", "(1, 4)", "`stack`"]),
    "time in metres": ({"units": {"t": "m"}}, ["'m'", "'t'", "Give 's'"]),
    "one sample": ({"t": [0.0], "u": [[1.0]], "z": [[1.0, 1.0]]}, ["1 samples", "at least 2"]),
    "u short": ({"u": [[1.0], [2.0], [3.0]]}, ["elevator", "3 rows", "4", "same times"]),
    "z short": ({"z": [[1.0, 2.0]] * 3}, ["alpha, q", "3 rows", "4", "same times"]),
    "u has a column too many": (
        {"u": np.ones((4, 2))},
        ["elevator", "(4, 2)", "one column per name"],
    ),
    "z has a column too few": ({"z": np.ones(4)}, ["alpha, q", "(4,)", "(time, 2)"]),
    "u infinite": (
        {"u": [[1], [2], [np.inf], [4]]},
        ["input 'elevator'", "row 2", "t = 0.2 s", "Replace"],
    ),
    "z infinite": (
        {"z": [[1, 1], [1, 1], [1, 1], [1, -np.inf]]},
        ["output 'q'", "row 3", "0.3 s", "Write NaN"],
    ),
    "u unknown": (
        {"u": [[1], [np.nan], [3], [4]]},
        ["input 'elevator'", "row 1", "t = 0.1 s", "interpolate"],
    ),
    "q never measured": (
        {"z": [[1, np.nan]] * 4},
        ["output 'q'", "no valid sample", "Leave it out of `outputs`"],
    ),
    "twice among outputs": ({"outputs": ("q", "q")}, ["'q'", "twice", "Rename"]),
    "input and output": ({"outputs": ("alpha", "elevator")}, ["'elevator'", "twice", "Rename"]),
    "named as time": ({"outputs": ("alpha", "t")}, ["'t'", "twice", "Rename"]),
    "constant named as channel": ({"constants": {"q": 1.0}}, ["'q'", "twice", "Rename"]),
    "unit of no channel": ({"units": {"alfa": "deg"}}, ["'alfa'", "Did you mean 'alpha'"]),
    "unit unknown": (
        {"units": {"q": "deg/sec2"}},
        ["'q'", "'deg/sec2'", "not known", "Did you mean"],
    ),
    "unit ambiguous": ({"units": {"q": "g"}}, ["'q'", "'g0'", "'gram'"]),
    "complex": ({"z": np.ones((4, 2)) * 1j}, ["alpha, q", "complex", "two channels"]),
    "text": (
        {"u": [["1"], ["up"], ["3"], ["4"]]},
        ["'elevator'", "row 0", "not a number", "Convert"],
    ),
    "text in the second column": (
        {"z": [[1.0, 2.0], [1.0, "x"], [1.0, 2.0], [1.0, 2.0]]},
        ["not a number", "Convert"],
    ),
    "object": (
        {"z": np.array([[1, 2], [1, 2], [1, None], [1, 2]], object)},
        ["'q'", "None", "row 2", "NaN"],
    ),
    "dates": (
        {"t": np.arange("2020-01", "2020-05", dtype="datetime64[M]")},
        ["'t'", "datetime64", "seconds"],
    ),
    "ragged": (
        {"z": [[1.0, 2.0], [1.0], [1.0], [1.0]]},
        ["alpha, q", "different lengths", "one value per channel"],
    ),
    "names as a string": ({"inputs": "elevator"}, ["`inputs`", "'elevator'", "tuple"]),
    "empty name": ({"outputs": ("alpha", "")}, ["`outputs`", "non-empty"]),
    "no output": ({"outputs": (), "z": np.ones((4, 0))}, ["no output", "Name at least one"]),
    "constant is a vector": ({"constants": {"mass": [1.0, 2.0]}}, ["'mass'", "(2,)", "one number"]),
    "constant is NaN": ({"constants": {"mass": np.nan}}, ["'mass'", "nan", "finite"]),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_invalid_arguments_are_refused_with_channel_and_remedy(case):
    changes, words = REFUSALS[case]
    with pytest.raises(InputError) as caught:
        simple(**changes)
    for word in words:
        assert word in str(caught.value), f"{word!r} is not in: {caught.value}"


def aligned(numbers) -> np.ndarray:
    """Copy of numbers in memory that JAX can use without a copy of its own: a multiple of 64."""
    numbers = np.asarray(numbers, float)
    buffer = np.zeros(numbers.nbytes + 64, np.uint8)
    begin = -buffer.ctypes.data % 64
    copy = buffer[begin : begin + numbers.nbytes].view(float).reshape(numbers.shape)
    copy[...] = numbers
    return copy


def test_record_does_not_follow_later_changes_of_the_arrays():
    t, x = aligned(0.1 * np.arange(64)), aligned(np.ones((64, 1)))
    made = record(t, x, x, inputs=("u",), outputs=("x",))
    parameter = as_float(t)
    t[:], x[:] = -1.0, -1.0
    np.testing.assert_array_equal(made.t, 0.1 * np.arange(64))
    np.testing.assert_array_equal(made.u, np.ones((64, 1)))
    np.testing.assert_array_equal(made.z, np.ones((64, 1)))
    np.testing.assert_array_equal(parameter, 0.1 * np.arange(64))


def test_single_precision_is_refused():
    with jax.enable_x64(False), pytest.raises(InputError, match=r"float32.*jaxid\.configure\(\)"):
        simple()


@given(st.data())
def test_invalid_input_sample_is_refused_with_row_and_channel(data):
    good = data.draw(records(max_inputs=3))()
    if not good.inputs:
        return
    u = np.array(good.u)
    row, k = data.draw(st.integers(0, u.shape[0] - 1)), data.draw(st.integers(0, u.shape[1] - 1))
    u[row, k] = data.draw(st.sampled_from([np.nan, np.inf, -np.inf]))
    with pytest.raises(InputError) as caught:
        record(good.t, u, good.z, inputs=good.inputs, outputs=good.outputs)
    assert f"'{good.inputs[k]}'" in str(caught.value)
    assert f"row {row} " in str(caught.value)


@given(records())
def test_record_has_consistent_shapes_and_mask(make):
    r = make()
    rows = r.t.shape[0]
    assert r.u.shape == (rows, len(r.inputs))
    assert r.z.shape == r.mask.shape == (rows, len(r.outputs))
    assert not r.is_stack
    assert r.n_cases == 1
    assert int(r.samples) == rows
    assert np.isfinite(r.z).all()
    assert not np.asarray(r.z)[~np.asarray(r.mask)].any()
    for k, name in enumerate(r.outputs):
        np.testing.assert_array_equal(np.isnan(r.channel(name)), ~np.asarray(r.mask)[:, k])


@given(st.data())
def test_window_equals_slice(data):
    r = data.draw(records())()
    start = data.draw(st.integers(0, r.t.shape[0] - 1))
    stop = data.draw(st.integers(start + 1, r.t.shape[0]))
    part = r.window(start, stop)
    for key in ("t", "u", "z", "mask"):
        np.testing.assert_array_equal(getattr(part, key), np.asarray(getattr(r, key))[start:stop])
    assert part.names == r.names


@pytest.mark.parametrize(("start", "stop"), [(2, 2), (-1, 2), (0, 5), (3, 1)])
def test_window_outside_record_is_refused(start, stop):
    with pytest.raises(InputError, match=r"run 7.*4 samples.*Choose"):
        simple().window(start, stop)


def test_unknown_channel_or_case_is_refused():
    r, s = simple(), stack([simple(), simple()])
    with pytest.raises(InputError, match=r"no channel 'alfa'.*Did you mean 'alpha'"):
        r.channel("alfa")
    with pytest.raises(InputError, match=r"single record"):
        r[0]
    with pytest.raises(InputError, match=r"no case 2 in a stack of 2"):
        s[2]
    with pytest.raises(InputError, match=r"stack\[i\]"):
        s.window(0, 1)


def test_record_works_under_jit_and_vmap_and_compiles_once_if_anonymous():
    compiled = []

    @jax.jit
    def mean(r: Record):
        compiled.append(r.names)
        return jnp.sum(jnp.where(r.mask, r.z, 0.0)) / jnp.sum(r.mask) + 0 * r.samples

    a, b = simple(name="a"), simple(name="b")
    assert float(mean(a.anonymous())) == float(mean(b.anonymous())) == pytest.approx(90 / 7)
    assert compiled == [("",)]
    s = stack([a, b])
    np.testing.assert_allclose(jax.vmap(mean)(s.anonymous()), [90 / 7, 90 / 7])
    np.testing.assert_array_equal(jax.jit(lambda r: r[1].t)(s), s.t[1])
    assert "time" not in jax.jit(lambda r: len(repr(r)) + r.t)(a).__repr__()


@settings(max_examples=20)
@given(records())
def test_constructor_works_inside_transformations(make):
    r = make()
    doubled = jax.jit(
        lambda r: Record(
            *(r.t, 2 * r.u, r.z, r.mask, r.constants),
            *(r.inputs, r.outputs, r.input_units, r.output_units, r.names),
        )
    )(r)
    np.testing.assert_array_equal(doubled.u, 2 * r.u)
    assert doubled.names == r.names


def test_repr_has_size_units_and_missing_share():
    text = repr(simple(units={"q": "deg/s"}, constants={"mass": 3.0}))
    for word in ("run 7", "4 samples", "0.3 s", "12.5 %", "mass", "elevator", "alpha, q [rad/s]"):
        assert word in text
    short = simple().window(0, 3)
    text = repr(stack([simple(), short]))
    for word in ("Stack of 2", "3 to 4 samples", "0.2 to 0.3 s", "14.3 %"):
        assert word in text


def test_channels_by_name_are_refused_with_the_two_arguments():
    """Typed as `Sequence`, `record` itself refuses a mapping where annotations execute."""
    values = {"force": np.zeros(3)}
    with pytest.raises(InputError, match=r"`inputs` is a mapping.*column_stack\(\[\*inputs"):
        channel_names(values, "inputs", "The record")
