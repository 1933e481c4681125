"""Harder truths of the aircraft in its plane of symmetry, without gusts."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from benchmarks.missing_effects import longitudinal
from benchmarks.missing_effects.harder.draw import (
    harder,
    moment,
    one_of,
    pairs,
    sized,
)
from benchmarks.missing_effects.harder.flight import flown, with_noise
from benchmarks.missing_effects.harder.sensors import at_sensor, curve, late, saturation, two_late
from benchmarks.missing_effects.scenarios import (
    CHECK,
    TEST,
    TRAIN,
    Flown,
    Planted,
    Scenario,
    System,
    planted,
)
from benchmarks.missing_effects.truth_only import HeightDependence, SensorAbsolute, SensorSquare
from jaxid.aircraft.effects.coefficient_term import CoefficientTerm
from jaxid.aircraft.effects.flow_dependence import CoefficientGradient, in_coefficient
from jaxid.aircraft.effects.separation import Separation
from jaxid.aircraft.flight.longitudinal import LONGITUDINAL_AFFECTED_STATES, Longitudinal
from jaxid.aircraft.flight.longitudinal_flight import (
    FLIGHT_SAMPLE_TIME,
    LONGITUDINAL_SPEED,
    NOISE_DEG,
    NOISE_SI,
    SAMPLES,
    level_trim,
    manoeuvres,
    true_aircraft,
)
from jaxid.effects import (
    Augmented,
    InputDeadZone,
    InputDelay,
    InputLag,
    InputRateLimit,
    Location,
    LocationKind,
    ParameterStep,
    SensorBias,
    SensorLag,
    SensorScale,
)

DURATION = FLIGHT_SAMPLE_TIME * (SAMPLES - 1)  # s
EQUATIONS = {"CX": "u", "CZ": "w", "Cm": "q"}
ELEVATOR = (Location(LocationKind.INPUT, "elevator"), Location(LocationKind.EQUATION, "q"))
# Coefficient, product and slope with the airspeed [s/m]; the aircraft has no other flow variable.
WITH_SPEED = (("CZ", "alpha", -0.04), ("Cm", "alpha", -0.01), ("Cm", "elevator", 0.02))
POWERS = {"Cm": (-0.5, -8.0), "CZ": (3.0, 10.0)}  # of alpha^2 and alpha^3


def system() -> System:
    """The aircraft with its harder truths."""
    return longitudinal.system()._replace(scenarios=_scenarios(), fly=fly)


def fly(wanted: Scenario, seed: int) -> Flown:
    """Seven manoeuvres of 20 s, each larger or smaller by up to a third, to either side."""
    generator = wanted.generator(seed)
    count = TRAIN + CHECK + TEST
    size = generator.uniform(0.7, 1.3, count) * generator.choice([-1.0, 1.0], count)
    aircraft, t, u, start = manoeuvred(size)
    outputs = aircraft.outputs
    noise = np.array([np.radians(NOISE_DEG[c]) if c in NOISE_DEG else NOISE_SI[c] for c in outputs])
    clean = flown(aircraft, centred(wanted.effects, float(u[0, 0, 0])), t, u, start)
    z = with_noise(
        wanted.effects, clean, noise * generator.normal(size=clean.shape), aircraft.outputs
    )
    usual = longitudinal.given(aircraft, Augmented(aircraft, ()), t, u, z)
    return usual._replace(noise=tuple(noise.tolist()))


def manoeuvred(size: np.ndarray):
    """Return the trimmed aircraft, sample times, elevator and initial state of all manoeuvres.

    Args:
        size: factor on each manoeuvre.
    """
    aircraft: Longitudinal = true_aircraft()
    trimmed, elevator, thrust = level_trim(aircraft, LONGITUDINAL_SPEED)
    aircraft = eqx.tree_at(lambda model: model.thrust, aircraft, thrust)
    t = FLIGHT_SAMPLE_TIME * jnp.arange(SAMPLES)
    u = elevator + (size[:, None] * jnp.stack(list(manoeuvres(t).values())))[..., None]
    return aircraft, t, u, trimmed


def centred(effects, elevator: float):
    """Return the effects with dead zones about the elevator's trim [rad]."""
    return tuple(
        eqx.tree_at(lambda effect: effect.centre, one, jnp.asarray(elevator))
        if isinstance(one, InputDeadZone)
        else one
        for one in effects
    )


def _places(coefficient: str) -> tuple[Location, ...]:
    return (Location(LocationKind.EQUATION, EQUATIONS[coefficient]),)


def _term(generator, coefficient: str, product: str, gain: float) -> Planted:
    return planted(
        CoefficientTerm,
        coefficient,
        product,
        LONGITUDINAL_AFFECTED_STATES[coefficient],
        gain=sized(generator, gain),
        places=_places(coefficient),
    )


