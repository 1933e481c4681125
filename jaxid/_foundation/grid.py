"""Time grids: padding made harmless, uniformity asked for."""

import jax.numpy as jnp
import numpy as np

from .types import Array, Bool, Float


def strictly_increasing(t: Float[Array, " time"]) -> Float[Array, " time"]:
    """The same grid with its padding, where time stands still, continued at the first step's length.

    Interpolation needs distinct knots; no query ever falls into the padding.
    """
    step = jnp.diff(t)
    return jnp.concatenate([t[:1], t[0] + jnp.cumsum(jnp.where(step > 0, step, step[0]))])


def typical_step(t: Float[Array, "*case time"]) -> Float[Array, ""]:
    """The median of all real steps; where time stands still there is none."""
    step = jnp.diff(t, axis=-1)
    return jnp.nanmedian(jnp.where(step > 0, step, jnp.nan))


def is_uniform(t: Float[np.ndarray, "*case time"], tolerance: float = 1e-6) -> bool:
    """Whether all real steps are equal, up to a relative tolerance that covers the rounding of logged time stamps."""
    step = np.diff(np.asarray(t), axis=-1)
    real: Bool[np.ndarray, "*case time"] = step > 0
    typical = np.median(step[real])
    return bool(
        np.all(np.abs(step[real] - typical) <= tolerance * max(typical, float(np.max(np.abs(t))) * 1e-9 / tolerance))
    )
