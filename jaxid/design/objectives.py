"""Objectives of an input's design as functions of its samples: information, and discrimination."""

import abc
import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.types import Array, Bool, Float
from ..data.record import Record
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel
from ..models.free import Positions
from ..models.free_model import FreeModel
from ..models.names import flatten
from .information import whitened_sensitivities
from .measures import AbstractMeasure


class Hypothesis(eqx.Module):
    """A model with the values of all its parameters, and the positions of the free ones.

    Attributes:
        model: the model.
        positions: positions of the free parameters.
        flat: values of all parameters, followed by the initial state.
    """

    model: AbstractModel
    positions: Positions
    flat: Float[Array, " flat"]

    def at(self, flat: Float[Array, " flat"]) -> "Hypothesis":
        """Return the hypothesis with other values of all parameters and another initial state."""
        _, unflatten = flatten(self.model)
        size = flat.size - len(self.model.states)
        return Hypothesis(unflatten(flat[:size]), self.positions, flat)

    @property
    def initial_state(self) -> Float[Array, " state"]:
        """State at the first sample."""
        return self.flat[self.flat.size - len(self.model.states) :]

    def family(self) -> tuple[FreeModel, Float[Array, " column"]]:
        """Return the model as a function of own and shared parameters, and their values."""
        theta = self.flat[jnp.concatenate([self.positions.rows, self.positions.shared])]
        return FreeModel(self.model, self.flat, self.positions), theta

    def sensitivities(self, t, u, likelihood: AbstractLikelihood):
        """Return whitened sensitivities to own and shared parameters, shape (row, column) each."""
        record = _record(self.model, t, u)
        own, shared = whitened_sensitivities(
            self.model, self.positions, self.flat, record, likelihood
        )
        count = t.size * len(self.model.outputs)
        return own.reshape(count, own.shape[-1]), shared.reshape(count, shared.shape[-1])


class AbstractObjective(eqx.Module):
    """A cost of the samples of an input, smaller for a better input.

    Attributes:
        likelihood: the likelihood of the later estimate.
    """

    likelihood: eqx.AbstractVar[AbstractLikelihood]

    @abc.abstractmethod
    def cost(self, t: Float[Array, " time"], u: Float[Array, "time input"]) -> Float[Array, ""]:
        """Return a logarithmic cost, with its derivative by the samples."""


class InformationObjective(AbstractObjective):
    """A measure of the information on the shared parameters; variances as logarithms.

    The derivative of the cost by the sensitivities is the measure's own, so that no matrix
    decomposition is differentiated.

    Args:
        hypothesis: the model.
        measure: the measure.
        earlier: factor of information from earlier flights and priors.
        likelihood: the likelihood of the later estimate.
    """

    hypothesis: Hypothesis
    measure: AbstractMeasure
    earlier: Float[Array, "row parameter"]
    likelihood: AbstractLikelihood

    def cost(self, t, u):
        own, shared = self.hypothesis.sensitivities(t, u, self.likelihood)
        fixed_own, fixed = jax.lax.stop_gradient((own, shared))
        absorbed = _least_squares(fixed_own, fixed)
        factor = jnp.concatenate([fixed - fixed_own @ absorbed, self.earlier])
        value, slope = logarithmic_cost(self.measure, factor)
        slope = slope[: fixed.shape[0]]
        slope_own = -slope @ absorbed.T
        change = jnp.sum(slope * (shared - fixed)) + jnp.sum(slope_own * (own - fixed_own))
        return value + change

    def factor(self, t, u) -> Float[Array, "row parameter"]:
        """Return the rows of information on the shared parameters, earlier ones included."""
        own, shared = self.hypothesis.sensitivities(t, u, self.likelihood)
        return jnp.concatenate([shared - own @ _least_squares(own, shared), self.earlier])


class RobustObjective(AbstractObjective):
    """The cost over a distribution of the parameters: its average, or its largest value.

        cost = mean_j J(u, theta_j)    or    max_j J(u, theta_j)

    The mean of a logarithmic cost is the logarithm of a geometric mean.

    Args:
        information: the cost at given parameters.
        draws: values of all parameters and the initial state, one row per draw.
        likelihood: the likelihood of the later estimate.
        worst: true for the largest value; an array, so that both share a compiled program.
    """

    information: InformationObjective
    draws: Float[Array, "draw flat"]
    likelihood: AbstractLikelihood
    worst: Bool[Array, ""]

    def cost(self, t, u):
        def at(flat):
            hypothesis = self.information.hypothesis.at(flat)
            return dataclasses.replace(self.information, hypothesis=hypothesis).cost(t, u)

        costs = jax.vmap(at)(self.draws)
        return jnp.where(self.worst, jnp.max(costs), jnp.mean(costs))


