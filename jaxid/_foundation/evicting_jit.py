"""`EvictingJit`: a jitted function whose programs can be released; compilation side by side."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from typing import Any

import jax

from .compiler import compiler_options
from .host import are_known
from .progress import report_part
from .stored_programs import joined_leaves, split_leaves, stored_program, types_of


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
            return self.function(*joined_leaves(arrays, others))

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
        return types_of(*split_leaves(arguments))

    def _program(self, arguments: tuple) -> tuple[Any, tuple]:
        """Return the jitted program for such arguments, and its own arguments."""
        arrays, others = split_leaves(arguments)
        key = types_of(arrays, others)
        if key not in self.known:
            run = partial(self.run, others=others)
            options = compiler_options()
            self.known[key] = stored_program(self.function, arguments, arrays, run, options)
        program = self.known[key]
        if program is None or not are_known(arrays):
            return self.jitted, (arrays, others)
        return program, (arrays,)


def compile_together(programs: Sequence[tuple[EvictingJit, tuple]]) -> None:
    """Compile new programs concurrently, each for its arguments; later calls need no compilation.

    XLA compiles one program on little more than one core, and without Python's global lock.
    Programs that run at the same time could deadlock on few cores; these are only compiled.

    Args:
        programs: pairs of a program and the arguments that it will be called with.
    """
    keyed = [(program, program.key(*arguments), arguments) for program, arguments in programs]
    different = {(p, key): arguments for p, key, arguments in keyed if key not in p.known}
    compilations, count = [], len(different)
    with ThreadPoolExecutor() as executor:
        for (program, _), arguments in different.items():
            report_part(f"{len(compilations)} of {count} programs traced")
            compilations.append(executor.submit(program.lower(*arguments).compile))
        ended = as_completed(compilations)
        for done in range(count):
            report_part(f"{done} of {count} programs compiled")
            next(ended).result()
