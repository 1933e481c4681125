"""What every test stands on: float64, a compile cache, ranks that never promote, annotations that
execute, told seeds.

The order matters: environment, then JAX and its settings, then the import hook, and jaxid after all
of them.
"""
# ruff: noqa: E402

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

# In the environment, so that programs started by tests use the same.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(ROOT / ".jax_cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
os.environ["MPLBACKEND"] = "Agg"
# Tests compile much and compute little: without XLA's optimisations the suite takes half the time,
# and says the same.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
# Two workers on two cores: more threads of linear algebra would wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# With this flag a test file takes 36 s in place of 47. XLA ends the process at a flag that it does
# not know, so another process tries it; workers inherit the result.
FEWER_EMITTERS = "--xla_cpu_use_fusion_emitters=false"


def flag_is_known(flag: str) -> bool:
    """True if this version of XLA accepts a flag."""
    command = [sys.executable, "-c", "import jax; jax.devices()"]
    environment = os.environ | {"XLA_FLAGS": flag}
    return not subprocess.run(command, env=environment, capture_output=True).returncode


if "xla_cpu_use_fusion_emitters" not in os.environ.get("XLA_FLAGS", "") and flag_is_known(
    FEWER_EMITTERS
):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {FEWER_EMITTERS}".strip()

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

CACHE_RACE = "ignore:Error (reading|writing) persistent compilation cache entry:UserWarning"


def pytest_configure(config):
    # Two workers that write one cache entry at once: JAX tells, and compiles anew.
    config.addinivalue_line("filterwarnings", CACHE_RACE)


@pytest.fixture(scope="module", autouse=True)
def forget_compiled_programs():
    """Programs that one module compiled are not kept for the next: a worker would grow by several
    gigabytes.
    """
    yield
    jax.clear_caches()


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
