"""Ends of confidence intervals from estimates and their standard errors."""

import numpy as np
import scipy

from .._foundation.checks import require_level
from .._foundation.host import on_host
from .._foundation.types import Float


def upper_probability(level: float) -> float:
    """Return the probability below the upper end of a two-sided interval.

    Args:
        level: probability of the interval, such as 0.95.

    Raises:
        InputError: when the level is not between 0 and 1.
    """
    require_level(level, 0.95)
    return 0.5 * (1.0 + level)


def student_factor(upper: float, samples, dof) -> Float[np.ndarray, "*batch"]:
    """Return `q sqrt(N / nu)` with the quantile q of Student's t; NaN without degrees of freedom.

    Args:
        upper: probability below the quantile.
        samples: number N of measurements.
        dof: degrees of freedom nu.
    """
    enough = dof > 0
    safe = np.where(enough, dof, 1.0)
    return np.where(enough, scipy.special.stdtrit(safe, upper) * np.sqrt(samples / safe), np.nan)


@on_host
def interval_ends(xp, values, errors, factor, is_scale):
    """Return the ends `value -/+ factor error`, of a scale `value exp(-/+ factor error / value)`.

    Args:
        xp: NumPy or `jax.numpy`.
        values, errors: estimates and their standard errors, shape (*batch, parameter).
        factor: quantile of the errors.
        is_scale: true for positive scales, such as standard deviations.
    """
    width = factor * errors
    usable = xp.broadcast_to(is_scale, values.shape) & (values > 0)
    ratio = xp.exp(xp.where(usable, width / xp.where(usable, values, 1.0), 0.0))
    lower = xp.where(usable, values / ratio, values - width)
    return xp.stack([lower, xp.where(usable, values * ratio, values + width)], axis=-1)
