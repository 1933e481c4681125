"""Response of the outputs to free-form disturbances (linear B-splines in time).

A disturbance acts in an equation, an input, an output, a parameter or the air. The response follows
from the linear model along a trajectory,

    dx_(i+1) = Phi_i dx_i + P_i d_i + Q_i d_(i+1),    dy_i = C_i dx_i + D_i d_i

so that every place costs a linear recursion and no simulation. P and Q are the effect over one step
of a disturbance that is linear in time, from `d_i` at the start of the step to `d_(i+1)` at its
end. `linear_models` is the only program here that holds the model; what uses its arrays is compiled
once for each shape.
"""
# Pyright counts the arguments of functions that equinox and jaxtyping wrap in its own way; the
# tests execute them.
# pyright: reportCallIssue=false

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.compiler import fast_compile_jit
from .._foundation.evicting_jit import EvictingJit
from .._foundation.host import to_device
from .._foundation.location import LocationKind
from .._foundation.types import Array, Float
from ..estimation.likelihoods import OutputError
from ..estimation.problem import Problem
from ..models.base import AbstractModel
from ..models.free import Parameters
from ..models.free_model import insert
from ..sensitivity.disturbances import disturbed_motion

# names by kind, hashable, so that programs can be compiled for them
Places = tuple[tuple[LocationKind, tuple[str, ...]], ...]


class Linear(NamedTuple):
    """Linear model along the trajectory of one record, or of each of some records.

    Attributes:
        x, y: the trajectory.
        Phi, C: transition and output matrices.
        P, Q, D: matrices of the disturbances.
    """

    x: Float[Array, "*case time state"]
    y: Float[Array, "*case time output"]
    Phi: Float[Array, "*case step state state"]
    P: Float[Array, "*case step state place"]
    Q: Float[Array, "*case step state place"]
    C: Float[Array, "*case time output state"]
    D: Float[Array, "*case time output place"]

    def at(self, places: Places, chosen: Places) -> "Linear":
        """Return the linear model with disturbances at some of its places.

        Args:
            places: its places.
            chosen: those to keep, in their new order.
        """
        known = [(kind, name) for kind, names in places for name in names]
        columns = [known.index((kind, name)) for kind, names in chosen for name in names]
        P, Q, D = (to_device(np.asarray(part)[..., columns]) for part in (self.P, self.Q, self.D))
        return self._replace(P=P, Q=Q, D=D)

    def of_rows(self, rows: int) -> "Linear":
        """Return the linear models of the first rows of each record."""
        Phi, P, Q = (part[:, : rows - 1] for part in (self.Phi, self.P, self.Q))
        x, y, C, D = (part[:, :rows] for part in (self.x, self.y, self.C, self.D))
        return Linear(x, y, Phi, P, Q, C, D)

    def of_states(self, kept: Sequence[int]) -> "Linear":
        """Return the linear model of some of its states; the others must not act on these.

        Args:
            kept: positions of the states.
        """
        at = [*kept]
        return self._replace(
            x=to_device(np.asarray(self.x)[..., at]),
            Phi=to_device(np.asarray(self.Phi)[..., at, :][..., at]),
            P=to_device(np.asarray(self.P)[..., at, :]),
            Q=to_device(np.asarray(self.Q)[..., at, :]),
            C=to_device(np.asarray(self.C)[..., at]),
        )


def _linear_models(problem: Problem, parameters: Parameters, places: Places) -> Linear:
    """Return the linear model along the trajectory of each record.

    Args:
        problem: estimation problem whose likelihood is output error.
        parameters: its parameters.
        places: as for `linear_model`.
    """
    return jax.vmap(lambda own, case: linear_model(problem, own, parameters.shared, case, places))(
        parameters.rows, problem.cases()
    )


linear_models = EvictingJit(_linear_models)


