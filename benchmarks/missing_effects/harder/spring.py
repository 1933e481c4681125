"""Harder truths of the spring."""

from benchmarks.missing_effects import spring
from benchmarks.missing_effects.harder.draw import (
    harder,
    moment,
    one_of,
    pairs,
    sized,
    two_delays,
)
from benchmarks.missing_effects.harder.sensors import curve, late, saturation
from benchmarks.missing_effects.scenarios import Planted, Scenario, System, planted
from benchmarks.missing_effects.spring import FORCE, KINK, SENSOR_A, SENSOR_X
from benchmarks.missing_effects.truth_only import MassStep, SensorAbsolute, SensorSquare
from jaxid.effects import (
    DryFriction,
    Hysteresis,
    InputDeadZone,
    InputDelay,
    InputLag,
    InputRateLimit,
    Placement,
    QuadraticDrag,
    SensorBias,
    SensorDelay,
    SensorDrift,
    SensorLag,
    SensorScale,
    Term,
)

DURATION = spring.STEP * (spring.SAMPLES - 1)  # s
# A delay of both sensors equals a delay of the force.
FORCE_DELAY = ("delay of input force",)
POWERS = {"x": ((2, 0.1), (3, -0.3)), "v": ((2, 0.1), (3, -0.1))}


def system() -> System:
    """The spring with its harder truths."""
    return spring.system()._replace(scenarios=_scenarios())


def _term(generator, product: str, gain: float) -> Planted:
    return planted(Term, "v", product, gain=sized(generator, gain), places=FORCE)


def _lag(generator) -> Planted:
    return planted(InputLag, "force", gain=1.0, time=sized(generator, 0.3), places=FORCE)


def _rate_limit(generator) -> Planted:
    return planted(InputRateLimit, "force", gain=1.0, limit=sized(generator, 1.2), places=FORCE)


def _dead_zone(generator) -> Planted:
    return planted(InputDeadZone, "force", gain=1.0, width=sized(generator, 0.25), places=FORCE)


def _powers(generator):
    signal = one_of(generator, tuple(POWERS))
    return tuple(_term(generator, f"{signal}^{power}", gain) for power, gain in POWERS[signal])


def _late(generator):
    x, a = two_delays(generator, 0.15)
    return late("x", x, FORCE_DELAY), late("a", a, FORCE_DELAY)


def _mass(generator):
    step = MassStep("v", sized(generator, 0.3), moment(generator, DURATION))
    return (Planted(step, FORCE, ("step of *mass*",)),)


def _hysteresis(generator):
    loop = planted(
        Hysteresis,
        Placement.equation("v"),
        "x",
        gain=sized(generator, -0.3),
        width=0.3,
        places=FORCE,
    )
    return loop, _term(generator, *one_of(generator, (("x^2", 0.1), ("v^3", -0.1))))


MOTION = (
    lambda g: _term(g, "x^3", -0.3),
    lambda g: _term(g, "x^2 v", -0.1),
    lambda g: planted(QuadraticDrag, "v", "v", gain=sized(g, -0.2), places=FORCE),
    lambda g: planted(
        DryFriction, "v", "v", gain=sized(g, -0.2), width=0.01, places=FORCE, also=KINK
    ),
    lambda g: planted(InputDelay, "force", gain=sized(g, 0.15), places=FORCE),
)
SENSORS = (
    lambda g: planted(SensorScale, "a", gain=sized(g, 0.1), places=SENSOR_A),
    lambda g: planted(SensorBias, "a", gain=sized(g, 0.05), places=SENSOR_A),
    lambda g: planted(SensorLag, "a", gain=sized(g, 0.15), places=SENSOR_A),
    lambda g: planted(SensorDelay, "x", gain=sized(g, 0.1), places=SENSOR_X),
    lambda g: planted(SensorDrift, "x", gain=sized(g, 0.004), places=SENSOR_X),
)


def _scenarios() -> tuple[Scenario, ...]:
    return (
        harder("square and cube of a state", _powers),
        harder(
            "third and fifth power of the position",
            lambda g: (_term(g, "x^3", -0.3), _term(g, "x^5", -0.05)),
        ),
        harder("lag and dead zone of the actuator", lambda g: (_lag(g), _dead_zone(g))),
        harder(
            "rate limit and dead zone of the actuator", lambda g: (_rate_limit(g), _dead_zone(g))
        ),
        harder("lag and rate limit of the actuator", lambda g: (_lag(g), _rate_limit(g))),
        harder("hysteresis of the spring, and a term", _hysteresis),
        harder("two late sensors", _late),
        harder(
            "saturation of a sensor", lambda g: saturation(g, {"x": (0.5, 1.0), "a": (0.7, 1.4)})
        ),
        harder("square of a sensor", lambda g: curve(SensorSquare, g, {"x": 0.1, "a": 0.1})),
        harder(
            "absolute value of a sensor", lambda g: curve(SensorAbsolute, g, {"x": 0.1, "a": 0.1})
        ),
        harder("mass steps", _mass),
        *pairs(MOTION, SENSORS),
    )
