"""`Minimiser`: Gauss-Newton on square-root information, as a minimiser of optimistix.

The search of optimistix uses the likelihood and its gradient. The descent uses the factor of the
information: since R is re-estimated at every iteration, the factor is not the derivative of one
residual vector.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx

from .._foundation.types import Array, Bool, Float, Int
from ..models.free import Parameters
from ..sensitivity.information import Information
from .descent import SpectrumDescent
from .problem import Linearised, Problem

# Chosen: share of a step below which the search has found no descent, 24 halvings.
SMALLEST_STEP = 2.0**-24
# Chosen: the same along weak directions, where the next phase takes over, ten halvings.
GIVE_UP = 2.0**-10
# Rounding of a cost, which is a sum over many samples, relative to its size.
COST_ROUNDING = 64 * float(jnp.finfo(jnp.float64).eps)
# Largest distance in tolerances within which sensitivities at other parameters are reused; chosen.
REUSE_DISTANCE = 100.0
# Change of the decrement by new sensitivities, per standard error of distance, until it is
# measured: as where half of the error remains after a Gauss-Newton step; chosen.
UNMEASURED_CHANGE = 1.0
# In tolerances: a parameter this close to its bound, in standard errors, is set to it; chosen.
ON_BOUND = 1e-3
# Reused sensitivities after which more than this share of the step remains are renewed; chosen.
REFRESH_SHARE = 0.25


class Evaluation(optx.FunctionInfo.EvalGradHessian):
    """Likelihood, gradient (4.17) and Fisher matrix (4.18) for the search, with their factor."""

    information: Information


class State(eqx.Module):
    """State of the iteration.

    Attributes:
        trial: parameters of the next evaluation of the likelihood.
        cost, linearised: cost and linearised problem at the last accepted parameters.
        decrement: length of the full step at the last accepted parameters [standard errors].
        drift: upper bound of the distance from the parameters at which the sensitivities were
            computed [standard errors].
        change: change of the decrement by new sensitivities, per standard error from the parameters
            of the old ones: at least `1 / REUSE_DISTANCE`, measured at the last renewal.
        renew: True if the next evaluation computes the sensitivities; its trial then is the last
            accepted point.
        ending: True if the iteration ends once the sensitivities are renewed.
        step_size: share of the full step at the trial.
        search, descent: states of the search and of the descent.
        first: True before the first evaluation.
        converged, stuck, diverged: the reason for which the iteration ended.
        accepted: number of accepted steps.
        costs, decrements: values by accepted step; NaN after the last one.
    """

    trial: Parameters
    cost: Float[Array, ""]
    linearised: Linearised
    decrement: Float[Array, ""]
    drift: Float[Array, ""]
    change: Float[Array, ""]
    renew: Bool[Array, ""]
    ending: Bool[Array, ""]
    step_size: Float[Array, ""]
    search: Any
    descent: Any
    first: Bool[Array, ""]
    converged: Bool[Array, ""]
    stuck: Bool[Array, ""]
    diverged: Bool[Array, ""]
    accepted: Int[Array, ""]
    costs: Float[Array, " step"]
    decrements: Float[Array, " step"]


class _Trial(NamedTuple):
    """A trial after the search's decision.

    Attributes:
        y, cost, linearised: the best parameters so far, their cost and linearised problem; those of
            the trial if it is accepted.
        accept: True if the trial is accepted.
        evaluated: the trial's cost.
        step_size, search: share of the full step for the next trial, and the state of the search.
    """

    y: Parameters
    cost: Float[Array, ""]
    linearised: Linearised
    accept: Bool[Array, ""]
    evaluated: Float[Array, ""]
    step_size: Float[Array, ""]
    search: Any


class _Progress(NamedTuple):
    """Progress of the iteration after a trial.

    Attributes:
        decrement: length of the full step [standard errors].
        drift: distance from the parameters of the sensitivities, at most [standard errors].
        change: change of the decrement per standard error of this distance.
        near: True if the sensitivities are near enough to end the iteration with.
        renew: True if the next evaluation computes the sensitivities again.
        done: True if the iteration should end.
        small_gain_ends: True if it should end because the cost fell by little.
    """

    decrement: Float[Array, ""]
    drift: Float[Array, ""]
    change: Float[Array, ""]
    near: Bool[Array, ""]
    renew: Bool[Array, ""]
    done: Bool[Array, ""]
    small_gain_ends: Bool[Array, ""]


class Minimiser(optx.AbstractMinimiser):
    """`GaussNewton` as a minimiser of optimistix; `args` is the `Problem`."""

    descent: SpectrumDescent
    search: optx.AbstractSearch
    tolerance: float = eqx.field(static=True)
    least_fall: float = eqx.field(static=True)
    max_steps: int = eqx.field(static=True)
    chord: bool = eqx.field(static=True)
    smallest_step: float = eqx.field(static=True, default=SMALLEST_STEP)
    rtol: float = eqx.field(static=True, default=0.0)
    atol: float = eqx.field(static=True, default=0.0)
    norm: Callable = eqx.field(static=True, default=optx.max_norm)

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        problem: Problem = args
        structure = jax.eval_shape(partial(self._linearise, problem), y)
        empty = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), structure)
        evaluation = _evaluation(jnp.zeros(()), empty.information)
        known = options.get("S")
        if known is not None:
            empty = eqx.tree_at(lambda linearised: linearised.S, empty, known)
        true, false, history = jnp.array(True), jnp.array(False), jnp.full(self.max_steps, jnp.nan)
        return State(
            trial=problem.project(y),
            cost=jnp.array(jnp.inf),
            linearised=empty,
            decrement=jnp.array(jnp.inf),
            drift=jnp.array(0.0),
            change=jnp.array(UNMEASURED_CHANGE),
            renew=jnp.array(known is None),
            ending=false,
            step_size=jnp.array(1.0),
            search=self.search.init(y, evaluation),
            descent=self.descent.init(y, evaluation),
            first=true,
            converged=false,
            stuck=false,
            diverged=false,
            accepted=jnp.array(0),
            costs=history,
            decrements=history,
        )

    def step(self, fn, y, args, options, state, tags):
        problem: Problem = args
        trial = self._search(problem, y, state)
        progress = self._progress(state, trial)
        accept, renew, linearised = trial.accept, progress.renew, trial.linearised
        before = _evaluation(state.cost, state.linearised.information)
        evaluation = _evaluation(trial.cost, linearised.information)
        descent, skip = self._next_descent(
            trial.y, state, evaluation, accept, ~accept & ~renew, trial.step_size
        )
        # the size of a trust region outlives the sensitivities
        restart = skip if self.descent.policy.curved else skip | renew
        restarted = self.search.init(trial.y, before)
        search = jax.tree.map(partial(jnp.where, restart), restarted, trial.search)
        step_size = jnp.where(restart, 1.0, trial.step_size)
        difference, _ = self.descent.step(jnp.where(renew, 0.0, step_size), descent)
        repeated = state.renew & ~state.first  # the accepted parameters, evaluated again
        row = jnp.where(accept, state.accepted - repeated, self.max_steps)
        ends = progress.near & (progress.done | state.ending)
        new = State(
            trial=problem.project(
                jax.tree.map(jnp.add, trial.y, difference),
                linearised.information,
                ON_BOUND * self.tolerance,
            ),
            cost=trial.cost,
            linearised=linearised,
            decrement=progress.decrement,
            drift=progress.drift,
            change=progress.change,
            renew=renew,
            ending=progress.small_gain_ends,
            step_size=step_size,
            search=search,
            descent=descent,
            first=jnp.array(False),
            converged=accept & ends & jnp.isfinite(trial.cost),
            stuck=step_size < self.smallest_step,
            diverged=state.first & ~jnp.isfinite(trial.evaluated),
            accepted=state.accepted + (accept & ~repeated),
            costs=state.costs.at[row].set(trial.cost, mode="drop"),
            decrements=state.decrements.at[row].set(progress.decrement, mode="drop"),
        )
        return trial.y, new, None

    def _search(self, problem: Problem, y: Parameters, state: State) -> _Trial:
        """Return the trial, accepted or refused by the search."""
        cost, linearised = self._evaluate(problem, state)
        # Costs that differ by rounding count as equal; otherwise the last, smallest steps would be
        # refused at random.
        slack = jnp.where(jnp.isfinite(cost), COST_ROUNDING * jnp.abs(cost), 0.0)
        before = _evaluation(state.cost, state.linearised.information)
        step_size, accept, _, search = self.search.step(
            state.first, y, state.trial, before, optx.FunctionInfo.Eval(cost - slack), state.search
        )
        if self.descent.policy.curved:  # the same parameters again show nothing of a step
            repeated = state.renew & ~state.first
            kept = state.step_size, state.search
            step_size, search = jax.tree.map(
                partial(jnp.where, repeated), kept, (step_size, search)
            )
        accept = state.first | state.renew | (accept & jnp.isfinite(cost))
        # a branch hands the arrays over, where a choice by element would copy the sensitivities
        y, lowest, linearised = jax.lax.cond(
            accept,
            lambda new, old: new,
            lambda new, old: old,
            (state.trial, cost, linearised),
            (y, state.cost, state.linearised),
        )
        return _Trial(y, lowest, linearised, accept, cost, step_size, search)

    def _progress(self, state: State, trial: _Trial) -> _Progress:
        """Return the progress of the iteration after a trial."""
        accept = trial.accept
        moved, optional = accept & ~state.first & ~state.renew, state.descent.optional
        decrement = self.descent.decrement(trial.linearised.information)
        fall = jnp.abs(state.cost - trial.evaluated)
        small_gain = moved & ~optional & (fall < self.least_fall)
        if self.descent.policy.curved:  # a step that the damping shortens gains little anywhere
            small_gain &= trial.step_size >= 1.0
        close = REUSE_DISTANCE * self.tolerance
        # An old direction can be poor and gain little, so it does not end the iteration.
        small_gain_ends = small_gain & self._is_near(state.drift, state.change)
        done = (decrement < self.tolerance) | small_gain_ends
        drift, change = self._drift(state, moved), _change(state, decrement)
        near = self._is_near(drift, change)
        renew = ~near & (
            ~accept
            | done
            | small_gain
            | (decrement < close)
            | (decrement > REFRESH_SHARE * state.decrement)
        )
        return _Progress(decrement, drift, change, near, renew, done, small_gain_ends)

    def _is_near(self, drift: Float[Array, ""], change: Float[Array, ""]) -> Bool[Array, ""]:
        """Return True if new sensitivities would change the decrement by less than a tolerance."""
        return change * drift <= self.tolerance

    def _next_descent(self, y: Parameters, state: State, evaluation, accept, refused, step_size):
        """Return the state of the descent, and whether the search begins with another direction.

        After a refused step that has become too short the direction is changed: turned away from a
        corner, or without its optional part.
        """
        turn = refused & state.descent.has_other & (step_size < self.smallest_step)
        skip = refused & state.descent.optional & (step_size < GIVE_UP) & ~turn
        query = self.descent.query(y, evaluation, state.descent)
        turned = self.descent.turn(evaluation, state.descent)
        descent = jax.tree.map(partial(jnp.where, accept | skip), query, state.descent)
        return jax.tree.map(partial(jnp.where, turn), turned, descent), skip | turn

    def _drift(self, state: State, moved: Bool[Array, ""]) -> Float[Array, ""]:
        """Return the distance from the parameters of the sensitivities after a trial.

        It is an upper bound [standard errors].
        """
        if not self.chord:
            return state.drift
        return jnp.where(state.renew, 0.0, state.drift + jnp.where(moved, state.decrement, 0.0))

    def _evaluate(self, problem: Problem, state: State) -> tuple[Float[Array, ""], Linearised]:
        """Return the trial's cost and linearised problem.

        With `chord`, the sensitivities are computed only when `state.renew` is true.
        """
        if not self.chord:
            linearised = self._linearise(problem, state.trial)
            return problem.cost_of(linearised.v, state.trial), linearised
        v, S = jax.lax.cond(
            state.renew,
            lambda trial: _sensitivities(problem, trial),
            lambda trial: (problem.residuals(trial), state.linearised.S),
            state.trial,
        )
        return problem.cost_of(v, state.trial), problem.informed(v, S, state.trial)

    def _linearise(self, problem: Problem, y: Parameters) -> Linearised:
        """Return the linearised problem; `chord` keeps the sensitivities of all records."""
        if self.chord:
            return problem.informed(*_sensitivities(problem, y), y)
        return _linearise(problem, y)

    def terminate(self, fn, y, args, options, state, tags):
        return state.converged | state.stuck | state.diverged, optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return y, aux, {}


def _change(state: State, decrement: Float[Array, ""]) -> Float[Array, ""]:
    """Return the change of the decrement per standard error of distance (`State.change`)."""
    repeated = state.renew & (state.drift > 0)
    measured = jnp.abs(decrement - state.decrement) / jnp.where(repeated, state.drift, 1.0)
    return jnp.where(repeated, jnp.maximum(measured, 1.0 / REUSE_DISTANCE), state.change)


@eqx.filter_jit
def _sensitivities(problem: Problem, y: Parameters):
    """Return residuals and sensitivities; a separate function, so that it is traced once."""
    return problem.sensitivities(y)


@eqx.filter_jit
def _linearise(problem: Problem, y: Parameters) -> Linearised:
    """Return the linearised problem; a separate function, so that it is traced once."""
    return problem.linearise(y)


def _evaluation(cost, information: Information) -> Evaluation:
    grad = Parameters(*information.gradient())
    structure = jax.eval_shape(lambda: grad)
    hessian = lx.FunctionLinearOperator(
        lambda d: Parameters(*information.apply(d.shared, d.rows)),
        structure,
        lx.positive_semidefinite_tag,
    )
    return Evaluation(cost, grad, hessian, information)
