"""A turbofan with afterburner; its thrust follows the throttle with the lag of its rotors."""

from typing import ClassVar

import jax.numpy as jnp

from ..._foundation.checks import require
from ..._foundation.traced_checks import require_value
from ..._foundation.types import Array, Float
from ...models.tables import Table
from .engine import AbstractThrust, Signals

RATINGS = ("idle", "mil", "max")
MILITARY = 50.0  # % of power at which the afterburner lights
# Source of all constants below: Stevens and Lewis, App. A (functions TGEAR, PDOT and RTAU).
DETENT = 0.77  # throttle at military power
BELOW = 64.94  # % of power over throttle up to the detent
ABOVE, OFFSET = 217.38, 117.38  # % of power over throttle beyond the detent, and its offset
# %, goal of the core before the afterburner lights, and just after it is shut off
UP, DOWN = 60.0, 40.0
BURNING = 5.0  # 1/s, rate constant with the afterburner lit
CORE_SLOW, CORE_QUICK = 0.1, 1.0  # 1/s, rate constants of the core far from and near its goal
POWER_NEAR, POWER_FAR = 25.0, 50.0  # % of power: distances from the goal that count as near and far


class Turbofan(AbstractThrust):
    r"""The engine model of Stevens and Lewis: throttle to commanded power, its lag, and thrust from
    three ratings.

        throttle = setting + lever, in 0 to 1
        commanded = 64.94 throttle up to 0.77,    217.38 throttle - 117.38 beyond
        d(power)/dt = k (goal - power)
        T = idle + (mil - idle) power/50 up to 50 %,    mil + (max - mil) (power - 50)/50 beyond

    `goal` is the commanded power if it lies on the same side of 50 % as the power; otherwise 60 %
    for rising and 40 % for falling power. k is 5/s above 50 %; below, 1/s within 25 % of the goal
    and 0.1/s beyond 50 % from it, linear in between.

    Args:
        ratings: thrust [N] at `idle`, `mil` (military) and `max` power, over `altitude` [m] and
            `mach`.
        setting: throttle in trim, 0 to 1.

    Raises:
        InputError: when the table does not hold the three ratings, or the setting is not traced and
            not within 0 to 1.

    Source: B. L. Stevens, F. L. Lewis, Aircraft Control and Simulation, 2nd ed., Wiley 2003,
    section 3.5 and App. A.
    """

    ratings: Table
    setting: Float[Array, ""]

    states: ClassVar[tuple[str, ...]] = ("power",)
    inputs: ClassVar[tuple[str, ...]] = ("throttle",)
    limits: ClassVar[tuple[float, float]] = (0.0, 1.0)  # of the setting, for a trim

    def __init__(self, ratings: Table, setting: Float[Array, ""] | float = 0.0):
        require(
            ratings.quantities == RATINGS,
            f"The engine's table holds {', '.join(ratings.quantities) or 'one nameless quantity'}. "
            f"It must hold {', '.join(RATINGS)}, in this order.",
        )
        require_value(
            setting,
            lambda s: (s >= 0) & (s <= 1),
            "The throttle setting is {}. Give a number between 0 and 1.",
        )
        self.ratings, self.setting = ratings, jnp.asarray(setting, float)

    def thrust(self, x: Float[Array, " state"], signals: Signals) -> Float[Array, ""]:
        idle, military, most = self.ratings(signals)
        dry = idle + (military - idle) * x[0] / MILITARY
        return jnp.where(
            x[0] < MILITARY,
            dry,
            military + (most - military) * (x[0] - MILITARY) / (100.0 - MILITARY),
        )

    def rates(
        self, x: Float[Array, " state"], lever: Float[Array, " input"], signals: Signals
    ) -> Float[Array, " state"]:
        power, commanded = x[0], commanded_power(self.setting + lever[0])
        burning, to_burn = power >= MILITARY, commanded >= MILITARY
        goal = jnp.where(to_burn == burning, commanded, jnp.where(to_burn, UP, DOWN))
        core = jnp.interp(
            goal - power, jnp.array([POWER_NEAR, POWER_FAR]), jnp.array([CORE_QUICK, CORE_SLOW])
        )
        return jnp.stack([jnp.where(burning, BURNING, core) * (goal - power)])

    def trimmed(self, setting: Float[Array, ""]) -> "Turbofan":
        return Turbofan(self.ratings, setting)

    def resting(self) -> Float[Array, " state"]:
        return jnp.stack([commanded_power(self.setting)])


def commanded_power(throttle: Float[Array, ""]) -> Float[Array, ""]:
    """Return the commanded power [%] of a throttle, clipped to 0 to 1."""
    throttle = jnp.clip(throttle, 0.0, 1.0)
    return jnp.where(throttle <= DETENT, BELOW * throttle, ABOVE * throttle - OFFSET)
