"""The F-4-like aircraft with its tables, as in `python -m jaxid`."""

from benchmarks.missing_effects import sixdof
from benchmarks.missing_effects.scenarios import System
from jaxid.aircraft.airframes import f4
from jaxid.aircraft.vehicle.controls import ControlSystem, standard_actuators

TERMS = {
    "moment in sideslip": ("Cm", "beta^2", -0.8),
    "moment in sideslip, faint": ("Cm", "beta^2", -0.04),
    "lift bends over": ("CZ", "alpha^2", 2.0),
    "dihedral grows with alpha": ("Cl", "alpha beta", -0.3),
    "directional stability, cubic": ("Cn", "beta^3", 0.5),
}


def aircraft() -> sixdof.Type:
    """At 550 ft/s and 35,000 ft, some 11 deg of angle of attack."""
    return sixdof.Type(
        name="f4",
        frame=lambda: f4(interpolation="cubic"),
        controls=lambda frame: ControlSystem(standard_actuators(frame.limits)),
        speed=167.64,
        altitude=10668.0,
        size=1.0,
    )


def system() -> System:
    """The aircraft with its scenarios."""
    return sixdof.system(aircraft(), TERMS)
