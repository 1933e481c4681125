"""Design of an input by way of the states that show the parameters best (C.3.2 of the report).

The information of the equation error (Eq. C.40) is a function of the states and inputs themselves.
Their histories, splines within the limits, minimise (steps b to e)

    measure( M(x, u) ) + eps mean |(dx/dt - f(x, u)) / s|^2,    s: size of f within the limits

for growing weights `eps`. The input whose simulated motion is nearest to them is the design (f):

    min_p  mean |(x(p) - x_o) / room|^2 + w mean |(u(p) - u_o) / amplitude|^2     (Eq. C.41)

with the amplitude, rate, energy and envelope limits of that motion as constraints. The report
chooses the histories without regard to the equations of motion (`eps = 0`). For a spring these are
so far from any motion that the nearest one has 1.5 to 2.4 times the standard errors of a direct
design, against 1.04 to 1.06 with the penalty of the report's Eq. C.34.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy

from .._foundation.checks import InputError, require, require_float64
from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Float, Numbers
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel
from ..models.free import Free
from ..simulation.simulate import run
from ..simulation.solution import Solution
from ..simulation.steppers import rate
from .design import Design
from .equation_error import EquationError, equation_error_of, require_equations
from .information import require_shown
from .input_design import design_of, task_of
from .limits import Limits, exact_maximum, quantities
from .measures import AbstractMeasure
from .objectives import AbstractObjective, Hypothesis, InformationObjective, logarithmic_cost
from .optimisation import (
    Task,
    deviations_of,
    integration_of,
    nearest_input,
    optimise,
    reaching_limits,
    summaries,
)
from .shapes import AbstractShape, b_splines, default_knots
from .signals import InputSignal

# Random histories that are improved and followed, evaluations for each weight, and knots of the
# default histories, where these have four times as many samples (all chosen).
HISTORIES, EVALUATIONS, HISTORY_KNOTS = 4, 100, 40
# Weights eps in turn (tuned with the evaluations on a spring with three seeds: five times as many
# evaluations with a last weight of 1000 raise the standard errors by 2 to 11 %, a weight of 100
# alone by 5 to 23 %).
COMPATIBILITY = (1.0, 10.0, 100.0)
CLOSE = 1e-4  # mean square of a distance that needs no improvement: 1 % of the limits (chosen)
INPUT_WEIGHT = 0.1  # w of the input's distance: the states carry the information (chosen)


def approximate_design(
    model: AbstractModel,
    free: Free,
    t: Float[Numbers, " time"],
    shape: AbstractShape | None,
    measure: AbstractMeasure,
    limits: Limits,
    likelihood: AbstractLikelihood,
    rate_noise: Mapping[str, float],
    state_noise: Mapping[str, float] | None = None,
    *,
    axes: Sequence[str] | None = None,
    trim_input: Float[Numbers, " input"] | None = None,
    initial_state: Float[Numbers, " state"] | None = None,
    earlier: Float[Numbers, "row parameter"] | None = None,
    knots: int | None = None,
    compatibility: Sequence[float] = COMPATIBILITY,
    conventional: Sequence[InputSignal] = (),
    seed: int = 0,
) -> Design:
    """Return the input whose motion is nearest to the states that show the parameters best.

        1. max_(x, u) of the information  sum_i h' (g R g')^-1 h   within the limits
        2. min_p of the distance of the simulated motion x(p) to x

    Approximate: the search uses the information of the equation error, not of the estimate. No
    sensitivity is simulated in the search. The cost and the predicted standard errors of the result
    follow from the given likelihood, exact as in `design_input`, which can begin with the result:
    `conventional=[result.signal]`.

    Source: the report, section C.3.2, Eq. C.35 to C.41, with the penalty of Eq. C.34.

    Args:
        model: the model with declared values. Transformations of its inputs (delays) count in the
            simulation only.
        free: the parameters of the later estimate, with priors.
        t: sample times, uniform [s].
        shape: parametrised input, such as `spline(t, 12)`; None for a spline of up to 20 knots.
        measure: the measure to be minimised.
        limits: the limits, with both limits of every state in `envelope`.
        likelihood: the likelihood of the later estimate, with known noise, for the result.
        rate_noise: standard deviation of the measured rate of each state, by name of the state;
            equations without one carry no information [unit of the state per second].
        state_noise: standard deviation of the measured states, zero without one.
        axes, trim_input, initial_state, earlier, conventional: as for `design_input`; the inputs in
            `conventional` are only compared.
        knots: of each history, from the number of samples by default, up to 40.
        compatibility: weights of the equations of motion in step 1, in turn; `(0.0,)` for the
            report's step without them.
        seed: of the random histories.

    Returns:
        The design; `starts` are the costs of the motions that follow the histories.

    Raises:
        InputError: as `design_input`; when a state has no limits, a parameter is in no equation
            whose rate is measured, an equation has no noise, or the shape has no nearest signal.
    """
    require_float64()
    _require_limits(limits, model)
    task, information = task_of(
        *(model, free, t, shape, measure, limits, likelihood),
        axes=axes,
        trim_input=trim_input,
        initial_state=initial_state,
        earlier=earlier,
        conventional=conventional,
    )
    regression = equation_error_of(information.hypothesis, rate_noise, state_noise)
    search = _search_of(task, regression, information, knots)
    low, high = (np.broadcast_to(side, search.shape) for side in search.bounds)
    starts = np.random.default_rng(seed).uniform(low, high, (HISTORIES, *search.shape))
    search = _checked(search, free, jnp.asarray(starts))
    followed = [_followed(task, search, start, compatibility) for start in starts]
    costs, factors = summaries(task, information, deviations_of(task, jnp.asarray(followed)))
    require(
        bool(np.isfinite(np.min(costs))),
        "The motions that follow the histories are not finite, or show too little. Narrow the "
        "limits, or use `design_input`.",
    )
    require_shown(model, free, factors[np.isfinite(costs)].reshape(-1, factors.shape[-1]))
    best = followed[int(np.argmin(costs))]
    return design_of(task, information, free, [best], costs.tolist(), conventional)


class HistorySearch(eqx.Module):
    """The measure of the equation error's information over histories of states and inputs.

    A history is a spline of deviations from trim, from zero at the first sample. It keeps its
    limits if its coefficients do.

    Attributes:
        task: the task of the design, with its limits.
        regression: the equation error.
        measure, earlier: the measure, and the information of earlier flights and priors.
        basis: splines at the samples.
        room: distance from trim to the lower and the upper limit of each state and moved input.
        rates: typical rate of each state.
    """

    task: Task
    regression: EquationError
    measure: AbstractMeasure
    earlier: Float[Array, "row parameter"]
    basis: Float[Array, "time coefficient"]
    room: Float[Array, "channel 2"]
    rates: Float[Array, " state"]

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the coefficients: states, then moved inputs."""
        return self.room.shape[0], self.basis.shape[1]

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of the coefficients, one column each."""
        room = np.asarray(self.room / self._scale[:, None])
        return -room[:, :1], room[:, 1:]

    @property
    def _scale(self) -> Float[Array, " channel"]:
        return jnp.max(self.room, axis=1)

    def histories(
        self, p: Float[Array, "channel coefficient"]
    ) -> tuple[Float[Array, "time state"], Float[Array, "time input"]]:
        """Return states, and deviations of all inputs from trim."""
        curves = self.basis @ (p * self._scale[:, None]).T
        state = self.regression.hypothesis.initial_state
        moved = jnp.zeros((self.task.t.size, self.task.trim_input.size))
        moved = moved.at[:, np.array(self.task.limits.axes, int)].set(curves[:, state.size :])
        return state[None] + curves[:, : state.size], moved

    def cost(
        self, p: Float[Array, "channel coefficient"], weight: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Return the logarithmic cost, with the penalties of the equations and the limits.

        Args:
            p: coefficients of the histories.
            weight: of the penalties, eps.
        """
        x, moved = self.histories(p)
        u = moved + self.task.trim_input[None]
        rows = self.regression.rows(self.task.t, x, u)
        fixed = jax.lax.stop_gradient(rows)
        value, slope = logarithmic_cost(self.measure, jnp.concatenate([fixed, self.earlier]))
        value = value + jnp.sum(slope[: fixed.shape[0]] * (rows - fixed))
        return value + weight * (self._contradiction(x, u) + self._excess(x, u, moved))

    def _contradiction(self, x, u) -> Float[Array, ""]:
        """Return the mean square of `dx/dt - f` over the typical rate, by the trapezoidal rule."""
        t = self.task.t
        f = _rates(self.regression.hypothesis, t, x, u)
        error = jnp.diff(x, axis=0) / jnp.diff(t)[:, None] - 0.5 * (f[1:] + f[:-1])
        return jnp.mean(jnp.sum((error / self.rates[None]) ** 2, axis=1))

    def _excess(self, x, u, moved) -> Float[Array, ""]:
        """Return the squares by which rate, energy, outputs and signals exceed their limits."""
        t, model = self.task.t, self.regression.hypothesis.model
        y = jax.vmap(model.output)(t, x, u)
        solution = Solution(t, x, y, jnp.asarray(True))
        values = quantities(model, self.task.limits.names, solution, u)
        ratios = self.task.limits.of(t, moved, values, exact_maximum)
        return jnp.sum(jnp.maximum(ratios - 1.0, 0.0) ** 2)


