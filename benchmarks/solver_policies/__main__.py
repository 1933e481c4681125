"""Convergence from many starts: `python -m benchmarks.solver_policies [--json] [--starts 200]
[--only NAME ...]`.

Twenty problems, sixteen static ones of the literature and four of simulated systems, are solved
from random starts by Gauss-Newton with the report's fixes (section 4.3.1: a and b in all; c
truncates weak eigenvalues, d raises them, e is the two-step procedure), with damping in place of a
fix, and by SciPy: Levenberg and Marquardt (`lm`), trust region (`trf`) and dogleg (`dogbox`). Each
end counts once:

    lowest      at the lowest cost that any of them reached, or that is published,
    elsewhere   at a higher cost, and called converged by the method,
    failed      not called converged.

A start is `value exp(0.7 e)`, with e standard normal, or `0.3 e` where the value is zero. A cost is
the lowest if it is within a millionth of the fall from the standard start.
"""

import argparse
import json
import sys
import time
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from benchmarks.reference_problem.__main__ import machine
from benchmarks.solver_policies.dynamic_problems import dynamic_problems
from benchmarks.solver_policies.static_problems import STATIC, StaticProblem
from jaxid import AbstractModel, GaussNewton, OutputError, Record, free, record
from jaxid._foundation.types import Array
from jaxid.batches import estimate_many
from jaxid.estimation import Clip, Damp, Plain, Truncate, TwoStep
from jaxid.estimation.problem import Problem
from jaxid.models import FixedNoise, Free, Parameters
from jaxid.models.free import initial_parameters

POLICIES = {"a, b": Plain(), "c": Truncate(), "d": Clip(), "e": TwoStep(), "damped": Damp()}
SCIPY = ("lm", "trf", "dogbox")
CONVERGED = ("successful", "at_bound", "undetermined")
SPREAD, SPREAD_OF_ZERO = 0.7, 0.3
SAME_COST = 1e-6


class Residuals(AbstractModel):
    """A static model whose output at sample i is element i of a function of the parameters."""

    theta: Array
    function: Any = eqx.field(static=True)
    states, inputs, outputs = (), ("row",), ("residual",)

    def rhs(self, t, x, u):
        return jnp.zeros(0)

    def output(self, t, x, u):
        return self.function(self.theta)[u.astype(int)]


class Case(NamedTuple):
    """A problem as `estimate_many` takes it.

    Attributes:
        model: the model at the standard start.
        free: its free parameters.
        record: the record.
        variance: known variance of the noise of each output.
        least: least sum of squares that is published, or infinity.
    """

    model: AbstractModel
    free: Free
    record: Record
    variance: np.ndarray
    least: float

    @property
    def likelihood(self) -> OutputError:
        """Output error with the known noise."""
        return OutputError(noise=FixedNoise(self.variance))


class Ends(NamedTuple):
    """Ends of one method from all starts: sums of squares, and whether it calls them converged."""

    squares: np.ndarray
    converged: np.ndarray
    seconds: float


def static_case(problem: StaticProblem) -> Case:
    """Return a static problem with one row per sample, and noise of the size of its minimum."""
    start = np.array(problem.start)
    rows = problem.function(jnp.asarray(start))
    row = np.arange(rows.size, dtype=float)
    made = record(
        row, row[:, None], np.zeros((rows.size, 1)), inputs=("row",), outputs=("residual",)
    )
    model = Residuals(jnp.asarray(start), problem.function)
    variance = max(problem.least, 1e-6 * float(jnp.sum(rows**2))) / rows.size
    return Case(model, free(model, "theta"), made, np.array([variance]), problem.least / variance)


def cases() -> dict[str, Case]:
    """Return all problems by name."""
    found = {name: static_case(problem) for name, problem in STATIC.items()}
    for name, problem in dynamic_problems().items():
        chosen, variance = free(problem.model, *problem.free), np.square(problem.noise)
        found[name] = Case(problem.model, chosen, problem.record, variance, np.inf)
    return found


class Evaluation(NamedTuple):
    """The residuals of a case in units of the noise, their derivatives, and the standard start."""

    residuals: Any
    jacobian: Any
    start: np.ndarray


def evaluation(case: Case) -> Evaluation:
    """Return compiled functions of a vector of parameters."""
    stack = jax.tree.map(lambda leaf: leaf[None], case.record)
    problem = Problem.of(case.model, case.free, stack, case.likelihood)
    deviation = jnp.sqrt(case.variance)

    def at(theta):
        return Parameters(theta, jnp.zeros((1, 0)))

    @jax.jit
    def residuals(theta):
        return (problem.residuals(at(theta)) / deviation).reshape(-1)

    @jax.jit
    def jacobian(theta):
        S = problem.sensitivities(at(theta))[1] / deviation[:, None]
        return -S.reshape(-1, S.shape[-1])

    start = initial_parameters(problem.model, problem.positions, problem.records).shared
    return Evaluation(residuals, jacobian, np.asarray(start))


