"""What a simulated test flight hands over: records, the declared model, and the truth to hold results against."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp

from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.free import Free


class SimulatedFlight(NamedTuple):
    """Several manoeuvres of one simulated flight, with something in them that the declared model lacks.

    Attributes:
        model: the declared model, without the planted effect and with wrong coefficients.
        free: what the data shall determine, and an initial state for each record.
        train, check, test: records to fit, to decide and to report.
        truth: the model that made the records.
        noise: standard deviations of the white measurement noise, shape (output,) [units of the outputs].
        clean: the outputs without that noise, by name of the record.
    """

    model: AbstractModel
    free: Free
    train: tuple[Record, ...]
    check: tuple[Record, ...]
    test: tuple[Record, ...]
    truth: AbstractModel
    noise: Float[Array, " output"]
    clean: dict[str, Float[Array, "time output"]]


def realised_noise(flight: SimulatedFlight, records: Sequence[Record], skip: int = 0) -> Float[Array, " output"]:
    """RMS of the noise that stands in some records of a flight: the error that the truth itself would have on them.

        rms_j = sqrt( 1/N sum_i (z_ij - y_ij(truth))^2 )

    It scatters about `flight.noise` by `1/sqrt(2 N)`, and a prediction is to be held against it.

    Args:
        flight: of which the records are.
        records: some of its records.
        skip: samples at the start of each record that do not count.

    Returns:
        One value for each output [its unit].
    """
    errors = jnp.concatenate([(one.z - flight.clean[one.names[0]])[skip:] for one in records])
    return jnp.sqrt(jnp.mean(errors**2, axis=0))


def smoothed(signal: Float[Array, " time"]) -> Float[Array, " time"]:
    """A commanded signal without its corners: under a Gaussian window with a standard deviation of two samples.

    Args:
        signal: uniformly sampled [any unit].

    Returns:
        As many samples, in the same unit; beyond its ends the signal counts as zero.
    """
    weight = jnp.exp(-0.5 * (jnp.arange(-6, 7) / 2.0) ** 2)
    return jnp.convolve(signal, weight / jnp.sum(weight), mode="same")
