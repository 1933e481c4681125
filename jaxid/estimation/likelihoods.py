"""Likelihoods: measures of the misfit between a model and its records."""

import abc

import equinox as eqx
from equinox import AbstractVar

from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.noise import AbstractNoise, DiagonalNoise
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

    def compact(self):
        return OutputError(self.noise, self.hold, self.stepper.compact())

    def check(self, model, records):
        self.noise.check(records.mask, records.outputs)
        self.check_times(records.t)

    def check_times(self, t):
        self.hold.check(t)
