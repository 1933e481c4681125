"""The section [design] of a study file: the next record, its limits and its trim."""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Array, Float
from ..data.io.study import StudyFile
from ..design.design import Design
from ..design.input_design import design_input
from ..design.limits import Limits
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
        InputError: when a key is missing, or an input or a state is unknown to the model.
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
        axes = tuple(section.get("axes", section["amplitude"]))
        require_known("input", axes, model.inputs)
        shape = spline(t, section["knots"]) if "knots" in section else None
    energy = section.get("energy")
    limits = Limits(
        _floats(section["amplitude"]),
        _floats(section.get("rate", {})),
        None if energy is None else float(energy),
        {name: (low, high) for name, (low, high) in section.get("envelope", {}).items()},
    )
    return DesignSection(
        t,
        limits,
        shape,
        axes,
        _by_name(file, "trim_input", model.inputs),
        _by_name(file, "initial_state", model.states),
    )


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


def _floats(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items()}


def _by_name(file: StudyFile, key: str, names: tuple[str, ...]) -> Float[np.ndarray, " name"]:
    """Return the values of a table in the order of the names, zero where it has none."""
    values = file.design.get(key, {})
    with file.at("design", key):
        require_known(key.replace("_", " "), values, names)
    return np.array([float(values.get(name, 0.0)) for name in names])
