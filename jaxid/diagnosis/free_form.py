"""Free-form disturbances: what hat functions in an equation, an input, an output or a parameter do to the outputs.

They follow from the linear model along a trajectory,

    dx_(i+1) = Phi_i dx_i + h/2 (Phi_i B_i d_i + B_(i+1) d_(i+1)),    dy_i = C_i dx_i + D_i d_i

so that every place costs a linear recursion and no simulation.
"""
# Pyright counts the arguments of functions that equinox and jaxtyping wrap in its own way; the tests execute them.
# pyright: reportCallIssue=false

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float
from ..estimation.likelihoods import OutputError
from ..estimation.problem import Problem
from ..models.base import AbstractModel
from ..models.free import insert
from ..simulation.simulate import run
from ..simulation.steppers import rate

Kind = Literal["equation", "input", "output", "parameter"]


class Linear(NamedTuple):
    """The linear model along one trajectory: the trajectory, transitions, outputs, and how each place enters."""

    x: Float[Array, "time state"]
    y: Float[Array, "time output"]

    Phi: Float[Array, "step state state"]
    C: Float[Array, "time output state"]
    B: Float[Array, "time state place"]
    D: Float[Array, "time output place"]


def linear_model(problem: Problem, own, shared, case, kinds: tuple[Kind, ...], equations: tuple[str, ...]) -> Linear:
    """The linear model along the trajectory of one case.

    Args:
        problem: with output error for likelihood.
        own, shared, case: as `Problem.solve_one` takes them.
        kinds: of places, in the order of their columns.
        equations: states whose equation is a place.
    """
    flat, record = case
    likelihood = problem.likelihood
    assert isinstance(likelihood, OutputError)

    def made(theta):
        return insert(problem.model, flat, problem.positions, theta, own)

    model, x0 = made(shared)
    t, u = record.t, record.u
    solution = run(model, t, u, x0, likelihood.hold, likelihood.stepper)
    x = solution.x
    path = model.input_path(likelihood.hold.path(t, u))

    def interval(i, x):
        return likelihood.stepper.states(model, jax.lax.dynamic_slice(t, (i,), (2,)), path, x)[0][1]

    Phi = jax.vmap(jax.jacfwd(interval, argnums=1))(jnp.arange(t.size - 1), x[:-1])
    Phi = jnp.where((jnp.diff(t) > 0)[:, None, None], Phi, jnp.eye(x.shape[1]))

    def moved(t, x, u, force):
        """Rates and outputs under a force in each equation: one function, so that the model is compiled once for all places."""
        dx = rate(model, t, x, u) + force
        return dx, model.output_given(t, x, u, dx)

    def at(t, x, u):
        A, C = jax.jacfwd(moved, argnums=(1, 2, 3))(t, x, u, jnp.zeros(x.size))
        parts = []
        for kind in kinds:
            if kind == "equation":
                chosen = np.array([model.states.index(name) for name in equations], int)
                parts.append((A[2][:, chosen], C[2][:, chosen]))
            elif kind == "input":
                parts.append((A[1], C[1]))
            elif kind == "output":
                parts.append((jnp.zeros((x.size, len(model.outputs))), jnp.eye(len(model.outputs))))
            else:
                parts.append(_by_parameter(made, t, x, u, shared))
        B, D = (jnp.concatenate(part, axis=1) for part in zip(*parts, strict=True))
        return C[0], B, D

    C, B, D = jax.vmap(at)(t, x, u)
    return Linear(x, solution.y, Phi, C, B, D)


def _by_parameter(made, t, x, u, shared):
    """How the rates and the outputs at a given state change with each shared parameter."""

    def both(theta):
        model: AbstractModel = made(theta)[0]
        return model.rhs(t, x, u), model.output(t, x, u)

    return jax.jacfwd(both)(shared)


def hats_of(t: Float[Array, " time"], knots: int) -> tuple[Float[Array, "time knot"], Float[Array, " knot"]]:
    """Hat functions over one record, and the times of their tops."""
    grid = jnp.linspace(t[0], t[-1], knots)
    return jnp.clip(1.0 - jnp.abs(t[:, None] - grid[None]) / (grid[1] - grid[0]), 0.0), grid


def answers(linear: Linear, t, hats) -> Float[Array, "time output place knot"]:
    """The outputs' answers to every hat at every place."""
    h = jnp.diff(t)
    forcing = jnp.einsum("tsp,tk->tspk", linear.B, hats)

    def step(dx, now):
        Phi, h, before, after = now
        dx = jnp.tensordot(Phi, dx + h / 2 * before, 1) + h / 2 * after
        return dx, dx

    start = jnp.zeros(forcing.shape[1:])
    _, later = jax.lax.scan(step, start, (linear.Phi, h, forcing[:-1], forcing[1:]))
    dx = jnp.concatenate([start[None], later])
    return jnp.einsum("tos,tspk->topk", linear.C, dx) + jnp.einsum("top,tk->topk", linear.D, hats)
