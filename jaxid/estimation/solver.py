"""The one solver: Gauss-Newton on square-root information, as a minimiser of optimistix.

The search of optimistix sees the likelihood itself and its gradient; our descent sees the factor, because a factor, whose R is
re-estimated at every iteration, is not the derivative of any one residual vector.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx

from .._foundation.types import Array, Bool, Float, Int
from ..models.free import Parameters
from ..sensitivity.information import Information
from ..sensitivity.spectrum import spectrum
from .policies import AbstractPolicy, Clip
from .problem import Linearised, Problem

SMALLEST_STEP = 2.0**-24
GIVE_UP = 2.0**-10  # of a step along weak directions, which the next phase replaces
ROUNDING = 64 * float(jnp.finfo(jnp.float64).eps)  # of a cost that is a sum over many samples, relative to its size
NEAR = 100.0  # times the tolerance: sensitivities of parameters no farther away serve as those of the parameters themselves
SLOW = 0.25  # of the step that was left: sensitivities of elsewhere that leave more are made anew


class SpectrumDescent(optx.AbstractDescent):
    """The Gauss-Newton direction of square-root information under a policy for weak eigenvalues.

    Args:
        policy: what to do with weak directions.
        scale: typical sizes of the shared parameters, NaN where the sensitivity itself scales.
    """

    policy: AbstractPolicy
    scale: Float[Array, " parameter"]

    def init(self, y, f_info_struct):
        return y, jnp.array(0), jnp.array(False)

    def query(self, y, f_info, state):
        _, phase, _ = state
        information: Information = f_info.information
        found = spectrum(information.triangle, information.rhs, self.scale)
        shared = found.step(self.policy.weights(found, phase)) if found.scale.size else jnp.zeros(0)
        optional = self.policy.optional(found, phase) if found.scale.size else jnp.array(False)
        return Parameters(shared, information.own.solve(shared)), phase + 1, optional

    def decrement(self, information: Information) -> Float[Array, ""]:
        """Length of the whole step that is left, in standard errors; weak shared directions do not count."""
        own = jnp.sum(information.own.rhs**2)
        if not self.scale.size:
            return jnp.sqrt(own)
        found = spectrum(information.triangle, information.rhs, self.scale)
        return jnp.sqrt(own + jnp.sum(jnp.where(found.weak(self.policy.threshold), 0.0, found.turned) ** 2))

    def step(self, step_size, state):
        direction, *_ = state
        return jax.tree.map(lambda leaf: step_size * leaf, direction), optx.RESULTS.successful


class Evaluation(optx.FunctionInfo.EvalGradHessian):
    """What the search compares: the likelihood, its gradient (4.17), the Fisher matrix (4.18), and their common factor."""

    information: Information


class State(eqx.Module):
    """Where an iteration stands.

    Attributes:
        trial: where the likelihood is evaluated next.
        cost, linearised: at the last accepted parameters.
        left: length of the whole step that is left there, in standard errors.
        away: length of the steps since the sensitivities were made, in standard errors; at most.
        renew: whether the trial is evaluated for its sensitivities; what was accepted is then its own trial.
        ending: whether the iteration ends once they are renewed.
        search, descent: the states of their own.
        first: True before the first evaluation.
        converged, stuck, diverged: why the iteration ended, if it has.
        accepted: number of accepted steps.
        costs, decrements: by accepted step; NaN behind them.
    """

    trial: Parameters
    cost: Float[Array, ""]
    linearised: Linearised
    left: Float[Array, ""]
    away: Float[Array, ""]
    renew: Bool[Array, ""]
    ending: Bool[Array, ""]
    search: Any
    descent: Any
    first: Bool[Array, ""]
    converged: Bool[Array, ""]
    stuck: Bool[Array, ""]
    diverged: Bool[Array, ""]
    accepted: Int[Array, ""]
    costs: Float[Array, " step"]
    decrements: Float[Array, " step"]


class GaussNewton(eqx.Module):
    """How to iterate.

    Args:
        policy: what to do with weak eigenvalues; the report found clipping adequate in most cases.
        search: a search of optimistix; backtracking by default.
        tolerance: iteration ends when the whole step left is shorter than this, in standard errors.
        least_fall: iteration also ends when an accepted step lowers the cost by less than this (zero: never). Where a model
            has corners, steps stay short, and the last thousandth of a unit of log-likelihood is not worth them.
        max_steps: evaluations of the likelihood before it gives up.
        chord: whether sensitivities serve for several steps. A trial is then simulated for its residuals alone, which costs a
            small part of the sensitivities. These are made anew where a step with those of elsewhere is refused, leaves more
            than a quarter of what was left before it, or ends the iteration; elsewhere is more than 100 tolerances away.
            It compiles one simulation more, and under `vmap` it saves nothing. (The chord method between Newton's
            steps: V. E. Shamanskii, Ukrainian Mathematical Journal 19, 1967; C. T. Kelley, Iterative Methods for Linear and
            Nonlinear Equations, SIAM 1995, section 5.4.)
    """

    policy: AbstractPolicy = eqx.field(default_factory=Clip)
    search: optx.AbstractSearch = eqx.field(default_factory=lambda: optx.BacktrackingArmijo(slope=1e-4))
    tolerance: float = eqx.field(static=True, default=1e-6)
    least_fall: float = eqx.field(static=True, default=0.0)
    max_steps: int = eqx.field(static=True, default=200)
    chord: bool = eqx.field(static=True, default=False)


class Minimiser(optx.AbstractMinimiser):
    """`GaussNewton` as optimistix runs it, on a problem that it is given as `args`, which knows more than its cost."""

    descent: SpectrumDescent
    search: optx.AbstractSearch
    tolerance: float = eqx.field(static=True)
    least_fall: float = eqx.field(static=True)
    max_steps: int = eqx.field(static=True)
    chord: bool = eqx.field(static=True)
    rtol: float = eqx.field(static=True, default=0.0)
    atol: float = eqx.field(static=True, default=0.0)
    norm: Callable = eqx.field(static=True, default=optx.max_norm)

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        problem: Problem = args
        structure = jax.eval_shape(lambda y: problem.informed(*_sensitivities(problem, y), y), y)
        empty = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), structure)
        evaluation = _evaluation(jnp.zeros(()), empty.information)
        known = options.get("S")
        if known is not None:
            empty = eqx.tree_at(lambda one: one.S, empty, known)
        yes, no, history = jnp.array(True), jnp.array(False), jnp.full(self.max_steps, jnp.nan)
        return State(
            trial=problem.project(y),
            cost=jnp.array(jnp.inf),
            linearised=empty,
            left=jnp.array(jnp.inf),
            away=jnp.array(0.0),
            renew=yes if known is None else ~jnp.all(jnp.isfinite(known)),
            ending=no,
            search=self.search.init(y, evaluation),
            descent=self.descent.init(y, evaluation),
            first=yes,
            converged=no,
            stuck=no,
            diverged=no,
            accepted=jnp.array(0),
            costs=history,
            decrements=history,
        )

    def step(self, fn, y, args, options, state, tags):
        problem: Problem = args
        cost, trial = self._evaluate(problem, state)
        # Costs that differ by rounding are equal; otherwise the last, smallest steps would be refused at random.
        slack = jnp.where(jnp.isfinite(cost), ROUNDING * jnp.abs(cost), 0.0)
        before, seen = _evaluation(state.cost, state.linearised.information), optx.FunctionInfo.Eval(cost - slack)
        step_size, accept, _, search = self.search.step(state.first, y, state.trial, before, seen, state.search)
        accept = state.first | state.renew | (accept & jnp.isfinite(cost))
        moved, optional = accept & ~state.first & ~state.renew, state.descent[-1]

        choose = partial(jax.tree.map, partial(jnp.where, accept))
        y, new_cost, linearised = choose((state.trial, cost, trial), (y, state.cost, state.linearised))
        left = self.descent.decrement(linearised.information)
        little = moved & ~optional & (jnp.abs(state.cost - cost) < self.least_fall)
        close = NEAR * self.tolerance
        enough = little & (state.away <= close)  # a bad direction, too, brings little
        done = (left < self.tolerance) | enough
        away = self._away(state, moved)
        near = away <= close
        renew = ~near & (~accept | done | little | (left < close) | (left > SLOW * state.left))

        skip = ~accept & ~renew & optional & (step_size < GIVE_UP)
        asked = self.descent.query(y, _evaluation(new_cost, linearised.information), state.descent)
        descent = jax.tree.map(partial(jnp.where, accept | skip), asked, state.descent)
        search = jax.tree.map(partial(jnp.where, skip | renew), self.search.init(y, before), search)
        step_size = jnp.where(skip | renew, 1.0, step_size)
        difference, _ = self.descent.step(jnp.where(renew, 0.0, step_size), descent)
        again = state.renew & ~state.first  # the same parameters once more
        at = jnp.where(accept, state.accepted - again, self.max_steps)
        new = State(
            trial=problem.project(jax.tree.map(jnp.add, y, difference)),
            cost=new_cost,
            linearised=linearised,
            left=left,
            away=away,
            renew=renew,
            ending=enough,
            search=search,
            descent=descent,
            first=jnp.array(False),
            converged=accept & near & (done | state.ending) & jnp.isfinite(new_cost),
            stuck=step_size < SMALLEST_STEP,
            diverged=state.first & ~jnp.isfinite(cost),
            accepted=state.accepted + (accept & ~again),
            costs=state.costs.at[at].set(new_cost, mode="drop"),
            decrements=state.decrements.at[at].set(left, mode="drop"),
        )
        return y, new, None

    def _away(self, state: State, moved: Bool[Array, ""]) -> Float[Array, ""]:
        """How far the parameters are, after a trial, from those at which the sensitivities were made."""
        if not self.chord:
            return state.away
        return jnp.where(state.renew, 0.0, state.away + jnp.where(moved, state.left, 0.0))

    def _evaluate(self, problem: Problem, state: State) -> tuple[Float[Array, ""], Linearised]:
        """The trial's cost and linearised problem, with old sensitivities unless they are due."""
        if self.chord:
            v, S = jax.lax.cond(
                state.renew,
                lambda trial: _sensitivities(problem, trial),
                lambda trial: (problem.residuals(trial), state.linearised.S),
                state.trial,
            )
        else:
            v, S = _sensitivities(problem, state.trial)
        return problem.cost_of(v, state.trial), problem.informed(v, S, state.trial)

    def terminate(self, fn, y, args, options, state, tags):
        return state.converged | state.stuck | state.diverged, optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return y, aux, {}


