"""NumPy with forward differences and SciPy's `least_squares`."""

from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from benchmarks.reference_problem import equations
from benchmarks.reference_problem.equations import COUNT, runge_kutta
from benchmarks.reference_problem.gauss_newton import Fitted, Pass, errors_of, normal_pass
from benchmarks.reference_problem.problem import ReferenceProblem

# Relative step of the differences; chosen near the square root of the rounding, where the errors of
# rounding and of curvature are both small.
STEP = 1e-6
# The weights are renewed until the estimates move by less [standard errors]; chosen.
SETTLED, MAX_ROUNDS = 1e-3, 30


class NumpyDifferences:
    """Passes by NumPy: all perturbed simulations run side by side as columns of arrays."""

    def __init__(self, given: ReferenceProblem, folder: Path):
        self.given, self._passes = given, 0

    def outputs(self, theta: np.ndarray) -> np.ndarray:
        """Return the outputs (time, 10, case) for coefficients (30, case)."""
        c, t, u, x0, _ = self._known()

        def rate(x, d):
            return np.array(equations.rates(np, c, theta, x, d))

        x = [np.repeat(x0[:, None], theta.shape[1], axis=1)]
        for h, before, after in zip(np.diff(t), u[:-1], u[1:], strict=True):
            x.append(runge_kutta(rate, x[-1], h, before, after))
        states, controls = np.stack(x, axis=1), u.T[:, :, None]
        rows = equations.outputs(np, c, theta[:, None, :], states, controls)
        return np.stack(np.broadcast_arrays(*rows), axis=1)

    def sensitivities(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return outputs (time, 10) and forward differences (time, 10, 30)."""
        self._passes += 1
        steps = STEP * np.maximum(np.abs(theta), 1e-3)
        y = self.outputs(np.column_stack([theta, theta[:, None] + np.diag(steps)]))
        return y[..., 0], (y[..., 1:] - y[..., :1]) / steps

    def evaluate(self, theta: np.ndarray) -> Pass:
        """Return cost, normal matrix and gradient."""
        return normal_pass(*self.sensitivities(theta), self.given.z)

    def fit(self) -> Fitted:
        """Return the fit: weighted least squares, and new weights, in turn until settled."""
        theta, self._passes, settled = self.given.start, 0, False
        rounds = 0
        while not settled and rounds < MAX_ROUNDS:
            deviation = np.sqrt(np.mean((self.given.z - self._simulated(theta)) ** 2, axis=0))
            solution = least_squares(
                lambda x, w=deviation: ((self._simulated(x) - self.given.z) / w).ravel(),
                theta,
                jac=lambda x, w=deviation: (self.sensitivities(x)[1] / w[:, None]).reshape(
                    -1, COUNT
                ),
                x_scale="jac",
            )
            errors = errors_of(solution.jac.T @ solution.jac)
            settled = float(np.max(np.abs(solution.x - theta) / errors)) < SETTLED
            theta, rounds = solution.x, rounds + 1
        v = self.given.z - self._simulated(theta)
        cost = len(v) * float(np.sum(0.5 * np.log(np.mean(v**2, axis=0)) + 0.5))
        return Fitted(theta, errors, cost, self._passes, settled)

    def _simulated(self, theta):
        c, t, u, x0, _ = self._known()
        return equations.simulate(c, t, u, x0, theta)[1]

    def _known(self):
        given = self.given
        return given.constants, given.t, given.u, given.x0, given.z
