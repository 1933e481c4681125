"""The small programs of a workbench, and how its large ones are compiled together."""

import inspect
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.quickly import OPTIONS, quickly
from .._foundation.types import Array, Bool, Float, Int
from ..diagnosis.scores import sensitivities
from ..diagnosis.validation import predict_stack
from ..estimation.estimate import fit_problem
from ..estimation.problem import Problem
from ..models.augmented import Augmented
from ..models.base import AbstractModel
from ..models.free import Parameters
from ..models.names import flatten
from ..models.starts import RECORD
from ..simulation.steppers import rate

# What a fit costs to compile, in operations that the 24 passes of a refit carry through one sample: 3 s and 10 ms for each
# operation of its model, at 0.3 us an operation and sample (0.15 to 0.6); on two cores, models of 6 to 1,435 operations.
COMPILED, COMPILED_EACH = 400_000, 1400
KEPT_FITS = 48  # as many more come in one round at most, and all of a large model's leave half of the memory maps


class Programs:
    """A function that is compiled for every structure of its arguments, and can let go of what was compiled.

    What `jax.jit` compiled it keeps as long as the function lives. A search compiles one fit for each set of effects, and each
    takes some three hundred of the 65,530 memory maps that Linux grants a process (`vm.max_map_count`): behind two hundred of
    them lies a crash.

    Args:
        function: pure, of arguments whose leaves are arrays, or hashable.
    """

    def __init__(self, function: Callable[..., Any]):
        self.function = function
        self._begin()

    def __call__(self, *arguments: Any) -> Any:
        """What the function gives, compiled where it is not yet."""
        return self.jitted(*self._noted(arguments))

    def lower(self, *arguments: Any) -> Any:
        """The program for such arguments, to be compiled."""
        return self.jitted.lower(*self._noted(arguments))

    def make_room(self, count: int, most: int) -> None:
        """Let go of all programs, where so many more would be too many."""
        if len(self.known) + count > most:
            self._begin()

    def _begin(self) -> None:
        def run(arrays, others):
            rest, structure = others
            both = zip(arrays, rest, strict=True)
            return self.function(*jax.tree.unflatten(structure, [b if a is None else a for a, b in both]))

        run.__name__ = self.function.__name__  # by which JAX calls the program
        self.jitted, self.known = jax.jit(run, static_argnums=1, compiler_options=OPTIONS), set()

    def _noted(self, arguments: tuple) -> tuple[list, tuple]:
        arrays, others = _apart(arguments)
        self.known.add((others, tuple((one.shape, one.dtype) for one in arrays if one is not None)))
        return arrays, others


def _apart(arguments: tuple) -> tuple[list, tuple]:
    """Arrays, with None in the place of what is none; and the rest the other way round, with the structure of both."""
    leaves, structure = jax.tree.flatten(arguments)
    is_array = [eqx.is_array(leaf) for leaf in leaves]
    arrays = [leaf if known else None for leaf, known in zip(leaves, is_array, strict=True)]
    rest = tuple(None if known else leaf for leaf, known in zip(leaves, is_array, strict=True))
    return arrays, (rest, structure)


def compile_together(programs: Sequence[tuple[Programs, tuple]]) -> None:
    """Compile programs side by side, each for its arguments, so that calling them with such does not.

    XLA compiles one program on little more than one core, and outside of Python's lock. Programs that run beside each other could
    lock up on few cores; these only come into being.

    Args:
        programs: with what they are going to be called with.
    """
    with ThreadPoolExecutor() as beside:
        for done in [beside.submit(program.lower(*arguments).compile) for program, arguments in programs]:
            done.result()


# One for all workbenches: studies of the same shapes compile once.
FITS = Programs(inspect.unwrap(fit_problem))
PASSES = Programs(inspect.unwrap(sensitivities))
PREDICTIONS = Programs(inspect.unwrap(predict_stack))


def pays_to_compile(model: Augmented, samples: int) -> bool:
    """Whether every set of effects is better fitted by a program of its own than by one for the whole library.

    One program for all is compiled once, and carries every effect that is absent through each of its passes:

        samples * (operations of the library)  >  COMPILED + COMPILED_EACH * (operations of the declared model)

    in operations of the right-hand side; the right side is what a program of its own costs to compile. It pays for a small model
    with many candidates and long records, and not for an aircraft, whose own equations are most of the work.

    Args:
        model: the declared model with the whole library.
        samples: of a record.
    """
    declared = operations(model.model)
    return samples * (operations(model) - declared) > COMPILED + COMPILED_EACH * declared


def operations(model: AbstractModel) -> int:
    """Number of elementary operations in a model's right-hand side; its trace is the one that every program then takes."""
    t, x, u = jnp.zeros(()), jnp.zeros(len(model.states)), jnp.zeros(len(model.inputs))
    return _count(jax.make_jaxpr(lambda *instant: rate(model, *instant))(t, x, u).jaxpr)


def _count(program) -> int:
    inner = [[getattr(one, "jaxpr", one) for one in equation.params.values()] for equation in program.eqns]
    called = [[one for one in parts if hasattr(one, "eqns")] for parts in inner]
    return sum(sum(map(_count, parts)) if parts else 1 for parts in called)


@eqx.filter_jit
def placed(model: Augmented, at: Int[Array, " column"], values: Float[Array, " column"]) -> Augmented:
    """A model with values at positions of its flat vector; compiled, as it is asked for before each program runs."""
    vector, unflatten = flatten(model)
    return unflatten(vector.at[at].set(values))


@quickly
def signals_of(problem: Problem, parameters: Parameters) -> tuple[dict[str, Array], Bool[Array, "case time"]]:
    """Every signal of the model at every sample, time and number of the record with them, and which samples are real time."""

    def of_one(own, case, number):
        solution, model = problem.solve_one(own, parameters.shared, case)
        when = {"t": solution.t, RECORD: jnp.full_like(solution.t, number)}
        return when | jax.vmap(model.signals)(solution.t, solution.x, case[1].u)

    signals = jax.vmap(of_one)(parameters.rows, problem.cases(), jnp.arange(problem.records.n_cases))
    moving = jnp.diff(problem.records.t, axis=1) > 0
    return signals, jnp.concatenate([jnp.ones((moving.shape[0], 1), bool), moving], axis=1)
