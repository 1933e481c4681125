"""Steppers: the classical Runge-Kutta method with fixed steps, and the solvers of diffrax."""

import abc
import math
from collections.abc import Sequence

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError
from .._foundation.grid import HOLE, holes, strictly_increasing
from .._foundation.types import Array, Float
from ..models.base import AbstractModel
from .input_signal import AbstractInputSignal, substeps_of


@eqx.filter_jit
def rate(
    model: AbstractModel, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
) -> Float[Array, " state"]:
    """Return the right-hand side; a separate function, so that all calls share one trace."""
    return model.rhs(t, x, u)


def runge_kutta_step(
    model: AbstractModel,
    x: Float[Array, " state"],
    t: Float[Array, ""],
    h: Float[Array, ""],
    u: Float[Array, "stage input"],
) -> tuple[Float[Array, " state"], Float[Array, " state"]]:
    """Return the state after a classical Runge-Kutta step, and its rate before it.

    Args:
        model: the model.
        x: state before the step.
        t: time before the step [s].
        h: length of the step [s].
        u: input at the beginning, in the middle and at the end of the step.
    """
    k1 = rate(model, t, x, u[0])
    k2 = rate(model, t + h / 2, x + h / 2 * k1, u[1])
    k3 = rate(model, t + h / 2, x + h / 2 * k2, u[1])
    k4 = rate(model, t + h, x + h * k3, u[2])
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), k1


class AbstractStepper(eqx.Module):
    """Integration of the state from sample to sample."""

    @abc.abstractmethod
    def states(
        self,
        model: AbstractModel,
        t: Float[Array, " time"],
        path: AbstractInputSignal,
        initial_state: Float[Array, " state"],
    ) -> tuple[Float[Array, "time state"], Float[Array, "time state"]]:
        """Return states and rates at the sample times, not finite where the simulation fails."""

    def check(self, t: Float[Array, "*case time"], names: Sequence[str] = ()) -> None:
        """Check that this method is accurate over the sample times; no check by default.

        Args:
            t: sample times [s].
            names: names of the records, for the message.
        """

    def compact(self, linearised: bool = False) -> "AbstractStepper":
        """Return the same method in a form that compiles fast, for models with many effects.

        Args:
            linearised: True for long records, on which an estimation should linearise the steps.
        """
        return self


class RK4(AbstractStepper):
    """Classical Runge-Kutta method of fourth order, with a fixed number of steps per interval.

    Jumps of a zero-order hold lie between steps, so that they do not reduce the order. A hole in
    the time base, an interval of more than 5 `substeps` median ones, is refused: a step that long
    is inaccurate or unstable.

    Args:
        substeps: steps in each interval between samples.
        unrolled: unroll the four stages of all substeps: faster than a loop over the stages for
            small models, but slower to compile.
        linearised: let an estimation linearise the steps: faster than forward mode through the
            simulation by up to three times, but two to four times slower to compile for a model
            with many effects.
    """

    substeps: int = eqx.field(static=True, default=1)
    unrolled: bool = eqx.field(static=True, default=True)
    linearised: bool = eqx.field(static=True, default=True)

    def states(self, model, t, path, initial_state):
        # The first stage of every step is the rate at a sample; a last step of length zero adds the
        # rate at the last sample.
        t = jnp.append(t, t[-1])
        begin, length = substeps_of(t, self.substeps)
        stages = (begin, length, path.stages(t, self.substeps))
        by_interval = jax.tree.map(
            lambda leaf: leaf.reshape(t.size - 1, self.substeps, *leaf.shape[1:]), stages
        )
        step = runge_kutta_step if self.unrolled else self._looped_step

        def interval(x, now):
            later, rates = jax.lax.scan(
                lambda x, now: step(model, x, *now), x, now, unroll=self.unrolled
            )
            return later, (x, rates[0])

        return jax.lax.scan(interval, initial_state, by_interval)[1]

    def check(self, t, names=()):
        gaps = holes(np.asarray(t), HOLE * self.substeps)
        if gaps:
            raise InputError(_explain_holes(gaps, names, self.substeps))

    def compact(self, linearised=False):
        return RK4(self.substeps, unrolled=False, linearised=linearised)

    @staticmethod
    def _looped_step(model, x, t, h, u):
        def stage(carry, now):
            k, total = carry
            reach, weight, u = now
            k = rate(model, t + reach * h, x + reach * h * k, u)
            return (k, total + weight * k), k

        nodes = (
            jnp.array([0.0, 0.5, 0.5, 1.0]),
            jnp.array([1.0, 2.0, 2.0, 1.0]),
            u[jnp.array([0, 1, 1, 2])],
        )
        (_, total), rates = jax.lax.scan(stage, (jnp.zeros_like(x), jnp.zeros_like(x)), nodes)
        return x + h / 6 * total, rates[0]


