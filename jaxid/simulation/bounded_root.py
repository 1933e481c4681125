"""`BoundedSearch`: Levenberg-Marquardt root finder for optimistix, with bounds and restarts."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax.scipy.linalg import solve_triangular

from .._foundation.types import Array, Bool, Float, Int

# Factors of the damping after an accepted and after a rejected step (chosen).
DAMPING_DECREASE, DAMPING_INCREASE = 0.1, 5.0
# Initial damping relative to the squares of the columns (chosen).
INITIAL_DAMPING = 1e-2
# Damping without effect on a step, and damping that makes a step vanish (chosen).
MIN_STEP_DAMPING, MAX_STEP_DAMPING = 1e-14, 1e12
# Scaled residual that is only rounding (chosen, some 5000 times the spacing of float64).
ROUNDING_RESIDUAL = 1e-12
# Relative fall of the cost that counts as zero, if damping has not shortened the step (chosen).
MIN_RELATIVE_DECREASE = 1e-9
# Share of the largest column: the least scale for the damping of an unknown on which the equations
# hardly depend (chosen).
MIN_RELATIVE_COLUMN = 1e-6


class State(eqx.Module):
    """State of the search.

    Attributes:
        trial: point of the next evaluation of the equations.
        rows, jacobian, cost: at the last accepted point; the cost is half the sum of squares.
        damping: damping relative to the squares of the Jacobian's columns.
        best, best_cost: best point of all starts and its cost.
        start_index, steps: index of the start, and number of steps from it.
        done: True if the equations are balanced or no start is left.
    """

    trial: Float[Array, " unknown"]
    rows: Float[Array, " equation"]
    jacobian: Float[Array, "equation unknown"]
    cost: Float[Array, ""]
    damping: Float[Array, ""]
    best: Float[Array, " unknown"]
    best_cost: Float[Array, ""]
    start_index: Int[Array, ""]
    steps: Int[Array, ""]
    done: Bool[Array, ""]


class BoundedSearch(optx.AbstractRootFinder):
    """Levenberg-Marquardt method with an active set of bounds.

        (J'J + damping diag(J'J)) step = -J'r    for the unknowns that no bound holds

    and the step is cut off at the bounds. Near a root the steps become Newton steps. An unknown is
    held if it stands on a bound and the cost falls beyond it (J. Nocedal & S. J. Wright, Numerical
    Optimization, 2006, sections 10.3 and 16.7). If a start leads to a minimum that is no root, or
    takes more than `patience` steps, the next start is tried; if no start leads to a root, the
    lowest point is returned.

    `optx.root_find` passes it `options` with `starts`, shape (start, unknown), `lower` and `upper`,
    shape (unknown,).

    Args:
        rtol, atol: the second is the largest residual that counts as balanced.
        patience: largest number of steps from each start.
    """

    rtol: float = eqx.field(static=True)
    atol: float = eqx.field(static=True)
    patience: int = eqx.field(static=True)
    norm: Any = eqx.field(static=True, default=optx.max_norm)

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        infinite = jnp.array(jnp.inf)
        return State(
            trial=options["starts"][0],
            rows=jnp.zeros(f_struct.shape),
            jacobian=jnp.zeros((*f_struct.shape, *y.shape)),
            cost=infinite,
            damping=jnp.array(INITIAL_DAMPING),
            best=y,
            best_cost=infinite,
            start_index=jnp.array(0),
            steps=jnp.array(0),
            done=jnp.array(False),
        )

    def step(self, fn, y, args, options, state, tags):
        def both(y):
            rows, aux = fn(y, args)
            return rows, (rows, aux)

        jacobian, (rows, aux) = jax.jacfwd(both, has_aux=True)(state.trial)
        cost = 0.5 * jnp.sum(rows**2)
        cost = jnp.where(jnp.isfinite(cost) & jnp.all(jnp.isfinite(jacobian)), cost, jnp.inf)
        accept = (cost < state.cost) | (state.steps == 0)
        small_fall = (
            accept
            & (state.damping < 1.0)
            & (state.cost - cost < MIN_RELATIVE_DECREASE * state.cost)
        )
        damping = jnp.where(
            accept,
            jnp.maximum(DAMPING_DECREASE * state.damping, MIN_STEP_DAMPING),
            DAMPING_INCREASE * state.damping,
        )
        trial_point = (state.trial, rows, jacobian, cost)
        before = (y, state.rows, state.jacobian, state.cost)
        y, rows, jacobian, cost = jax.tree.map(
            lambda new, old: jnp.where(accept, new, old), trial_point, before
        )

        error = jnp.max(jnp.abs(rows))
        balanced = (error < ROUNDING_RESIDUAL) | ((error < self.atol) & (small_fall | ~accept))
        exhausted = (
            small_fall
            | (damping > MAX_STEP_DAMPING)
            | (state.steps + 1 >= self.patience)
            | ~jnp.isfinite(cost)
        )
        better = balanced | (cost < state.best_cost)
        last = state.start_index + 1 >= options["starts"].shape[0]
        next_start = exhausted & ~balanced & ~last
        start_index = jnp.where(next_start, state.start_index + 1, state.start_index)
        trial = y + _step(y, rows, jacobian, damping, options["lower"], options["upper"])
        new = State(
            trial=jnp.where(
                next_start,
                options["starts"][start_index],
                jnp.clip(trial, options["lower"], options["upper"]),
            ),
            rows=rows,
            jacobian=jacobian,
            cost=jnp.where(next_start, jnp.inf, cost),
            damping=jnp.where(next_start, INITIAL_DAMPING, damping),
            best=jnp.where(better, y, state.best),
            best_cost=jnp.where(better, cost, state.best_cost),
            start_index=start_index,
            steps=jnp.where(next_start, 0, state.steps + 1),
            done=balanced | (exhausted & last),
        )
        return y, new, aux

    def terminate(self, fn, y, args, options, state, tags):
        return state.done, optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return state.best, aux, {}


def _step(y, rows, jacobian, damping, lower, upper) -> Float[Array, " unknown"]:
    """Return the damped Gauss-Newton step of the unknowns that no bound holds, zero for others."""
    gradient = jacobian.T @ rows
    held = ((y <= lower) & (gradient > 0)) | ((y >= upper) & (gradient < 0))
    columns = jnp.where(held, 0.0, jacobian)
    squares = jnp.sum(columns**2, axis=0)
    floor = MIN_RELATIVE_COLUMN * jnp.max(squares) + jnp.finfo(float).tiny
    weight = jnp.where(held, 1.0, jnp.sqrt(damping * jnp.maximum(squares, floor)))
    q, r = jnp.linalg.qr(jnp.concatenate([columns, jnp.diag(weight)]))
    return jnp.where(held, 0.0, solve_triangular(r, -q[: rows.size].T @ rows))
