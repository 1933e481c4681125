"""The F-16 of the wind tunnel (NASA TP-1538), its centre of gravity forward, the report's dampers
on.
"""

from benchmarks.missing_effects import sixdof
from benchmarks.missing_effects.scenarios import System
from jaxid.aircraft.airframes import f16
from jaxid.aircraft.vehicle.augmentation import ALWAYS, Augmentation, Switch
from jaxid.aircraft.vehicle.controls import ControlSystem, standard_actuators

TERMS = {
    "moment in sideslip": ("Cm", "beta^2", -0.5),
    "moment bends over": ("Cm", "alpha^2", -0.5),
    "lift bends over, faint": ("CZ", "alpha^2", 0.3),
    "dihedral grows with alpha": ("Cl", "alpha beta", -0.3),
    "yaw of the ailerons": ("Cn", "alpha aileron", 0.05),
}


def aircraft() -> sixdof.Type:
    """At 150 m/s and 6 km, some 8 deg of angle of attack; at 0.35 chord it would be unstable in
    pitch.
    """

    def controls(frame):
        return ControlSystem(
            standard_actuators(frame.limits), augmentation=Augmentation(Switch(on=ALWAYS))
        )

    return sixdof.Type(
        name="f16",
        frame=lambda: f16(flap_deg=None, xcg=0.30, interpolation="cubic"),
        controls=controls,
        speed=150.0,
        altitude=6000.0,
        size=1.0,
    )


def system() -> System:
    """The aircraft with its scenarios."""
    return sixdof.system(aircraft(), TERMS)
