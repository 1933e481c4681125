"""Cost of a pass with process noise: `python -m benchmarks.filter_cost [--json] [--samples 751]`.

The aircraft of `reference_problem` (9 states, 10 outputs, 30 free coefficients) with random moments
in its three rotational equations. A pass is the simulation or the filter with all derivatives, and
the square-root information. Filter error has 3 intensities and 10 sensor deviations as further
parameters; its innovation form, the gain constant, has 3 gains. `FrozenGain` is filter error in the
iterations with which `FilterError(frozen_gain=True)` starts. The ratios to the pass of output error
are of one run, in turns.
"""

import argparse
import json
import sys

import equinox as eqx
import jax

from benchmarks.reference_problem.__main__ import machine
from benchmarks.reference_problem.aircraft import reference_record, user_free, user_model
from benchmarks.reference_problem.clocks import CLOCKS, time_in_turns
from benchmarks.reference_problem.problem import make_problem
from jaxid import FilterError, InnovationForm, OutputError
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.filter.filter_error import FrozenGain
from jaxid.estimation.likelihoods import AbstractLikelihood
from jaxid.estimation.problem import Problem
from jaxid.models import DiagonalNoise
from jaxid.models.base import canonical
from jaxid.models.free import initial_parameters

RATES = ("p", "q", "r")  # rad/s, states and outputs
MOMENTS = 0.01  # rad/s per sqrt(s), chosen
BASE = "output error"


def likelihoods() -> dict[str, AbstractLikelihood]:
    """Return the likelihoods that are compared, by name."""
    filter_error = FilterError(dict.fromkeys(RATES, MOMENTS))
    return {
        BASE: OutputError(),
        "filter error": filter_error,
        "filter error, gain frozen": FrozenGain(filter_error),
        "innovation form": InnovationForm({name: (name,) for name in RATES}, DiagonalNoise()),
    }


@eqx.filter_jit
def _evaluate(problem: Problem, parameters):
    return problem.evaluate(parameters)


def passes(samples: int):
    """Return a function for each likelihood that makes a pass, and its number of parameters."""
    given, made = make_problem(samples), {}
    model, records = user_model(given, given.start), as_stack(reference_record(given))
    for name, likelihood in likelihoods().items():
        wide, chosen = canonical(likelihood.prepared(model, user_free(model), records))
        problem = Problem.of(wide, chosen, records, likelihood)
        begin = initial_parameters(problem.model, problem.positions, problem.records)

        def evaluate(problem=problem, begin=begin):
            return jax.block_until_ready(_evaluate(problem, begin))

        made[name] = (evaluate, begin.shared.size)
    return made


def measure(samples: int, repeats: int, clock: str) -> list[dict]:
    """Return the time of a pass of each likelihood, and its ratio to a pass of output error."""
    made = passes(samples)
    functions = {name: evaluate for name, (evaluate, _) in made.items()}
    for evaluate in functions.values():
        evaluate()  # compiles
    times = time_in_turns(functions, repeats, 60.0, CLOCKS[clock])
    return [
        {
            "likelihood": name,
            "parameters": made[name][1],
            "milliseconds": 1e3 * timing.smallest,
            "ratio": timing.smallest / times[BASE].smallest,
        }
        for name, timing in times.items()
    ]


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.filter_cost", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    parser.add_argument("--samples", type=int, default=751)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--clock", choices=CLOCKS, default="wall")
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    rows = measure(options.samples, options.repeats, options.clock)
    if options.json:
        print(
            json.dumps(
                {"status": "measured", "samples": options.samples, **machine(), "rows": rows}
            )
        )
    else:
        for row in rows:
            print(
                f"{row['likelihood']}: {row['parameters']} parameters, "
                f"{row['milliseconds']:.2f} ms, {row['ratio']:.2f} times output error"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
