"""Air-relative signals of a moving body: angles, pressures and dimensionless rates."""

from ..._foundation.types import Array, Float
from ..air.atmosphere import Air
from ..physics.frames import air_angles
from .airframe import Airframe


def flow(
    airframe: Airframe, air: Air, velocity: Float[Array, "3"], omega: Float[Array, "3"]
) -> dict[str, Float[Array, ""]]:
    """Return the signals of the flow at an instant.

        phat = p b/2V,   qhat = q cbar/2V,   rhat = r b/2V,   mach = V/c,   qbar = density V^2/2

    Args:
        airframe: its span and chord.
        air: state of the air.
        velocity: relative to the air, body axes [m/s].
        omega: angular rate relative to the air [rad/s].

    Returns:
        `u_air v_air w_air`, `V alpha beta`, `phat qhat rhat`, `density pressure mach qbar` [SI].
    """
    V, alpha, beta = air_angles(velocity)
    return {
        **dict(zip(("u_air", "v_air", "w_air"), velocity, strict=True)),
        **dict(zip(("phat", "qhat", "rhat"), omega * airframe.lengths / (2.0 * V), strict=True)),
        **{"V": V, "alpha": alpha, "beta": beta},
        **{"density": air.density, "pressure": air.pressure, "mach": V / air.sound_speed},
        "qbar": 0.5 * air.density * V**2,
    }
