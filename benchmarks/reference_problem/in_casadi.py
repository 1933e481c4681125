"""CasADi: sensitivity equations of one Runge-Kutta step, accumulated over the record.

The step and its Jacobians are one expression graph; it is interpreted, or written as C and
compiled. R and the normal equations are computed by NumPy.
"""

import os
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np

from benchmarks.reference_problem import equations, gauss_newton
from benchmarks.reference_problem.equations import COUNT, Constants, runge_kutta
from benchmarks.reference_problem.gauss_newton import Fitted, Pass, normal_pass
from benchmarks.reference_problem.in_c import compiler
from benchmarks.reference_problem.problem import ReferenceProblem

STATES, OUTPUTS, CONTROLS = 9, 10, 3
FLAGS = ("-O3", "-march=native", "-ffast-math", "-fPIC", "-shared", "-w")


class CasadiFunctions:
    """The functions of the equations under CasADi's names."""

    sqrt, sin, cos, arctan2, arcsin = ca.sqrt, ca.sin, ca.cos, ca.atan2, ca.asin


def step_function(c: Constants) -> ca.Function:
    """Return one step: state and S at the next sample, outputs and their sensitivities at this
    one.
    """
    x, theta = ca.SX.sym("x", STATES), ca.SX.sym("theta", COUNT)
    before, after = ca.SX.sym("before", CONTROLS), ca.SX.sym("after", CONTROLS)
    h, S = ca.SX.sym("h"), ca.SX.sym("S", STATES, COUNT)

    def rate(x, d):
        return ca.vertcat(*equations.rates(CasadiFunctions, c, theta, x, d))

    following = runge_kutta(rate, x, h, before, after)
    y = ca.vertcat(*equations.outputs(CasadiFunctions, c, theta, x, before))
    S_following = ca.jacobian(following, x) @ S + ca.jacobian(following, theta)
    S_outputs = ca.jacobian(y, x) @ S + ca.jacobian(y, theta)
    return ca.Function(
        "step",
        [ca.horzcat(x, S), theta, before, after, h],
        [ca.horzcat(following, S_following), y, ca.densify(S_outputs)],
        {"cse": True},
    )


def sensitivity_function(given: ReferenceProblem) -> ca.Function:
    """Return the function from theta to outputs (10, time) and sensitivities (10, 30 time)."""
    count, u = given.t.size, given.u
    step = step_function(given.constants).mapaccum("record", count)
    theta = ca.MX.sym("theta", COUNT)
    start = np.column_stack([given.x0, np.zeros((STATES, COUNT))])
    following = np.concatenate([u[1:], u[-1:]])
    h = np.append(np.diff(given.t), 0.0)
    _, y, S = step(start, ca.repmat(theta, 1, count), u.T, following.T, h[None])
    return ca.Function("sensitivities", [theta], [y, S])


class CasadiProgram:
    """Passes of a CasADi function, by its buffers: no copy of arguments and results.

    Args:
        given: the problem.
        function: from theta to outputs and sensitivities.
    """

    def __init__(self, given: ReferenceProblem, function: ca.Function):
        count = given.t.size
        self.given = given
        self._theta = np.zeros(COUNT)
        # column-major in CasADi
        self._y, self._S = np.zeros((count, OUTPUTS)), np.zeros((count, COUNT, OUTPUTS))
        self._buffer, self._run = function.buffer()
        self._buffer.set_arg(0, memoryview(self._theta))
        self._buffer.set_res(0, memoryview(self._y.reshape(-1)))
        self._buffer.set_res(1, memoryview(self._S.reshape(-1)))

    def sensitivities(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return outputs (time, 10) and sensitivities (time, 10, 30)."""
        self._theta[:] = theta
        self._run()
        return self._y.copy(), self._S.transpose(0, 2, 1).copy()

    def evaluate(self, theta: np.ndarray) -> Pass:
        """Return cost, normal matrix and gradient."""
        return normal_pass(*self.sensitivities(theta), self.given.z)

    def fit(self) -> Fitted:
        """Return the fit from the problem's start."""
        return gauss_newton.fit(self.evaluate, self.given.start)


def interpreted(given: ReferenceProblem, folder: Path) -> CasadiProgram:
    """Return the program by CasADi's virtual machine."""
    return CasadiProgram(given, sensitivity_function(given))


def generated(given: ReferenceProblem, folder: Path) -> CasadiProgram:
    """Return the program by generated C, compiled unless the folder holds it."""
    library = folder / f"casadi_{given.t.size}.so"
    if not library.exists():
        folder.mkdir(parents=True, exist_ok=True)
        source = f"casadi_{given.t.size}_{os.getpid()}.c"
        # CasADi writes into a folder given with its separator, and the file by its bare name
        generator = ca.CodeGenerator(source)
        generator.add(sensitivity_function(given))
        generator.generate(f"{folder}{os.sep}")
        command = [compiler() or "cc", *FLAGS, str(folder / source), "-o", str(library), "-lm"]
        subprocess.run(command, check=True, capture_output=True, text=True)
    return CasadiProgram(given, ca.external("sensitivities", str(library)))
