"""Cost of a pass with many columns: `python -m benchmarks.columns [--json] [--candidates 0]`.

Sensitivities of the coupled flight of `python -m jaxid` to its free parameters and to all
parameters of its candidate effects, of which many are drawn from the library (all by default). By
linearised steps and by forward mode through the simulation, in one run: seconds to trace, to
compile and to run, temporary memory, and the largest difference relative to the largest entry of a
column. With `--columns` only the first ones are free, as in the fits of a study.
"""

import argparse
import json
import sys

import equinox as eqx
import jax
import numpy as np

from benchmarks.reference_problem.__main__ import machine
from benchmarks.reference_problem.clocks import CLOCKS
from jaxid import OutputError
from jaxid._foundation.compiler import FAST, is_known
from jaxid._foundation.host import to_device
from jaxid.aircraft.flight.coupled_flight import coupled_flight
from jaxid.effects import Augmented
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.model_programs import sensitivities, simulating
from jaxid.loop.columns import Columns
from jaxid.models.base import canonical
from jaxid.models.free import all_names, flat_vectors, leaves_at
from jaxid.simulation import RK4
from jaxid.study.candidates import candidates

METHODS = {
    "linearised steps": RK4(),
    "forward mode through the simulation": RK4(unrolled=False, linearised=False),
}


def arguments_of(candidate_count: int, samples: int, records: int, columns: int):
    """Return the arguments of `model_programs.sensitivities`, without the likelihood.

    Args:
        candidate_count: number of candidates; 0 for all.
        samples, records: size of the data.
        columns: number of free parameters besides those of each record; 0 for all.
    """
    flight = coupled_flight(jax.random.key(0), samples)
    stack = as_stack([*flight.train, *flight.check][:records])
    known = candidates(flight.model, flight.free, as_stack(list(flight.train)))
    if candidate_count:
        drawn = np.random.default_rng(0).choice(len(known), candidate_count, replace=False)
        known = [known[k] for k in sorted(drawn)]
    model = canonical(Augmented(flight.model, tuple(known)))
    names = (*flight.free.per_record, *Columns(flight.free, known).names)
    position = {name: number for number, name in enumerate(all_names(model))}
    at = np.array([position[name] for name in names], int)
    leaves = leaves_at(model, at)
    if columns:
        at = at[: len(flight.free.per_record) + columns]
    return model, flat_vectors(model, stack), stack.anonymous(), to_device(at), leaves


def measure(method: str, arguments, repeats: int, clock: str):
    """Return the costs of one method, and its sensitivities."""
    model, flat, records, at, leaves = arguments
    likelihood = simulating(canonical(OutputError(stepper=METHODS[method])))
    arrays, rest = eqx.partition((model, flat, records, likelihood, at), eqx.is_array)

    def function(arrays):
        model, flat, records, likelihood, at = eqx.combine(arrays, rest)
        return sensitivities(model, flat, records, likelihood, at, leaves)

    seconds, options = CLOCKS[clock], {n: value for n, value in FAST.items() if is_known(n, value)}
    times = [seconds()]
    lowered = jax.jit(function).lower(arrays)
    times.append(seconds())
    compiled = lowered.compile(compiler_options=options)
    times.append(seconds())
    _, S = jax.block_until_ready(compiled(arrays))
    runs = []
    for _ in range(repeats):
        begin = seconds()
        jax.block_until_ready(compiled(arrays))
        runs.append(seconds() - begin)
    memory = compiled.memory_analysis()
    return {
        "method": method,
        "columns": int(at.size),
        "states": len(model.states),
        "trace_seconds": times[1] - times[0],
        "compile_seconds": times[2] - times[1],
        "run_seconds": min(runs),
        "temporary_megabytes": None if memory is None else memory.temp_size_in_bytes / 1e6,
    }, np.asarray(S)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.columns", description=(__doc__ or "").splitlines()[0]
    )
    add = parser.add_argument
    add("--json", action="store_true", help="print one JSON object, nothing else")
    add("--candidates", type=int, default=0, help="drawn from the library (default: all)")
    add("--columns", type=int, default=0, help="free parameters (default: all)")
    add("--samples", type=int, default=501)
    add("--records", type=int, default=3)
    add("--repeats", type=int, default=3)
    add("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    add("--clock", choices=CLOCKS, default="wall")
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    problem = arguments_of(options.candidates, options.samples, options.records, options.columns)
    rows, results = [], []
    for method in options.methods:
        row, S = measure(method, problem, options.repeats, options.clock)
        rows.append(row)
        results.append(S)
    size = np.max(np.abs(results[-1]), axis=(0, 1, 2))
    error = np.max(np.abs(results[0] - results[-1]), axis=(0, 1, 2))
    setting = {"samples": options.samples, "records": options.records, "clock": options.clock}
    difference = float(np.max(error / np.where(size > 0, size, 1.0)))
    report = {"status": "measured", **setting, **machine(), "difference": difference, "rows": rows}
    if options.json:
        print(json.dumps(report))
    else:
        for row in rows:
            print(*(f"{name} {value}" for name, value in row.items()), sep=", ")
        print(f"largest difference {difference:.1e}; {setting}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
