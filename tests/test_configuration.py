"""`jaxid.configure`: float64, compilation cache and threads of linear algebra, by one call.

Each call runs in a new process, so that its settings do not reach other tests.
"""

import json
import subprocess
import sys
from types import SimpleNamespace

import pytest

import jaxid
from jaxid._foundation.checks import InputError
from jaxid._foundation.device import require_threads

SETTINGS = (
    "jax_enable_x64",
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)
REPORT = f"""
import json
print(json.dumps([jax.config.values[name] for name in {SETTINGS}]))
"""


@pytest.fixture
def new_environment(user_environment, tmp_path):
    """Environment without JAX's variables of the cache, whose user cache is a temporary folder."""
    environment = {
        name: value
        for name, value in user_environment.items()
        if "CACHE" not in name.upper() or not name.startswith("JAX_")
    }
    return environment | {"XDG_CACHE_HOME": str(tmp_path / "user cache")}


def run(code: str, environment: dict[str, str]) -> subprocess.CompletedProcess:
    """Return the finished process of a program that imports jax and jaxid."""
    command = [sys.executable, "-W", "error", "-c", f"import jax, jaxid\n{code}"]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=300, check=False
    )


def settings(code: str, environment: dict[str, str]) -> list:
    """Return the values of `SETTINGS` after a program."""
    done = run(code + REPORT, environment)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_objects_of_the_imports_are_exempt_from_garbage_collection_once(new_environment):
    done = run(
        "import gc\njaxid.configure(cache=False)\nfirst = gc.get_freeze_count()\n"
        "kept = [[] for _ in range(1000)]\njaxid.configure(cache=False)\n"
        "print(first, gc.get_freeze_count() - first)",
        new_environment,
    )
    first, more = map(int, done.stdout.split())
    assert first > 10_000
    assert more < 1000


def test_default_is_float64_and_the_user_cache(new_environment, tmp_path):
    folder = tmp_path / "user cache" / "jaxid"
    assert settings("jaxid.configure()\njaxid.configure()", new_environment) == [
        *(True, str(folder), 0.0, -1)
    ]
    assert folder.is_dir()


def test_default_without_xdg_is_below_the_home_folder(new_environment, tmp_path):
    environment = new_environment | {"HOME": str(tmp_path), "XDG_CACHE_HOME": ""}
    folder = settings("jaxid.configure()", environment)[1]
    assert folder == str(tmp_path / ".cache" / "jaxid")


