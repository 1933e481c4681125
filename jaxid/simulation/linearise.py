"""`linearise`: the linear model tangent to a nonlinear one at a point."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.host import on_host
from .._foundation.types import Array, Float, Numbers
from ..models.base import AbstractModel, canonical
from ..models.equation_shapes import check_equations
from ..models.linear import LinearModel


class Linearisation(eqx.Module):
    """Matrices of a linear model, with the names of their rows and columns.

        d(dx)/dt = A dx + B du,    dy = C dx + D du

    Under `vmap` the matrices have a leading axis; the names are shared.

    Attributes:
        A, B, C, D: derivatives of the state's rate and of the output, in the units of the model's
            channels.
        states, inputs, outputs: the names of the channels, in order.
    """

    A: Float[Array, "*case state state"]
    B: Float[Array, "*case state input"]
    C: Float[Array, "*case output state"]
    D: Float[Array, "*case output input"]
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    def reduced(
        self,
        *,
        states: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
    ) -> "Linearisation":
        """Return the subsystem of some channels, in the given order.

        The other states are held at the point.

        Args:
            states, inputs, outputs: names to keep; all by default.

        Returns:
            The matrices with the rows and columns of these names.

        Raises:
            InputError: for a name that does not exist, with the list of names.
        """
        selected, at = [], []
        for kind, chosen, available in (
            ("state", states, self.states),
            ("input", inputs, self.inputs),
            ("output", outputs, self.outputs),
        ):
            names = available if chosen is None else tuple(chosen)
            require_known(f"{kind} of the linearisation", names, available)
            selected.append(names)
            at.append(np.array([available.index(name) for name in names], int))
        x, u, y = at
        A, B = _block(self.A, rows=x, columns=x), _block(self.B, rows=x, columns=u)
        C, D = _block(self.C, rows=y, columns=x), _block(self.D, rows=y, columns=u)
        return Linearisation(A, B, C, D, *selected)

    def as_model(self) -> LinearModel:
        """Return the `LinearModel` of deviations from the point; for one case only."""
        channels = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        return LinearModel(self.A, self.B, self.C, self.D, **channels)

    def __str__(self) -> str:
        if self.A.ndim > 2:
            return f"Linearisation at {self.A.shape[0]} points: {', '.join(self.states)}"
        rows = [
            *_table("A", self.A, [f"d({name})/dt" for name in self.states], self.states),
            *_table("B", self.B, [f"d({name})/dt" for name in self.states], self.inputs),
            *_table("C", self.C, self.outputs, self.states),
            *_table("D", self.D, self.outputs, self.inputs),
        ]
        return "\n".join(rows)


def linearise(
    model: AbstractModel,
    t: Float[Numbers, ""] | float,
    x: Float[Numbers, " state"],
    u: Float[Numbers, " input"],
) -> Linearisation:
    """Return the linearisation of a model at a point, exact to rounding.

        A = d rhs/dx,   B = d rhs/du,   C = d output/dx,   D = d output/du     at (t, x, u)

    Pure: works under `jit`, `vmap` and `jacfwd`. The point need not be an equilibrium. At a kink of
    the equations (a limit, a knot of a linear table) the derivative is the one-sided one.

    Args:
        model: any model.
        t: time [s].
        x: state at the point [the units of the states].
        u: input at the point [the units of the inputs].

    Returns:
        Matrices and names.

    Raises:
        InputError: when a shape does not fit the model's channels, or `rhs` or `output` does
            not return one number for each of its channels.
    """
    model = canonical(model)
    t, x, u = jnp.asarray(t, float), jnp.asarray(x, float), jnp.asarray(u, float)
    for name, array, channels in (("x", x, model.states), ("u", u, model.inputs)):
        require(
            array.shape == (len(channels),),
            f"{name} has shape {array.shape}, but the model has {len(channels)} channels there: "
            f"{', '.join(channels)}.",
        )
    check_equations(model)
    (A, B), (C, D) = _derivatives(model, t, x, u)
    return Linearisation(A, B, C, D, model.states, model.inputs, model.outputs)


@eqx.filter_jit
def _derivatives(model: AbstractModel, t: Array, x: Array, u: Array):
    """Return the derivatives of the state's rate and of the output by state and input.

    They are compiled, since a model consists of many operations.
    """

    def both(x, u):
        return model.rhs(t, x, u), model.output(t, x, u)

    return jax.jacfwd(both, argnums=(0, 1))(x, u)


@on_host
def _block(xp, matrix, rows, columns):
    """Return some rows and columns of a matrix."""
    return matrix[..., rows[:, None], columns[None]]


def _table(title: str, matrix: Array, rows: Sequence[str], columns: Sequence[str]) -> list[str]:
    if not rows or not columns:
        return []
    left = max(len(name) for name in (title, *rows))
    width = max(11, *(len(name) + 1 for name in columns))
    lines = [f"{title:<{left}}" + "".join(f"{name:>{width}}" for name in columns)]
    for name, values in zip(rows, np.asarray(matrix), strict=True):
        lines.append(f"{name:<{left}}" + "".join(f"{value:>{width}.4g}" for value in values))
    return lines
