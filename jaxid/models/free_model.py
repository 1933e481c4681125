"""`FreeModel`: model and initial state of one record as functions of the free parameters."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from .._foundation.host import on_host
from .._foundation.types import Array, Float, Int
from .base import AbstractModel
from .free import Positions
from .names import array_leaves, with_array_leaves

Leaves = tuple[Array, ...]


class FreeModel(eqx.Module):
    """A model and the initial state of one record as functions of the free parameters.

    The vector `theta` of free parameters, those of this record first, fills elements of some leaves
    of the model (`Positions.leaves`). A derivative needs these leaves only.

    Attributes:
        model: the model with the values that are not free.
        flat: flat vector of the model's parameters and the initial state of this record.
        positions: positions of the free parameters in it.
    """

    model: AbstractModel
    flat: Float[Array, " flat"]
    positions: Positions

    def leaves(self, theta: Float[Array, " column"]) -> Leaves:
        """Return the leaves that hold free parameters, with the given values."""
        per_record = self.positions.rows.size
        return self.fill(theta[:per_record], theta[per_record:])

    def fill(self, rows: Float[Array, " row_parameter"], shared: Float[Array, " p"]) -> Leaves:
        """Return the leaves that hold free parameters, with the values of this record and the
        shared ones.
        """
        positions = (self.positions.rows, self.positions.shared)
        chosen = self.positions.leaves
        return _filled_leaves(
            self.flat, positions, (rows, shared), shapes=self._shapes, chosen=chosen
        )

    def build(self, leaves: Leaves) -> tuple[AbstractModel, Float[Array, " state"]]:
        """Return the model and the initial state with the given leaves."""
        shapes, given = self._shapes, self.positions.leaves
        fixed = tuple(number for number in range(len(shapes)) if number not in given)
        constants = _filled_leaves(self.flat, (), (), shapes=shapes, chosen=fixed)
        values = dict(zip((*given, *fixed), (*leaves, *constants), strict=True))
        complete = [values[number] for number in range(len(shapes))]
        return with_array_leaves(self.model, complete[:-1]), complete[-1]

    def __call__(self, theta: Float[Array, " column"]):
        """Return the model and the initial state for a vector of free parameters."""
        return self.build(self.leaves(theta))

    def tangents(self, subset: Sequence[int]) -> Leaves:
        """Return the derivatives of some of the leaves by the free parameters.

        Args:
            subset: indices into `leaves`.

        Returns:
            One array per leaf, shape (column, *leaf), of zeros and ones.
        """
        element = self.elements(subset)
        sizes = [self._sizes[self.positions.leaves[index]] for index in subset]
        begin = np.cumsum([0, *sizes])
        return tuple(
            (element[:, None] == first + jnp.arange(size)[None])
            .astype(float)
            .reshape(element.size, *self._shapes[self.positions.leaves[index]])
            for index, size, first in zip(subset, sizes, begin[:-1], strict=True)
        )

    def elements(self, subset: Sequence[int]) -> Int[Array, " column"]:
        """Return the index of each free parameter among the elements of some of the leaves.

        The index of a parameter that is in none of them is the number of elements.
        """
        offsets, sizes = self._offsets, self._sizes
        count = sum(sizes[self.positions.leaves[index]] for index in subset)
        lookup, begin = np.full(offsets[-1] + 1, count), 0
        for index in subset:
            leaf = self.positions.leaves[index]
            lookup[offsets[leaf] : offsets[leaf + 1]] = begin + np.arange(sizes[leaf])
            begin += sizes[leaf]
        at = jnp.concatenate([self.positions.rows, self.positions.shared])
        return jnp.asarray(lookup)[jnp.minimum(at, offsets[-1])]

    def select(
        self, jacobian: Float[Array, "*axes element"], subset: Sequence[int]
    ) -> Float[Array, "*axes column"]:
        """Return the columns of the free parameters from derivatives by the elements of leaves."""
        return jnp.take(jacobian, self.elements(subset), axis=-1, mode="fill", fill_value=0.0)

    @property
    def n_columns(self) -> int:
        """Number of free parameters."""
        return self.positions.rows.size + self.positions.shared.size

    @property
    def _shapes(self) -> tuple[tuple[int, ...], ...]:
        return (*(leaf.shape for leaf in array_leaves(self.model)), (len(self.model.states),))

    @property
    def _sizes(self) -> list[int]:
        return [int(np.prod(shape)) for shape in self._shapes]

    @property
    def _offsets(self) -> list[int]:
        return [0, *np.cumsum(self._sizes).tolist()]


def insert(
    model: AbstractModel,
    flat: Float[Array, " flat"],
    positions: Positions,
    shared: Float[Array, " p"],
    rows: Float[Array, " r"],
) -> tuple[AbstractModel, Float[Array, " state"]]:
    """Return the model and the initial state of a record's flat vector, with the given values at
    the positions of the free parameters.
    """
    free_model = FreeModel(model, flat, positions)
    return free_model.build(free_model.fill(rows, shared))


@on_host
def _filled_leaves(xp, flat, positions, values, shapes: tuple[tuple[int, ...], ...], chosen):
    """Return some leaves of a flat vector after values have been inserted in it.

    Args:
        xp: NumPy or `jax.numpy`.
        flat: the flat vector.
        positions: positions of the values; those beyond the vector are ignored.
        values: for each vector of positions, its values.
        shapes: shapes of all leaves, in the order of the vector.
        chosen: indices of the leaves to return.
    """
    filled = flat.copy() if xp is np else flat
    for at, new in zip(positions, values, strict=True):
        if xp is np:
            inside = at < flat.size
            filled[at[inside]] = new[inside]
        else:
            filled = jnp.asarray(filled).at[at].set(new, mode="drop")
    offsets = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])
    return tuple(filled[offsets[leaf] : offsets[leaf + 1]].reshape(shapes[leaf]) for leaf in chosen)


def flattened(arrays: Leaves, axes: int) -> Float[Array, "*axes element"]:
    """Return arrays with some leading axes in common as one array, their other axes flattened."""
    return jnp.concatenate([leaf.reshape(*leaf.shape[:axes], -1) for leaf in arrays], axis=-1)


def unit_elements(leaves: Leaves) -> Leaves:
    """Return the unit directions of all elements of some leaves, shape (element, *leaf) each."""
    vector, unravel = ravel_pytree(leaves)
    return jax.vmap(unravel)(jnp.eye(vector.size))
