"""What a record shows first, channel by channel: where a simulation of it starts."""

import jax.numpy as jnp

from .._foundation.types import Array, Float
from ..data.record import Record


def first_samples(record: Record) -> dict[str, Float[Array, ""]]:
    """The first valid sample of each output, zero where it has none.

    Args:
        record: a single record.

    Returns:
        Values by name of the output [its unit].
    """
    row = jnp.argmax(record.mask, axis=0)
    first = jnp.take_along_axis(record.z, row[None], axis=0)[0]
    return dict(zip(record.outputs, jnp.where(jnp.any(record.mask, axis=0), first, 0.0), strict=True))
