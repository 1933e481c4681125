"""Explanations of records already flown, and the expected chi-square between two of them."""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require
from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Float, Numbers
from ..data.record import Record
from ..data.stack import require_single
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel, canonical
from ..models.free import Free, first_state
from ..models.names import flatten
from .information import prior_rows, require_known_noise, start_of
from .objectives import Discrimination, Hypothesis, InformationObjective, MutualDiscrimination
from .optimisation import Task

# Draws of the parameters of each explanation for which the envelope holds, and their seed (chosen).
DRAWS, DRAW_SEED = 12, 0


class Explanation(NamedTuple):
    """A model of records already flown.

    Attributes:
        model: the model, with the values of its estimate.
        free: its free parameters.
        earlier: factor of the information of these records on its shared parameters
            (`fit.information.triangle`); None if it was not fitted to any.
    """

    model: AbstractModel
    free: Free
    earlier: Float[Numbers, "row parameter"] | None = None


def as_explanation(given: Explanation | tuple[AbstractModel, Free]) -> Explanation:
    """Return a model with its free parameters as an explanation."""
    return given if isinstance(given, Explanation) else Explanation(*given)


def expected_chi_square(
    true: tuple[AbstractModel, Free],
    wrong: Explanation | tuple[AbstractModel, Free],
    record: Record,
    likelihood: AbstractLikelihood,
    *,
    initial_state: Float[Numbers, " state"] | None = None,
) -> float:
    """Return the chi-square by which a wrong hypothesis loses on an input, after its refit.

    Args:
        true: the hypothesis assumed to be true, and its free parameters.
        wrong: the rival, with the same inputs and outputs, and the information of its earlier
            records if it is an `Explanation`.
        record: a single record with the input.
        likelihood: the likelihood with known noise.
        initial_state: state at the first sample, to which further states of a model are added as
            zero; by default each model reads it from the record.

    Raises:
        InputError: when the record is a stack, or the noise is unknown.
    """
    require_single(record, "compared on")
    likelihood = canonical(likelihood)
    require_known_noise(likelihood)
    rival = as_explanation(wrong)

    def hypothesis(model: AbstractModel, free: Free) -> Hypothesis:
        state = first_state(model, record) if initial_state is None else initial_state
        return hypothesis_of(canonical(model), free, start_of(model, state))

    first, second = hypothesis(*true), hypothesis(rival.model, rival.free)
    objective = Discrimination(
        true=first,
        wrong=second,
        earlier=known_information(rival.free, rival.earlier),
        likelihood=likelihood,
    )
    return float(_chi_square(objective, record.t, record.u))


def separating_task(task: Task, rival: Explanation) -> Task:
    """Return the task of separating the model of a task from a rival, within the limits of both."""
    information, (first,) = task.objective, task.hypotheses
    assert isinstance(information, InformationObjective)
    model = canonical(rival.model)
    require(
        (model.inputs, model.outputs) == (first.model.inputs, first.model.outputs),
        f"The rival has the inputs ({', '.join(model.inputs)}) and the outputs "
        f"({', '.join(model.outputs)}), and the model other ones. Compare models of one record.",
    )
    trim = dict(zip(first.model.states, first.initial_state, strict=True))
    state = jnp.stack([trim.get(name, jnp.zeros(())) for name in model.states])
    second = hypothesis_of(model, rival.free, state)
    likelihood = information.likelihood
    known = known_information(rival.free, rival.earlier)
    directions = (
        Discrimination(true=first, wrong=second, earlier=known, likelihood=likelihood),
        Discrimination(
            true=second, wrong=first, earlier=information.earlier, likelihood=likelihood
        ),
    )
    objective = MutualDiscrimination(directions=directions, likelihood=likelihood)
    draws = (
        uncertain_values(first, information.earlier, DRAWS),
        uncertain_values(second, known, DRAWS),
    )
    return dataclasses.replace(task, objective=objective, hypotheses=(first, second), draws=draws)


def uncertain_values(
    hypothesis: Hypothesis, triangle: Float[Numbers, "row parameter"], count: int
) -> Float[Array, "draw flat"]:
    """Return values of all parameters, drawn from the uncertainty of the free ones.

        theta + d,    d ~ N(0, (T' T)^-1),    |d| <= |theta| where theta is not zero

    A deviation is shortened where a parameter would change by more than its own size, as it would
    in a direction that the records do not show. Without information there are no draws.

    Args:
        hypothesis: the hypothesis.
        triangle: triangle T of the information on its free parameters.
        count: number of draws.
    """
    positions = hypothesis.positions.shared
    values, T = np.asarray(hypothesis.flat[positions]), np.asarray(triangle)
    if not np.any(T):
        return jnp.zeros((0, hypothesis.flat.size))
    _, sizes, directions = np.linalg.svd(T)
    shown = sizes > sizes[0] * np.finfo(float).eps * values.size
    unit = np.random.default_rng(DRAW_SEED).normal(size=(count, int(shown.sum())))
    deviations = (unit / sizes[shown]) @ directions[shown]
    sized = values != 0
    size = np.max(np.abs(deviations[:, sized]) / np.abs(values[sized]), axis=1, initial=1.0)
    deviations /= size[:, None]
    flat = jnp.tile(hypothesis.flat, (count, 1))
    return flat.at[:, positions].add(jnp.asarray(deviations))


def known_information(free: Free, earlier) -> Float[Array, "row parameter"]:
    """Return the triangle of the information of records already flown, else of the priors."""
    flown = prior_rows(free) if earlier is None else np.array(earlier, float)
    require(
        flown.shape[1:] == (len(free.shared),),
        f"The information of earlier records has shape {flown.shape}, and there are "
        f"{len(free.shared)} free parameters. Take `fit.information.triangle` of a fit with the "
        "same parameters.",
    )
    count = len(free.shared)  # rows of a triangle: one shape, one compiled program
    return jnp.asarray(np.linalg.qr(np.pad(flown, ((0, count), (0, 0))), mode="r"))


def hypothesis_of(model: AbstractModel, free: Free, state) -> Hypothesis:
    vector, _ = flatten(model)
    return Hypothesis(model, free.positions(model), jnp.concatenate([vector, state]))


@fast_compile_jit
def _chi_square(objective: Discrimination, t, u):
    return objective.chi_square(t, u)
