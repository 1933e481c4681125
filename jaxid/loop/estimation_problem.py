"""Estimation problems of hypotheses, on the model with all candidates or its own effects."""

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._foundation.host import to_device
from .._foundation.types import Array, Float
from ..estimation.likelihoods import AbstractLikelihood, OutputError
from ..estimation.limits import Limits
from ..estimation.problem import Problem
from ..models.base import AbstractModel, as_float, canonical
from ..models.free import Free, Parameters, Positions, initial_parameters, with_values
from .hypothesis import Hypothesis
from .problem import LoopProblem


class Estimation(NamedTuple):
    """An estimation problem of a hypothesis.

    Attributes:
        problem: the problem, with padding columns if it has the absent effects.
        parameters: starting values.
        free: the free parameters, without the padding.
    """

    problem: Problem
    parameters: Parameters
    free: Free


def estimation_of(
    problem: LoopProblem,
    hypothesis: Hypothesis,
    values: Float[np.ndarray, " column"],
    known: Mapping[str, float],
    rows: Float[Array, "case own"] | None,
) -> Estimation:
    """Return the estimation problem of a hypothesis.

    Args:
        problem: the problem of the search.
        hypothesis: effects and noise.
        values: starting values of all columns.
        known: starting values by name, also of parameters of the noise.
        rows: starting values of the per-record parameters; by default those of the model.
    """
    effects = hypothesis.effects
    likelihood = canonical(hypothesis.noise.likelihood(problem.likelihood))
    model, free = problem.model_at(values, effects), free_of(problem, effects)
    if isinstance(likelihood, OutputError) and not problem.uses_reduced_model:
        base, shared = padded_problem(problem, model, likelihood, effects, values)
    else:
        own, model = free.shared, canonical(model.only(effects))
        model, free = canonical(likelihood.prepared(model, free, problem.train))
        extra = tuple(name for name in free.shared if name in known and name not in own)
        if extra:
            model = with_values(model, extra, jnp.array([known[name] for name in extra]))
        base = Problem.of(model, free, problem.train, likelihood)
        shared = initial_parameters(model, base.positions, problem.train).shared
    if rows is None:
        rows = initial_parameters(base.model, base.positions, problem.train).rows
    return Estimation(base, Parameters(shared, rows), free)


def free_of(problem: LoopProblem, effects: tuple[str, ...]) -> Free:
    """Return the declared free parameters and those of some effects, with their bounds."""
    free, columns = problem.free, problem.columns
    bounds = {
        f"{name}.{field}": bound
        for name in effects
        for field, bound in problem.effects[name].card.bounds.items()
    }
    lower, upper = ({n: as_float(pair[k]) for n, pair in bounds.items()} for k in (0, 1))
    names = tuple(columns.names[k] for k in columns.chosen(effects))
    lower, upper = {**free.lower, **lower}, {**free.upper, **upper}
    return Free(names, free.per_record, lower, upper, free.scale, free.prior)


def padded_problem(
    problem: LoopProblem,
    model: AbstractModel,
    likelihood: AbstractLikelihood,
    effects: tuple[str, ...],
    values: Float[np.ndarray, " column"],
) -> tuple[Problem, Float[Array, " parameter"]]:
    """Return a problem of the model with all candidates, and the values of its shared parameters,
    both padded to a width.

    All hypotheses of one width share their compiled programs.
    """
    chosen = problem.columns.chosen(effects)
    padding = problem.width(len(chosen)) - len(chosen)

    def padded(vector, fill):
        return to_device(np.r_[np.asarray(vector), np.full(padding, fill)])

    at = padded(problem.positions[chosen], len(problem.position))
    positions = Positions(at, problem.row_positions, problem.leaves)
    own = Limits.of(free_of(problem, effects), problem.train.n_cases)
    limits = Limits(
        Parameters(padded(own.lower.shared, -np.inf), own.lower.rows),
        Parameters(padded(own.upper.shared, np.inf), own.upper.rows),
        padded(own.scale, np.nan),
        padded(own.prior_mean, 0.0),
        padded(own.prior_deviation, np.inf),
    )
    shared = padded(values[chosen], 0.0)
    return Problem(model, positions, problem.train, likelihood, limits), shared
