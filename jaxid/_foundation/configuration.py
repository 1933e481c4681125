"""`configure`: the settings of JAX and of linear algebra that jaxid recommends, by one call."""

import gc
import os
import re
from pathlib import Path
from typing import Any

import jax
import scipy.linalg  # noqa: F401  (loads the library whose threads are limited)
from jax.experimental.compilation_cache import compilation_cache

from .checks import InputError, require
from .device import POOL, THREADS_EACH, processors
from .stored_programs import store_programs

# Thresholds of JAX's persistent compilation cache at which it stores every program. A first
# estimate of a small model compiles dozens of programs, each far below JAX's default of one second.
STORE_EVERY_PROGRAM = {
    "jax_persistent_cache_min_compile_time_secs": 0.0,
    "jax_persistent_cache_min_entry_size_bytes": -1,
}


# The option of XLA that divides a CPU into several devices.
DEVICE_COUNT = re.compile(r"--xla_force_host_platform_device_count=(\d+)")


def configure(
    *,
    cache: bool | str | Path = True,
    float64: bool = True,
    linear_algebra_threads: int | None = 1,
) -> None:
    """Set JAX to 64 bit, store compiled programs on disk for the next process, decompose matrices
    on one thread, and give XLA's pool enough threads where there are several CPU devices.

    Call it once, after the imports and before the first array is made; arrays made earlier keep
    their precision. Importing jaxid changes no setting, and a second call is allowed. For
    several CPU devices the number of threads in XLA's pool is set by the environment variable
    `NPROC`, which is kept where it exists. The objects that exist at the first call, those of the
    imported modules, are exempt from Python's garbage collector (`gc.freeze`), which otherwise
    takes an eighth of a first estimate, because tracing a model makes many objects.

    Args:
        cache: folder of JAX's persistent compilation cache, made if it does not exist. True keeps a
            folder that JAX already has (from `JAX_COMPILATION_CACHE_DIR` or `jax.config`), else
            takes `jaxid` in the user's cache folder (`XDG_CACHE_HOME`, by default `~/.cache`).
            False leaves JAX's settings of the cache unchanged. The cache stores every program; a
            threshold in an environment variable, such as
            `JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS`, is kept. The large programs of models,
            effects and likelihoods of this package are also stored as exported before compilation,
            in `jaxid-exported` there, so that another process does not trace them. JAX runs the
            stored programs, so the folder must be writable only by trusted users.
        float64: True switches on 64 bit, without which jaxid refuses to compute; False leaves the
            precision unchanged.
        linear_algebra_threads: threads of the library (OpenBLAS) by which JAX, NumPy and SciPy
            decompose matrices on a CPU. The matrices here are narrow; more threads wait for each
            other, the longer the more programs share the processor. None leaves them unchanged.

    Raises:
        InputError: when the number of threads is below one, or the folder cannot be made or written
            to.
    """
    if linear_algebra_threads is not None:
        require(
            linear_algebra_threads >= 1,
            f"`linear_algebra_threads` is {linear_algebra_threads}; give at least 1.",
        )
        # not at the top: this package sets an environment variable where it is imported
        from threadpoolctl import threadpool_limits

        threadpool_limits(linear_algebra_threads, user_api="blas")
    _enlarge_pool()
    if cache is not False:
        _use_cache(_default_folder() if cache is True else str(cache))
    if float64:
        jax.config.update("jax_enable_x64", True)
    if not gc.get_freeze_count():
        gc.freeze()


def _enlarge_pool() -> None:
    """Let XLA's pool have enough threads for several CPU devices, unless the environment sets their
    number.

    XLA reads it when JAX makes its first array.
    """
    of_jax = int(jax.config.values["jax_num_cpu_devices"])
    counts = [of_jax, *map(int, DEVICE_COUNT.findall(os.environ.get("XLA_FLAGS", "")))]
    if max(counts) > 1:
        os.environ.setdefault(POOL, str(max(THREADS_EACH * max(counts), processors())))


def settings_in_use() -> dict[str, Any]:
    """Return the arguments with which `configure` gives another process the settings of this one.

    Its linear algebra has one thread.
    """
    in_64_bit = jax.config.jax_enable_x64  # pyright: ignore[reportAttributeAccessIssue]
    return {"cache": _folder_in_use() or False, "float64": bool(in_64_bit)}


def _default_folder() -> str:
    """Return the folder that JAX already has, or that of the user's cache."""
    return (
        _folder_in_use()
        or os.environ.get("JAX_COMPILATION_CACHE_DIR")
        or str(Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "jaxid")
    )


def _settings_of_jax() -> tuple:
    """Return all settings of JAX but the folder of its cache, as they are in this context."""
    settings = jax.config.values.items()
    return tuple(setting for setting in settings if setting[0] != "jax_compilation_cache_dir")


def _folder_in_use() -> str | None:
    return jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]


def _use_cache(folder: str) -> None:
    """Set the folder of the persistent compilation cache, and its thresholds."""
    local = "://" not in folder  # JAX also accepts addresses such as gs://bucket/folder
    if local:
        folder = str(_writable(Path(folder)))
    store_programs(Path(folder) if local else None, _settings_of_jax)
    if folder != _folder_in_use():
        jax.config.update("jax_compilation_cache_dir", folder)
        # JAX opens the cache at its first compilation, and would keep an earlier folder
        compilation_cache.reset_cache()
    for setting, value in STORE_EVERY_PROGRAM.items():
        if setting.upper() not in os.environ:
            jax.config.update(setting, value)


def _writable(folder: Path) -> Path:
    """Return the folder, made if needed, with the home folder in place of `~`.

    Raises:
        InputError: when it cannot be made or written to.
    """
    try:
        folder = folder.expanduser()
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError) as error:  # RuntimeError: the home folder is unknown
        raise InputError(_refusal(folder, str(error))) from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(_refusal(folder, "permission denied"))
    return folder


def _refusal(folder: Path, reason: str) -> str:
    return (
        f"The folder {str(folder)!r} of the compilation cache cannot be written to ({reason}). "
        "Name another one, by `jaxid.configure(cache=FOLDER)` or the environment variable "
        "JAX_COMPILATION_CACHE_DIR, or leave the cache off: `jaxid.configure(cache=False)`."
    )
