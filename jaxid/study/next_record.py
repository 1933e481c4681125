"""The manoeuvre to fly after a study, which decides an open question."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require
from .._foundation.types import Float, Numbers
from ..design.design import Design
from ..design.explanations import Explanation
from ..design.information import ROUGHLY
from ..design.input_design import design_input
from ..design.limits import Limits
from ..design.measures import Combination, Determinant
from ..design.shapes import AbstractShape
from ..design.signals import InputSignal
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import as_float
from ..models.free import all_names
from ..models.noise import FixedNoise
from .study import Study


def next_record(
    study: Study,
    t: Float[Numbers, " time"],
    limits: Limits,
    *,
    shape: AbstractShape | None = None,
    axes: Sequence[str] | None = None,
    trim_input: Float[Numbers, " input"] | None = None,
    initial_state: Float[Numbers, " state"] | None = None,
    conventional: Sequence[InputSignal] = (),
    seed: int = 0,
) -> Design:
    """Return the manoeuvre within its limits that settles an open question of a study.

    If the study has alternatives, the manoeuvre separates the model found from the nearest of them
    (`separating_input`). Else it determines the weakest combination of the parameters:

        min c' (M_0 + M(u))^-1 c,    c the direction of the smallest eigenvalue of the scaled M_0

    or, if no combination is weak, the parameter with the largest relative standard error. R is
    that of `study.noise`; `M_0` is the information of the training records.

    Args:
        study: the study.
        t: sample times of the next record, uniform [s].
        limits: limits of the inputs and the envelope, which holds for both explanations, and for
            values drawn from their uncertainty.
        shape: parametrised input; by default a spline.
        axes: inputs that move; all by default.
        trim_input: inputs at trim; zero by default.
        initial_state: declared state at trim; zero by default.
        conventional: inputs to compare, from which the search also starts.
        seed: of the random starts.

    Returns:
        The design; with alternatives its `chi_square` is the one expected between the explanations.

    Raises:
        InputError: when the outcome of the study is process noise, whose parameters no input is
            designed for, when the study leaves nothing open, and as `design_input`.
    """
    _require_simulated(study)
    noise = FixedNoise(jnp.array([study.noise[name] ** 2 for name in study.outputs]))
    likelihood = dataclasses.replace(study.likelihood, noise=noise)
    options: dict[str, Any] = {
        "shape": shape,
        "axes": axes,
        "trim_input": trim_input,
        "initial_state": initial_state,
        "conventional": conventional,
        "seed": seed,
    }
    fit = study.after.estimate
    known = Explanation(study.after.model, fit.free, np.asarray(fit.information.triangle))
    if study.alternatives:
        nearest = min(study.alternatives, key=lambda other: abs(other.chi_square))
        other = Explanation(nearest.model, nearest.free, nearest.information)
        return separating_input(known, other, t, limits, likelihood, **options)
    return design_input(
        *known[:2],
        as_float(t),
        measure=Combination(_open_combination(fit)),
        limits=limits,
        likelihood=likelihood,
        earlier=known.earlier,
        **options,
    )


def _require_simulated(study: Study) -> None:
    """Refuse a study whose estimate has parameters of random forces, which its model has not."""
    known = all_names(study.after.model)
    others = [name for name in study.after.estimate.free.shared if name not in known]
    require(
        not others,
        f"The study ends with {study.noise_model.words}, whose parameters ({', '.join(others)}) "
        "are in its estimate and not in its model: no input is designed for them. Design for the "
        "declared model: `jaxid.design.design_input(study.after.model, study.before.estimate.free, "
        "t, ...)`, or the command `design` without `--after-loop`.",
    )


def separating_input(
    first: Explanation,
    second: Explanation,
    t: Float[Numbers, " time"],
    limits: Limits,
    likelihood: AbstractLikelihood,
    *,
    shape: AbstractShape | None = None,
    **options: Any,
) -> Design:
    """Return the manoeuvre by which the wrong one of two explanations loses most chi-square.

    The minimum over both directions of

        T = min_d |L^-1 (y_true - y_wrong - S_wrong d)|^2 + |T_0 d|^2

    is as large as the limits permit: the refit of the wrong explanation has to agree with the
    records already flown, whose information is `T_0' T_0`.

    Args:
        first, second: the explanations, each fitted to the records already flown.
        t: sample times, uniform [s].
        limits: limits of the inputs and the envelope, which holds for both explanations, and for
            values drawn from their uncertainty.
        likelihood: the likelihood of the later estimate, with known noise.
        shape: parametrised input; by default a spline.
        options: further arguments of `design_input`.

    Returns:
        The design, with the information on the parameters of the first explanation.

    Raises:
        InputError: as `design_input`.
    """
    return design_input(
        *first[:2],
        as_float(t),
        shape=shape,
        measure=Determinant(),
        limits=limits,
        likelihood=likelihood,
        earlier=first.earlier,
        rival=second,
        **options,
    )


def _open_combination(estimate) -> Float[np.ndarray, " parameter"]:
    """Return the combination of the parameters of an `Estimate` that a next record should show.

    Raises:
        InputError: when the records determine all parameters.
    """
    if estimate.weak_directions:
        spectrum = estimate.spectrum
        return np.asarray(spectrum.directions[-1]) * np.asarray(spectrum.scale)
    values, errors = np.asarray(estimate.values), np.asarray(estimate.standard_errors)
    relative = np.where(np.isfinite(errors), errors, 0.0) / np.maximum(
        np.abs(values), np.finfo(float).tiny
    )
    worst = int(np.argmax(relative))
    require(
        bool(relative[worst] > ROUGHLY),
        "The study leaves nothing open: it has no alternatives, no combination of its parameters "
        f"is weak, and each is determined to {100 * ROUGHLY:.0f} % and better. For smaller "
        "standard errors use `jaxid.design.design_input`.",
    )
    return np.eye(values.size)[worst]
