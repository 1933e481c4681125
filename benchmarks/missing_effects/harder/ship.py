"""Harder truths of the ship."""

from benchmarks.missing_effects import ship
from benchmarks.missing_effects.harder.draw import (
    harder,
    moment,
    one_of,
    pairs,
    sized,
)
from benchmarks.missing_effects.harder.sensors import at_sensor, curve, late, saturation, two_late
from benchmarks.missing_effects.scenarios import Planted, Scenario, System, planted
from benchmarks.missing_effects.ship import ROLL, RUDDER, SWAY, YAW
from benchmarks.missing_effects.truth_only import MassStep, SensorAbsolute, SensorSquare
from jaxid.effects import (
    InputDeadZone,
    InputDelay,
    InputLag,
    InputRateLimit,
    QuadraticDrag,
    SensorBias,
    SensorLag,
    SensorScale,
    Term,
)

DURATION = ship.STEP * (ship.SAMPLES - 1)  # s
PLACES = {"v": SWAY, "r": YAW, "p": ROLL}
# Equation, and powers of one signal in it with their gains.
POWERS = (
    ("p", "phi", ((2, 0.2), (3, -3.0))),
    ("r", "r", ((2, 1.0), (3, -50.0))),
    ("v", "v", ((2, 0.005), (3, -0.005))),
)


def system() -> System:
    """The ship with its harder truths."""
    return ship.system()._replace(scenarios=_scenarios())


def _lag(generator) -> Planted:
    return planted(InputLag, "rudder", gain=1.0, time=sized(generator, 2.0), places=RUDDER)


def _rate_limit(generator) -> Planted:
    return planted(InputRateLimit, "rudder", gain=1.0, limit=sized(generator, 0.03), places=RUDDER)


def _dead_zone(generator) -> Planted:
    return planted(InputDeadZone, "rudder", gain=1.0, width=sized(generator, 0.02), places=RUDDER)


def _powers(generator):
    state, signal, powers = one_of(generator, POWERS)
    return tuple(
        planted(Term, state, f"{signal}^{power}", gain=sized(generator, gain), places=PLACES[state])
        for power, gain in powers
    )


def _mass(generator):
    step = MassStep("v", sized(generator, 0.3), moment(generator, DURATION))
    return (Planted(step, SWAY, ("step of *mass*",)),)


MOTION = (
    lambda g: planted(QuadraticDrag, "p", "p", gain=sized(g, -1.0), places=ROLL),
    lambda g: planted(QuadraticDrag, "v", "v", gain=sized(g, -0.01), places=SWAY),
    lambda g: planted(Term, "p", "phi^3", gain=sized(g, -3.0), places=ROLL),
    lambda g: planted(Term, "r", "r^3", gain=sized(g, -50.0), places=YAW),
    lambda g: planted(InputDelay, "rudder", gain=sized(g, 0.5), places=RUDDER),
)
SENSORS = (
    lambda g: planted(SensorScale, "r", gain=sized(g, 0.05), places=at_sensor("r")),
    lambda g: planted(SensorBias, "r", gain=sized(g, 0.001), places=at_sensor("r")),
    lambda g: planted(SensorLag, "phi", gain=sized(g, 0.3), places=at_sensor("phi")),
    lambda g: late("v", sized(g, 1.0)),
)


def _scenarios() -> tuple[Scenario, ...]:
    levels = {"phi": (0.03, 0.06), "r": (0.012, 0.018)}
    return (
        harder("square and cube of a state", _powers),
        harder("lag and dead zone of the rudder", lambda g: (_lag(g), _dead_zone(g))),
        harder("rate limit and dead zone of the rudder", lambda g: (_rate_limit(g), _dead_zone(g))),
        harder("lag and rate limit of the rudder", lambda g: (_lag(g), _rate_limit(g))),
        harder("two late sensors", lambda g: two_late(g, ("v", "r", "p", "phi"), 1.0)),
        harder("saturation of a sensor", lambda g: saturation(g, levels)),
        harder("square of a sensor", lambda g: curve(SensorSquare, g, {"phi": 1.0, "v": 0.05})),
        harder(
            "absolute value of a sensor", lambda g: curve(SensorAbsolute, g, {"phi": 0.1, "r": 0.1})
        ),
        harder("mass steps", _mass),
        *pairs(MOTION, SENSORS),
    )
