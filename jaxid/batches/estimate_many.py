"""`estimate_many`: independent estimates of many cases in one call."""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jax.sharding import Mesh

from .._foundation.checks import InputError, require, require_float64
from .._foundation.device import require_threads
from .._foundation.host import on_cpu
from ..data.record import Record
from ..estimation.argument_checks import require_no_shooting
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.solver import GaussNewton, solver_or_default
from ..models.base import AbstractModel, canonical
from ..models.free import Free
from .cases import Case, CaseRecords, Starts, buckets, read_cases
from .chunk import Finished, run
from .identity import identity_of
from .iteration import Settings
from .parts import Part
from .progress import Progress, listener
from .results import SUCCESSFUL, UNFINISHED, Arrays, Layout, refuse
from .store import BatchStore
from .width import with_width

if TYPE_CHECKING:
    import xarray as xr

STEPS = 3  # steps between two looks at the cases that have ended; chosen
Device = Any  # a jax.Device, which is no class for a type checker
WRITE_SECONDS = 1.0  # shortest time between two writes to the store [s]; chosen


def estimate_many(
    model: AbstractModel,
    free: Free,
    cases: Record | Sequence[CaseRecords],
    likelihood: AbstractLikelihood,
    *,
    models: AbstractModel | Sequence[AbstractModel] | None = None,
    starts: Starts | None = None,
    solver: GaussNewton | None = None,
    store: str | Path | None = None,
    part: tuple[int, int] | None = None,
    devices: Sequence[Device] | Mesh | None = None,
    progress: bool | Callable[[Progress], object] = True,
) -> "xr.Dataset":
    """Return the independent estimates of many cases as one dataset.

        theta_i = argmin J_i(theta),    i = 1 ... number of cases

    Each case is estimated as by `estimate`: for a Monte Carlo, a bootstrap, flight conditions,
    starts, aircraft. Cases of one shape advance together; those that have ended make room for
    others, so that a slow case delays none. A case that fails does not affect the others.

    Args:
        model: the model; its values are the start of the free parameters and the fixed values of
            all others.
        free: the free parameters.
        cases: one record, or several, for each case; or a stack with one record per case.
            Records of nearly equal length are padded to one length. Repeat a record to estimate
            it from several starts.
        likelihood: the likelihood.
        models: the model of each case, of the same structure as `model`: a sequence, or one model
            whose arrays have a leading case axis.
        starts: starts of parameters: values of shape (case,) by name, or an array of shape
            (case, parameter) in the order of `free.shared`.
        solver: options of the iteration.
        store: folder of a Zarr store, to which the results are written as the cases finish. A call
            with the same arguments continues a run that was stopped, and computes again the cases
            of a file that is lost.
        part: number of this process, from zero, and number of processes. Each process has the same
            arguments but for this one, estimates its own share of the cases, and writes it to the
            common `store`; the processes exchange nothing else. The last one to end returns all
            results, as does a further call without `part`.
        devices: devices of this process over which the cases are distributed, or a mesh of them; by
            default JAX's default device.
        progress: True shows a bar on a terminal or a line in a notebook; False does not; or a
            function of `Progress`.

    Returns:
        A dataset with the dimensions `case`, `parameter`, `record` and `own_parameter`: `values`,
        `standard_errors`, `own`, `cost`, `iterations` and others [units of the parameters, in the
        coordinate `unit`]. `status` is the name of the outcome and `reason` its sentence; a case
        that failed is `start_diverges`, `steps_exhausted`, `no_descent`, `undetermined` (a
        shared parameter has no finite standard error) or `refused` (it did not pass the checks of
        `estimate`, and has no numbers). `corrected_errors` depend slightly on the padding. The
        attributes hold version and settings.

    Raises:
        InputError: when there is no case, models or starts do not suit the cases, every case is
            refused, the store belongs to another batch, cannot be written or is in use by another
            process, a part has no store, several CPU devices share too few threads, or JAX is in
            32 bit.
    """
    require_float64()
    require_no_shooting(likelihood, "estimate_many")
    solver, own_part = solver_or_default(solver), _part(part, store)
    with on_cpu():
        read = read_cases(model, free, cases, likelihood, models, starts)
    _require_one_set_of_parameters(read)
    layout = Layout.of(read, solver.policy.threshold)
    attributes = identity_of(model, free, likelihood, solver, read)
    mesh = _mesh(devices)
    _require_own_devices(mesh)
    settings = Settings(canonical(likelihood), solver, 1, STEPS)
    saved = None if store is None else BatchStore(store, layout, attributes, own_part)
    arrays = layout.empty() if saved is None else saved.load()
    own = np.arange(len(read)) if saved is None else saved.cases
    pending = [read[index] for index in own if arrays["status"][index] == UNFINISHED]
    if pending:
        claim = contextlib.nullcontext() if saved is None else saved.claimed()
        with claim, listener(progress) as notify:
            finished = _finished(pending, settings, mesh)
            _gather(finished, layout, arrays, pending, own, saved, notify)
    return layout.dataset(_joined(arrays, saved), attributes)


