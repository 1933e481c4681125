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


@eqx.filter_jit
def rate(
    model: AbstractModel, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
) -> Float[Array, " state"]:
    """The right-hand side as a function of its own: traced once, however often and in whatever program it is called."""
    return model.rhs(t, x, u)


class AbstractStepper(eqx.Module):
    """A way to carry the state from sample to sample."""

    @abc.abstractmethod
    def states(
        self, model: AbstractModel, t: Float[Array, " time"], path: AbstractPath, initial_state: Float[Array, " state"]
    ) -> tuple[Float[Array, "time state"], Float[Array, "time state"]]:
        """States at the sample times and their rates there; not finite where the simulation fails."""

    def compact(self) -> "AbstractStepper":
        """The same method in the form that compiles fastest, for models with many effects."""
        return self


class RK4(AbstractStepper):
    """The classical Runge-Kutta method of fourth order, with a fixed number of steps between two samples.

    Jumps of a zero-order hold lie between steps, so that they cost no order.

    Args:
        substeps: steps in each interval between samples.
        unrolled: whether the four stages of all substeps are written out, which runs faster and, for a large model,
            compiles many times as long as a loop over them.
    """

    substeps: int = eqx.field(static=True, default=1)
    unrolled: bool = eqx.field(static=True, default=True)

    def states(self, model, t, path, initial_state):
        # One more step, of no length: the first stage of every step is the rate at a sample, which then costs nothing.
        t = jnp.append(t, t[-1])
        begin, length = substeps_of(t, self.substeps)
        stages = (begin, length, path.stages(t, self.substeps))
        by_interval = jax.tree.map(lambda leaf: leaf.reshape(t.size - 1, self.substeps, *leaf.shape[1:]), stages)
        step = self._written_out if self.unrolled else self._in_a_loop

        def interval(x, now):
            later, rates = jax.lax.scan(lambda x, now: step(model, x, *now), x, now, unroll=self.unrolled)
            return later, (x, rates[0])

        return jax.lax.scan(interval, initial_state, by_interval)[1]

    def compact(self):
        return RK4(self.substeps, unrolled=False)

    @staticmethod
    def _written_out(model, x, t, h, u):
        """The state after a step, and its rate before it."""
        k1 = rate(model, t, x, u[0])
        k2 = rate(model, t + h / 2, x + h / 2 * k1, u[1])
        k3 = rate(model, t + h / 2, x + h / 2 * k2, u[1])
        k4 = rate(model, t + h, x + h * k3, u[2])
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), k1

    @staticmethod
    def _in_a_loop(model, x, t, h, u):
        def stage(carry, now):
            k, total = carry
            reach, weight, u = now
            k = rate(model, t + reach * h, x + reach * h * k, u)
            return (k, total + weight * k), k

        nodes = (jnp.array([0.0, 0.5, 0.5, 1.0]), jnp.array([1.0, 2.0, 2.0, 1.0]), u[jnp.array([0, 1, 1, 2])])
        (_, total), rates = jax.lax.scan(stage, (jnp.zeros_like(x), jnp.zeros_like(x)), nodes)
        return x + h / 6 * total, rates[0]


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
            diffrax.ODETerm(lambda time, x, _: model.rhs(jnp.asarray(time), x, path(jnp.asarray(time)))),
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
