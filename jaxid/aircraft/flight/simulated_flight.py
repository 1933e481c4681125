"""Result of a simulated test flight: records, declared model, and truth for comparison."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp

from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.base import AbstractModel
from ...models.free import Free


class SimulatedFlight(NamedTuple):
    """Manoeuvres of a simulated flight with an effect that the declared model lacks.

    Attributes:
        model: the declared model, without the planted effect and with wrong coefficients.
        free: parameters to estimate, and an initial state for each record.
        train, check, test: records for fitting, for acceptance of effects, and for reporting.
        truth: the model that simulated the records.
        noise: standard deviations of the white measurement noise, shape (output,) [units of the
            outputs].
        clean: outputs without noise, by name of the record.
    """

    model: AbstractModel
    free: Free
    train: tuple[Record, ...]
    check: tuple[Record, ...]
    test: tuple[Record, ...]
    truth: AbstractModel
    noise: Float[Array, " output"]
    clean: dict[str, Float[Array, "time output"]]


def realised_noise(
    flight: SimulatedFlight, records: Sequence[Record], skip: int = 0
) -> Float[Array, " output"]:
    """Return the RMS of the realised noise in records of a flight.

        rms_j = sqrt( 1/N sum_i (z_ij - y_ij(truth))^2 )

    This is the prediction error of the truth itself. It scatters about `flight.noise` by `1/sqrt(2
    N)`, and is the reference for the error of a prediction.

    Args:
        flight: the flight.
        records: records of this flight.
        skip: number of samples at the start of each record that are ignored.

    Returns:
        One value for each output [its unit].
    """
    errors = jnp.concatenate(
        [(record.z - flight.clean[record.names[0]])[skip:] for record in records]
    )
    return jnp.sqrt(jnp.mean(errors**2, axis=0))


def smoothed(signal: Float[Array, " time"]) -> Float[Array, " time"]:
    """Return a commanded signal with rounded corners.

    The signal is convolved with a Gaussian window with a standard deviation of two samples.

    Args:
        signal: uniformly sampled signal [any unit].

    Returns:
        The same number of samples, in the same unit; beyond its ends the signal counts as zero.
    """
    weight = jnp.exp(-0.5 * (jnp.arange(-6, 7) / 2.0) ** 2)
    return jnp.convolve(signal, weight / jnp.sum(weight), mode="same")