def starts_of(start: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Return random starts, the standard start first."""
    e = np.random.default_rng(seed).normal(size=(count - 1, start.size))
    drawn = np.where(start == 0.0, SPREAD_OF_ZERO * e, start * np.exp(SPREAD * e))
    return np.concatenate([start[None], drawn])


def by_jaxid(case: Case, policy, starts: np.ndarray, residuals) -> Ends:
    """Return the ends of Gauss-Newton with one of the fixes."""
    begin = time.process_time()
    results = estimate_many(
        case.model,
        case.free,
        [case.record] * len(starts),
        case.likelihood,
        starts=starts,
        solver=GaussNewton(policy=policy),
    )
    seconds = time.process_time() - begin
    squares = np.array([_squares(residuals, theta) for theta in results["values"].values])
    return Ends(squares, np.isin(results["status"].values, CONVERGED), seconds)


def by_scipy(method: str, starts: np.ndarray, made: Evaluation) -> Ends:
    """Return the ends of a method of SciPy; an error of SciPy counts as a failure."""
    begin, squares, converged = time.process_time(), [], []
    for start in starts:
        try:
            end = least_squares(
                lambda theta: np.asarray(made.residuals(theta)),
                start,
                jac=lambda theta: np.asarray(made.jacobian(theta)),
                method=method,
                x_scale="jac",
            )
            squares.append(_squares(made.residuals, end.x))
            converged.append(end.status > 0)
        except ValueError:  # residuals that are not finite
            squares.append(np.inf)
            converged.append(False)
    return Ends(np.array(squares), np.array(converged), time.process_time() - begin)


def _squares(residuals, theta: np.ndarray) -> float:
    value = float(jnp.sum(residuals(theta) ** 2))
    return value if np.isfinite(value) else np.inf


def compare(case: Case, count: int, seed: int = 1974) -> dict[str, dict[str, float]]:
    """Return the counts of each method on one problem."""
    made = evaluation(case)
    starts = starts_of(made.start, count, seed)
    ends = {
        name if name == "damped" else f"fix {name}": by_jaxid(case, policy, starts, made.residuals)
        for name, policy in POLICIES.items()
    }
    if made.residuals(made.start).size >= made.start.size:
        ends |= {f"SciPy {method}": by_scipy(method, starts, made) for method in SCIPY}
    least = min(case.least, *(float(np.min(one.squares)) for one in ends.values()))
    near = least + SAME_COST * (_squares(made.residuals, made.start) - least)
    return {
        name: {
            "lowest": int(np.sum(one.squares <= near)),
            "elsewhere": int(np.sum((one.squares > near) & one.converged)),
            "failed": int(np.sum((one.squares > near) & ~one.converged)),
            "seconds": one.seconds,
        }
        for name, one in ends.items()
    }


def table(results: dict[str, dict[str, dict[str, float]]]) -> str:
    """Return the counts `lowest / elsewhere / failed` as text, a line per problem."""
    methods = list(next(iter(results.values())))
    lines = [f"{'lowest/elsewhere/failed':30}" + "".join(f"{name:>14}" for name in methods)]
    counts = ("lowest", "elsewhere", "failed")
    for name, row in results.items():
        cells = ["/".join(str(row[method][key]) for key in counts) for method in methods]
        lines.append(f"{name:30}" + "".join(f"{cell:>14}" for cell in cells))
    totals = {m: [sum(row[m][key] for row in results.values()) for key in counts] for m in methods}
    cells = ["/".join(map(str, totals[method])) for method in methods]
    return "\n".join([*lines, f"{'all':30}" + "".join(f"{cell:>14}" for cell in cells)])


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; 0 where every problem ran."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.solver_policies", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--starts", type=int, default=200, help="starts of each problem")
    parser.add_argument("--only", nargs="+", help="names of problems")
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    results = {}
    for name, case in cases().items():
        if options.only is None or name in options.only:
            print(name, file=sys.stderr, flush=True)
            results[name] = compare(case, options.starts)
    if options.json:
        print(json.dumps({"status": "measured", "machine": machine(), "problems": results}))
    else:
        print(table(results))
    return 0


if __name__ == "__main__":
    sys.exit(main())
