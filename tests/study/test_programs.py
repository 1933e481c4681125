"""Programs that are compiled for every structure of their arguments, and let go of when there are too many."""

import gc
import subprocess
import sys
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.memory import make_room, memory_maps
from jaxid.study.programs import Programs, compile_together


def times(x, factor):
    return {"product": factor * x["x"]}


def asked(count):
    return {"x": jnp.arange(float(count))}, 3.0


def test_what_is_no_array_is_part_of_the_structure():
    traced = []

    def counted(x, factor):
        traced.append(factor)
        return times(x, factor)

    programs = Programs(counted)
    for factor in (2.0, 3.0, 3.0):
        np.testing.assert_array_equal(programs({"x": jnp.ones(2)}, factor)["product"], factor * np.ones(2))
    assert traced == [2.0, 3.0]


def test_programs_that_are_too_many_are_let_go_and_compiled_anew():
    programs = Programs(times)
    compile_together([(programs, asked(count)) for count in (1, 2)])
    compiled = weakref.ref(programs.jitted)
    programs(*asked(2))  # compiled already: no more than two are known
    programs.make_room(1, 3)
    assert programs.jitted is compiled()
    programs.make_room(2, 3)
    gc.collect()
    assert compiled() is None
    np.testing.assert_array_equal(programs(*asked(2))["product"], [0.0, 3.0])
    assert len(programs.known) == 1


def test_what_jax_compiled_is_let_go_where_half_of_the_memory_maps_are_taken(monkeypatch):
    traced = []

    @jax.jit
    def doubled(x):
        traced.append(x)
        return 2.0 * x

    def times_compiled(taken):
        monkeypatch.setattr("jaxid._foundation.memory.memory_maps", lambda: (taken, 100))
        make_room()
        assert doubled(jnp.ones(())) == 2.0
        return len(traced)

    assert [times_compiled(taken) for taken in (50, 50, 51, 50)] == [1, 1, 2, 2]
    monkeypatch.undo()
    taken, granted = memory_maps()
    assert 0 <= taken < granted


def test_derivatives_go_through_what_is_compiled():
    programs = Programs(times)
    (slope,) = jax.jacfwd(lambda x: programs({"x": x[None]}, 3.0)["product"])(jnp.array(1.0))
    assert slope == 3.0


AS_A_USER = """
import jax.numpy as jnp
from jaxid._foundation.quickly import FLAGS, OPTIONS, quickly
from jaxid.study.programs import Programs

assert OPTIONS == {expected}, OPTIONS
assert float(quickly(jnp.sum)(jnp.ones(3))) == 3.0  # XLA knows all of them
assert float(Programs(lambda x: x + 1.0)(jnp.ones(()))) == 2.0
"""


@pytest.mark.parametrize(("flags", "expected"), [(None, "FLAGS"), ("--xla_cpu_use_fusion_emitters=true", "None")])
def test_large_programs_are_compiled_quickly_where_nobody_says_how(flags, expected, user_environment):
    environment = {name: value for name, value in user_environment.items() if name != "XLA_FLAGS"}
    environment |= {"XLA_FLAGS": flags} if flags else {}
    code = AS_A_USER.format(expected=expected)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
