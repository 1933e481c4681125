"""Output sensitivities of the longitudinal aircraft by four methods: `python -m
benchmarks.sensitivities [--json]`.

Autodiff through the fixed-step scan and through diffrax, the hand-derived sensitivity equations in
JAX, and central differences of a NumPy simulation. The table shows their agreement, the time of a
pass, and the extra time of the first call.
"""

import argparse
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks import longitudinal_by_hand as by_hand
from jaxid.aircraft.flight.longitudinal import Longitudinal
from jaxid.aircraft.flight.longitudinal_flight import (
    LONGITUDINAL_SPEED,
    NOISE_DEG,
    NOISE_SI,
    level_trim,
    manoeuvres,
    true_aircraft,
)
from jaxid.models.free import Positions, all_names, insert, leaves_at
from jaxid.models.names import flatten, read_parameters
from jaxid.sensitivity import value_and_jacobian
from jaxid.simulation import RK4, Adaptive, Linear
from jaxid.simulation.simulate import run

SCAN, DIFFRAX, HAND, NUMPY = (
    "autodiff, RK4 scan",
    "autodiff, diffrax",
    "hand-derived, JAX",
    "differences, NumPy",
)
# relative; diffrax has other steps, NumPy differences
TOLERANCES = {SCAN: 0.0, DIFFRAX: 1e-6, HAND: 1e-9, NUMPY: 1e-5}

Method = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class Problem(NamedTuple):
    """A record of the aircraft, and the parameters of its sensitivities.

    Attributes:
        model: the aircraft.
        theta: coefficients and initial state in the order of `longitudinal_by_hand.NAMES`.
        t, u, z: times [s], elevator [rad] and measured outputs.
        noise: standard deviations of the outputs.
    """

    model: Longitudinal
    theta: np.ndarray
    t: np.ndarray
    u: np.ndarray
    z: np.ndarray
    noise: np.ndarray

    @property
    def constants(self) -> by_hand.Constants:
        return by_hand.Constants(
            *(float(getattr(self.model, name)) for name in by_hand.Constants._fields)
        )


def make_problem(samples: int, sample_time: float = 0.02, seed: int = 0) -> Problem:
    """A multisine about level flight, with measurement noise."""
    model = true_aircraft()
    state, elevator, thrust = jax.jit(lambda: level_trim(model, LONGITUDINAL_SPEED))()
    t = sample_time * np.arange(samples)
    u = np.asarray(elevator + manoeuvres(jnp.asarray(t))["multisine"])
    theta = np.concatenate(
        [np.asarray(read_parameters(model, by_hand.NAMES[:10])), np.asarray(state)]
    )
    model = eqx.tree_at(lambda model: model.thrust, model, thrust)
    deviations = {name: np.radians(value) for name, value in NOISE_DEG.items()} | NOISE_SI
    noise = np.array([deviations[name] for name in model.outputs])
    exact = Problem(model, theta, t, u, np.zeros(0), noise)
    y = by_hand.simulate_numpy(exact.constants, t, u, theta[:, None])[..., 0]
    return exact._replace(z=y + noise * np.random.default_rng(seed).normal(size=y.shape))


def methods(problem: Problem) -> dict[str, Method]:
    """Return each method as a function of theta.

    It returns outputs (time, output) and sensitivities (time, output, parameter).
    """
    constants, t, u = problem.constants, jnp.asarray(problem.t), jnp.asarray(problem.u)
    sizes = np.maximum(np.abs(problem.theta), np.r_[np.full(10, 0.1), 1.0, 1.0, 0.1, 0.1])
    return {
        SCAN: jax.jit(_autodiff(problem, RK4())),
        DIFFRAX: jax.jit(_autodiff(problem, Adaptive())),
        HAND: jax.jit(lambda theta: by_hand.sensitivities(constants, t, u, theta)),
        NUMPY: lambda theta: by_hand.finite_differences(
            constants, problem.t, problem.u, theta, sizes
        ),
    }


