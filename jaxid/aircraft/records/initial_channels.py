"""First valid samples of a record, from which a simulation starts."""

import jax.numpy as jnp

from ..._foundation.types import Array, Float
from ...data.record import Record


def initial_channels(record: Record) -> dict[str, Float[Array, ""]]:
    """Return the first valid sample of each output, zero for an output without valid samples.

    Args:
        record: a single record.

    Returns:
        Values by name of the output [its unit].
    """
    row = jnp.argmax(record.mask, axis=0)
    first = jnp.take_along_axis(record.z, row[None], axis=0)[0]
    return dict(
        zip(record.outputs, jnp.where(jnp.any(record.mask, axis=0), first, 0.0), strict=True)
    )
