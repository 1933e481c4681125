"""Programs in JAX without jaxid's estimation: forward mode, hand-derived equations, diffrax."""

from collections.abc import Callable
from pathlib import Path

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

import jaxid
from benchmarks.reference_problem import equations, gauss_newton
from benchmarks.reference_problem.aircraft import reference_record, user_model
from benchmarks.reference_problem.equations import COUNT, runge_kutta
from benchmarks.reference_problem.gauss_newton import Fitted, Pass
from benchmarks.reference_problem.partials import output_partials, rate_partials
from benchmarks.reference_problem.problem import ReferenceProblem
from jaxid.sensitivity import value_and_jacobian


class JaxProgram:
    """Passes and fits from a function that returns outputs and sensitivities.

    Args:
        given: the problem.
        function: from theta (30,) to outputs (time, 10) and sensitivities (time, 10, 30).
    """

    def __init__(self, given: ReferenceProblem, function: Callable):
        self.given, self._sensitivities = given, jax.jit(function)
        z = jnp.asarray(given.z)
        self._pass = jax.jit(lambda theta: normal_equations(*function(theta), z))

    def evaluate(self, theta: np.ndarray) -> Pass:
        """Return cost, normal matrix and gradient."""
        cost, matrix, gradient = self._pass(theta)
        return Pass(float(cost), np.asarray(matrix), np.asarray(gradient))

    def sensitivities(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return outputs (time, 10) and sensitivities (time, 10, 30)."""
        y, S = self._sensitivities(theta)
        return np.asarray(y), np.asarray(S)

    def fit(self) -> Fitted:
        """Return the fit from the problem's start."""
        return gauss_newton.fit(self.evaluate, self.given.start)


def normal_equations(y, S, z):
    """Return cost, normal matrix and gradient with R re-estimated (Eq. 4.4)."""
    v = z - y
    deviation = jnp.sqrt(jnp.mean(v**2, axis=0))
    rows = (S / deviation[None, :, None]).reshape(-1, S.shape[-1])
    cost = len(z) * jnp.sum(jnp.log(deviation) + 0.5)
    return cost, rows.T @ rows, rows.T @ (v / deviation[None]).ravel()


def forward_mode(given: ReferenceProblem, folder: Path) -> JaxProgram:
    """Return the program that pushes 30 tangents through jaxid's simulation of the user's model."""
    record, likelihood = reference_record(given), jaxid.OutputError()

    def outputs(theta):
        model = user_model(given, theta)
        return likelihood.solve(model, record, model.start).y

    return JaxProgram(given, lambda theta: value_and_jacobian(outputs, theta))


def hand_derived(given: ReferenceProblem, folder: Path) -> JaxProgram:
    """Return the program that integrates the hand-derived sensitivity equations.

    S' = f_x S + f_theta (Eq. 4.6), at each stage of the Runge-Kutta step with the state.
    """
    c, x0 = given.constants, jnp.asarray(given.x0)
    t, u = jnp.asarray(given.t), jnp.asarray(given.u)

    def function(theta):
        def rate(both, d):
            x, S = both[:, 0], both[:, 1:]
            f_x, f_theta = rate_partials(c, theta, x, d)
            dx = jnp.stack(equations.rates(jnp, c, theta, x, d))
            return jnp.concatenate([dx[:, None], f_x @ S + f_theta], axis=1)

        def step(both, now):
            return runge_kutta(rate, both, *now), both

        def output(both, d):
            x, S = both[:, 0], both[:, 1:]
            h_x, h_theta = output_partials(c, theta, x, d)
            return jnp.stack(equations.outputs(jnp, c, theta, x, d)), h_x @ S + h_theta

        start = jnp.concatenate([x0[:, None], jnp.zeros((9, COUNT))], axis=1)
        last, earlier = jax.lax.scan(step, start, (jnp.diff(t), u[:-1], u[1:]))
        return jax.vmap(output)(jnp.concatenate([earlier, last[None]]), u)

    return JaxProgram(given, function)


def by_diffrax(given: ReferenceProblem, folder: Path) -> JaxProgram:
    """Return the program that pushes 30 tangents through diffrax.

    diffrax has no classical Runge-Kutta method of fourth order: Tsit5 takes its place, with one
    step per sample as well. The difference of the methods is below 1e-5 of each sensitivity.
    """
    t, u = jnp.asarray(given.t), jnp.asarray(given.u)
    control = diffrax.LinearInterpolation(t, u)

    def outputs(theta):
        model = user_model(given, theta)
        term = diffrax.ODETerm(lambda now, x, _: model.rhs(now, x, control.evaluate(now)))
        solution = diffrax.diffeqsolve(
            term,
            diffrax.Tsit5(),
            t[0],
            t[-1],
            None,
            model.start,
            stepsize_controller=diffrax.StepTo(t),
            saveat=diffrax.SaveAt(ts=t),
            adjoint=diffrax.ForwardMode(),
            max_steps=t.size,
            throw=False,
        )
        return jax.vmap(model.output)(t, solution.ys, u)

    return JaxProgram(given, lambda theta: value_and_jacobian(outputs, theta))