class Following(AbstractObjective):
    """Logarithm of the distance of a simulated motion from a history (Eq. C.41).

    Args:
        hypothesis: the model.
        x, u: the history.
        state_weight, input_weight: of the squares, one for each channel.
        likelihood: the likelihood, with its hold and stepper.
    """

    hypothesis: Hypothesis
    x: Float[Array, "time state"]
    u: Float[Array, "time input"]
    state_weight: Float[Array, " state"]
    input_weight: Float[Array, " input"]
    likelihood: AbstractLikelihood

    def cost(self, t, u):
        solution = run(
            self.hypothesis.model,
            *(t, u, self.hypothesis.initial_state),
            *integration_of(self.likelihood),
        )
        away = (solution.x - self.x) ** 2 @ self.state_weight
        return jnp.log(CLOSE + jnp.mean(away + (u - self.u) ** 2 @ self.input_weight))


def _require_limits(limits: Limits, model: AbstractModel) -> None:
    open_states = [name for name in model.states if None in limits.envelope.get(name, (None,))]
    require(
        not open_states,
        f"The states {', '.join(open_states)} have no limits on both sides, within which their "
        "histories are chosen. Give both in `envelope`.",
    )


def _search_of(
    task: Task, regression: EquationError, information: InformationObjective, knots: int | None
) -> HistorySearch:
    """Return the search; its typical rates are one until the starts are known."""
    knots = default_knots(task.t.size, HISTORY_KNOTS) if knots is None else knots
    states = regression.hypothesis.model.states
    rows = np.array([task.limits.names.index(name) for name in states], int)
    amplitude = task.limits.amplitude[:, None]
    room = jnp.concatenate([task.limits.room[rows], jnp.tile(amplitude, (1, 2))])
    basis = jnp.asarray(b_splines(np.asarray(task.t), knots)[:, 1:])
    one = jnp.ones(len(states))
    return HistorySearch(
        task, regression, information.measure, information.earlier, basis, room, one
    )