def linear_model(problem: Problem, own, shared, case, places: Places) -> Linear:
    """Return the linear model along the trajectory of one record.

    Args:
        problem: estimation problem whose likelihood is output error.
        own, shared, case: arguments of `Problem.solve_one`.
        places: in the order of their columns: equations by their states, the air by the further
            inputs of `model.with_disturbance_inputs()`, inputs and outputs by their names, and all
            shared parameters.
    """
    flat, record = case
    likelihood = problem.likelihood
    assert isinstance(likelihood, OutputError)

    def made(theta):
        return insert(problem.model, flat, problem.positions, theta, own)

    model, x0 = made(shared)
    own_inputs = len(model.inputs)
    if dict(places).get(LocationKind.AIR):
        model = model.with_disturbance_inputs()
    t = record.t
    u = jnp.pad(record.u, ((0, 0), (0, len(model.inputs) - own_inputs)))
    motion = disturbed_motion(model, x0, t, u, likelihood.hold, likelihood.stepper)
    x, Phi = motion.x, motion.Phi

    def entering(kind, names):
        """Return P, Q and D of the places of one kind."""
        if kind is LocationKind.SENSOR:
            nothing = jnp.zeros((t.size - 1, x.shape[1], len(names)))
            D = jnp.eye(len(model.outputs))[:, [model.outputs.index(name) for name in names]]
            return nothing, nothing, jnp.broadcast_to(D, (t.size, *D.shape))
        if kind is LocationKind.PARAMETER:
            B, D = jax.vmap(lambda t, x, u: _by_parameter(made, t, x, u, shared))(
                t, x, motion.u[:, :own_inputs]
            )
            half = jnp.diff(t)[:, None, None] / 2
            return half * Phi @ B[:-1], half * B[1:], D
        pushes = [(kind is LocationKind.EQUATION, name) for name in names]
        columns = np.array([known.index(push) for push in pushes], int)
        return motion.P[..., columns], motion.Q[..., columns], motion.D[..., columns]

    # Disturbances of the motion; an equation and an input may have the same name.
    known = [(True, name) for name in model.states] + [(False, name) for name in model.inputs]
    P, Q, D = (
        jnp.concatenate(part, axis=2)
        for part in zip(*itertools.starmap(entering, places), strict=True)
    )
    return Linear(x, motion.y, Phi, P, Q, motion.C, D)


def gusts_of(model: AbstractModel) -> tuple[str, ...]:
    """Return the names of the disturbance inputs (gusts) of a model."""
    return model.with_disturbance_inputs().inputs[len(model.inputs) :]


def _by_parameter(made, t, x, u, shared):
    """Derivatives of the rates and the outputs with respect to the shared parameters."""

    def both(theta):
        model: AbstractModel = made(theta)[0]
        return model.rhs(t, x, u), model.output(t, x, u)

    return jax.jacfwd(both)(shared)


def spline_basis(
    t: Float[Array, " time"], knots: int
) -> tuple[Float[Array, "time knot"], Float[Array, " knot"]]:
    """Return linear B-splines over one record, and the times of their knots."""
    grid = jnp.linspace(t[0], t[-1], knots)
    return jnp.clip(1.0 - jnp.abs(t[:, None] - grid[None]) / (grid[1] - grid[0]), 0.0), grid


@fast_compile_jit
def responses(
    linear: Linear, disturbances: Float[Array, "case time shape"]
) -> Float[Array, "case time output place shape"]:
    """Return `answers` for each record (jitted)."""
    return jax.vmap(answers)(linear, disturbances)


def answers(
    linear: Linear, disturbances: Float[Array, "time shape"]
) -> Float[Array, "time output place shape"]:
    """Return the response of the outputs to each disturbance at every place.

    Args:
        linear: linear model along a trajectory.
        disturbances: disturbances at the samples, in straight lines between them.
    """
    pushed = jnp.einsum("tsp,tk->tspk", linear.P, disturbances[:-1])
    pushed += jnp.einsum("tsp,tk->tspk", linear.Q, disturbances[1:])
    dx = _states_under(linear.Phi, pushed)
    direct = jnp.einsum("top,tk->topk", linear.D, disturbances)
    return jnp.einsum("tos,tspk->topk", linear.C, dx) + direct


def _states_under(Phi: Float[Array, "step state state"], pushed: Float[Array, "step state *place"]):
    """State at every sample, from rest, under an increment in every step."""

    def step(dx, now):
        Phi, pushed = now
        dx = jnp.tensordot(Phi, dx, 1) + pushed
        return dx, dx

    start = jnp.zeros(pushed.shape[1:])
    _, later = jax.lax.scan(step, start, (Phi, pushed))
    return jnp.concatenate([start[None], later])
