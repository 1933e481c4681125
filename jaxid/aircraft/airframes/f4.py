"""`f4`: an F-4-like aircraft at high angle of attack."""

from ...models.tables import Extrapolation, Interpolation
from ..vehicle.aerodynamics_tables import TableAerodynamics, origins, read_coefficients
from ..vehicle.airframe import Airframe
from .shared import DATA, angles, ft, ft2, mass_properties


def f4(
    *,
    interpolation: Interpolation | str = Interpolation.MONOTONE,
    extrapolation: Extrapolation | str = Extrapolation.HOLD,
) -> Airframe:
    """Return an F-4-like aircraft, -10 to 110 deg in alpha and -40 to 40 deg in beta, reliable from
    5 to 21 deg in alpha.

    The report does not print its tables. These tables are compiled from public F-4 data (0 to 15
    deg), from numbers printed in the report (10 to 21 deg), and elsewhere from engineering
    judgement; `f4_origins` gives the source of each value. Mass, inertia and size: F-4 model of
    Garza and Morelli, NASA/TM-2003-212145. Stops of the controls: report, App. D.1.5. The moment
    reference is the centre of gravity. The report's engine momentum is unknown; add one to the
    engine if needed.

    Args:
        interpolation: between knots, see `Table`.
        extrapolation: beyond the knots.
    """
    return Airframe(
        name="f4",
        mass_properties=mass_properties(
            weight_lb=38924.0, Ix=24970.0, Iy=122190.0, Iz=139800.0, Ixz=1175.0
        ),
        S=ft2(530.0),
        b=ft(38.67),
        cbar=ft(16.04),
        aerodynamics=TableAerodynamics(
            read_coefficients(DATA / "f4"), interpolation=interpolation, extrapolation=extrapolation
        ),
        limits=angles(stabilator=(-21.0, 9.0), aileron=(-30.0, 30.0), rudder=(-30.0, 30.0)),
        trusted=angles(alpha=(5.0, 21.0)),
    )


def f4_origins() -> dict[str, str]:
    """Return the origin of each value of the tables of `f4`, by its name, such as
    `Cm.alpha=10,beta=-5`.

    The first letter is the class: M from a measured source, R printed in the report, B a blend of
    these two, I interpolated between neighbours of the classes in brackets, E engineering
    judgement.
    """
    return origins(read_coefficients(DATA / "f4"))
