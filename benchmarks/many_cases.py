"""Cost per case of `estimate_many`: `python -m benchmarks.many_cases [--json]`.

A small spring, 150 samples, two shared parameters and a free initial state; each case is a record
with independent noise. The table shows the processor time per case by number of cases, and of
single estimates, all compiled before. A last line shows the cost of slow cases: a tenth of the
cases starts far away and ends at the limit of 200 steps. The time of the mixed batch less the time
of the slow cases alone is divided by the time of the other cases alone.

`--devices N` distributes the cases over N host devices, and compares the wall time with one device;
`--reference N` does so for N cases of the reference problem too (30 coefficients, 751 samples), in
which the estimates take the time, not the reading of the records.

`--gpu` compares the wall time per case on JAX's default device and on the CPU, by number of
cases; its options stand in `many_cases_gpu`.
"""

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Sequence

DEVICES = "--xla_force_host_platform_device_count"
SAMPLES, NOISE = 150, 0.02
REFERENCE_SAMPLES = 751
SLOW_SHARE = 10  # one case in as many is slow
NORMAL_START = (1.2, 0.1)
SLOW_START = (0.02, 0.003)  # no convergence within the limit of 200 steps


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print one table, or with `--json` one object."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if "--gpu" in arguments:
        from benchmarks import many_cases_gpu

        return many_cases_gpu.main([one for one in arguments if one != "--gpu"])
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, nargs="+", default=[1, 100, 1000])
    parser.add_argument("--slow-cases", type=int, default=1000, help="cases of the mixed batch")
    parser.add_argument("--single", type=int, default=100, help="estimates one by one")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--devices", type=int, default=1)
    parser.add_argument("--reference", type=int, default=0, help="cases of the reference problem")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    if options.devices > 1:  # before JAX is imported
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {DEVICES}={options.devices}"
    result = measure(options)
    sys.stdout.write(json.dumps(result) + "\n" if options.json else table(result))


def measure(options: argparse.Namespace) -> dict:
    """Return all figures."""
    import jax

    import jaxid

    jaxid.configure()
    cases = spring_cases(max(*options.cases, options.slow_cases))
    result = {
        "machine": platform.processor() or platform.machine(),
        "backend": jax.default_backend(),
        "device": jax.devices()[0].device_kind,
        "single": single_cost(cases, min(options.single, len(cases[2])), options.repeats),
        "batches": [batch_cost(cases, count, options.repeats) for count in options.cases],
        "slow": slow_cost(cases, options.slow_cases, options.repeats),
    }
    if options.devices > 1:
        result["devices"] = device_cost(cases, max(options.cases), options.repeats)
        if options.reference:
            result["reference"] = device_cost(
                reference_cases(options.reference), options.reference, 1
            )
    return result


