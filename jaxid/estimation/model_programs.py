"""The two programs of a model: its states and outputs, and its residuals with their sensitivities.

They serve all fits, scores and predictions of a model, whatever its free parameters and noise: the
values stand in one flat vector per record, and the free parameters are positions in it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.evicting_jit import EvictingJit
from .._foundation.host import to_device
from .._foundation.types import Array, Float, Int
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.free import Parameters, Positions, flat_vectors
from ..models.free_model import FreeModel
from .likelihoods import AbstractLikelihood, OutputError
from .problem import Problem


class FlatProblem(NamedTuple):
    """A problem whose parameters stand in one flat vector per record.

    Attributes:
        problem: the problem.
        flat: flat vector of the model's parameters and the initial state, for each record.
    """

    problem: Problem
    flat: Float[np.ndarray, "case flat"]

    @classmethod
    def of(cls, problem: Problem) -> "FlatProblem":
        """Return the flat problem of a problem."""
        return cls(problem, np.array(flat_vectors(problem.model, problem.records)))

    @property
    def at(self) -> np.ndarray:
        """Positions of the free parameters, those per record first."""
        positions = self.problem.positions
        return np.concatenate([np.asarray(positions.rows), np.asarray(positions.shared)])

    def filled(self, parameters: Parameters) -> Float[np.ndarray, "case flat"]:
        """Return the flat vectors with the given values of the free parameters."""
        flat, rows = self.flat.copy(), np.asarray(parameters.rows)
        shared = np.broadcast_to(np.asarray(parameters.shared), (len(rows), parameters.shared.size))
        values = np.concatenate([rows, shared], axis=1)
        inside = self.at < flat.shape[1]
        flat[:, self.at[inside]] = values[:, inside]
        return flat

    def outputs_arguments(self, parameters: Parameters) -> tuple:
        """Return the arguments of `ModelPrograms.outputs`."""
        problem = self.problem
        flat = to_device(self.filled(parameters))
        return problem.model, flat, problem.records, simulating(problem.likelihood)

    def sensitivities_arguments(self, parameters: Parameters, padding: int = 0) -> tuple:
        """Return the arguments of `ModelPrograms.sensitivities`.

        Args:
            parameters: values of the free parameters.
            padding: number of columns of zeros after those of the free parameters.
        """
        at = to_device(np.append(self.at, np.full(padding, self.flat.shape[1])))
        return (*self.outputs_arguments(parameters), at, self.problem.positions.leaves)


def simulating(likelihood: AbstractLikelihood) -> AbstractLikelihood:
    """Return a likelihood for simulation: output error does not need its noise model, without which
    problems with estimated and with known noise share their programs.
    """
    if isinstance(likelihood, OutputError):
        return OutputError(hold=likelihood.hold, stepper=likelihood.stepper)
    return likelihood


def outputs(
    model: AbstractModel,
    flat: Float[Array, "case flat"],
    records: Record,
    likelihood: AbstractLikelihood,
) -> tuple[Float[Array, "case time state"], Float[Array, "case time output"]]:
    """Return the states and the outputs of a model at every sample of every record.

    Args:
        model: structure of the model; its parameters stand in the flat vectors.
        flat: flat vector of the parameters and the initial state, for each record.
        records: a stack.
        likelihood: the likelihood, which simulates.
    """
    nothing = Positions(jnp.zeros(0, int), jnp.zeros(0, int), ())

    def of_case(flat, record):
        declared, initial_state = FreeModel(model, flat, nothing).build(())
        solution = likelihood.solve(declared, record, initial_state)
        return solution.x, solution.y

    return jax.vmap(of_case)(flat, records)


def sensitivities(
    model: AbstractModel,
    flat: Float[Array, "case flat"],
    records: Record,
    likelihood: AbstractLikelihood,
    at: Int[Array, " column"],
    leaves: tuple[int, ...],
) -> tuple[Float[Array, "case time row"], Float[Array, "case time sensitive column"]]:
    """Return the rows of misfit of a model and their negative derivatives by elements of the flat
    vectors: for output error the residuals and the derivatives of the outputs.

    Args:
        model, flat, records, likelihood: as in `outputs`.
        at: positions of the elements; a position beyond the vector gives a column of zeros.
        leaves: indices of the leaves that hold these elements (`Positions.leaves`).
    """
    positions = Positions(at, jnp.zeros(0, int), leaves)

    def of_case(flat, record):
        family = FreeModel(model, flat, positions)
        values = flat.at[at].get(mode="fill", fill_value=0.0)
        return likelihood.sensitivities(family, values, record)

    return jax.vmap(of_case)(flat, records)


class ModelPrograms(NamedTuple):
    """The programs of a model.

    Attributes:
        outputs: `outputs`, jitted.
        sensitivities: `sensitivities`, jitted.
    """

    outputs: EvictingJit
    sensitivities: EvictingJit


# Shared by all studies and predictions, so that those of the same shapes compile once.
PROGRAMS = ModelPrograms(EvictingJit(outputs), EvictingJit(sensitivities))
