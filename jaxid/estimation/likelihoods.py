"""Likelihoods: measures of the misfit between a model and its records."""

import abc
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from equinox import AbstractVar

from .._foundation.checks import InputError, require
from .._foundation.types import Array, Bool, Float
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.free import Free
from ..models.free_model import FreeModel
from ..models.noise import AbstractNoise, DiagonalNoise
from ..sensitivity.jacobian import value_and_jacobian
from ..sensitivity.linearisation import Trajectory, trajectory_sensitivities
from ..simulation.hold import AbstractHold, Linear
from ..simulation.simulate import run
from ..simulation.solution import Solution
from ..simulation.steppers import RK4, AbstractStepper

PART_EXAMPLES = {  # of a likelihood: the class of each, and an example
    "noise": (AbstractNoise, "jaxid.DiagonalNoise()"),
    "hold": (AbstractHold, "jaxid.hold.ZeroOrder()"),
    "stepper": (AbstractStepper, "jaxid.RK4(4)"),
}


class Folded(NamedTuple):
    """Rows of misfit of one record, and the triangle of `[S w]` of its whitened rows."""

    rows: Float[Array, "time row"]
    triangle: Float[Array, "column column"]


class AbstractLikelihood(eqx.Module):
    """A measure of misfit, with a noise model.

    For each record a likelihood returns rows of misfit and their sensitivities; the solver folds
    them into a triangle. The rows of output error are the residuals, which the noise model weights
    by a pooled R. Another likelihood may return rows that are whitened already, followed by columns
    without sensitivities.

    Attributes:
        noise: the noise model by which the residuals are weighted.
        simulates: True if the outputs of `solve` are a simulation, False if each is predicted from
            the samples before it.
    """

    simulates: ClassVar[bool] = True
    noise: AbstractVar[AbstractNoise]

    def __check_init__(self):
        for name, (kind, example) in PART_EXAMPLES.items():
            part = getattr(self, name, None)
            # no `require`: its message would print all arrays of each likelihood that is made
            if not (part is None or isinstance(part, kind)):
                raise InputError(
                    f"`{name}` of {type(self).__name__} is {part!r}. Give an object, such as "
                    f"`{example}`."
                )

    @abc.abstractmethod
    def solve(
        self, model: AbstractModel, record: Record, initial_state: Float[Array, " state"]
    ) -> Solution:
        """Return the states of one record and the model's outputs at its samples."""

    def smoothed(
        self, model: AbstractModel, record: Record, initial_state: Float[Array, " state"]
    ) -> tuple[Solution, Float[Array, "time state state"] | None]:
        """Return the solution of one record given all its samples, and the covariance of its
        states for known parameters; None without process noise.
        """
        return self.solve(model, record, initial_state), None

    def drawn(
        self,
        model: AbstractModel,
        record: Record,
        initial_state: Float[Array, " state"],
        root: Float[Array, "output output"],
        key: Array,
    ) -> Float[Array, "time output"]:
        """Return measurements of one record, drawn from the model with its noise.

        Args:
            model: the model.
            record: times and inputs.
            initial_state: state at the first sample, or its mean.
            root: Cholesky factor of R, of noise without memory.
            key: random key.
        """
        y = self.solve(model, record, initial_state).y
        return y + jax.random.normal(key, y.shape) @ root.T

    def prepared(
        self, model: AbstractModel, free: Free, records: Record
    ) -> tuple[AbstractModel, Free]:
        """Return the model and the free parameters with those of the likelihood added.

        By default a likelihood has no parameters.
        """
        return model, free

    def rows(
        self, model: AbstractModel, record: Record, initial_state: Float[Array, " state"]
    ) -> Float[Array, "time row"]:
        """Return the rows of misfit of one record: `z - y`, zero at missing samples."""
        return _residuals(record, self.solve(model, record, initial_state).y)

    def row_mask(self, mask: Bool[Array, "*case time output"]) -> Bool[Array, "*case time row"]:
        """Return the valid elements of the rows."""
        return mask

    def n_sensitive(self, n_outputs: int) -> int:
        """Return the number of rows of a sample that have sensitivities; by default one for each
        output.
        """
        return n_outputs

    def residuals(
        self, rows: Float[Array, "*case time row"], mask: Bool[Array, "*case time output"]
    ) -> Float[Array, "*case time output"]:
        """Return the residuals in the units of the outputs from the rows."""
        return rows

    def knows_noise(self, free: Free) -> bool:
        """Return True if the noise is given, False if a part of it is estimated.

        Args:
            free: the free parameters, with those of the likelihood.
        """
        return self.noise.is_known

    def measurement_covariance(
        self,
        model: AbstractModel,
        rows: Float[Array, "case time row"],
        mask: Bool[Array, "case time output"],
    ) -> Float[Array, "output output"]:
        """Return the covariance R of the measurement noise, as given or as estimated."""
        L = self.noise.cholesky(rows, mask)
        return L @ L.T

    def sensitivities(
        self, family: FreeModel, theta: Float[Array, " column"], record: Record
    ) -> tuple[Float[Array, "time row"], Float[Array, "time sensitive column"]]:
        """Return the rows of one record and `-d rows/d theta`, of the first rows if not of all.

        By default `rows` is differentiated in forward mode.

        Args:
            family: the model as a function of its free parameters.
            theta: values of the free parameters, those of this record first.
            record: a single record.
        """

        def rows(theta):
            model, initial_state = family(theta)
            return self.rows(model, record, initial_state)

        value, jacobian = value_and_jacobian(rows, theta)
        return value, -jacobian

    def folded(
        self, family: FreeModel, theta: Float[Array, " column"], record: Record
    ) -> Folded | None:
        """Return rows and triangle of one record, of a likelihood that keeps no sensitivities.

        None, the default, for one whose rows are whitened and decomposed after `sensitivities`,
        which has the same arguments.
        """
        return None

    def approximation(self) -> "AbstractLikelihood | None":
        """Return a likelihood with the same cost and cheaper, approximate derivatives.

        A fit starts with it. None if there is none.
        """
        return None

    def compact(self, linearised: bool = False) -> "AbstractLikelihood":
        """Return the same likelihood in a form that compiles fast, for models with many effects.

        Args:
            linearised: True for long records, on which an estimation should linearise the steps.
        """
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
        shooting: number of pieces of each record from which `estimate` starts (multiple shooting),
            for long or unstable records; None for one simulation of each record from the start. The
            estimate and its errors belong to the whole records.
    """

    noise: AbstractNoise = eqx.field(default_factory=DiagonalNoise)
    hold: AbstractHold = eqx.field(default_factory=Linear)
    stepper: AbstractStepper = eqx.field(default_factory=RK4)
    shooting: int | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        require(
            self.shooting is None or (isinstance(self.shooting, int) and self.shooting >= 2),
            f"`shooting` is {self.shooting!r}; give the number of pieces of each record, an int of "
            "2 or more.",
        )

    def solve(self, model, record, initial_state):
        return run(model, record.t, record.u, initial_state, self.hold, self.stepper)

    def sensitivities(self, family, theta, record):
        stepper = self.stepper
        if not (isinstance(stepper, RK4) and stepper.linearised):
            return forward_sensitivities(self, family, theta, record)
        if not (theta.size and family.model.states):
            return forward_sensitivities(self, family, theta, record)
        model, initial_state = family(theta)
        solution = self.solve(model, record, initial_state)
        trajectory = Trajectory(record.t, record.u, solution.x, self.hold, stepper)
        return _residuals(record, solution.y), trajectory_sensitivities(family, theta, trajectory)

    def compact(self, linearised=False):
        return OutputError(self.noise, self.hold, self.stepper.compact(linearised))

    def check(self, model, records):
        self.noise.check(records.mask, records.outputs)
        self.noise.check_times(records.t)
        self.check_times(records.t)

    def check_times(self, t):
        self.hold.check(t)


def forward_sensitivities(
    likelihood: AbstractLikelihood,
    family: FreeModel,
    theta: Float[Array, " column"],
    record: Record,
) -> tuple[Float[Array, "time output"], Float[Array, "time output column"]]:
    """Return the residuals of one record and the sensitivities of its outputs, at missing samples
    too, by forward mode through `solve`.

    It serves every stepper and model, at the cost of pushing each column through the whole
    simulation.
    """

    def outputs(theta):
        model, initial_state = family(theta)
        return likelihood.solve(model, record, initial_state).y

    y, S = value_and_jacobian(outputs, theta)
    return _residuals(record, y), S


def _residuals(record: Record, y: Float[Array, "time output"]) -> Float[Array, "time output"]:
    # A NaN of the model output at a masked sample would make sums over samples NaN.
    return jnp.where(record.mask, record.z - y, 0.0)
