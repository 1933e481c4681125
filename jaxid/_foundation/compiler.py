"""Compiler options for the large programs of a study, which run only a few times each."""

import functools
import os
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
from jax.core import Tracer

from .host import are_known
from .stored_programs import (
    StoredProgram,
    joined_leaves,
    split_leaves,
    stored_program,
    storing,
    types_of,
)

# Options that shorten compilation at little cost in run time. The loop on the embedded flight with
# 23 candidates on one core, cold and warm (jax 0.10): 188 and 7.7 s with XLA's defaults; 95 and
# 8.3 s with the first two; 86 and 8.6 s with the first three. LLVM compiles a program in parts at
# the same time: in 32, the default, it takes 1.4 times the processor time of two.
FAST = {
    "xla_cpu_use_fusion_emitters": False,
    "xla_backend_optimization_level": 1,
    "xla_llvm_disable_expensive_passes": True,
    "xla_cpu_parallel_codegen_split_count": 2,
}
# `JAX_DISABLE_MOST_OPTIMIZATIONS` sets these two lower still.
SET_BY_JAX = ("xla_backend_optimization_level", "xla_llvm_disable_expensive_passes")


def fast_compile_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `eqx.filter_jit(function)` compiled with `compiler_options()`, stored on disk once
    `configure` is called.

    JAX accepts compiler options for the outermost program only. Under `jit`, `vmap` or a derivative
    the function is therefore compiled without them. The options are looked up at the first call,
    not at import.
    """
    inner, stored = eqx.filter_jit(function), {}

    @functools.cache
    def jitted():
        options = compiler_options()
        return eqx.filter_jit(function, compiler_options=options)  # pyright: ignore

    def program(arguments, arrays, others) -> StoredProgram | None:
        def run(arrays):
            args, kwargs = joined_leaves(arrays, others)
            return function(*args, **kwargs)

        run.__name__ = function.__name__
        key = types_of(arrays, others)
        if key not in stored:
            stored[key] = stored_program(call, arguments, arrays, run, compiler_options())
        return stored[key]

    @functools.wraps(function)
    def call(*args, **kwargs):
        arrays, others = split_leaves((args, kwargs))
        if any(isinstance(array, Tracer) for array in arrays):
            return inner(*args, **kwargs)
        known = None
        if storing() and are_known(arrays):
            known = program((args, kwargs), arrays, others)
        return jitted()(*args, **kwargs) if known is None else known(arrays)

    return call


def compiler_options() -> dict[str, bool | int] | None:
    """Options of `FAST` that the installed XLA knows, or None.

    None of them is needed for a right result. If the environment variable `XLA_FLAGS` is set, the
    result is None: the user's choice of compiler options stands. It is None on a GPU as well, for
    whose programs the options were not chosen. With JAX's environment variable
    `JAX_DISABLE_MOST_OPTIMIZATIONS` the options that it sets are left out.
    """
    if "XLA_FLAGS" in os.environ or jax.default_backend() != "cpu":
        return None
    setting = os.environ.get("JAX_DISABLE_MOST_OPTIMIZATIONS", "").lower()
    reduced = setting not in ("", "0", "false")
    names = [name for name in FAST if not (reduced and name in SET_BY_JAX)]
    return {name: FAST[name] for name in names if is_known(name, FAST[name])} or None


@functools.cache
def is_known(name: str, value: bool | int) -> bool:
    """True if this version of XLA accepts a compiler option.

    XLA removes and adds options from release to release. A trivial program is compiled with the
    option once in each process (about 20 ms): an unknown option raises an error there, whereas in
    `XLA_FLAGS` it ends the process.
    """
    scalar = jax.ShapeDtypeStruct((), float)
    try:
        jax.jit(lambda x: x, compiler_options={name: value}).lower(scalar).compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True
