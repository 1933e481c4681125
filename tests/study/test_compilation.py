"""Programs that are compiled for every structure of their arguments, and let go of when there are
too many.
"""

import gc
import subprocess
import sys
import weakref

import jax
import jax.numpy as jnp
import numpy as np

from jaxid._foundation.compiler import compiler_options
from jaxid._foundation.evicting_jit import EvictingJit, compile_together
from jaxid._foundation.memory import memory_maps, release_compiled_programs_if_needed


def times(x, factor):
    return {"product": factor * x["x"]}


def arguments(count):
    return {"x": jnp.arange(float(count))}, 3.0


def test_static_argument_is_part_of_structure():
    traced = []

    def counted(x, factor):
        traced.append(factor)
        return times(x, factor)

    programs = EvictingJit(counted)
    for factor in (2.0, 3.0, 3.0):
        np.testing.assert_array_equal(
            programs({"x": jnp.ones(2)}, factor)["product"], factor * np.ones(2)
        )
    assert traced == [2.0, 3.0]


def test_program_not_used_for_longest_is_released_and_recompiled():
    traced = []

    def counted(x, factor):
        traced.append(x["x"].size)
        return times(x, factor)

    programs = EvictingJit(counted, most=2)
    compile_together([(programs, arguments(count)) for count in (1, 2)])
    released = weakref.ref(programs.known[programs.key(*arguments(2))])
    programs(*arguments(1))
    programs(*arguments(3))  # the second, as the first was used after it
    gc.collect()
    assert released() is None
    programs(*arguments(1))
    assert sorted(traced) == [1, 2, 3]
    np.testing.assert_array_equal(programs(*arguments(2))["product"], [0.0, 3.0])
    assert sorted(traced) == [1, 2, 2, 3]
    assert len(programs.known) == 2


def test_arrays_on_a_chosen_device_are_traced_once():
    traced = []

    def counted(x, factor):
        traced.append(x["x"].size)
        return times(x, factor)

    programs = EvictingJit(counted)
    placed = jax.device_put(arguments(2), jax.devices()[0])
    for given in (placed, placed, arguments(2), arguments(2), placed):
        np.testing.assert_array_equal(programs(*given)["product"], [0.0, 3.0])
    assert len(traced) == len(programs.known) == 2


def test_compiled_programs_are_released_at_half_of_memory_maps(monkeypatch):
    traced = []

    @jax.jit
    def doubled(x):
        traced.append(x)
        return 2.0 * x

    def times_compiled(taken):
        monkeypatch.setattr("jaxid._foundation.memory.memory_maps", lambda: (taken, 100))
        release_compiled_programs_if_needed()
        assert doubled(jnp.ones(())) == 2.0
        return len(traced)

    assert [times_compiled(taken) for taken in (50, 50, 51, 50)] == [1, 1, 2, 2]
    monkeypatch.undo()
    taken, granted = memory_maps()
    assert 0 <= taken < granted


def test_derivatives_pass_through_compiled_function():
    programs = EvictingJit(times)
    (slope,) = jax.jacfwd(lambda x: programs({"x": x[None]}, 3.0)["product"])(jnp.array(1.0))
    assert slope == 3.0


AS_A_USER = """
import jax, jax.numpy as jnp
import jaxid
from jaxid._foundation import compiler
from jaxid._foundation.evicting_jit import EvictingJit

compiler.FAST |= {{"xla_option_of_no_version": True}}
options = compiler.compiler_options()
assert {expected}, options
assert jax.jit(lambda x: x + len(compiler.compiler_options() or ()))(0.0) == len(options or ())
assert float(compiler.fast_compile_jit(jnp.sum)(jnp.ones(3))) == 3.0
assert float(EvictingJit(lambda x: x + 1.0)(jnp.ones(()))) == 2.0
assert float(jax.jit(EvictingJit(lambda x: x + 1.0))(jnp.ones(()))) == 2.0
"""


def run_as_a_user(environment, expected):
    code = AS_A_USER.format(expected=expected)
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_unknown_compiler_options_are_omitted(user_environment):
    """A removed option, as `xla_cpu_use_fusion_emitters` in jax 0.12, is not an error."""
    environment = without_compiler_settings(user_environment)
    known = {"xla_backend_optimization_level": 1, "xla_llvm_disable_expensive_passes": True}
    run_as_a_user(
        environment,
        f"options.items() >= {known}.items() and 'xla_option_of_no_version' not in options",
    )


def test_no_options_are_set_on_a_gpu(monkeypatch):
    """Its programs are compiled with XLA's defaults."""
    monkeypatch.delenv("XLA_FLAGS", raising=False)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert compiler_options() is None


def test_no_options_are_set_where_the_user_sets_xla_flags(user_environment):
    environment = without_compiler_settings(user_environment)
    run_as_a_user(
        environment | {"XLA_FLAGS": "--xla_cpu_prefer_vector_width=128"}, "options is None"
    )


def test_options_do_not_undo_what_jax_disables(user_environment):
    environment = without_compiler_settings(user_environment) | {
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "1"
    }
    run_as_a_user(environment, "'xla_backend_optimization_level' not in (options or {})")


def test_command_line_leaves_the_environment_of_the_compiler_alone(user_environment):
    """An option that XLA does not know ends the process where it stands in `XLA_FLAGS`."""
    code = (
        "import os, jaxid.__main__; assert 'XLA_FLAGS' not in os.environ, os.environ['XLA_FLAGS']"
    )
    environment = without_compiler_settings(user_environment)
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def without_compiler_settings(environment):
    names = ("XLA_FLAGS", "JAX_DISABLE_MOST_OPTIMIZATIONS")
    return {name: value for name, value in environment.items() if name not in names}