def minimise(
    problem: Problem,
    begin: Parameters,
    solver: GaussNewton,
    S: Float[Array, "case time output column"] | None = None,
) -> tuple[Parameters, State]:
    """Run the solver on a problem: the best parameters, and the state in which it ended.

    Args:
        problem: what is to be solved.
        begin: where to start.
        solver: how to iterate.
        S: the sensitivities at the start, of use to a solver with `chord`; NaN where they are not known.
    """
    minimiser = Minimiser(  # pyright: ignore[reportCallIssue]  (as in models/library.py)
        SpectrumDescent(solver.policy, problem.limits.scale),
        solver.search,
        solver.tolerance,
        solver.least_fall,
        solver.max_steps,
        solver.chord,
    )
    solution = optx.minimise(
        lambda y, problem: problem.cost_of(_sensitivities(problem, y)[0], y),
        minimiser,
        begin,
        args=problem,
        options={"S": S},
        max_steps=solver.max_steps,
        throw=False,
    )
    return solution.value, solution.state


@eqx.filter_jit
def _sensitivities(problem: Problem, y: Parameters):
    """A function of its own, to be traced once."""
    return problem.sensitivities(y)


def _evaluation(cost, information: Information) -> Evaluation:
    grad = Parameters(*information.gradient())
    structure = jax.eval_shape(lambda: grad)
    hessian = lx.FunctionLinearOperator(
        lambda d: Parameters(*information.apply(d.shared, d.rows)), structure, lx.positive_semidefinite_tag
    )
    return Evaluation(cost, grad, hessian, information)
