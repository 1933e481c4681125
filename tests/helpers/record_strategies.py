"""Random records for property tests.

The strategies draw numbers only, and give a call that makes the record: JAX, when it compiles,
moves the global random state, which hypothesis does not allow inside a strategy.
"""

from functools import partial

import numpy as np
from hypothesis import strategies as st

from jaxid.data import record

NUMBERS = st.floats(-1e6, 1e6, allow_subnormal=False)
UNITS = ("", "rad", "rad/s", "m/s^2", "N", "kg*m^2")


@st.composite
def records(draw, max_inputs=2, channels=None, name=None):
    """A call that makes a record of 2 to 9 samples, with or without inputs, missing samples and
    constants, in SI units.

    `channels` (inputs, outputs, units, constants' names) fixes what records of one stack share.
    """
    inputs, outputs, units, constants = draw(layouts(max_inputs)) if channels is None else channels
    rows = draw(st.integers(2, 9))
    steps = draw(st.lists(st.floats(1e-3, 10.0), min_size=rows, max_size=rows))
    u = draw(st.lists(NUMBERS, min_size=rows * len(inputs), max_size=rows * len(inputs)))
    cell = st.one_of(NUMBERS, st.just(np.nan))
    z = np.array(draw(st.lists(cell, min_size=rows * len(outputs), max_size=rows * len(outputs))))
    z = z.reshape(rows, len(outputs))
    z[draw(st.integers(0, rows - 1))] = 1.0  # an output without any valid sample is refused
    return partial(
        record,
        np.cumsum(steps),
        np.reshape(u, (rows, len(inputs))),
        z,
        inputs=inputs,
        outputs=outputs,
        units=units,
        name=draw(st.sampled_from(["", "a", "run 1", "Flug 2"])) if name is None else name,
        constants={key: draw(NUMBERS) for key in constants},
    )


@st.composite
def layouts(draw, max_inputs=2):
    """Names of inputs and outputs, units, names of constants."""
    inputs = ("elevator", "thrust", "aileron")[: draw(st.integers(0, max_inputs))]
    outputs = ("alpha", "q", "az")[: draw(st.integers(1, 3))]
    units = {n: draw(st.sampled_from(UNITS)) for n in (*inputs, *outputs)}
    constants = ("mass", "sensor.x")[: draw(st.integers(0, 2))]
    return inputs, outputs, units, constants


@st.composite
def alike(draw, min_size=1):
    """Calls that make records which can be stacked."""
    channels = draw(layouts())
    count = draw(st.integers(min_size, 3))
    return [draw(records(channels=channels, name=f"run {i}")) for i in range(count)]


def assert_same(a, b):
    """Two records agree in every bit and name."""
    for key in ("t", "u", "z", "mask"):
        x, y = np.asarray(getattr(a, key)), np.asarray(getattr(b, key))
        assert x.dtype == y.dtype, key
        assert x.shape == y.shape, key
        assert x.tobytes() == y.tobytes(), key
    assert a.constants.keys() == b.constants.keys()
    for key, value in a.constants.items():
        assert np.asarray(value).tobytes() == np.asarray(b.constants[key]).tobytes(), key
    for key in ("inputs", "outputs", "input_units", "output_units", "names"):
        assert getattr(a, key) == getattr(b, key), key
