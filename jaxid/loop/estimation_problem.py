"""Estimation problems of hypotheses, on the model with all candidates or its own effects."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._foundation.host import to_device
from .._foundation.types import Array, Float
from ..estimation.likelihoods import AbstractLikelihood, OutputError
from ..estimation.limits import Limits
from ..estimation.problem import Problem
from ..models.base import as_float, canonical
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

    def rows(self, parameters: Parameters) -> Float[np.ndarray, "case own"]:
        """Return the per-record parameters without the padding."""
        return np.asarray(parameters.rows)[:, : len(self.free.per_record)]


def estimation_of(
    problem: LoopProblem,
    hypothesis: Hypothesis,
    values: Float[np.ndarray, " column"],
    known: Mapping[str, float],
    rows: Mapping[str, Float[np.ndarray, " case"]],
) -> Estimation:
    """Return the estimation problem of a hypothesis.

    Args:
        problem: the problem of the search.
        hypothesis: effects and noise.
        values: starting values of all columns.
        known: starting values by name, also of parameters of the noise.
        rows: starting values of per-record parameters by name; of others those of the model.
    """
    effects = hypothesis.effects
    likelihood = canonical(hypothesis.noise.likelihood(problem.likelihood))
    free = free_of(problem, effects)
    if isinstance(likelihood, OutputError) and not problem.uses_reduced_model:
        base, shared = padded_problem(problem, likelihood, effects, values, effects)
    else:
        own, model = free.shared, canonical(problem.model_at(values, effects).only(effects))
        model, free = canonical(likelihood.prepared(model, free, problem.train))
        extra = tuple(name for name in free.shared if name in known and name not in own)
        if extra:
            model = with_values(model, extra, jnp.array([known[name] for name in extra]))
        base = Problem.of(model, free, problem.train, likelihood)
        shared = initial_parameters(model, base.positions, problem.train).shared
    first = np.array(initial_parameters(base.model, base.positions, problem.train).rows)
    for k, name in enumerate(free.per_record):
        first[:, k] = rows.get(name, first[:, k])
    return Estimation(base, Parameters(shared, to_device(first)), free)


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
    return Free(names, problem.per_record(effects), lower, upper, free.scale, free.prior)


def padded_problem(
    problem: LoopProblem,
    likelihood: AbstractLikelihood,
    effects: tuple[str, ...],
    values: Float[np.ndarray, " column"],
    free: tuple[str, ...] = (),
) -> tuple[Problem, Float[Array, " parameter"]]:
    """Return a problem of the model with all candidates, and the values of its shared parameters,
    both padded to a width, as are the per-record parameters.

    All hypotheses of one width share their compiled programs.

    Args:
        problem: the problem of the search.
        likelihood: the likelihood.
        effects: names of the effects in the model.
        values: values of all columns.
        free: names of those effects whose parameters are free.
    """
    chosen, row_positions = problem.columns.chosen(free), problem.row_positions(effects)
    padding = problem.width(len(chosen)) - len(chosen)

    def padded(vector, fill):
        return to_device(np.r_[np.asarray(vector), np.full(padding, fill)])

    def padded_rows(rows, fill):
        width = row_positions.size - rows.shape[1]
        return to_device(np.pad(rows, ((0, 0), (0, width)), constant_values=fill))

    at = padded(problem.positions[chosen], len(problem.position))
    positions = Positions(at, to_device(row_positions), problem.leaves)
    selected = dataclasses.replace(free_of(problem, free), per_record=problem.per_record(effects))
    own = Limits.of(selected, problem.train.n_cases)
    limits = Limits(
        Parameters(padded(own.lower.shared, -np.inf), padded_rows(own.lower.rows, -np.inf)),
        Parameters(padded(own.upper.shared, np.inf), padded_rows(own.upper.rows, np.inf)),
        padded(own.scale, np.nan),
        padded(own.prior_mean, 0.0),
        padded(own.prior_deviation, np.inf),
    )
    model = problem.model_at(values, effects)
    return Problem(model, positions, problem.train, likelihood, limits), padded(values[chosen], 0.0)
