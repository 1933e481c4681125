"""Bands of a fitted coefficient that include the misfit of its structure and instrument errors."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Array, Float
from ..data.record import Record
from ..estimation.estimate import as_stack
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.result import Estimate
from ..models.base import AbstractModel
from ..models.free import all_names, flat_vectors, with_values
from .autoregression import white_noise_variance
from .bands import Band, prediction_bands


class CombinedBand(eqx.Module):
    """A coefficient along the records and the parts of its standard uncertainty.

    Attributes:
        value: the coefficient of the model, shape (case, time).
        parameters: deviation due to the parameters, corrected for coloured residuals; with process
            noise, also due to the states.
        misfit: deviation due to the structure, one number for all samples.
        instruments: deviation due to the instruments' constants, shape (case, time).
    """

    value: Float[Array, "case time"]
    parameters: Float[Array, "case time"]
    misfit: Float[Array, ""]
    instruments: Float[Array, "case time"]

    @property
    def deviation(self) -> Float[Array, "case time"]:
        """Root of the sum of the three variances."""
        return jnp.sqrt(self.parameters**2 + self.misfit**2 + self.instruments**2)


def combined_bands(
    fit: Estimate,
    records: Sequence[Record],
    likelihood: AbstractLikelihood,
    deviations: Mapping[str, float] | None = None,
    model: AbstractModel | None = None,
) -> dict[str, CombinedBand]:
    r"""Return the responses of a fitted model with bands for their true values along the records.

        variance = dc/dtheta C dc/dtheta' + s_m^2 + sum_k (c_k - c)^2
        s_m^2 = mean (pseudo-measured - c)^2 - variance of the white noise of the difference

    A band of the parameters alone is one of the best polynomial: of a true function that is no
    polynomial it holds a share that falls to zero as records grow. The second term is the mean
    square of the misfit, which is estimated from the pseudo-measurements; it makes the band one of
    the true value at a sample drawn from the records, not of their mean, and does not apply to
    motion outside of them. Errors of instruments that leave no residual, such as an accelerometer's
    axis, bias a coefficient and its pseudo-measurement alike; the third term has the changes `c_k`
    of the pseudo-measurements by one standard deviation of each constant.

    Output error takes random motion of the environment, such as gusts, as noise of the sensors, and
    the white part of the difference is subtracted as such: no term holds the change of a
    coefficient by gusts. With `FilterError` the coefficient is taken along the smoothed states.

    Args:
        fit: from `estimate`, of a model with pseudo-measurements.
        records: records of the fit, with all channels that the pseudo-measurements need.
        likelihood: the likelihood of the fit.
        deviations: standard deviations of constants that are not estimated, such as
            `{"instruments.scale.V": 0.005}` [the constant's unit]; independent of each other, the
            same in all records.
        model: the estimated model with its pseudo-measurements; by default the model of the fit. A
            fit by `FilterError` has a model without them.

    Returns:
        The band of each response whose equation the model has, by name.

    Raises:
        InputError: for a name that is no parameter of the model or is estimated, a deviation that
            is not positive, or a missing channel.

    Source: JCGM 100:2008 (combined standard uncertainty).
    """
    deviations = dict(deviations or {})
    model = fit.model if model is None else model
    _check(fit, model, deviations)
    prepared = as_stack([model.prepared(record) for record in records])
    responses, valid = _responses(model, records)
    bands = prediction_bands(fit, prepared, likelihood, tuple(responses), coloured=True).signals
    values = dict(zip(all_names(model), flat_vectors(model, prepared)[0], strict=True))
    squares = {name: jnp.zeros_like(response) for name, response in responses.items()}
    for constant, deviation in deviations.items():
        value = jnp.reshape(values[constant] + deviation, (1,))
        changed, _ = _responses(with_values(model, [constant], value), records)
        squares = {
            name: square + (changed[name] - responses[name]) ** 2
            for name, square in squares.items()
        }
    return {
        name: CombinedBand(
            band.value,
            band.deviation,
            _misfit(responses[name], band, valid),
            jnp.sqrt(squares[name]),
        )
        for name, band in bands.items()
    }


def _check(fit: Estimate, model: AbstractModel, deviations: Mapping[str, float]) -> None:
    require_known("constant", deviations, all_names(model))
    for name, deviation in deviations.items():
        require(
            name not in fit.free.shared + fit.free.per_record,
            f"{name!r} is estimated, so that its uncertainty is in the parameters. Leave it out.",
        )
        require(
            bool(np.isfinite(deviation) and deviation > 0),
            f"The standard deviation of {name!r} is {deviation}; it must be positive.",
        )


def _responses(model, records: Sequence[Record]):
    """Return pseudo-measured responses of shape (case, time), padded, and where they are valid."""
    measured = [model.pseudo_measurements(record) for record in records]
    longest = max(one.t.size for one in measured)

    def padded(history):
        return jnp.pad(history, (0, longest - history.size))

    responses = {
        name: jnp.stack([padded(one.responses[name]) for one in measured])
        for name in measured[0].responses
    }
    return responses, jnp.stack([padded(one.valid) for one in measured])


def _misfit(response, band: Band, valid) -> Float[Array, ""]:
    """Return the root mean square of the difference without its white noise."""
    apart = jnp.where(valid, response - band.value, 0.0)[..., None]
    noise = white_noise_variance(apart, valid[..., None])[0]
    return jnp.sqrt(jnp.maximum(jnp.sum(apart**2) / jnp.sum(valid) - noise, 0.0))
