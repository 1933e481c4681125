"""`LocalisationResult`: places of the residual in falling order of the share that they explain."""

from typing import NamedTuple

import numpy as np
import scipy

from .._foundation.location import Location
from .._foundation.types import Float
from .thresholds import LARGEST_WEIGHT


class Place(NamedTuple):
    """One place and the effect of a free-form disturbance there.

    Attributes:
        location: an equation by its state, an input, an output's sensor, a parameter that drifts,
            or the air by what moves in it.
        score: fall of the whitened sum of squares of the residual; chi-square with `dof` degrees of
            freedom if no effect is missing.
        dof: number of combinations of the basis functions that the free parameters cannot
            reproduce.
        share: explained share of the residual's power (of the power above the noise, if the noise
            is known), less the share expected by chance under white noise; NaN if no power is above
            the noise.
        disturbance, deviation: the most probable disturbance and its standard deviation, shape
            (case, knot) [rate of the state, or the channel's or parameter's unit].
    """

    location: Location
    score: float
    dof: int
    share: float
    disturbance: Float[np.ndarray, "case knot"]
    deviation: Float[np.ndarray, "case knot"]

    @property
    def size(self) -> float:
        """Root mean square of the disturbance."""
        return float(np.sqrt(np.mean(self.disturbance**2)))


class LocalisationResult(NamedTuple):
    """Places in falling order of their explained share.

    Attributes:
        places: one entry for each place considered.
        knots: times of the knots, shape (case, knot) [s].
        variables: states, inputs and outputs at the knots, by name, each of shape (case, knot).
        splines: number of linear B-splines in each record, and number of rows that they cover.
        power: reference of the shares: the whitened sum of squares of the residual, less its
            degrees of freedom if the noise is known, and at least the fall at the first place; NaN
            if no place explains any of it.
        noise_dof: degrees of freedom of the estimate of the noise; infinite if it is known.
    """

    places: tuple[Place, ...]
    knots: Float[np.ndarray, "case knot"]
    variables: dict[str, Float[np.ndarray, "case knot"]]
    splines: tuple[int, int]
    power: float
    noise_dof: float = np.inf

    def near_best(self, within: float = 0.05) -> tuple[Place, ...]:
        """Return the first place and all places whose share is less than `within` below its."""
        first, *others = self.places
        return (first, *(place for place in others if place.share > first.share - within))

    def is_significant(self, level: float) -> bool:
        """Return True if a free-form disturbance at a place explains more than chance would.

        Args:
            level: probability of a false alarm over all places.
        """
        places = [place for place in self.places if place.dof]
        chances = [self.chance(place) for place in places]
        return min(chances, default=1.0) < level / max(len(chances), 1)

    def chance(self, place: Place) -> float:
        """Return the probability of a larger score at a place if no effect is missing: by
        chi-square, or with an estimated noise by the F distribution of `score / dof`.

        Args:
            place: one of the places, with `dof` above zero.
        """
        if np.isfinite(self.noise_dof):
            return float(scipy.stats.f.sf(place.score / place.dof, place.dof, self.noise_dof))
        return float(scipy.stats.chi2.sf(place.score, place.dof))

    def significant(self, level: float) -> tuple[Place, ...]:
        """Return the places near the best one, none if it explains no more than chance would.

        Args:
            level: probability of a false alarm over all places.
        """
        return self.near_best() if self.is_significant(level) else ()

    def explained_by(self, place: Place) -> tuple[tuple[str, float], ...]:
        """Return the R^2 of a cubic regression of the disturbance on each variable, largest first:
        the share of its power about its mean. It is zero for a constant disturbance.

        Each knot is weighted by the inverse standard deviation of the disturbance there. The free
        parameters can reproduce a part of the disturbance, so its linear part in a variable may be
        missing.
        """
        d = place.disturbance.reshape(-1)
        weight = 1.0 / np.maximum(place.deviation.reshape(-1), 1e-300)
        if np.any(weight > 0):
            weight /= np.median(weight[weight > 0])
            weight = np.minimum(weight, LARGEST_WEIGHT)
            d = d - np.average(d, weights=weight**2)
        power = float(np.sum((weight * d) ** 2))
        shares = []
        for name, values in self.variables.items():
            s = values.reshape(-1)
            size = np.ptp(s) or 1.0
            A = weight[:, None] * np.vander((s - s.mean()) / size, 4)
            remainder = weight * d - A @ np.linalg.lstsq(A, weight * d, rcond=None)[0]
            share = 1.0 - float(remainder @ remainder) / power if power > 0 else 0.0
            shares.append((name, share))
        return tuple(sorted(shares, key=lambda pair: -pair[1]))

    def __str__(self) -> str:
        width = max(len(place.location.label) for place in self.places)
        lines = [f"{'place':<{width}} {'share':>8} {'chi-square':>11} {'dof':>5}"]
        for place in self.places:
            label = f"{place.location.label:<{width}}"
            lines.append(f"{label} {place.share:>8.1%} {place.score:>11.4g} {place.dof:>5}")
        return "\n".join(lines)