class Discrimination(AbstractObjective):
    """T-optimality: `-log` of the expected chi-square by which the wrong hypothesis loses.

        T = min_d |L^-1 (y_true - y_wrong - S_wrong d)|^2 + |T_0 d|^2

    The minimum is the refit of the wrong hypothesis, in the linearised sense, with its initial
    state if that is free. It fitted earlier records at its present values, which their information
    `T_0' T_0` holds.

    Source: A. C. Atkinson, V. V. Fedorov, The design of experiments for discriminating between two
    rival models, Biometrika 62(1), 1975.

    Args:
        true: hypothesis that is assumed to be true.
        wrong: its rival.
        earlier: factor `T_0` of the information on the shared parameters of the wrong hypothesis.
        likelihood: the likelihood of the later estimate.
    """

    true: Hypothesis
    wrong: Hypothesis
    earlier: Float[Array, "row parameter"]
    likelihood: AbstractLikelihood

    def cost(self, t, u):
        return -jnp.log(self.chi_square(t, u))

    def chi_square(
        self, t: Float[Array, " time"], u: Float[Array, "time input"]
    ) -> Float[Array, ""]:
        """Return the expected chi-square T."""
        own, shared = self.wrong.sensitivities(t, u, self.likelihood)
        record = _record(self.wrong.model, t, u)
        first, second = (
            self.likelihood.solve(
                each.model, jax.tree.map(lambda leaf: leaf[0], record), each.initial_state
            ).y
            for each in (self.true, self.wrong)
        )
        L = self.likelihood.noise.cholesky(jnp.zeros(record.z.shape), record.mask)
        difference = jax.scipy.linalg.solve_triangular(L, (first - second).T, lower=True).T.ravel()
        rows = self.earlier.shape[0]
        known = jnp.pad(self.earlier, ((0, 0), (own.shape[1], 0)))
        S = jnp.concatenate([jnp.concatenate([own, shared], axis=1), known])
        difference = jnp.pad(difference, (0, rows))
        refit = _least_squares(*jax.lax.stop_gradient((S, difference[:, None])))
        return jnp.sum((difference - (S @ refit)[:, 0]) ** 2)


class MutualDiscrimination(AbstractObjective):
    """Discrimination of two hypotheses where either may be true.

        cost = log(1 / T_12 + 1 / T_21)

    It follows the smaller of both chi-squares and is smooth where they are equal.

    Args:
        directions: the discrimination with the first and with the second hypothesis true.
        likelihood: the likelihood of the later estimate.
    """

    directions: tuple[Discrimination, Discrimination]
    likelihood: AbstractLikelihood

    def cost(self, t, u):
        first, second = (direction.chi_square(t, u) for direction in self.directions)
        return jnp.log(1.0 / first + 1.0 / second)


def logarithmic_cost(
    measure: AbstractMeasure, factor: Float[Array, "row parameter"]
) -> tuple[Float[Array, ""], Float[Array, "row parameter"]]:
    """Return the cost of a measure, a variance as its logarithm, and its derivative by the rows."""
    value, slope = jnp.asarray(measure.cost(factor)), jnp.asarray(measure.gradient(factor))
    return (jnp.log(value), slope / value) if measure.is_variance else (value, slope)


def _least_squares(columns, right):
    """Return the least-squares solution of least length, columns scaled; zero without columns."""
    if columns.shape[1] == 0:
        return jnp.zeros((0, right.shape[1]))
    length = jnp.linalg.norm(columns, axis=0)
    scale = jnp.where(length > 0, length, 1.0)
    return jnp.linalg.pinv(columns / scale[None]) @ right / scale[:, None]


def _record(model: AbstractModel, t, u) -> Record:
    """Return a stack of one record with these inputs, all of its samples valid."""
    shape = (1, t.size, len(model.outputs))
    return Record(
        t[None],
        u[None],
        jnp.zeros(shape),
        jnp.ones(shape, bool),
        {},
        model.inputs,
        model.outputs,
        ("",) * len(model.inputs),
        ("",) * len(model.outputs),
        ("",),
    )