def test_folder_and_threshold_of_the_environment_are_kept(new_environment, tmp_path):
    environment = new_environment | {
        "JAX_COMPILATION_CACHE_DIR": str(tmp_path / "chosen"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.5",
    }
    assert settings("jaxid.configure()", environment) == [
        *(True, str(tmp_path / "chosen"), 0.5, -1)
    ]


def test_false_leaves_settings_unchanged(new_environment, tmp_path):
    done = run(f"{REPORT}\njaxid.configure(cache=False, float64=False)\n{REPORT}", new_environment)
    before, after = done.stdout.splitlines()
    assert len(json.loads(before)) == len(SETTINGS)
    assert after == before
    assert not (tmp_path / "user cache").exists()


NPROC = """
import os

def threads(**variables):
    os.environ.pop("NPROC", None)
    os.environ.update(variables)
    jaxid.configure(cache=False)
    print(os.environ.get("NPROC"))

flags = os.environ.get("XLA_FLAGS", "")
threads()
threads(XLA_FLAGS=f"{flags} --xla_force_host_platform_device_count=5")
threads(NPROC="3")
"""


def test_pool_has_threads_for_several_devices_unless_the_user_sets_their_number(new_environment):
    none, five, chosen = run(NPROC, new_environment).stdout.splitlines()
    assert (none, chosen) == ("None", "3")
    assert int(five) >= 20
    six = run(NPROC, new_environment | {"JAX_NUM_CPU_DEVICES": "6"}).stdout.splitlines()
    assert int(six[0]) >= 24


def test_devices_that_decompose_batches_at_once_do_not_stand_still(new_environment):
    # Without `configure` it stood still in five of five trials on two processors (jax 0.10.2).
    code = """
jaxid.configure(cache=False)
import jax.numpy as jnp, numpy as np
from jax.sharding import Mesh, PartitionSpec

def local(rows):
    def step(total, _):
        return total + jnp.sum(jnp.linalg.qr(rows + 1e-9 * total, mode="r")), None
    return jax.lax.scan(step, 0.0, None, length=3000)[0][None]

split = PartitionSpec("device")
mesh = Mesh(jax.devices(), ("device",))
both = jax.shard_map(local, mesh=mesh, in_specs=split, out_specs=split, check_vma=False)
rows = np.random.default_rng(0).normal(size=(32, 200, 30))
print(jax.jit(both)(jnp.asarray(rows)).shape)
"""
    flags = f"{new_environment.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    without = {name: value for name, value in new_environment.items() if name != "NPROC"}
    done = run(code, without | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"})
    assert done.stdout == "(2,)\n", done.stderr


def test_several_devices_on_too_few_threads_are_refused():
    one, other = (SimpleNamespace(platform="cpu") for _ in range(2))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NPROC", "7")
        require_threads([one])
        require_threads([one, SimpleNamespace(platform="gpu")])
        with pytest.raises(InputError, match=r"2 CPU devices share 7 threads.*NPROC.*8 or more"):
            require_threads([one, other])
        patch.setenv("NPROC", "8")
        require_threads([one, other])


def test_every_program_is_stored_also_after_a_compilation(new_environment, tmp_path):
    """JAX opens its cache once: a folder named after the first compilation would have no effect."""
    first, second = tmp_path / "first", tmp_path / "second"
    code = f"""
import pathlib
for number, folder in enumerate(({str(first)!r}, pathlib.Path({str(second)!r}))):
    jaxid.configure(cache=folder)
    jax.jit(lambda x: x + number)(1.0).block_until_ready()
"""
    settings(code, new_environment)
    assert list(first.glob("*-cache"))
    assert list(second.glob("*-cache"))


THREADS = """
import json, os, scipy.linalg, threadpoolctl

def threads():
    return [pool["num_threads"] for pool in threadpoolctl.threadpool_info()]

counts = []
for options in {}, {"linear_algebra_threads": 2}, {"linear_algebra_threads": None}:
    threadpoolctl.threadpool_limits(3, user_api="blas")
    counts.append([threads()])
    jaxid.configure(cache=False, **options)
    counts[-1].append(threads())
print(json.dumps(counts))
"""


def test_matrices_are_decomposed_on_the_chosen_number_of_threads(new_environment):
    done = run(THREADS, new_environment)
    assert done.returncode == 0, done.stderr
    for (before, after), expected in zip(json.loads(done.stdout), (1, 2, 3), strict=True):
        assert before
        assert set(before) == {3}
        assert set(after) == {expected}


def test_no_threads_are_refused():
    with pytest.raises(InputError, match=r"`linear_algebra_threads` is 0; give at least 1\."):
        jaxid.configure(cache=False, linear_algebra_threads=0)


def test_folder_that_cannot_be_written_to_is_refused_with_remedy(new_environment, tmp_path):
    file = tmp_path / "file"
    file.touch()
    done = run(f"jaxid.configure(cache={str(file / 'cache')!r})", new_environment)
    assert done.returncode != 0
    for words in ("InputError", str(file / "cache"), "cache=FOLDER", "cache=False"):
        assert words in done.stderr


def test_command_line_names_a_folder_that_cannot_be_written_to(new_environment, tmp_path):
    file = tmp_path / "file"
    file.touch()
    command = [sys.executable, "-m", "jaxid", "dataset", "emps"]
    done = subprocess.run(
        command,
        env=new_environment | {"JAX_COMPILATION_CACHE_DIR": str(file)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert str(file) in done.stderr