def _part(part: tuple[int, int] | None, store: str | Path | None) -> Part:
    """Return the part of this process; several parts need a store."""
    own = Part.of(part)
    require(
        store is not None or own.count == 1,
        "A `part` of the cases needs a `store`, in which the parts come together. Name a folder "
        "that all processes reach.",
    )
    return own


def _finished(cases: list[Case], settings: Settings, mesh: Mesh | None) -> Iterator[Finished]:
    """Yield the results of cases as they finish."""
    for bucket in buckets(cases):
        yield from run(bucket, with_width(settings, bucket, mesh), mesh)


def _joined(arrays: Arrays, saved: BatchStore | None) -> Arrays:
    """Return the results with those that other processes have written in the meantime."""
    return arrays if saved is None or saved.part.count == 1 else saved.load()


def _gather(
    finished: Iterator[Finished],
    layout: Layout,
    arrays: Arrays,
    cases: list[Case],
    own: np.ndarray,
    saved: BatchStore | None,
    notify: Callable[[Progress], object],
) -> None:
    """Write results into the arrays and the store as they come.

    Args:
        finished: results of the cases.
        layout: names of cases and parameters.
        arrays: results of all cases.
        cases: the cases of this run.
        own: indices of the cases of this process, those of an earlier run included.
        saved: the store.
        notify: function of the progress.
    """
    begin = written = time.monotonic()
    unsaved = refuse(arrays, cases)
    done = len(unsaved)
    try:
        for group in finished:
            indices = layout.add(arrays, group)
            unsaved += indices
            done += len(indices)
            if saved is not None and time.monotonic() - written >= WRITE_SECONDS:
                batch, unsaved = unsaved, []
                saved.write(batch, arrays)
                written = time.monotonic()
            notify(_progress(arrays["status"][own], done, len(cases), time.monotonic() - begin))
    finally:  # an interrupted run keeps its results
        if saved is not None:
            saved.write(unsaved, arrays)


def _progress(status: np.ndarray, done: int, pending: int, seconds: float) -> Progress:
    """Return the progress after some of the cases of this run."""
    finished = int(np.sum(status != UNFINISHED))
    failed = finished - int(np.sum(np.isin(status, SUCCESSFUL)))
    remaining = seconds / done * (pending - done) if done else float("inf")
    return Progress(finished, failed, len(status), seconds, remaining)


def _mesh(devices: Sequence[Device] | Mesh | None) -> Mesh | None:
    """Return the devices as a mesh."""
    if devices is None or isinstance(devices, Mesh):
        return devices
    require(len(devices) > 0, "`devices` is empty. Leave it out to use JAX's default device.")
    return Mesh(np.array(devices), ("device",))


def _require_own_devices(mesh: Mesh | None) -> None:
    """Refuse devices of another process, as the processes share only the store, and more CPU
    devices than the threads of this one serve.
    """
    devices = [] if mesh is None else list(mesh.devices.flat)
    strangers = [device for device in devices if not _is_own(device)]
    require(
        not strangers,
        f"{len(strangers)} of the devices belong to another process. Give `jax.local_devices()`, "
        "and to each process its `part`.",
    )
    require_threads(devices)


def _is_own(device: Device) -> bool:
    return device.process_index == jax.process_index()


def _require_one_set_of_parameters(cases: Sequence[Case]) -> None:
    """Refuse cases whose likelihood adds different parameters."""
    by_structure = {case.structure: case for case in cases if not case.refusal}
    free = [case.arrays.free for case in by_structure.values()]
    names = {(one.shared, one.per_record) for one in free}
    if len(names) > 1:
        raise InputError(
            "The cases have different free parameters: "
            + " and ".join(sorted(str(shared + own) for shared, own in names))
            + ". Estimate them in separate calls."
        )