def _autodiff(problem: Problem, stepper) -> Method:
    """Return the library's method: forward-mode derivatives of `run`."""
    names = all_names(problem.model)
    at = np.array([names.index(name) for name in by_hand.NAMES])
    positions = Positions(jnp.array(at), jnp.zeros(0, int), leaves_at(problem.model, at))
    flat = jnp.concatenate([flatten(problem.model)[0], jnp.zeros(len(problem.model.states))])
    t, u = jnp.asarray(problem.t), jnp.asarray(problem.u)[:, None]

    def predict(theta):
        model, initial_state = insert(problem.model, flat, positions, theta, jnp.zeros(0))
        return run(model, t, u, initial_state, Linear(), stepper).y

    return lambda theta: value_and_jacobian(predict, theta)


def disagreement(S: np.ndarray, reference: np.ndarray) -> float:
    """Largest difference of any sensitivity, relative to the largest value of its own output and
    parameter.
    """
    size = np.max(np.abs(reference), axis=0)
    return float(
        np.max(np.max(np.abs(np.asarray(S) - reference), axis=0) / np.where(size > 0, size, 1.0))
    )


def measure(problem: Problem, repeats: int) -> list[dict]:
    """Return one row for each method: agreement, misfit and times.

    The methods are timed in turn, so that all have the same load of the machine.
    """
    functions = methods(problem)
    first, results, steady = {}, {}, {name: [] for name in functions}
    for name, function in functions.items():
        first[name], results[name] = _timed(function, problem.theta)
    for _ in range(repeats):
        for name, function in functions.items():
            steady[name].append(_timed(function, problem.theta)[0])
    seconds = {name: statistics.median(times) for name, times in steady.items()}
    reference = np.asarray(results[SCAN][1])
    rows = []
    for name, (y, S) in results.items():
        apart = disagreement(S, reference)
        misfit = float(np.sqrt(np.mean(((problem.z - np.asarray(y)) / problem.noise) ** 2)))
        rows.append(
            {
                "way": name,
                "status": "agrees" if apart <= TOLERANCES[name] else "differs",
                "misfit": misfit,
                "disagreement": apart,
                "seconds": seconds[name],
                "compile_seconds": max(first[name] - seconds[name], 0.0) if name != NUMPY else 0.0,
                "ratio_to_hand": seconds[name] / seconds[HAND],
            }
        )
    return rows


def _timed(function: Method, theta: np.ndarray) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
    begin = time.perf_counter()
    result = jax.block_until_ready(function(theta))
    return time.perf_counter() - begin, result


def table(rows: list[dict]) -> str:
    """Return the rows as a text table."""
    heads = f"{'misfit':>7} {'disagreement':>13} {'ms a pass':>10} {'/ hand':>7} {'compile s':>10}"
    lines = [f"{'way':<20} {'status':<8} {heads}"]
    for row in rows:
        lines.append(
            f"{row['way']:<20} {row['status']:<8} {row['misfit']:>7.4f} "
            f"{row['disagreement']:>13.1e} "
            f"{1e3 * row['seconds']:>10.2f} {row['ratio_to_hand']:>7.2f} "
            f"{row['compile_seconds']:>10.2f}"
        )
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if all methods agree."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.sensitivities", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else"
    )
    parser.add_argument(
        "--samples", type=int, default=750, help="length of the record (default: 750)"
    )
    parser.add_argument(
        "--repeats", type=int, default=15, help="passes of which the median is taken (default: 15)"
    )
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    # compile times are measured, not read from a file
    jax.config.update("jax_enable_compilation_cache", False)
    problem = make_problem(options.samples)
    rows = measure(problem, options.repeats)
    status = "agrees" if all(row["status"] == "agrees" for row in rows) else "differs"
    setting = {
        "samples": options.samples,
        "outputs": problem.z.shape[1],
        "parameters": problem.theta.size,
    }
    machine = {"cores": os.cpu_count(), "device": jax.devices()[0].platform, "jax": jax.__version__}
    machine["python"] = platform.python_version()
    if options.json:
        print(json.dumps({"status": status, **setting, **machine, "rows": rows}))
    else:
        print(", ".join(f"{value} {name}" for name, value in setting.items()))
        print(table(rows))
        print(f"disagreement: relative, with the first row; {machine}")
    return 0 if status == "agrees" else 1


if __name__ == "__main__":
    sys.exit(main())
