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
from .columns import Padding
from .hypothesis import Hypothesis
from .problem import LoopProblem


class Estimation(NamedTuple):
    """An estimation problem of a hypothesis.

    Attributes:
        problem: the problem.
        parameters: starting values.
        free: the free parameters, without the padding.
        padding: padding of the problem and its parameters; none without the absent effects.
    """

    problem: Problem
    parameters: Parameters
    free: Free
    padding: Padding

    def rows(self, parameters: Parameters) -> Float[np.ndarray, "case own"]:
        """Return the per-record parameters without the padding."""
        return np.asarray(parameters.rows)[:, : self.padding.own]


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
        padding = problem.padding(effects)
    else:
        own, model = free.shared, canonical(problem.model_at(values, effects).only(effects))
        if not likelihood.simulates:
            likelihood.check(model, problem.train)
        model, free = canonical(likelihood.prepared(model, free, problem.train))
        extra = tuple(name for name in free.shared if name in known and name not in own)
        if extra:
            model = with_values(model, extra, jnp.array([known[name] for name in extra]))
        base = Problem.of(model, free, problem.train, likelihood)
        shared = initial_parameters(model, base.positions, problem.train).shared
        width, count = len(free.per_record), len(free.shared)
        padding = Padding(width, width, count, count)
    first = np.array(initial_parameters(base.model, base.positions, problem.train).rows)
    for k, name in enumerate(free.per_record):
        first[:, k] = rows.get(name, first[:, k])
    return Estimation(base, Parameters(shared, to_device(first)), free, padding)


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
    both with padding.

    All hypotheses of one width share their compiled programs.

    Args:
        problem: the problem of the search.
        likelihood: the likelihood.
        effects: names of the effects in the model.
        values: values of all columns.
        free: names of those effects whose parameters are free.
    """
    chosen, own = problem.columns.chosen(free), problem.per_record(effects)
    padding, nowhere = problem.padding(effects, free), len(problem.position)
    shared, rows = padding.padded_shared, padding.padded_own
    positions = Positions(
        shared(problem.positions[chosen], nowhere),
        rows(np.array([problem.position[name] for name in own], int), nowhere),
        problem.leaves,
    )
    selected = dataclasses.replace(free_of(problem, free), per_record=own)
    known = Limits.of(selected, problem.train.n_cases)
    limits = Limits(
        Parameters(shared(known.lower.shared, -np.inf), rows(known.lower.rows, -np.inf)),
        Parameters(shared(known.upper.shared, np.inf), rows(known.upper.rows, np.inf)),
        shared(known.scale, np.nan),
        shared(known.prior_mean, 0.0),
        shared(known.prior_deviation, np.inf),
    )
    model = problem.model_at(values, effects)
    return Problem(model, positions, problem.train, likelihood, limits), shared(values[chosen], 0.0)
