"""Harder truths of the aircraft in six degrees of freedom.

Surfaces come from a flight without the planted effects. The true aircraft with them flies from its
trim with these recorded surfaces as inputs, by an adaptive method of order five.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from benchmarks.missing_effects import sixdof
from benchmarks.missing_effects.harder.draw import (
    harder,
    moment,
    one_of,
    pairs,
    sized,
)
from benchmarks.missing_effects.harder.flight import flown
from benchmarks.missing_effects.harder.sensors import at_sensor, curve, guesses, late, two_late
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
from benchmarks.missing_effects.sixdof import EQUATIONS, GUSTS, Type
from benchmarks.missing_effects.truth_only import Joint, SensorSquare
from jaxid.aircraft.effects.coefficient_term import CoefficientTerm
from jaxid.aircraft.effects.flow_dependence import CoefficientGradient, in_coefficient
from jaxid.aircraft.effects.separation import Separation
from jaxid.aircraft.flight.aircraft import AFFECTED_STATES, RIGID, Aircraft
from jaxid.aircraft.flight.coupled_flight import (
    FLIGHT_SAMPLE_TIME,
    RECORDED_CHANNELS,
    SAMPLES,
    TABLES_ARE_OFF_BY,
)
from jaxid.aircraft.flight.trims import level
from jaxid.aircraft.instruments.noise_levels import DEMONSTRATION
from jaxid.aircraft.vehicle.controls import SURFACES, MeasuredSurfaces
from jaxid.effects import (
    InputDeadZone,
    InputDelay,
    InputLag,
    InputRateLimit,
    Location,
    LocationKind,
    ParameterStep,
    SensorScale,
)

DURATION = FLIGHT_SAMPLE_TIME * (SAMPLES - 1)  # s
# Gains of the terms with the reduced rate of alpha or beta; of the size of the damping.
RATES = {"CX": 10.0, "CZ": -20.0, "Cm": -4.0, "CY": 3.0, "Cl": 0.3, "Cn": -0.6}
# Coefficient, product and slope of terms that vary with Mach [1].
WITH_MACH = (("CZ", "alpha", -4.0), ("Cm", "alpha", -1.0), ("Cn", "beta", 0.4))
# Changes of dynamic pressure [Pa] and altitude [m] that count as one of Mach; chosen: the first is
# about 2 qbar/Mach in both trims.
AS_MACH = {"mach": 1.0, "qbar": 24000.0, "altitude": 1000.0}
POWERS = {"Cm": (-0.5, -2.0), "CZ": (2.0, 5.0)}  # of alpha^2 and alpha^3
STALL = {"f4": (0.21, 0.24), "f16": (0.16, 0.19)}  # rad; 1 to 3 deg above the trimmed alpha
LATE = ("alpha", "beta", "q", "r", "pitch")  # sensors: a draw makes two of them late
STABILATOR = (Location(LocationKind.INPUT, "stabilator"), Location(LocationKind.EQUATION, "q"))


def system(of: Type, usual: System) -> System:
    """Return the system of an aircraft with its harder truths.

    Args:
        of: the aircraft.
        usual: the system with its usual scenarios.
    """
    return usual._replace(scenarios=_scenarios(of), fly=lambda wanted, seed: _fly(of, wanted, seed))


def _fly(of: Type, wanted: Scenario, seed: int) -> Flown:
    """Seven manoeuvres of 20 s, each larger or smaller by up to a third, to either side."""
    generator = wanted.generator(seed)
    count = TRAIN + CHECK + TEST
    size = of.size * generator.uniform(0.7, 1.3, count) * generator.choice([-1.0, 1.0], count)
    levels = np.array([DEMONSTRATION.bias[name] for name in RECORDED_CHANNELS])
    bias = levels * generator.normal(size=len(RECORDED_CHANNELS))
    noise = np.array([DEMONSTRATION.noise[name] for name in RECORDED_CHANNELS])
    aircraft, t, surfaces, state = manoeuvred(of, size, bias)
    effects = centred(wanted.effects, aircraft, surfaces[0, 0], state)
    clean = flown(aircraft, effects, t, surfaces, state)
    z = clean + noise * generator.normal(size=clean.shape)
    return sixdof.given(of, aircraft, t, surfaces, z, bias)._replace(noise=tuple(noise.tolist()))


def manoeuvred(of: Type, size: np.ndarray, bias: np.ndarray):
    """Return the true aircraft, sample times, surfaces, and the initial state of all manoeuvres.

    The surfaces are inputs of this aircraft.

    Args:
        of: the aircraft.
        size: factor on each manoeuvre.
        bias: offsets of the instruments.
    """
    corrections = {name: dict(terms) for name, terms in TABLES_ARE_OFF_BY.items()}
    trimmed = level(sixdof.true_aircraft(of, corrections, bias), of.speed, of.altitude)
    t = FLIGHT_SAMPLE_TIME * np.arange(SAMPLES)
    still = jnp.zeros((size.size, SAMPLES, len(GUSTS)))
    surfaces, _ = sixdof.surfaces_and_outputs(
        trimmed.aircraft, jnp.asarray(t), jnp.asarray(size), still, trimmed.state
    )
    flew = trimmed.aircraft
    aircraft = Aircraft(
        flew.airframe,
        engines=flew.engines,
        controls=MeasuredSurfaces(),
        instruments=flew.instruments,
    )
    return aircraft, t, np.asarray(surfaces), trimmed.state[: len(RIGID)]


def centred(effects, aircraft: Aircraft, surfaces: np.ndarray, state):
    """Return the effects with gradients and dead zones about the trim.

    Args:
        effects: planted effects.
        aircraft: the true aircraft.
        surfaces: in trim [rad].
        state: in trim.
    """
    trim = aircraft.immediate_signals(jnp.zeros(()), state, jnp.asarray(surfaces))

    def about(one):
        if isinstance(one, CoefficientGradient | InputDeadZone):
            name = one.signal if isinstance(one, CoefficientGradient) else one.channel
            return eqx.tree_at(lambda effect: effect.centre, one, trim[name])
        return one

    return tuple(about(one) for one in effects)


def _places(coefficient: str) -> tuple[Location, ...]:
    states = dict.fromkeys((EQUATIONS[coefficient], *AFFECTED_STATES[coefficient]))
    return tuple(Location(LocationKind.EQUATION, state) for state in states)


def _term(generator, coefficient: str, product: str, gain: float) -> Planted:
    return planted(
        CoefficientTerm,
        coefficient,
        product,
        AFFECTED_STATES[coefficient],
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


def _varying(generator, signal: str):
    coefficient, product, slope = one_of(generator, WITH_MACH)
    # In a short flight dynamic pressure varies as Mach does.
    also = (f"{product} varying with mach in {coefficient}",) if signal == "qbar" else ()
    return (
        planted(
            CoefficientGradient,
            in_coefficient(coefficient, AFFECTED_STATES[coefficient]),
            signal,
            product,
            gain=sized(generator, slope / AS_MACH[signal]),
            centre=0.0,
            places=_places(coefficient),
            also=also,
        ),
    )


def _mass(generator, mass: float):
    return (
        planted(
            ParameterStep,
            "mass",
            0.5,
            gain=-sized(generator, 0.05) * mass,
            time=moment(generator, DURATION),
            width=FLIGHT_SAMPLE_TIME,
            places=(*_places("CX"), *_places("CZ")),
        ),
    )


def _separated(generator, stall: tuple[float, float]):
    placements = tuple(in_coefficient(name, AFFECTED_STATES[name]) for name in ("CX", "CZ", "Cm"))
    separation = planted(
        Separation,
        placements,
        0.65,
        gain=sized(generator, -3.0),
        alpha_star=float(generator.uniform(*stall)),
        steepness=25.0,
        forward=0.0,
        pitching=0.05,
        lag=sized(generator, 0.3),
        late=sized(generator, 0.15),
        places=(*_places("CZ"), *_places("Cm")),
    )
    return separation, _term(generator, "Cm", "beta^2", -0.6)


def _lag(generator) -> Planted:
    return planted(InputLag, "stabilator", gain=1.0, time=sized(generator, 0.08), places=STABILATOR)


def _dead_zone(generator) -> Planted:
    width = np.radians(sized(generator, 0.3))
    return planted(
        InputDeadZone, "stabilator", gain=1.0, width=width, centre=0.0, places=STABILATOR
    )


def _all(name: str, parts) -> tuple[Planted, ...]:
    places = tuple(Location(LocationKind.INPUT, surface) for surface in SURFACES)
    also = (*guesses(name), name.replace("inputs", "surfaces"))
    return (Planted(Joint(name, tuple(parts)), places, also),)


def _all_lag(generator):
    time = jnp.array(sized(generator, 0.08))
    parts = (InputLag(surface, gain=jnp.ones(()), time=time) for surface in SURFACES)
    return _all("lag of all inputs in rad", parts)


def _all_rate_limited(generator):
    limit = jnp.radians(sized(generator, 4.0))
    parts = (InputRateLimit(surface, gain=jnp.ones(()), limit=limit) for surface in SURFACES)
    return _all("rate limit of all inputs in rad", parts)


MOTION = (
    lambda g: _term(g, "Cm", "beta^2", -0.6),
    lambda g: _term(g, "CZ", "alpha^2", 2.0),
    lambda g: _term(g, "Cl", "alpha beta", -0.3),
    lambda g: planted(InputDelay, "stabilator", gain=sized(g, 0.05), places=STABILATOR),
    _lag,
)
SENSORS = (
    lambda g: planted(SensorScale, "alpha", gain=sized(g, 0.05), places=at_sensor("alpha")),
    lambda g: planted(SensorScale, "r", gain=sized(g, 0.05), places=at_sensor("r")),
    lambda g: late("alpha", sized(g, 0.05)),
    lambda g: late("beta", sized(g, 0.08)),
)


def _scenarios(of: Type) -> tuple[Scenario, ...]:
    mass = float(of.frame().mass_properties.mass)
    rates = (
        harder(
            f"{angle}-dot in {name}",
            lambda g, name=name, angle=angle: (_term(g, name, f"{angle}dot_hat", RATES[name]),),
        )
        for angle, names in (("alpha", ("CX", "CZ", "Cm")), ("beta", ("CY", "Cl", "Cn")))
        for name in names
    )
    varying = (
        harder(f"a coefficient varies with {signal}", lambda g, signal=signal: _varying(g, signal))
        for signal in AS_MACH
    )
    return (
        *rates,
        *varying,
        harder("square and cube of alpha", _powers),
        harder("mass steps", lambda g: _mass(g, mass)),
        harder("separation with hysteresis, and a term", lambda g: _separated(g, STALL[of.name])),
        harder("lag of all surfaces", _all_lag),
        harder("rate limit of all surfaces", _all_rate_limited),
        harder("lag and dead zone of the stabilator", lambda g: (_lag(g), _dead_zone(g))),
        harder("two late sensors", lambda g: two_late(g, LATE, 0.08)),
        harder("square of a sensor", lambda g: curve(SensorSquare, g, {"alpha": 0.3, "beta": 0.5})),
        *pairs(MOTION, SENSORS),
    )
