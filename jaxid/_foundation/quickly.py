"""`quickly`: how the large programs of a study are compiled, of which each runs some times and is then done with."""

import os

import equinox as eqx

# The loop on the embedded flight with 23 candidates, on one core, cold and warm: 188 and 7.7 s as XLA comes; 95 and 8.3 s with
# its older way of fusing and the first level of optimisation; 86 and 8.6 s without expensive passes as well.
FLAGS = {
    "xla_cpu_use_fusion_emitters": False,
    "xla_backend_optimization_level": 1,
    "xla_llvm_disable_expensive_passes": True,
}
# Who says what XLA is to do is not contradicted.
OPTIONS = None if "XLA_FLAGS" in os.environ else FLAGS


def quickly(function):
    """`eqx.filter_jit` with these flags, for a function that no other program calls: JAX takes them outermost only."""
    return eqx.filter_jit(function, compiler_options=OPTIONS)  # pyright: ignore[reportCallIssue]
