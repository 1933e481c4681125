"""jaxid itself: the pass `Problem.evaluate` and the fit `fit_problem`, for a user's model and its
own.
"""

from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxid
from benchmarks.reference_problem.aircraft import reference_record, user_free, user_model
from benchmarks.reference_problem.gauss_newton import Fitted
from benchmarks.reference_problem.identification import package_free, package_model
from benchmarks.reference_problem.problem import ReferenceProblem
from jaxid._foundation.results import RESULTS
from jaxid.estimation.estimate import as_stack, fit_problem
from jaxid.estimation.problem import Problem
from jaxid.models.free import Parameters, initial_parameters


class JaxidProgram:
    """Passes and fits by jaxid.

    Args:
        given: the problem.
        model: the model at the start of the fit.
        free: selection of the 30 coefficients, in the order of `problem.NAMES`.
    """

    def __init__(self, given: ReferenceProblem, model: jaxid.AbstractModel, free: jaxid.Free):
        self.model, self.free, self.record = model, free, reference_record(given)
        self.problem = Problem.of(model, free, as_stack(self.record), jaxid.OutputError())
        self.begin = initial_parameters(
            self.problem.model, self.problem.positions, self.problem.records
        )

    def evaluate(self, theta: np.ndarray):
        """Return cost and linearised problem: residuals, sensitivities, triangle."""
        return jax.block_until_ready(_evaluate(self.problem, self._at(theta)))

    def sensitivities(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return outputs (time, 10) and sensitivities (time, 10, 30)."""
        v, S = _sensitivities(self.problem, self._at(theta))
        return np.asarray(self.record.z - v[0]), np.asarray(S[0])

    def fit(self) -> Fitted:
        """Return the fit of the problem, compiled at the first call."""
        result = jax.block_until_ready(fit_problem(self.problem, self.begin, jaxid.GaussNewton()))
        return Fitted(
            np.asarray(result.parameters.shared),
            np.sqrt(np.diag(np.asarray(result.covariance))),
            float(result.cost),
            int(result.iterations),
            bool(result.result == RESULTS.successful),
        )

    def estimate(self) -> jaxid.Estimate:
        """Return the estimate with names, checks and diagnostics, as a user gets it."""
        return jaxid.estimate(self.model, self.free, self.record, jaxid.OutputError())

    def _at(self, theta: np.ndarray) -> Parameters:
        return Parameters(jnp.asarray(theta), self.begin.rows)


@eqx.filter_jit
def _evaluate(problem: Problem, parameters: Parameters):
    return problem.evaluate(parameters)


@eqx.filter_jit
def _sensitivities(problem: Problem, parameters: Parameters):
    return problem.sensitivities(parameters)


def _program(make_model: Callable, make_free: Callable, given: ReferenceProblem) -> JaxidProgram:
    model = make_model(given, given.start)
    return JaxidProgram(given, model, make_free(model))


def with_user_model(given: ReferenceProblem, folder: Path) -> JaxidProgram:
    """Return jaxid with the model of `aircraft`."""
    return _program(user_model, user_free, given)


def with_package_model(given: ReferenceProblem, folder: Path) -> JaxidProgram:
    """Return jaxid with its own `IdentificationModel`."""
    return _program(package_model, package_free, given)
