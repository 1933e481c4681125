"""`EvictingJit`: a jitted function whose programs can be released; compilation side by side."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import equinox as eqx
import jax

from .compiler import compiler_options
from .stored_programs import exported, on_one_device


class EvictingJit:
    """A jitted function whose compiled programs can be released.

    `jax.jit` keeps its compiled programs as long as the function lives. A search compiles one fit
    for each set of effects, and each takes about 300 of the 65,530 memory maps that Linux grants a
    process (`vm.max_map_count`): more than about 200 of them crash the process.

    Args:
        function: pure, of arguments whose leaves are arrays, or hashable.
    """

    def __init__(self, function: Callable[..., Any]):
        self.function = function
        self._begin()

    def __call__(self, *arguments: Any) -> Any:
        """Return the function's result; compile it first if necessary."""
        program, inputs = self._program(arguments)
        return program(*inputs)

    def lower(self, *arguments: Any) -> Any:
        """Return the lowered program for such arguments."""
        program, inputs = self._program(arguments)
        return program.lower(*inputs)

    def make_room(self, count: int, most: int) -> None:
        """Release all programs if `count` further ones would make more than `most`."""
        if len(self.known) + count > most:
            self._begin()

    def _begin(self) -> None:
        def run(arrays, others):
            static, structure = others
            both = zip(arrays, static, strict=True)
            return self.function(
                *jax.tree.unflatten(structure, [b if a is None else a for a, b in both])
            )

        run.__name__ = self.function.__name__  # the name that JAX gives to the program
        self.run, self.compiled, self.known = run, None, {}

    @property
    def jitted(self) -> Any:
        """The jitted function; made at its first use, because the compiler options are unknown at
        import.
        """
        if self.compiled is None:
            self.compiled = jax.jit(self.run, static_argnums=1, compiler_options=compiler_options())
        return self.compiled

    def key(self, *arguments: Any) -> tuple:
        """Return a key of the program for such arguments."""
        return _key(*_apart(arguments))

    def _program(self, arguments: tuple) -> tuple[Any, tuple]:
        """Return the jitted program for such arguments, and its own arguments."""
        arrays, others = _apart(arguments)
        key = _key(arrays, others)
        if key not in self.known:
            stored = exported(self.function, arguments, arrays, partial(self.run, others=others))
            options = compiler_options()
            self.known[key] = stored and jax.jit(stored, compiler_options=options)
        program = self.known[key]
        if program is None or not on_one_device(arrays):
            return self.jitted, (arrays, others)
        return program, (arrays,)


def _key(arrays: list, others: tuple) -> tuple:
    return others, tuple((a.shape, a.dtype, a.weak_type) for a in arrays if a is not None)


def _apart(arguments: tuple) -> tuple[list, tuple]:
    """Split the leaves of the arguments into arrays and static leaves.

    Returns:
        The arrays, None at the static leaves; and the static leaves, None at the arrays, with the
        tree structure of both.
    """
    leaves, structure = jax.tree.flatten(arguments)
    is_array = [eqx.is_array(leaf) for leaf in leaves]
    arrays = [leaf if known else None for leaf, known in zip(leaves, is_array, strict=True)]
    static = tuple(None if known else leaf for leaf, known in zip(leaves, is_array, strict=True))
    return arrays, (static, structure)


def compile_together(programs: Sequence[tuple[EvictingJit, tuple]]) -> None:
    """Compile programs concurrently, each for its arguments; later calls need no compilation.

    XLA compiles one program on little more than one core, and without Python's global lock.
    Programs that run at the same time could deadlock on few cores; these are only compiled.

    Args:
        programs: pairs of a program and the arguments that it will be called with.
    """
    different = {(program, program.key(*arguments)): arguments for program, arguments in programs}
    with ThreadPoolExecutor() as executor:
        for future in [
            executor.submit(program.lower(*arguments).compile)
            for (program, _), arguments in different.items()
        ]:
            future.result()
