"""Buffet: the random normal force of separated flow, beyond a set angle of attack."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.checks import require, require_known
from ..._foundation.traced_checks import require_value
from ..._foundation.types import Array, Float
from .random_sinusoids import random_sinusoids, sum_of_sinusoids

Value = Array | float | int


class Buffet(eqx.Module):
    """A random part of the normal force that sets in smoothly with the angle of attack.

        dCZ = intensity share(alpha) n(t)
        share = x^2 (3 - 2x),    x = (alpha - onset)/(full - onset), held between 0 and 1

    n is the input channel `buffet`, of unit variance, such as `buffet_noise` makes. The report
    lists random variation of the normal force among the disturbances of its simulation (Table 2.1)
    without numbers: the defaults of onset and full angle are chosen here, and the intensity is zero
    by default.

    Args:
        onset: angle of attack at which it begins [rad].
        full: angle of attack from which it is full, above `onset` [rad].
        intensity: root mean square of dCZ at full buffet.

    Raises:
        InputError: when `full` is not above `onset`, or the intensity is negative.
    """

    onset: Float[Array, ""]
    full: Float[Array, ""]
    intensity: Float[Array, ""]

    def __init__(self, onset: Value = 0.2, full: Value = 0.35, intensity: Value = 0.0):
        require_value(
            intensity,
            lambda s: s >= 0,
            "Buffet: the intensity is {}. Give zero or more, an RMS of CZ.",
        )
        require_value(
            full - onset,
            lambda s: s > 0,
            "Buffet: `full` less `onset` is {} rad. Give full above onset.",
        )
        self.onset, self.full = jnp.asarray(onset, float), jnp.asarray(full, float)
        self.intensity = jnp.asarray(intensity, float)

    def coefficient(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, ""]:
        """Return the increment of CZ at an instant.

        Args:
            signals: with `alpha` [rad] and `buffet`.

        Raises:
            InputError: when a signal is not there.
        """
        require_known("signal", ("alpha", "buffet"), signals)
        x = jnp.clip((signals["alpha"] - self.onset) / (self.full - self.onset), 0.0, 1.0)
        return self.intensity * x**2 * (3.0 - 2.0 * x) * signals["buffet"]


def buffet_noise(
    key: Array, t: Float[Array, " time"], bandwidth: Value, *, count: int = 256
) -> Float[Array, " time"]:
    """Noise of unit variance, white from zero to the bandwidth and without content above it.

    A sum of sinusoids of random frequency, amplitude and phase, a line in each of equal bands.

    Args:
        key: a JAX random key.
        t: sample times, in any spacing, shape (time,) [s].
        bandwidth: end of the band, at most half the sample rate [Hz].
        count: number of sinusoids; above `bandwidth * duration` a spectrum does not resolve the
            single sinusoids.

    Returns:
        The noise, shape (time,), the input channel `buffet`.

    Raises:
        InputError: when the bandwidth is not positive, or the samples are too far apart for it.
    """
    require(
        count >= 1,
        f"Buffet noise of {count} sinusoids: give at least one, and some hundred for a "
        "smooth spectrum.",
    )
    require_value(
        bandwidth, lambda s: s > 0, "Buffet noise: the bandwidth is {} Hz. Give a positive number."
    )
    if t.size > 1:
        require_value(
            jnp.max(jnp.diff(t)) * jnp.asarray(bandwidth, float),
            lambda s: s <= 0.5 + 1e-9,
            "Buffet noise: bandwidth times sample time is {:.3g}. Sample at least twice as fast as "
            "the bandwidth.",
        )
    f, _, normal = random_sinusoids(
        key, jnp.zeros(()), jnp.asarray(bandwidth, float), count, logarithmic=False
    )
    normal = normal / count**0.5
    return sum_of_sinusoids(t, f, normal[:, :1], normal[:, 1:])[:, 0]
