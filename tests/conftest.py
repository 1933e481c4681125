"""What every test stands on: float64, a compile cache, ranks that never promote, annotations that
execute, told seeds.

The order matters: environment, then JAX and its settings, then the import hook, and jaxid after all
of them.
"""
# ruff: noqa: E402

import ctypes
import gc
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

# In the environment, so that programs started by tests use the same.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(ROOT / ".jax_cache"))
# Small programs too: most are compiled by both workers, and reading one takes a ninth of the time.
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ["MPLBACKEND"] = "Agg"
# Tests compile much and compute little: without XLA's optimisations the suite takes half the time,
# and says the same.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
# Programs without the source lines of their operations: with annotations that execute the stack is
# deep, and to write it down takes a tenth of the time (two test files: 56 to 61 s in place of 66).
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")
# Two workers on two cores: more threads of linear algebra would wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Without the emitters a test file takes 36 s in place of 47; compiled in one part in place of 32, a
# program takes 0.7 of the processor time. XLA ends the process at a flag that it does not know, so
# another process tries each; workers inherit the result.
FASTER_COMPILATION = (
    "--xla_cpu_use_fusion_emitters=false",
    "--xla_cpu_parallel_codegen_split_count=1",
)


def flag_is_known(flag: str) -> bool:
    """True if this version of XLA accepts a flag."""
    command = [sys.executable, "-c", "import jax; jax.devices()"]
    environment = os.environ | {"XLA_FLAGS": flag}
    return not subprocess.run(command, env=environment, capture_output=True).returncode


for flag in FASTER_COMPILATION:
    if flag.partition("=")[0] not in os.environ.get("XLA_FLAGS", "") and flag_is_known(flag):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flag}".strip()

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

from jaxtyping import install_import_hook

# before any import of jaxid: shape annotations execute
install_import_hook("jaxid", "beartype.beartype")

import hypothesis
import pytest

hypothesis.settings.register_profile("jaxid", deadline=None, derandomize=True, print_blob=True)
hypothesis.settings.load_profile("jaxid")

STATM = Path("/proc/self/statm")  # on Linux: pages of memory of this process
# of the C library of GNU
TRIM = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
# Size beyond which a worker's compiled programs are released [bytes] (chosen): an eighth of the
# memory, within these limits. At 3 GB the tests of a folder take 0.9 of the time at 1.5.
LARGEST_WORKER = (1.5e9, 3e9)
CACHE_RACE = "ignore:Error (reading|writing) persistent compilation cache entry:UserWarning"


def pytest_configure(config):
    # Two workers that write one cache entry at once: JAX tells, and compiles anew.
    config.addinivalue_line("filterwarnings", CACHE_RACE)


def pytest_collection_finish():
    # Tracing makes many objects: the collector runs less often, and not over those of the imports.
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)


@pytest.fixture(scope="module", autouse=True)
def compiler_setting_stays():
    """A module that leaves another setting slows down the rest of its worker by two fifths."""
    before = jax.config.read("jax_disable_most_optimizations")
    yield
    assert jax.config.read("jax_disable_most_optimizations") == before


def trim() -> None:
    """Return free memory to the system, where the C library can."""
    if TRIM is not None:
        TRIM(0)


def is_large() -> bool:
    """True if this process is larger than `LARGEST_WORKER`, or its size is unknown."""
    if not STATM.exists():
        return True
    page, (least, most) = os.sysconf("SC_PAGE_SIZE"), LARGEST_WORKER
    allowed = min(max(os.sysconf("SC_PHYS_PAGES") * page / 8, least), most)
    return int(STATM.read_text().split()[1]) * page > allowed


@pytest.fixture(scope="module", autouse=True)
def release_compiled_programs():
    """Release the compiled programs after a module if the process has become large; a worker would
    grow by several gigabytes.

    The allocator keeps free memory, of large arrays as of released programs, unless it is trimmed:
    programs are released only if the process is still large without it.
    """
    from jaxid._foundation.memory import release_compiled_programs_if_needed

    yield
    if is_large():
        trim()
        if is_large():
            jax.clear_caches()
            trim()
    release_compiled_programs_if_needed()


@pytest.fixture
def seed() -> int:
    """The seed of a test's random numbers; JAXID_TEST_SEED gives another one. A failing test shows
    it.
    """
    value = int(os.environ.get("JAXID_TEST_SEED", "1974"))
    print(f"seed = {value} (JAXID_TEST_SEED)")  # noqa: T201
    return value


@pytest.fixture
def key(seed) -> jax.Array:
    """A JAX random key made from `seed`."""
    return jax.random.key(seed)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of measured data: JAXID_DATA, else `../shared/data` beside the repository, else a
    skip.
    """
    given = os.environ.get("JAXID_DATA")
    folder = Path(given) if given else ROOT.parent / "shared" / "data"
    if given and not folder.is_dir():
        pytest.fail(f"JAXID_DATA is {given!r}, which is not a folder.")
    if not folder.is_dir():
        pytest.skip(
            "No measured data here. Fetch Silverbox, EMPS and the cascaded tanks "
            "(https://www.nonlinearbenchmark.org) "
            "into folders silverbox, emps and cascaded_tanks, and set JAXID_DATA to the folder "
            "that holds the three."
        )
    return folder


@pytest.fixture
def compilations():
    """Names of the functions that JAX compiles during a test, from the events that it records: one
    for every program, cached on disk or not.
    """
    names = []

    def listen(event, duration, *, fun_name="", **_):
        if event == "/jax/core/compile/backend_compile_duration":
            names.append(fun_name)

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield names
    jax.monitoring.unregister_event_duration_listener(listen)


@pytest.fixture
def user_environment(reader_environment) -> dict[str, str]:
    """As `reader_environment`, for one test."""
    return dict(reader_environment)


@pytest.fixture(scope="session")
def reader_environment() -> dict[str, str]:
    """Environment of a program run as a user runs it: this package found, precision not set from
    outside.
    """
    environment = {name: value for name, value in os.environ.items() if name != "JAX_ENABLE_X64"}
    environment["PYTHONPATH"] = os.pathsep.join(
        filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])
    )
    return environment
