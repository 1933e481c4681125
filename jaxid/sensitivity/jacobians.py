"""Jacobians of a function at many points, forward for few columns and reverse for many.

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

# Columns per equation from which reverse mode is used. Measured: half as fast as forward mode at
# three columns per equation where each parameter is an element taken from a vector, equal there
# where parameters are multiplied as a vector, 1.3 times as fast at three with 60 effects.
REVERSE_FROM = 6
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
        reverse: True for reverse mode.
    """

    function: Function
    family: FreeModel
    sizes: tuple[int, int, int]
    subset: tuple[int, ...]
    by_input: bool
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
        many = family.n_columns > REVERSE_FROM * rows and elements < WASTE * family.n_columns
        return cls(function, family, (rows, x.size, u.size), subset, by_input, many)

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
                by_leaves = jax.linearize(lambda own: of(t, x, u, own), own)[1]
            return value, (by_state, by_input, by_leaves)

        value, linear = jax.vmap(backward if self.reverse else forward)(t, x, u)
        return value, (linear, t)

    def apply(self, linear) -> Jacobians:
        """Return the Jacobians from the linearisations at many points."""
        rows, states, inputs = self.sizes
        linear, t = linear
        if self.reverse:
            pull = jax.vmap(lambda row: jax.vmap(lambda back, _: back(row))(linear, t), out_axes=1)
            A, *B_u, own = pull(jnp.eye(rows))
            B_u = B_u[0] if B_u else None
            B = self.family.select(flattened(own, 2), self.subset) if own else None
        else:
            by_state, by_input, by_leaves = linear
            tangents = self.family.tangents(self.subset)
            A = _push(by_state, t, jnp.eye(states))
            B_u = None if by_input is None else _push(by_input, t, jnp.eye(inputs))
            B = None if by_leaves is None else _push(by_leaves, t, tangents)
        if B is None:
            B = jnp.zeros((*A.shape[:2], self.family.n_columns))
        return Jacobians(A, B_u, B)

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


def _push(linear, t, directions) -> Float[Array, "point row direction"]:
    """Return the images of directions under linear functions, one function per point.

    Points are the last axis of all operations, which is long and contiguous.
    """

    def image(direction):
        return jax.vmap(lambda function, _: function(direction), out_axes=-1)(linear, t)

    return jnp.moveaxis(jax.vmap(image, out_axes=1)(directions), -1, 0)
