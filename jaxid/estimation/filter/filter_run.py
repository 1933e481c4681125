"""`FilterRun`: one run of the filter, along which the model is differentiated."""

from typing import NamedTuple

from ..._foundation.types import Array, Bool, Float
from ...data.record import Record
from ...models.free_model import FreeModel, Leaves
from ...models.stochastic import StochasticModel
from ...sensitivity.linearisation import Inputs, Trajectory, input_derivatives
from ...simulation.hold import AbstractHold
from ...simulation.steppers import RK4
from .kalman import Filtered, Steps, filter_signals, kalman_filter

SAMPLES_TOGETHER = 32  # samples differentiated at once; chosen: some megabytes for 40 parameters


class Measured(NamedTuple):
    """The filter at the samples of a block; `x` and `P` before, `P_after` after the measurement."""

    t: Float[Array, " sample"]
    u: Float[Array, "sample input"]
    mask: Bool[Array, "sample output"]
    v: Float[Array, "sample output"]
    B: Float[Array, "sample output output"]
    x: Float[Array, "sample state"]
    P: Float[Array, "sample state state"]
    P_after: Float[Array, "sample state state"]


class FilterRun(NamedTuple):
    """The filter of one record.

    Attributes:
        model, initial_state: of the filter.
        filtered: its states and innovations.
        measured: the same at the samples, before and after the measurements.
        steps: steps from each sample to the next.
        trajectory: the states after the measurements.
        acting: indices of the leaves that act on the input.
        inputs: the effective input with its derivatives.
    """

    model: StochasticModel
    initial_state: Float[Array, " state"]
    filtered: Filtered
    measured: Measured
    steps: Steps
    trajectory: Trajectory
    acting: tuple[int, ...]
    inputs: Inputs

    @classmethod
    def of(
        cls,
        family: FreeModel,
        leaves: Leaves,
        record: Record,
        hold: AbstractHold,
        substeps: int,
        *,
        steady: bool,
    ) -> "FilterRun":
        """Run the filter of a record.

        Args:
            family: the model and the initial state as functions of the parameters.
            leaves: the leaves that hold free parameters.
            record, hold, substeps, steady: as in `kalman_filter`.
        """
        model, x0 = stochastic(family, leaves)
        filtered = kalman_filter(model, record, x0, hold, substeps, steady=steady)
        samples, steps = filter_signals(model, record, hold, substeps)
        trajectory = Trajectory(record.t, record.u, filtered.x, hold, RK4(substeps))
        measured = Measured(
            *(samples.t, samples.u, record.mask, filtered.v, filtered.B),
            *(filtered.x_predicted, filtered.P_predicted, filtered.P),
        )
        derived = input_derivatives(family, leaves, trajectory)
        return cls(model, x0, filtered, measured, steps, trajectory, *derived)


def stochastic(family: FreeModel, leaves: Leaves) -> tuple[StochasticModel, Float[Array, " state"]]:
    """Return the model with its noises and the initial state, for given leaves."""
    model, x0 = family.build(leaves)
    assert isinstance(model, StochasticModel), "a model from `prepared`"
    return model, x0
