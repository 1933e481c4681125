"""The compiled programs of a batch: cases enter slots, advance by a few steps, and leave.

Slots are processed in groups of `width` cases, each by one `vmap`. A program computes only the
groups that hold active cases, and a group stops when all of its cases have ended.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh, PartitionSpec

from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Bool, Float, Int
from ..estimation.estimate import fit_of
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.result import Estimate
from ..estimation.solver import GaussNewton, first_state, one_step, strong
from ..models.free import Parameters, initial_parameters
from .cases import CaseArrays

STRUCTURES = 256  # chosen: number of shapes that are cached


class Settings(eqx.Module):
    """What all cases of a batch share.

    Attributes:
        likelihood: the likelihood.
        solver: options of the iteration.
        width: number of cases in a group.
        steps: largest number of steps in one call of `advance`.
    """

    likelihood: AbstractLikelihood
    solver: GaussNewton
    width: int = eqx.field(static=True)
    steps: int = eqx.field(static=True)


class Iterate(eqx.Module):
    """The iteration of one case, or of many with a leading axis.

    Attributes:
        parameters: the best parameters.
        state: state of the solver.
        count: number of steps.
        done: True when the iteration has ended.
    """

    parameters: Parameters
    state: Any
    count: Int[Array, "*slot"]
    done: Bool[Array, "*slot"]


class Slots(NamedTuple):
    """Cases under way.

    Attributes:
        arrays: model, free parameters and records of each slot.
        iterate: iteration of each slot.
    """

    arrays: CaseArrays
    iterate: Iterate


class CaseResult(NamedTuple):
    """The numbers of an `Estimate` that a batch keeps, with a leading axis for many cases.

    Attributes:
        factor, scale: triangle `[T r]` of the information and the scales of its columns, from which
            weak directions are described.
        result: code of the status.
        others: as in `Estimate`.
    """

    start: Float[Array, "*slot parameter"]
    values: Float[Array, "*slot parameter"]
    standard_errors: Float[Array, "*slot parameter"]
    corrected_errors: Float[Array, "*slot parameter"]
    corrected_dof: Float[Array, "*slot parameter"]
    covariance: Float[Array, "*slot parameter parameter"]
    on_bound: Bool[Array, "*slot parameter"]
    own: Float[Array, "*slot case own"]
    own_errors: Float[Array, "*slot case own"]
    noise: Float[Array, "*slot output output"]
    cost: Float[Array, "*slot"]
    degrees_of_freedom: Float[Array, "*slot"]
    iterations: Int[Array, "*slot"]
    result: Int[Array, "*slot"]
    factor: Float[Array, "*slot row column"]
    scale: Float[Array, "*slot parameter"]


@fast_compile_jit
def enter(
    slots: Slots,
    arrays: CaseArrays,
    is_new: Bool[Array, " slot"],
    settings: Settings,
    mesh: Mesh | None,
) -> Slots:
    """Return the slots with new cases in some of them.

    Args:
        slots: the slots.
        arrays: arrays of the new cases, each at its slot; those of other slots are not used.
        is_new: True for the slots of new cases.
        settings: likelihood and options.
        mesh: devices over which the slots are distributed; None for one device.
    """
    return _on_devices(_enter, mesh)(slots, arrays, is_new, settings)


@fast_compile_jit
def advance(
    slots: Slots,
    order: Int[Array, " slot"],
    active: Int[Array, " device"],
    settings: Settings,
    mesh: Mesh | None,
) -> Slots:
    """Return the slots in another order, the first ones advanced by up to `settings.steps`.

    Args:
        slots: the slots.
        order: the slots of each device in their new order, active ones first.
        active: number of active slots of each device.
        settings, mesh: as for `enter`.
    """
    return _on_devices(_advance, mesh)(slots, order, active, settings)


@fast_compile_jit
def finish(
    slots: Slots,
    order: Int[Array, " slot"],
    count: Int[Array, " device"],
    settings: Settings,
    mesh: Mesh | None,
) -> CaseResult:
    """Return the results of the first slots of an order; later ones hold no result.

    Args:
        slots: the slots.
        order: the slots of each device in an order, those whose iteration has ended first.
        count: number of slots of each device whose iteration has ended.
        settings, mesh: as for `enter`.
    """
    return _on_devices(_finish, mesh)(slots, order, count, settings)


def slot_shapes(arrays: CaseArrays, settings: Settings) -> Slots:
    """Return the shapes of the slots for cases of these shapes; each is evaluated once."""
    leaves, structure = jax.tree.flatten((arrays, settings))
    return _slot_shapes(structure, tuple(map(_described, leaves)))


def _described(leaf):
    """Return the shape and dtype of an array, and any other leaf unchanged."""
    return jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) if hasattr(leaf, "shape") else leaf


@functools.lru_cache(maxsize=STRUCTURES)
def _slot_shapes(structure, described) -> Slots:
    """Return the shapes of the slots for a tree structure and its leaves, arrays as shapes."""

    def slots(arrays: CaseArrays, settings: Settings) -> Slots:
        return Slots(arrays, jax.vmap(lambda one: _first(one, settings))(arrays))

    return eqx.filter_eval_shape(slots, *jax.tree.unflatten(structure, described))


def _on_devices(function: Callable, mesh: Mesh | None) -> Callable:
    """Return a function that each device applies to its own slots.

    The devices exchange nothing, so that none waits for another within a call.

    Args:
        function: of three trees of arrays with the slots, or the devices, first, and of settings.
        mesh: the devices; None for one device.
    """
    if mesh is None:
        return function
    split = PartitionSpec(mesh.axis_names)

    def distributed(slots, second, third, settings: Settings):
        arrays, static = eqx.partition(settings, eqx.is_array)

        def local(arrays, *own):
            return function(*own, eqx.combine(arrays, static))

        specs = (PartitionSpec(), split, split, split)
        mapped = jax.shard_map(local, mesh=mesh, in_specs=specs, out_specs=split, check_vma=False)
        return mapped(arrays, slots, second, third)

    return distributed


def _enter(slots: Slots, arrays: CaseArrays, is_new, settings: Settings) -> Slots:
    iterate = jax.vmap(lambda one: _first(one, settings))(arrays)

    def choose(new, old):
        return jnp.where(is_new.reshape(-1, *([1] * (new.ndim - 1))), new, old)

    return jax.tree.map(choose, Slots(arrays, iterate), slots)


def _advance(slots: Slots, order, active, settings: Settings) -> Slots:
    slots = _ordered(slots, order)

    def stepped(arrays: CaseArrays, iterate: Iterate) -> Iterate:
        return _step(arrays, iterate, settings)

    def group(number, iterate):
        def step(carry):
            index, part = carry
            return index + 1, jax.vmap(stepped)(arrays, part)

        def goes_on(carry):
            index, part = carry
            return (index < settings.steps) & ~jnp.all(part.done)

        arrays, part = _group((slots.arrays, iterate), number, settings.width)
        _, part = jax.lax.while_loop(goes_on, step, (0, part))
        return _with_group(iterate, part, number, settings.width)

    groups = -(-active[0] // settings.width)
    return Slots(slots.arrays, jax.lax.fori_loop(0, groups, group, slots.iterate))


def _finish(slots: Slots, order, count, settings: Settings) -> CaseResult:
    slots = _ordered(slots, order)

    def results(slots: Slots) -> CaseResult:
        def one(arrays: CaseArrays, iterate: Iterate) -> CaseResult:
            return _result(arrays, iterate, settings)

        return strong(jax.vmap(one)(*slots))

    def group(number, results_so_far):
        part = results(_group(slots, number, settings.width))
        return _with_group(results_so_far, part, number, settings.width)

    shapes = jax.eval_shape(results, slots)
    zeros = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    return jax.lax.fori_loop(0, -(-count[0] // settings.width), group, zeros)


def _problem(arrays: CaseArrays, settings: Settings) -> Problem:
    """Return the problem of one case."""
    return Problem.of(arrays.model, arrays.free, arrays.records, settings.likelihood)


def _first(arrays: CaseArrays, settings: Settings) -> Iterate:
    """Return the iteration of one case before its first step."""
    problem = _problem(arrays, settings)
    begin = initial_parameters(problem.model, problem.positions, problem.records)
    state = first_state(problem, begin, settings.solver)
    return strong(Iterate(begin, state, jnp.array(0), jnp.array(False)))


def _step(arrays: CaseArrays, iterate: Iterate, settings: Settings) -> Iterate:
    """Return the iteration of one case after one step; one that has ended is unchanged."""
    step = one_step(_problem(arrays, settings), iterate.parameters, settings.solver, iterate.state)
    count = iterate.count + 1
    done = step.done | (count >= settings.solver.max_steps)
    new = Iterate(step.parameters, step.state, count, done)
    return jax.tree.map(lambda old, new: jnp.where(iterate.done, old, new), iterate, new)


def _result(arrays: CaseArrays, iterate: Iterate, settings: Settings) -> CaseResult:
    """Return the result of one case."""
    problem, solver = _problem(arrays, settings), settings.solver
    fit = fit_of(problem, iterate.parameters, iterate.state, solver)
    is_known = settings.likelihood.knows_noise(arrays.free)
    estimate = Estimate.of(
        fit, problem.model, arrays.free, problem.records, solver.policy.threshold, is_known
    )
    kept = {
        name: getattr(estimate, name)
        for name in CaseResult._fields
        if name not in ("result", "factor", "scale")
    }
    (code,) = jax.tree.leaves(estimate.result)
    information, scale = estimate.information.factor, estimate.spectrum.scale
    return CaseResult(**kept, result=code, factor=information, scale=scale)


def _ordered(slots: Slots, order: Int[Array, " slot"]) -> Slots:
    """Return slots in another order."""
    return jax.tree.map(lambda leaf: leaf[order], slots)


def _group(tree, number, width: int):
    """Return one group of slots."""
    return jax.tree.map(
        lambda leaf: jax.lax.dynamic_slice_in_dim(leaf, number * width, width), tree
    )


def _with_group(tree, part, number, width: int):
    """Return slots with one group replaced."""
    return jax.tree.map(
        lambda leaf, new: jax.lax.dynamic_update_slice_in_dim(leaf, new, number * width, 0),
        tree,
        part,
    )
