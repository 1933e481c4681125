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
from ..models.base import AbstractModel, canonical
from ..models.free import Free, Parameters, Positions, initial_parameters, with_values
from .hypothesis import Hypothesis
from .problem import LoopProblem


class Estimation(NamedTuple):
    """An estimation problem of a hypothesis.

    Attributes:
        problem: the problem, with padding columns if it has the absent effects.
        parameters: starting values.
        names: names of the free shared parameters, without the padding.
        model, free: the model with its values, and its free parameters.
    """

    problem: Problem
    parameters: Parameters
    names: tuple[str, ...]
    model: AbstractModel
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
    noise, columns = hypothesis.noise, problem.columns
    likelihood = canonical(noise.likelihood(problem.likelihood))
    chosen = columns.chosen(hypothesis.effects)
    names = tuple(columns.names[k] for k in chosen)
    free = free_of(problem, names)
    augmented = problem.model_at(values, hypothesis.effects)
    padded = isinstance(likelihood, OutputError) and not problem.uses_reduced_model
    if padded:
        model = augmented
        shared = to_device(values[chosen])
        base = padded_problem(problem, model, likelihood, hypothesis.effects, shared)
        shared = padded_values(shared, base)
    else:
        model = canonical(noise.model(augmented.only(hypothesis.effects)))
        model, free = canonical(likelihood.prepared(model, free, problem.train))
        extra = tuple(name for name in free.shared if name in known and name not in names)
        if extra:
            model = with_values(model, extra, jnp.array([known[name] for name in extra]))
        base = Problem.of(model, free, problem.train, likelihood)
        shared = initial_parameters(model, base.positions, problem.train).shared
    if rows is None:
        rows = initial_parameters(base.model, base.positions, problem.train).rows
    return Estimation(base, Parameters(shared, rows), free.shared, model, free)


def free_of(problem: LoopProblem, names: tuple[str, ...]) -> Free:
    """Return the free parameters with these shared ones, and their bounds."""
    free, columns = problem.free, problem.columns
    lower, upper = dict(free.lower), dict(free.upper)
    for name in names:
        column = columns.index[name]
        if column >= columns.declared:
            lower[name] = to_device(np.array(columns.lower[column]))
            upper[name] = to_device(np.array(columns.upper[column]))
    return Free(names, free.per_record, lower, upper, free.scale, free.prior)


def padded_problem(
    problem: LoopProblem,
    model: AbstractModel,
    likelihood: AbstractLikelihood,
    effects: tuple[str, ...],
    shared: Float[Array, " column"],
) -> Problem:
    """Return a problem of the model with all candidates, whose columns are padded to a width.

    All hypotheses of one width share their compiled programs.
    """
    chosen = problem.columns.chosen(effects)
    padding = problem.width(len(chosen)) - len(chosen)
    at = to_device(np.r_[problem.positions[chosen], np.full(padding, len(problem.names))])
    positions = Positions(at, problem.row_positions, problem.leaves)
    limits: Limits = problem.columns.limits(chosen, padding, problem.train.n_cases)
    return Problem(model, positions, problem.train, likelihood, limits)


def padded_values(shared, base: Problem):
    """Return starting values with zeros for the padding."""
    missing = base.positions.shared.size - shared.size
    return to_device(np.r_[np.asarray(shared), np.zeros(missing)])