def _powers(generator):
    coefficient = one_of(generator, tuple(POWERS))
    square, cube = POWERS[coefficient]
    return (
        _term(generator, coefficient, "alpha^2", square),
        _term(generator, coefficient, "alpha^3", cube),
    )


def _with_speed(generator):
    coefficient, product, slope = one_of(generator, WITH_SPEED)
    placement = in_coefficient(coefficient, LONGITUDINAL_AFFECTED_STATES[coefficient])
    return (
        planted(
            CoefficientGradient,
            placement,
            "V",
            product,
            gain=sized(generator, slope),
            centre=LONGITUDINAL_SPEED,
            places=_places(coefficient),
            also=(f"{product} varying with mach in {coefficient}",),
        ),
    )


def _with_height(generator):
    effect = HeightDependence("CZ", sized(generator, -0.05), 50.0)
    return (Planted(effect, _places("CZ")),)


def _mass(generator):
    mass = float(true_aircraft().mass)
    step = planted(
        ParameterStep,
        "mass",
        0.5,
        gain=-sized(generator, 0.05) * mass,
        time=moment(generator, DURATION),
        width=FLIGHT_SAMPLE_TIME,
        places=(*_places("CX"), *_places("CZ")),
    )
    return (step,)


def _lag(generator) -> Planted:
    return planted(InputLag, "elevator", gain=1.0, time=sized(generator, 0.1), places=ELEVATOR)


def _rate_limit(generator) -> Planted:
    limit = np.radians(sized(generator, 4.0))
    return planted(InputRateLimit, "elevator", gain=1.0, limit=limit, places=ELEVATOR)


def _dead_zone(generator) -> Planted:
    width = np.radians(sized(generator, 0.4))
    return planted(InputDeadZone, "elevator", gain=1.0, width=width, centre=0.0, places=ELEVATOR)


def _separated(generator):
    coefficients = tuple(EQUATIONS)
    placements = tuple(
        in_coefficient(name, LONGITUDINAL_AFFECTED_STATES[name]) for name in coefficients
    )
    separation = planted(
        Separation,
        placements,
        0.65,
        gain=sized(generator, -3.0),
        alpha_star=float(generator.uniform(0.14, 0.18)),
        steepness=25.0,
        forward=0.0,
        pitching=0.05,
        lag=sized(generator, 0.3),
        late=sized(generator, 0.15),
        places=(*_places("CZ"), *_places("Cm")),
    )
    return separation, _term(generator, "Cm", "alpha qhat", -60.0)


MOTION = (
    lambda g: _term(g, "Cm", "alpha^3", -8.0),
    lambda g: _term(g, "CZ", "alpha^2", 3.0),
    lambda g: _term(g, "Cm", "alpha elevator", 2.0),
    lambda g: planted(InputDelay, "elevator", gain=sized(g, 0.05), places=ELEVATOR),
    _lag,
)
SENSORS = (
    lambda g: planted(SensorScale, "alpha", gain=sized(g, 0.05), places=at_sensor("alpha")),
    lambda g: planted(SensorBias, "q", gain=sized(g, 0.002), places=at_sensor("q")),
    lambda g: planted(SensorLag, "alpha", gain=sized(g, 0.08), places=at_sensor("alpha")),
    lambda g: late("alpha", sized(g, 0.08)),
)


def _scenarios() -> tuple[Scenario, ...]:
    levels = {"alpha": (0.11, 0.13), "q": (0.03, 0.06)}
    curves = {"alpha": 0.3, "q": 0.5}
    rates = {"CX": 10.0, "CZ": -20.0, "Cm": -3.0}
    return (
        *(
            harder(
                f"alpha-dot in {name}",
                lambda g, name=name, gain=gain: (_term(g, name, "alphadot_hat", gain),),
            )
            for name, gain in rates.items()
        ),
        harder("square and cube of alpha", _powers),
        harder("a coefficient varies with the airspeed", _with_speed),
        harder("lift depends on height", _with_height),
        harder("mass steps", _mass),
        harder("separation with hysteresis, and a term", _separated),
        harder("lag and dead zone of the elevator", lambda g: (_lag(g), _dead_zone(g))),
        harder(
            "rate limit and dead zone of the elevator", lambda g: (_rate_limit(g), _dead_zone(g))
        ),
        harder("lag and rate limit of the elevator", lambda g: (_lag(g), _rate_limit(g))),
        harder("two late sensors", lambda g: two_late(g, ("alpha", "q", "pitch"), 0.08)),
        harder("saturation of a sensor", lambda g: saturation(g, levels)),
        harder("square of a sensor", lambda g: curve(SensorSquare, g, curves)),
        harder(
            "absolute value of a sensor",
            lambda g: curve(SensorAbsolute, g, {"q": 0.1, "pitch": 0.05}),
        ),
        *pairs(MOTION, SENSORS),
    )
