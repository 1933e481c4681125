"""An airframe of a few polynomial terms, of an F-4's size, for tests that need no tables. Its
numbers are made up.
"""

from jaxid.aircraft.physics.mass import MassProperties
from jaxid.aircraft.vehicle.aerodynamics_polynomial import PolynomialAerodynamics
from jaxid.aircraft.vehicle.airframe import Airframe


def small_airframe(Ixy=0.0, Iyz=0.0):
    return Airframe(
        name="small",
        mass_properties=MassProperties(
            mass=17655.0, Ix=33855.0, Iy=165667.0, Iz=189543.0, Ixy=Ixy, Ixz=1593.0, Iyz=Iyz
        ),
        S=49.2,
        b=11.79,
        cbar=4.889,
        aerodynamics=PolynomialAerodynamics(
            {
                "CX": {"1": -0.02, "alpha^2": -0.6},
                "CY": {"beta": -0.5, "rudder": 0.09},
                "CZ": {"1": -0.15, "alpha": -3.2, "qhat": -5.0, "stabilator": -0.3},
                "Cl": {
                    "beta": -0.08,
                    "phat": -0.25,
                    "rhat": 0.1,
                    "aileron": -0.03,
                    "rudder": 0.005,
                },
                "Cm": {"1": 0.01, "alpha": -0.35, "qhat": -6.5, "stabilator": -0.55},
                "Cn": {"beta": 0.1, "rhat": -0.3, "rudder": -0.05, "aileron": 0.01, "phat": -0.02},
            }
        ),
        limits={"stabilator": (-0.37, 0.16), "aileron": (-0.52, 0.52), "rudder": (-0.52, 0.52)},
    )
