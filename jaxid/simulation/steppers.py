"""Steppers: the classical fixed-step Runge-Kutta scan, and every solver of diffrax."""

import abc

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.grid import strictly_increasing
from .._foundation.types import Array, Float
from ..models.base import AbstractModel
from .inputs import AbstractPath, substeps_of


class AbstractStepper(eqx.Module):
    """A way to carry the state from sample to sample."""

    @abc.abstractmethod
    def states(
        self, model: AbstractModel, t: Float[Array, " time"], path: AbstractPath, initial_state: Float[Array, " state"]
    ) -> Float[Array, "time state"]:
        """States at the sample times; not finite where the simulation fails."""


class RK4(AbstractStepper):
    """The classical Runge-Kutta method of fourth order, with a fixed number of steps between two samples.

    Jumps of a zero-order hold lie between steps, so that they cost no order.

    Args:
        substeps: steps in each interval between samples.
    """

    substeps: int = eqx.field(static=True, default=1)

    def states(self, model, t, path, initial_state):
        begin, length = substeps_of(t, self.substeps)

        def step(x, now):
            t0, h, u = now
            k1 = model.rhs(t0, x, u[0])
            k2 = model.rhs(t0 + h / 2, x + h / 2 * k1, u[1])
            k3 = model.rhs(t0 + h / 2, x + h / 2 * k2, u[1])
            k4 = model.rhs(t0 + h, x + h * k3, u[2])
            return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

        def interval(x, now):
            for substep in range(self.substeps):
                x = step(x, jax.tree.map(lambda leaf, at=substep: leaf[at], now))
            return x, x

        stages = (begin, length, path.stages(t, self.substeps))
        by_interval = jax.tree.map(lambda leaf: leaf.reshape(t.size - 1, self.substeps, *leaf.shape[1:]), stages)
        _, later = jax.lax.scan(interval, initial_state, by_interval)
        return jnp.concatenate([initial_state[None], later])


class Adaptive(AbstractStepper):
    """Any diffrax solver with adaptive steps, for stiff models and for checking a fixed step.

    Args:
        solver: a diffrax solver; `diffrax.Kvaerno5()` where the model is stiff.
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
            diffrax.ODETerm(lambda time, x, _: model.rhs(time, x, path(time))),
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
        return jnp.where(good, solution.ys, jnp.nan)
