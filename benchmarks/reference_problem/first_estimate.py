"""Time and memory of the first estimate in a new process.

Cold: nothing is compiled. Cached: JAX's persistent compilation cache, or the folder with compiled C
code, holds what the cold process compiled.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from benchmarks.reference_problem.clocks import CLOCKS, peak_megabytes
from benchmarks.reference_problem.contenders import CONTENDERS
from benchmarks.reference_problem.problem import make_problem

ROOT = Path(__file__).resolve().parents[2]
TIMEOUT = 900.0  # s


class FirstEstimate(NamedTuple):
    """Of one process.

    Attributes:
        import_seconds: from the problem to the imported program [s].
        seconds: from the imported program to the estimates, compilation included [s].
        megabytes: peak memory of the process [MB].
    """

    import_seconds: float
    seconds: float
    megabytes: float


def measure_first(key: str, samples: int, clock: str) -> tuple[FirstEstimate, FirstEstimate]:
    """Return the cold and the cached first estimate of a contender, in a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", __name__, key, folder]
        command += ["--samples", str(samples), "--clock", clock]
        environment = os.environ | {
            "JAX_ENABLE_X64": "1",
            "JAX_COMPILATION_CACHE_DIR": str(Path(folder) / "jax"),
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
            "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
        }
        cold, cached = (_child(command, environment) for _ in range(2))
    return cold, cached


def _child(command: list[str], environment: dict[str, str]) -> FirstEstimate:
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=TIMEOUT
    )
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stderr}")
    return FirstEstimate(*json.loads(done.stdout))


def main() -> None:
    """Make one estimate and print its times and memory as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("key", choices=CONTENDERS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--samples", type=int, required=True)
    parser.add_argument("--clock", choices=CLOCKS, required=True)
    options = parser.parse_args()
    clock, given = CLOCKS[options.clock], make_problem(options.samples)
    begin = clock()
    make = CONTENDERS[options.key].load()
    imported = clock()
    program = make(given, options.folder)
    # jaxid's users call `estimate`, with checks and names around the fit
    getattr(program, "estimate", program.fit)()
    print(json.dumps(FirstEstimate(imported - begin, clock() - imported, peak_megabytes())))


if __name__ == "__main__":
    main()
