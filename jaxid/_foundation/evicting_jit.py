"""`EvictingJit`: a jitted function whose programs can be released; compilation side by side."""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from threading import Lock
from typing import Any

import jax
from jax.core import Tracer

from .compiler import compiler_options
from .host import are_known
from .progress import report_part
from .stored_programs import joined_leaves, split_leaves, stored_program, types_of

# Chosen: programs of one function that are kept. Each takes some 300 of the 65,530 memory maps that
# Linux grants a process (`vm.max_map_count`), and some 50 MB for a fit on long records. A round of
# a search has up to 25, after which the program of all candidates is needed again.
MOST_PROGRAMS = 32


class EvictingJit:
    """A jitted function that releases the programs it has not used for longest.

    `jax.jit` keeps its compiled programs as long as the function lives. A search compiles one fit
    for each set of effects; more than about 200 of them crash the process.

    Args:
        function: pure, of arguments whose leaves are arrays, or hashable.
        most: number of programs that are kept.
    """

    def __init__(self, function: Callable[..., Any], most: int = MOST_PROGRAMS):
        self.function, self.most = function, most
        self.known: OrderedDict[tuple, Any] = OrderedDict()
        self.lock = Lock()

    def __call__(self, *arguments: Any) -> Any:
        """Return the function's result; compile it first if necessary."""
        arrays, others = split_leaves(arguments)
        if any(isinstance(array, Tracer) for array in arrays):
            # JAX accepts compiler options for the outermost program only, which keeps this one.
            return jax.jit(self._of_arrays(others))(arrays)
        return self._program(arguments, arrays, others)(arrays)

    def lower(self, *arguments: Any) -> Any:
        """Return the lowered program for such arguments."""
        arrays, others = split_leaves(arguments)
        return self._program(arguments, arrays, others).lower(arrays)

    def key(self, *arguments: Any) -> tuple:
        """Return a key of the program for such arguments."""
        return _key(*split_leaves(arguments))

    def clear(self) -> None:
        """Release all programs."""
        with self.lock:
            self.known.clear()

    def _program(self, arguments: tuple, arrays: list, others: tuple) -> Any:
        """Return the jitted program for such arguments, a function of their arrays."""
        key = _key(arrays, others)
        with self.lock:
            program = self.known.get(key)
        if program is None:
            run, options = self._of_arrays(others), compiler_options()  # not known at import
            program = stored_program(self.function, arguments, arrays, run, options)
            program = program or jax.jit(run, compiler_options=options)
        with self.lock:
            self.known[key] = program
            self.known.move_to_end(key)
            while len(self.known) > self.most:
                self.known.popitem(last=False)
        return program

    def _of_arrays(self, others: tuple) -> Callable[[list], Any]:
        """Return the function of arrays, for some static leaves."""

        def run(arrays):
            return self.function(*joined_leaves(arrays, others))

        run.__name__ = self.function.__name__  # the name that JAX gives to the program
        return run


def _key(arrays: list, others: tuple) -> tuple:
    """Return a key of the program for some split arguments; no program on disk serves arrays that
    stand on a device that the user chose.
    """
    return *types_of(arrays, others), are_known(arrays)


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
