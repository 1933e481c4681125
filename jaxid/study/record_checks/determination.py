"""The parameters that records determine, from the information at the model's present values."""

import dataclasses
from collections.abc import Iterator, Sequence

import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import InputError
from ...data.record import Record
from ...data.stack import stack
from ...design.information import ROUGHLY, PlannedInformation, information_of
from ...diagnosis.autoregression import white_noise_variance
from ...estimation.likelihoods import OutputError
from ...estimation.spectrum_policy import SPREAD
from ...models.base import AbstractModel
from ...models.free import INITIAL_STATE, Free
from ...models.free import free as free_parameters
from ...models.names import parameter_names
from ...models.noise import FixedNoise
from ...sensitivity.spectrum import spectrum, weak_components
from .findings import Finding, FindingKind
from .thresholds import MOST_PARAMETERS

# Chosen: least variance of the noise, relative to a channel's: simulated records have none.
MIN_NOISE_SHARE = 1e-10


def selection(model: AbstractModel, free: Free | None) -> Free | None:
    """Return the free parameters; by default all of a model that has few, else None."""
    if free is not None:
        return free
    names = parameter_names(model)
    if not 0 < len(names) <= MOST_PARAMETERS:
        return None
    return free_parameters(model, *names, per_record=(INITIAL_STATE,) if model.states else ())


def determination(
    model: AbstractModel, free: Free, records: Sequence[Record], likelihood: OutputError
) -> PlannedInformation | None:
    """Return the information of all records at the model's values, None where it is not finite.

    A noise that the likelihood does not know is taken from third differences of the samples of each
    sensor. The factors of the records, each with its own initial state eliminated, are joined.

    Args:
        model: the model.
        free: the parameters of the later fit.
        records: single records with the channels of the model.
        likelihood: its hold, stepper and known noise are those of the later fit.
    """
    together = stack(records)
    if not likelihood.noise.is_known:
        likelihood = dataclasses.replace(likelihood, noise=FixedNoise(noise_variance(together)))
    rows, total, selected = together.t.shape[1], None, free
    for record in records:
        try:
            total = information_of(
                model,
                selected,
                stack([record], pad_to=rows),
                likelihood,
                earlier=None if total is None else total.factor,
            )
        except InputError:
            return None
        selected = dataclasses.replace(free, prior={})  # a prior counts once
    return total


def noise_variance(records: Record) -> np.ndarray:
    """Return the variance of each sensor's noise from third differences, never zero."""
    variance = np.asarray(white_noise_variance(records.z, records.mask))
    count = np.maximum(np.sum(np.asarray(records.mask), axis=(0, 1)), 1)
    power = np.asarray(jnp.sum(jnp.where(records.mask, records.z, 0.0) ** 2, axis=(0, 1))) / count
    return np.maximum(variance, np.maximum(MIN_NOISE_SHARE * power, 1e-300))


def undetermined(information: PlannedInformation) -> Iterator[Finding]:
    """Findings on parameters that the records do not determine, or hardly."""
    decomposition = spectrum(information.factor, np.zeros(len(information.factor)))
    directions = weak_components(decomposition, SPREAD)
    for words, (_, kept) in zip(information.weak_directions, directions, strict=True):
        names = tuple(information.names[k] for k in kept)
        yield Finding(FindingKind.UNDETERMINED, "", names, {}, (words,))
    rows = zip(
        information.names, information.standard_errors, information.relative_errors, strict=True
    )
    for name, error, relative in rows:
        if np.isfinite(error) and np.isfinite(relative) and relative > ROUGHLY:
            numbers = {"error": float(error), "relative": float(relative)}
            yield Finding(FindingKind.HARDLY, "", (name,), numbers)
