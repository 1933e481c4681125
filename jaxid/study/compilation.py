"""Jitted functions of a workbench, and the concurrent compilation of the large ones."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.compiler import compiler_options, fast_compile_jit
from .._foundation.types import Array, Bool, Float, Int
from ..data.record import Record
from ..effects.augmented import Augmented
from ..effects.shape_initialisation import RECORD
from ..estimation.host_iteration import ModelPrograms
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..models.base import AbstractModel
from ..models.free import Parameters, Positions
from ..models.free_model import FreeModel
from ..simulation.steppers import rate
from .thresholds import COMPILE_COST, COMPILE_COST_PER_OPERATION


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
        return self.jitted(*self._noted(arguments))

    def lower(self, *arguments: Any) -> Any:
        """Return the lowered program for such arguments."""
        return self.jitted.lower(*self._noted(arguments))

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
        self.run, self.compiled, self.known = run, None, set()

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
        arrays, others = _apart(arguments)
        return others, tuple((array.shape, array.dtype) for array in arrays if array is not None)

    def _noted(self, arguments: tuple) -> tuple[list, tuple]:
        self.known.add(self.key(*arguments))
        return _apart(arguments)


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


def outputs(
    model: AbstractModel,
    flat: Float[Array, "case flat"],
    records: Record,
    likelihood: AbstractLikelihood,
) -> Float[Array, "case time output"]:
    """Return the outputs of a model at every sample of every record.

    Args:
        model: structure of the model; its parameters stand in the flat vectors.
        flat: flat vector of the parameters and the initial state, for each record.
        records: a stack.
        likelihood: the likelihood, which simulates.
    """
    nothing = Positions(jnp.zeros(0, int), jnp.zeros(0, int), ())

    def of_case(flat, record):
        declared, initial_state = FreeModel(model, flat, nothing).build(())
        return likelihood.solve(declared, record, initial_state).y

    return jax.vmap(of_case)(flat, records)


def sensitivities(
    model: AbstractModel,
    flat: Float[Array, "case flat"],
    records: Record,
    likelihood: AbstractLikelihood,
    at: Int[Array, " column"],
    leaves: tuple[int, ...],
) -> tuple[Float[Array, "case time output"], Float[Array, "case time output column"]]:
    """Return the outputs of a model, and their derivatives by elements of the flat vectors.

    Args:
        model, flat, records, likelihood: as in `outputs`.
        at: positions of the elements; a position beyond the vector gives a column of zeros.
        leaves: indices of the leaves that hold these elements (`Positions.leaves`).
    """
    positions = Positions(at, jnp.zeros(0, int), leaves)

    def of_case(flat, record):
        family = FreeModel(model, flat, positions)
        values = flat.at[at].get(mode="fill", fill_value=0.0)
        return likelihood.sensitivities(family, values, record)

    return jax.vmap(of_case)(flat, records)


# Shared by all workbenches, so that studies of the same shapes compile once.
PROGRAMS = ModelPrograms(EvictingJit(outputs), EvictingJit(sensitivities))


def use_reduced_model(model: Augmented, samples: int) -> bool:
    """True if each set of effects is fitted faster by a program of its own than by the program of
    the complete library.

    The program of the complete library is compiled once, but evaluates every absent effect in each
    of its passes. Separate programs are faster if

        samples * (operations of the library)
            > COMPILE_COST + COMPILE_COST_PER_OPERATION * (operations of the declared model)

    in operations of the right-hand side; the right side of the inequality is the cost of compiling
    a separate program. This holds for a small model with many candidates and long records, and not
    for an aircraft, whose declared equations are most of the work.

    Args:
        model: the declared model with the complete library.
        samples: number of samples of a record.
    """
    declared = operations(model.model)
    return (
        samples * (operations(model) - declared)
        > COMPILE_COST + COMPILE_COST_PER_OPERATION * declared
    )


def operations(model: AbstractModel) -> int:
    """Return the number of elementary operations in a model's right-hand side.

    Every later program reuses the trace made here.
    """
    t, x, u = jnp.zeros(()), jnp.zeros(len(model.states)), jnp.zeros(len(model.inputs))
    return _count(jax.make_jaxpr(lambda *instant: rate(model, *instant))(t, x, u).jaxpr)


def _count(program) -> int:
    inner = [
        [getattr(value, "jaxpr", value) for value in equation.params.values()]
        for equation in program.eqns
    ]
    called = [[part for part in parts if hasattr(part, "eqns")] for parts in inner]
    return sum(sum(map(_count, parts)) if parts else 1 for parts in called)


@fast_compile_jit
def signals_of(
    problem: Problem, parameters: Parameters
) -> tuple[dict[str, Array], Bool[Array, "case time"]]:
    """Return every signal of the model at every sample, with time and record number, and a mask of
    the samples that are not padding.
    """

    def of_one(own, case, number):
        solution, model = problem.solve_one(own, parameters.shared, case)
        when = {"t": solution.t, RECORD: jnp.full_like(solution.t, number)}
        return when | jax.vmap(model.signals)(solution.t, solution.x, case[1].u)

    signals = jax.vmap(of_one)(
        parameters.rows, problem.cases(), jnp.arange(problem.records.n_cases)
    )
    moving = jnp.diff(problem.records.t, axis=1) > 0
    return signals, jnp.concatenate([jnp.ones((moving.shape[0], 1), bool), moving], axis=1)
