"""Likelihoods: how the misfit between a model and its records is measured."""

import abc

import equinox as eqx
from equinox import AbstractVar

from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.noise import AbstractNoise, DiagonalNoise
from ..simulation.inputs import AbstractHold, Linear
from ..simulation.simulate import run
from ..simulation.solution import Solution
from ..simulation.steppers import RK4, AbstractStepper


class AbstractLikelihood(eqx.Module):
    """How a misfit is measured, with a noise model inside.

    Attributes:
        noise: what the residuals are weighted by.
    """

    noise: AbstractVar[AbstractNoise]

    @abc.abstractmethod
    def solve(self, model: AbstractModel, record: Record, initial_state: Float[Array, " state"]) -> Solution:
        """States of one record, and as outputs what the model says of each sample."""

    def compact(self) -> "AbstractLikelihood":
        """The same likelihood in the form that compiles fastest, for models with many effects."""
        return self

    @abc.abstractmethod
    def check(self, model: AbstractModel, records: Record) -> None:
        """Refuse records to estimate from that this likelihood cannot serve."""

    @abc.abstractmethod
    def check_times(self, t: Float[Array, "*case time"]) -> None:
        """Refuse sample times, also of records to predict, that this likelihood cannot serve."""


class OutputError(AbstractLikelihood):
    """Output error: all that the simulation misses is measurement noise.

        v_i = z_i - y_i(theta),    J = 1/2 sum_i ( v_i' R^-1 v_i + log det R )     (section 4.1, Eq. A.60)

    Args:
        noise: R fixed, diagonal or full; unknown ones are re-estimated at every iteration (Eq. 4.4).
        hold: how the inputs run between their samples.
        stepper: how the state is carried from sample to sample.
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