def spring_cases(count: int):
    """Return the model, the free parameters and the records."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    import jaxid

    class Spring(jaxid.AbstractModel):
        k: jax.Array
        c: jax.Array
        states, inputs, outputs = ("x", "v"), ("force",), ("x",)

        def rhs(self, t, x, u):
            return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

        def output(self, t, x, u):
            return x[:1]

    rng, t = np.random.default_rng(31), 0.1 * np.arange(SAMPLES)
    u = np.convolve(rng.normal(size=SAMPLES), np.ones(8) / 2.5, "same")[:, None]
    y = np.asarray(jaxid.simulate(Spring(1.5, 0.2), t, u, jnp.zeros(2)).y)
    records = [
        jaxid.record(t, u, y + NOISE * rng.normal(size=y.shape), inputs=("force",), outputs=("x",))
        for _ in range(count)
    ]
    model = Spring(*NORMAL_START)
    return model, jaxid.free(model, "k", "c", per_record=("initial_state",)), records


def reference_cases(count: int):
    """Return the model, the free parameters and records of the reference problem."""
    from benchmarks.many_cases_rows import reference

    problem = reference(REFERENCE_SAMPLES)
    return problem.model, problem.free, [problem.record(number) for number in range(count)]


def run(cases, count: int, starts=None, devices=None):
    """Return the results of a batch."""
    import jaxid

    model, free, records = cases
    return jaxid.estimate_many(
        model, free, records[:count], jaxid.OutputError(), starts=starts, devices=devices
    )


def least_seconds(function: Callable, repeats: int, clock: Callable[[], float]) -> float:
    """Return the shortest time of a function, which has been called before [s]."""
    function()
    times = []
    for _ in range(repeats):
        begin = clock()
        function()
        times.append(clock() - begin)
    return min(times)


def single_cost(cases, count: int, repeats: int) -> dict:
    """Return the processor time of single estimates."""
    import jax

    import jaxid

    model, free, records = cases

    def estimates():
        for record in records[:count]:
            fit = jaxid.estimate(model, free, record, jaxid.OutputError())
            jax.block_until_ready(fit.values)

    seconds = least_seconds(estimates, repeats, time.process_time)
    return {"cases": count, "ms_per_case": 1e3 * seconds / count}


def batch_cost(cases, count: int, repeats: int) -> dict:
    """Return the processor time of a batch, and its statuses and iterations."""
    seconds = least_seconds(lambda: run(cases, count), repeats, time.process_time)
    dataset = run(cases, count)
    return {
        "cases": count,
        "ms_per_case": 1e3 * seconds / count,
        "successful": int((dataset.status == "successful").sum()),
        "iterations": float(dataset.iterations.mean()),
    }


def slow_cost(cases, count: int, repeats: int) -> dict:
    """Return the cost of the other cases in a batch with slow ones, divided by their cost alone."""
    import numpy as np

    model, free, records = cases
    slow = np.arange(count) % SLOW_SHARE == SLOW_SHARE - 1
    starts = np.where(slow[:, None], SLOW_START, NORMAL_START)

    def part(chosen):
        own = [record for record, use in zip(records[:count], chosen, strict=True) if use]
        return run((model, free, own), len(own), starts=starts[chosen])

    everything = np.ones(count, bool)
    seconds = {
        name: least_seconds(lambda chosen=chosen: part(chosen), repeats, time.process_time)
        for name, chosen in (("mixed", everything), ("slow", slow), ("others", ~slow))
    }
    return {
        "cases": count,
        **{f"{name}_seconds": value for name, value in seconds.items()},
        "ratio": (seconds["mixed"] - seconds["slow"]) / seconds["others"],
    }


def device_cost(cases, count: int, repeats: int) -> dict:
    """Return the wall time on one device over that on all."""
    import jax

    one = least_seconds(lambda: run(cases, count), repeats, time.perf_counter)
    many = least_seconds(
        lambda: run(cases, count, devices=jax.devices()), repeats, time.perf_counter
    )
    return {"cases": count, "devices": len(jax.devices()), "speed_up": one / many}


def table(result: dict) -> str:
    """Return the figures as text."""
    single = result["single"]["ms_per_case"]
    lines = [
        f"{result['device']} ({result['backend']})",
        f"{'cases':>8} {'ms/case':>9} {'one by one':>11} {'ratio':>7} {'successful':>11}",
    ]
    lines += [
        f"{row['cases']:>8} {row['ms_per_case']:>9.3f} {single:>11.3f} "
        f"{single / row['ms_per_case']:>7.1f} {row['successful']:>11}"
        for row in result["batches"]
    ]
    slow = result["slow"]
    lines.append(
        f"a tenth of slow cases: the others cost {slow['ratio']:.2f} times as much (seconds: mixed "
        f"{slow['mixed_seconds']:.2f}, slow {slow['slow_seconds']:.2f}, others "
        f"{slow['others_seconds']:.2f})"
    )
    for name in ("devices", "reference"):
        if name in result:
            row = result[name]
            lines.append(
                f"{row['devices']} devices, {row['cases']} cases"
                f"{' of the reference problem' * (name == 'reference')}: "
                f"{row['speed_up']:.2f} times as fast as one"
            )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