def _checked(search: HistorySearch, free: Free, starts) -> HistorySearch:
    """Return the search with the typical rates within the limits, after all refusals.

    Args:
        search: the search.
        free: the free parameters.
        starts: coefficients of random histories, one set each.
    """
    x, moved = (leaf.reshape(-1, leaf.shape[-1]) for leaf in _histories(search, starts))
    t, u = jnp.tile(search.task.t, starts.shape[0]), moved + search.task.trim_input[None]
    search.regression.require_noise(t, x, u)
    require_equations(search.regression, free, search.earlier, t, x, u)
    rates = np.sqrt(np.mean(np.asarray(_rates(search.regression.hypothesis, t, x, u)) ** 2, axis=0))
    return dataclasses.replace(search, rates=jnp.asarray(np.where(rates > 0, rates, 1.0)))


def _followed(
    task: Task, search: HistorySearch, start: np.ndarray, compatibility: Sequence[float]
) -> np.ndarray:
    """Return the parameters of the input that follows the best history near a start."""
    x, moved = _histories(search, jnp.asarray(_improved(search, start, compatibility))[None])
    axes = np.array(task.limits.axes, int)
    amplitude = np.asarray(task.limits.amplitude)
    n_states = x.shape[-1]
    inverse = 1.0 / np.asarray(search.room[:n_states]).max(axis=1) ** 2
    weights = np.zeros(task.trim_input.size)
    weights[axes] = INPUT_WEIGHT / amplitude**2
    objective = Following(
        hypothesis=search.regression.hypothesis,
        x=x[0],
        u=moved[0] + task.trim_input[None],
        state_weight=jnp.asarray(inverse),
        input_weight=jnp.asarray(weights),
        likelihood=task.objective.likelihood,
    )
    nearest = nearest_input(task, np.asarray(moved[0]))
    if nearest is None:
        raise InputError(
            "No signal of this shape is nearest to a history. Take `spline` or `multisine`."
        )
    p, _ = optimise(dataclasses.replace(task, objective=objective), nearest)
    return reaching_limits(task, p)


def _improved(
    search: HistorySearch, start: np.ndarray, compatibility: Sequence[float]
) -> np.ndarray:
    """Return the coefficients of the history that minimises the cost for each weight in turn."""
    low, high = (np.broadcast_to(side, search.shape).ravel() for side in search.bounds)
    p, bounds = start.ravel(), np.stack([low, high], axis=1)
    for weight in compatibility:

        def cost(p, weight=weight):
            value, slope = _value_and_slope(
                search, jnp.asarray(p.reshape(search.shape)), jnp.asarray(float(weight))
            )
            return float(value), np.asarray(slope).ravel()

        options: dict[str, Any] = {"maxfun": EVALUATIONS}
        result = scipy.optimize.minimize(
            cost, p, jac=True, method="L-BFGS-B", bounds=bounds, options=options
        )
        p = result.x
    return p.reshape(search.shape)


@fast_compile_jit
def _value_and_slope(search: HistorySearch, p, weight):
    return jax.value_and_grad(search.cost)(p, weight)


@fast_compile_jit
def _histories(search: HistorySearch, p):
    return jax.vmap(search.histories)(p)


@eqx.filter_jit
def _rates(hypothesis: Hypothesis, t, x, u):
    return jax.vmap(lambda t, x, u: rate(hypothesis.model, t, x, u))(t, x, u)
