"""The programs that solve the reference problem.

Each is a function `make(problem, folder)` of one module, which is imported when the program is
made: a process that runs one of them loads nothing of the others. The folder keeps what a compiler
made. A program has three methods: `evaluate(theta)`, `sensitivities(theta)` and `fit()`.
"""

import importlib
import importlib.util
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from benchmarks.reference_problem.gauss_newton import Fitted
from benchmarks.reference_problem.in_c import compiler
from benchmarks.reference_problem.problem import SAMPLES, ReferenceProblem


class Program(Protocol):
    """A program made for one problem."""

    def evaluate(self, theta: np.ndarray) -> object:
        """Return the result of one pass: simulation, sensitivities, R, information."""
        ...

    def sensitivities(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return outputs (time, 10) and sensitivities (time, 10, 30)."""
        ...

    def fit(self) -> Fitted:
        """Return the fit from the problem's start."""
        ...


class Contender(NamedTuple):
    """A program that may be made.

    Attributes:
        name: for the table.
        module, function: where it is made.
        sensitivity_tolerance: largest difference of a sensitivity from the reference, relative to
            the largest entry of its column.
        estimate_tolerance: largest difference of an estimate from the reference [standard errors].
        needs_compiler: True if it needs a C compiler.
        package: a package that it needs and jaxid does not, or None.
        order: of its difference from the classical Runge-Kutta method in the step; the tolerances,
            which are those of 50 samples a second, grow with it. Zero if it takes the same steps.
    """

    name: str
    module: str
    function: str
    sensitivity_tolerance: float
    estimate_tolerance: float
    needs_compiler: bool = False
    package: str | None = None
    order: int = 0

    def tolerances(self, samples: int) -> tuple[float, float]:
        """Return the tolerances of sensitivities and of estimates for a number of samples."""
        growth = ((SAMPLES - 1) / (samples - 1)) ** self.order
        return growth * self.sensitivity_tolerance, growth * self.estimate_tolerance

    def missing(self) -> str | None:
        """Return what keeps the program from being made, None if nothing does."""
        if self.needs_compiler and compiler() is None:
            return "no C compiler"
        if self.package is not None and importlib.util.find_spec(self.package) is None:
            return "not installed"
        return None

    def load(self):
        """Return the function that makes the program, with its module imported."""
        module = importlib.import_module(f"benchmarks.reference_problem.{self.module}")
        return getattr(module, self.function)

    def make(self, given: ReferenceProblem, folder: Path) -> Program:
        """Return the program for a problem."""
        return self.load()(given, folder)


# Derived: programs that take the same steps differ by rounding alone, about 1e-14 times the
# number of operations that cancel. Tsit5 and differences have errors of their own.
EXACT, EXACT_ESTIMATE = 1e-9, 1e-4
CONTENDERS = {
    "c": Contender(
        "C, hand-derived", "in_c", "VariationalC", EXACT, EXACT_ESTIMATE, needs_compiler=True
    ),
    "user": Contender("jaxid, user's model", "in_jaxid", "with_user_model", EXACT, EXACT_ESTIMATE),
    "package": Contender(
        "jaxid, IdentificationModel", "in_jaxid", "with_package_model", EXACT, EXACT_ESTIMATE
    ),
    "jvp": Contender("JAX, jvp of the scan", "in_jax", "forward_mode", EXACT, EXACT_ESTIMATE),
    "hand": Contender("JAX, hand-derived", "in_jax", "hand_derived", EXACT, EXACT_ESTIMATE),
    "diffrax": Contender("diffrax, Tsit5", "in_jax", "by_diffrax", 1e-5, 1e-3, order=4),
    "casadi_c": Contender(
        "CasADi, generated C",
        "in_casadi",
        "generated",
        EXACT,
        EXACT_ESTIMATE,
        needs_compiler=True,
        package="casadi",
    ),
    "casadi": Contender(
        "CasADi, interpreted",
        "in_casadi",
        "interpreted",
        EXACT,
        EXACT_ESTIMATE,
        package="casadi",
    ),
    "numpy": Contender("NumPy and SciPy", "in_numpy", "NumpyDifferences", 1e-3, 5e-2),
}
# Sensitivities, estimates and standard errors with which the others are compared.
REFERENCE = CONTENDERS["hand"]