class Adaptive(AbstractStepper):
    """A diffrax solver with adaptive steps, for stiff models and for checking a fixed step.

    Args:
        solver: a diffrax solver; `diffrax.Kvaerno5()` for a stiff model.
        rtol, atol: relative and absolute tolerance of a step.
        max_steps: steps after which the simulation counts as failed.
    """

    solver: diffrax.AbstractSolver = eqx.field(default_factory=diffrax.Tsit5)
    rtol: float = eqx.field(static=True, default=1e-8)
    atol: float = eqx.field(static=True, default=1e-10)
    max_steps: int = eqx.field(static=True, default=100_000)

    def states(self, model, t, path, initial_state):
        knots = strictly_increasing(t)
        controller = diffrax.PIDController(rtol=self.rtol, atol=self.atol)
        corners = path.corners()
        if corners is not None:
            controller = diffrax.ClipStepSizeController(controller, jump_ts=corners)
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(
                lambda time, x, _: model.rhs(jnp.asarray(time), x, path(jnp.asarray(time)))
            ),
            self.solver,
            t0=knots[0],
            t1=t[-1],
            dt0=None,
            y0=initial_state,
            saveat=diffrax.SaveAt(ts=jnp.minimum(knots, t[-1])),
            stepsize_controller=controller,
            adjoint=diffrax.ForwardMode(),
            max_steps=self.max_steps,
            throw=False,
        )
        good = solution.result == diffrax.RESULTS.successful
        x = jnp.where(good, jnp.asarray(solution.ys), jnp.nan)
        return x, jax.vmap(lambda time, x: rate(model, time, x, path(time)))(t, x)


def _explain_holes(gaps, names: Sequence[str], substeps: int) -> str:
    """Return the message about holes in a time base: their rows, and the remedy."""
    descriptions = []
    for hole in gaps[:3]:
        name = names[hole.case] if hole.case < len(names) else ""
        record = (
            f"record {name!r}, "
            if name
            else f"case {hole.case}, "
            if len(names) > 1 or gaps[-1].case
            else ""
        )
        descriptions.append(
            f"{record}rows {hole.row} to {hole.row + 1} "
            f"({hole.start:.6g} to {hole.end:.6g} s, {hole.ratio:.3g} median steps)"
        )
    others = f" and {len(gaps) - 3} more" if len(gaps) > 3 else ""
    substeps_needed = math.ceil(max(hole.ratio for hole in gaps) / HOLE * (1.0 - 1e-6))
    steps = "One Runge-Kutta step" if substeps == 1 else f"{substeps} Runge-Kutta steps"
    return (
        f"The time base has {len(gaps)} hole{'s' if len(gaps) > 1 else ''}: "
        f"{'; '.join(descriptions)}{others}. {steps} would have "
        f"to cross an interval of more than {HOLE * substeps:g} median ones. Split the record "
        "there: "
        f"`jaxid.data.split_at(record, {gaps[0].row + 1})`. Or, where the input is known to run "
        "through the hole by its hold, "
        f"pass `stepper=Adaptive()` or `stepper=RK4({substeps_needed})`."
    )
