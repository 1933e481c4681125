"""Jacobians of a function at many points: forward for few columns, reverse for many, and between
forward by state and input and reverse by the parameters.

The linearisation at the points and its application are separate loops: in one loop XLA would
evaluate the sines and roots of the function again in each operation that uses them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from .._foundation.dependence import depends_on
from .._foundation.types import Array, Float
from ..models.free_model import FreeModel, Leaves, flattened, unit_elements

# Columns per equation above which reverse mode is used, by the parameters alone and by all
# arguments. By the parameters alone, measured with 30 parameters in nine equations: 1.3 times as
# fast for the package's model of an aircraft, 1.1 times where a user's model multiplies its
# parameters as vectors, 0.9 times where it takes them from vectors one by one. Reverse mode by all
# arguments compiles less: with 257 effects 67 s less.
REVERSE_LEAVES_FROM, REVERSE_FROM = 3, 6
# Elements per column in the leaves beyond which reverse mode computes too much for nothing: a
# table with one free element (chosen).
WASTE = 4

Function = Callable[[Array, Array, Array, Leaves], Float[Array, " row"]]


class Jacobians(NamedTuple):
    """Derivatives of a function by the state, the input and the free parameters.

    Attributes:
        A: by the state.
        B_u: by the input; None if no free parameter acts on the input.
        B: by the free parameters, at fixed state and input.
    """

    A: Float[Array, "*point row state"]
    B_u: Float[Array, "*point row input"] | None
    B: Float[Array, "*point row column"]


class Differentiation(NamedTuple):
    """The function `f(t, x, u, leaves)`, and how it is differentiated.

    Attributes:
        function: the function.
        family: the model as a function of its free parameters.
        sizes: number of values of the function, of states and of inputs.
        subset: indices of the leaves on which the function depends.
        by_input: True if the derivative by the input is needed.
        reverse_leaves: True for reverse mode by the leaves.
        reverse: True for reverse mode by all arguments.
    """

    function: Function
    family: FreeModel
    sizes: tuple[int, int, int]
    subset: tuple[int, ...]
    by_input: bool
    reverse_leaves: bool
    reverse: bool

    @classmethod
    def of(
        cls, family: FreeModel, function: Function, at, leaves: Leaves, by_input: bool
    ) -> "Differentiation":
        """Return the faster differentiation of a function.

        Args:
            family: the model as a function of its free parameters.
            function: the function.
            at: time, state and input of any point.
            leaves: the leaves that hold free parameters.
            by_input: True if the derivative by the input is needed.
        """
        t, x, u = at
        used = depends_on(lambda *leaves: function(t, x, u, leaves), leaves)
        subset = tuple(index for index, is_used in enumerate(used) if is_used)
        rows = jax.eval_shape(function, t, x, u, leaves).size
        elements = sum(leaves[index].size for index in subset)
        narrow = elements < WASTE * family.n_columns
        by_leaves, by_all = (
            narrow and family.n_columns > least * rows
            for least in (REVERSE_LEAVES_FROM, REVERSE_FROM)
        )
        return cls(function, family, (rows, x.size, u.size), subset, by_input, by_leaves, by_all)

    def linearise(self, leaves: Leaves, t, x, u):
        """Return the values of the function at many points, and its linearisations there.

        The linearisation of a linear function holds no array, so the times of the points are added.
        """
        of, own = self._of_own(leaves)

        def backward(t, x, u):
            if self.by_input:
                return jax.vjp(lambda x, u, own: of(t, x, u, own), x, u, own)
            return jax.vjp(lambda x, own: of(t, x, u, own), x, own)

        def forward(t, x, u):
            value, by_state = jax.linearize(lambda x: of(t, x, u, own), x)
            by_input = by_leaves = None
            if self.by_input:
                by_input = jax.linearize(lambda u: of(t, x, u, own), u)[1]
            if own:
                linearised = jax.vjp if self.reverse_leaves else jax.linearize
                by_leaves = linearised(lambda own: of(t, x, u, own), own)[1]
            return value, (by_state, by_input, by_leaves)

        value, linear = jax.vmap(backward if self.reverse else forward)(t, x, u)
        return value, (linear, t)

    def apply(self, linear) -> Jacobians:
        """Return the Jacobians from the linearisations at many points."""
        rows, states, inputs = self.sizes
        linear, t = linear
        if self.reverse:
            A, *B_u, own = _pull(linear, t, rows)
            return Jacobians(A, B_u[0] if B_u else None, self._selected(own, A))
        by_state, by_input, by_leaves = linear
        A = _push(by_state, t, jnp.eye(states))
        B_u = None if by_input is None else _push(by_input, t, jnp.eye(inputs))
        if by_leaves is None or self.reverse_leaves:
            (own,) = _pull(by_leaves, t, rows) if self.subset else ((),)
            return Jacobians(A, B_u, self._selected(own, A))
        return Jacobians(A, B_u, _push(by_leaves, t, self.family.tangents(self.subset)))

    def apply_by_stage(self, linear) -> Jacobians:
        """Return the Jacobians from the linearisations at many points of a few stages.

        Few columns are computed for all stages at once, many for one stage at a time, whose
        derivatives by all elements then stay in the processor's cache.
        """
        if self.reverse:
            return jax.lax.map(self.apply, linear)
        stages, count = linear[1].shape
        merged = jax.tree.map(lambda leaf: leaf.reshape(stages * count, *leaf.shape[2:]), linear)
        return jax.tree.map(
            lambda leaf: leaf.reshape(stages, count, *leaf.shape[1:]), self.apply(merged)
        )

    def _selected(self, own: Leaves, A) -> Float[Array, "point row column"]:
        """Return the derivatives by the free parameters from those by leaves, zero without any."""
        if not own:
            return jnp.zeros((*A.shape[:2], self.family.n_columns))
        return self.family.select(flattened(own, 2), self.subset)

    def derivatives_of_forms(self, leaves: Leaves, points, rows, directions) -> Jacobians:
        """Return the derivatives of the forms `r' (df/dx) d` at many points, in reverse mode.

        Args:
            leaves: the leaves that hold free parameters.
            points: times, states and inputs, the points first.
            rows: vectors `r`, shape (form row, point, row).
            directions: vectors `d`, shape (form column, point, state).

        Returns:
            Derivatives by state, input and `elements`, with the axes (form row, form column,
            point) first. `columns` turns elements into free parameters.
        """
        t, x, u = points
        of, own = self._of_elements(leaves)
        copies = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (t.size, *leaf.shape)), own)

        def row(r):
            def gradient(x):
                pull = jax.vjp(lambda *point: jax.vmap(of)(t, *point), x, u, copies)[1]
                return pull(r)

            return jax.vmap(jax.linearize(gradient, x)[1])(directions)

        by_state, by_input, by_own = jax.lax.map(row, rows)
        elements = flattened(by_own, 3) if own else jnp.zeros((*by_state.shape[:3], 0))
        return Jacobians(by_state, by_input if self.by_input else None, elements)

    def columns(self, elements: Float[Array, "*axes element"], leaves: Leaves):
        """Return derivatives by the free parameters from those of `derivatives_of_forms`."""
        if not self.subset:
            return jnp.zeros((*elements.shape[:-1], self.family.n_columns))
        if self._wasteful(leaves):
            return elements
        return self.family.select(elements, self.subset)

    def _wasteful(self, leaves: Leaves) -> bool:
        """True if most elements of the leaves are not free."""
        return sum(leaves[index].size for index in self.subset) >= WASTE * self.family.n_columns

    def _of_own(self, leaves: Leaves):
        """Return the function with the leaves on which it depends as its last argument, and these
        leaves.
        """

        def of(t, x, u, own):
            complete = list(leaves)
            for index, leaf in zip(self.subset, own, strict=True):
                complete[index] = leaf
            return self.function(t, x, u, tuple(complete))

        return of, tuple(leaves[index] for index in self.subset)

    def _of_elements(self, leaves: Leaves):
        """Return the function with the elements of `derivatives_of_forms` as its last argument, and
        their values: its leaves, or the changes of the free parameters if most elements of the
        leaves are not free.
        """
        of, own = self._of_own(leaves)
        if not self._wasteful(leaves):
            return of, own
        tangents = self.family.tangents(self.subset)

        def of_changes(t, x, u, changes):
            moved = [
                leaf + jnp.tensordot(changes[0], tangent, 1)
                for leaf, tangent in zip(own, tangents, strict=True)
            ]
            return of(t, x, u, tuple(moved))

        return of_changes, (jnp.zeros(self.family.n_columns),)


def by_elements(function: Callable[..., Any], leaves: Leaves, acting: tuple[int, ...]):
    """Return the value of a function of all leaves, and its derivatives by the elements of some.

    Args:
        function: a function of the leaves, which returns a tree of arrays.
        leaves: all leaves that hold free parameters.
        acting: indices of the leaves by which it is differentiated.

    Returns:
        The value, and the derivatives, whose last axis has one entry per element.
    """

    def of_acting(*own):
        given = dict(zip(acting, own, strict=True))
        return function(*(given.get(index, leaf) for index, leaf in enumerate(leaves)))

    own = tuple(leaves[index] for index in acting)
    if not own:
        value = function(*leaves)
        return value, jax.tree.map(lambda leaf: jnp.zeros((*leaf.shape, 0)), value)
    push = jax.vmap(lambda direction: jax.jvp(of_acting, own, direction), out_axes=(None, -1))
    return push(unit_elements(own))


def _pull(linear, t, rows: int):
    """Return the derivatives of all rows of transposed linear functions, one function per point,
    with the axes (point, row) first.
    """

    def of_row(row):
        return jax.vmap(lambda back, _: back(row))(linear, t)

    return jax.vmap(of_row, out_axes=1)(jnp.eye(rows))


def _push(linear, t, directions) -> Float[Array, "point row direction"]:
    """Return the images of directions under linear functions, one function per point.

    Points are the last axis of all operations, which is long and contiguous.
    """

    def image(direction):
        return jax.vmap(lambda function, _: function(direction), out_axes=-1)(linear, t)

    return jnp.moveaxis(jax.vmap(image, out_axes=1)(directions), -1, 0)
