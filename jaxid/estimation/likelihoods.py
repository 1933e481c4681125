"""Likelihoods: measures of the misfit between a model and its records."""

import abc

import equinox as eqx
from equinox import AbstractVar

from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.free_model import FreeModel
from ..models.noise import AbstractNoise, DiagonalNoise
from ..sensitivity.jacobian import value_and_jacobian
from ..sensitivity.linearisation import Trajectory, trajectory_sensitivities
from ..simulation.hold import AbstractHold, Linear
from ..simulation.simulate import run
from ..simulation.solution import Solution
from ..simulation.steppers import RK4, AbstractStepper


class AbstractLikelihood(eqx.Module):
    """A measure of misfit, with a noise model.

    Attributes:
        noise: the noise model by which the residuals are weighted.
    """

    noise: AbstractVar[AbstractNoise]

    @abc.abstractmethod
    def solve(
        self, model: AbstractModel, record: Record, initial_state: Float[Array, " state"]
    ) -> Solution:
        """Return the states of one record and the model's outputs at its samples."""

    def sensitivities(
        self, family: FreeModel, theta: Float[Array, " column"], record: Record
    ) -> tuple[Float[Array, "time output"], Float[Array, "time output column"]]:
        """Return the outputs of one record and their sensitivities to the free parameters.

        By default `solve` is differentiated in forward mode.

        Args:
            family: the model as a function of its free parameters.
            theta: values of the free parameters, those of this record first.
            record: a single record.
        """
        return forward_sensitivities(self, family, theta, record)

    def compact(self) -> "AbstractLikelihood":
        """Return the same likelihood in its fastest-compiling form, for models of many effects."""
        return self

    @abc.abstractmethod
    def check(self, model: AbstractModel, records: Record) -> None:
        """Check that this likelihood can estimate from the records."""

    @abc.abstractmethod
    def check_times(self, t: Float[Array, "*case time"]) -> None:
        """Check that this likelihood can use the sample times of records to estimate or predict."""


class OutputError(AbstractLikelihood):
    """Output error: the whole difference of record and simulation is measurement noise.

        v_i = z_i - y_i(theta),
        J = 1/2 sum_i ( v_i' R^-1 v_i + log det R )     (section 4.1, Eq. A.60)

    Args:
        noise: R fixed, diagonal or full; an unknown R is re-estimated at every iteration (Eq. 4.4).
        hold: the interpolation of the inputs between their samples.
        stepper: the integration of the state from sample to sample.
    """

    noise: AbstractNoise = eqx.field(default_factory=DiagonalNoise)
    hold: AbstractHold = eqx.field(default_factory=Linear)
    stepper: AbstractStepper = eqx.field(default_factory=RK4)

    def solve(self, model, record, initial_state):
        return run(model, record.t, record.u, initial_state, self.hold, self.stepper)

    def sensitivities(self, family, theta, record):
        stepper = self.stepper
        if not (isinstance(stepper, RK4) and stepper.unrolled):
            return forward_sensitivities(self, family, theta, record)
        if not (theta.size and family.model.states):
            return forward_sensitivities(self, family, theta, record)
        model, initial_state = family(theta)
        solution = self.solve(model, record, initial_state)
        trajectory = Trajectory(record.t, record.u, solution.x, self.hold, stepper)
        return solution.y, trajectory_sensitivities(family, theta, trajectory)

    def compact(self):
        return OutputError(self.noise, self.hold, self.stepper.compact())

    def check(self, model, records):
        self.noise.check(records.mask, records.outputs)
        self.check_times(records.t)

    def check_times(self, t):
        self.hold.check(t)


def forward_sensitivities(
    likelihood: AbstractLikelihood,
    family: FreeModel,
    theta: Float[Array, " column"],
    record: Record,
) -> tuple[Float[Array, "time output"], Float[Array, "time output column"]]:
    """Return the outputs and sensitivities of one record by forward mode through `solve`.

    It serves every likelihood, stepper and model, at the cost of pushing each column through the
    whole simulation.
    """

    def outputs(theta):
        model, initial_state = family(theta)
        return likelihood.solve(model, record, initial_state).y

    return value_and_jacobian(outputs, theta)
