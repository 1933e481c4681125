"""Compilation for the few tests whose programs run for longer than they take to compile."""

from collections.abc import Iterator
from contextlib import contextmanager

import jax

SETTING = "jax_disable_most_optimizations"


@contextmanager
def optimised() -> Iterator[None]:
    """Compile programs at level 1 inside the context: a third longer, to run in a third of the
    time.
    """
    before = jax.config.read(SETTING)
    jax.config.update(SETTING, False)
    try:
        yield
    finally:
        jax.config.update(SETTING, before)
