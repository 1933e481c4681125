"""The section [design] of a study file: the next record, its limits and its trim."""

import dataclasses
import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Array, Float
from ..data.io.study import StudyFile
from ..design.design import Design
from ..design.input_design import design_input
from ..design.limits import (
    Limits,
    quantity_names,
    require_amplitudes,
    require_inside,
    require_positive,
)
from ..design.measures import Determinant
from ..design.shapes import AbstractShape, spline
from ..design.signals import sample_times
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.result import Estimate
from ..models.base import AbstractModel
from ..models.noise import FixedNoise

REQUIRED = ("duration", "sample_time", "amplitude")


class DesignSection(NamedTuple):
    """The next record: its samples, limits, and trim.

    Attributes:
        t: sample times [s].
        limits: limits of the inputs and the envelope.
        shape: the spline whose coefficients are free; None for the default.
        axes: inputs that move.
        trim_input, initial_state: the trim.
    """

    t: Float[Array, " time"]
    limits: Limits
    shape: AbstractShape | None
    axes: tuple[str, ...]
    trim_input: Float[np.ndarray, " input"]
    initial_state: Float[np.ndarray, " state"]

    @property
    def options(self) -> dict[str, Any]:
        """The shape, axes and trim as arguments of `next_record`."""
        names = ("shape", "axes", "trim_input", "initial_state")
        return {name: getattr(self, name) for name in names}


def design_section(file: StudyFile, model: AbstractModel) -> DesignSection:
    """Return the section [design] of a study file, checked against the model.

    Args:
        file: result of `read_study`.
        model: the declared model.

    Raises:
        InputError: when a key is missing, a name is unknown to the model, a limit is not positive,
            a range is empty, or the range of a state excludes the trim.
    """
    section = file.design
    with file.at("design"):
        missing = [key for key in REQUIRED if key not in section]
        require(
            not missing,
            f"{', '.join(missing)} must be given: the length of the next record and its sample "
            "time [s], and the largest deviation of each input from trim.",
        )
        t = sample_times(float(section["duration"]), float(section["sample_time"]))
        shape = spline(t, section["knots"]) if "knots" in section else None
    trim_input = _by_name(file, "trim_input", model.inputs)
    initial_state = _by_name(file, "initial_state", model.states)
    limits = _limits(file, model, initial_state, trim_input)
    axes = tuple(section.get("axes", section["amplitude"]))
    with file.at("design", "axes"):
        require_known("input", axes, model.inputs)
        require_amplitudes(axes, limits)
    return DesignSection(t, limits, shape, axes, trim_input, initial_state)


def _limits(
    file: StudyFile,
    model: AbstractModel,
    initial_state: Float[np.ndarray, " state"],
    trim_input: Float[np.ndarray, " input"],
) -> Limits:
    """Return the limits of the section, checked key by key.

    Outputs and signals at trim depend on the estimate, and are compared with their ranges after it.
    """
    section = file.design
    limits = Limits(
        section["amplitude"],
        section.get("rate", {}),
        section.get("energy"),
        section.get("envelope", {}),
    )
    for key, values in (("amplitude", limits.amplitude), ("rate", limits.rate)):
        with file.at("design", key):
            require_known("input", values, model.inputs)
            require_positive(values)
    with file.at("design", "energy"):
        require_positive({"energy": limits.energy})
    known = quantity_names(model, initial_state, trim_input)
    trim = dict(zip(model.states, initial_state, strict=True))
    with file.at("design", "envelope"):
        require_known("state, output or signal", limits.envelope, known)
        for name, (low, high) in section.get("envelope", {}).items():
            require(low < high, f"the range of {name!r} is {low:g} to {high:g}. Widen it.")
            if name in trim:
                require_inside(name, low, high, float(trim[name]))
    return limits


def informative_input(
    fit: Estimate, likelihood: AbstractLikelihood, section: DesignSection
) -> Design:
    """Return the input that adds most information to an estimate (D-optimal).

        min -log det( M_0 + M(u) ),    M_0 the information of the records of the estimate

    Args:
        fit: an estimate.
        likelihood: its likelihood; the noise is the estimated one.
        section: the next record.

    Raises:
        InputError: as `design_input`.
    """
    noise = FixedNoise(jnp.diagonal(fit.noise))
    return design_input(
        fit.model,
        fit.free,
        section.t,
        measure=Determinant(),
        limits=section.limits,
        likelihood=dataclasses.replace(likelihood, noise=noise),
        earlier=np.asarray(fit.information.triangle),
        **section.options,
    )


def _by_name(file: StudyFile, key: str, names: tuple[str, ...]) -> Float[np.ndarray, " name"]:
    """Return the values of a table in the order of the names, zero where it has none."""
    values = file.design.get(key, {})
    with file.at("design", key):
        require_known(key.replace("_", " "), values, names)
        for name, value in values.items():
            require(math.isfinite(value), f"{name} is {value:g}. Give a finite number.")
    return np.array([float(values.get(name, 0.0)) for name in names])
