"""Aircraft with table aerodynamics in six degrees of freedom: an F-4-like one, and the F-16 of NASA
TP-1538.

The truth flies with actuators between pilot and surfaces and is integrated by an adaptive method of
order five. What acts between the recorded surfaces and the aircraft is planted in the record,
turned round; what instruments do, in NumPy.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.missing_effects.scenarios import (
    CHECK,
    TEST,
    TRAIN,
    Flown,
    Scenario,
    System,
    planted,
    scenario,
)
from benchmarks.missing_effects.truth import noise_of
from benchmarks.missing_effects.truth_effects import kind, read
from jaxid import free, record
from jaxid.aircraft.effects.coefficient_term import CoefficientTerm
from jaxid.aircraft.flight.aircraft import AFFECTED_STATES, Aircraft
from jaxid.aircraft.flight.coupled_flight import (
    FLIGHT_SAMPLE_TIME,
    RECORDED_CHANNELS,
    SAMPLES,
    STARTS,
    TABLES_ARE_OFF_BY,
    manoeuvres,
)
from jaxid.aircraft.flight.trims import level
from jaxid.aircraft.instruments.noise_levels import DEMONSTRATION, report_instruments
from jaxid.aircraft.vehicle.aerodynamics_increments import AerodynamicsWithIncrements
from jaxid.aircraft.vehicle.aerodynamics_polynomial import PolynomialAerodynamics
from jaxid.aircraft.vehicle.airframe import Airframe
from jaxid.aircraft.vehicle.controls import SURFACES, ControlSystem, MeasuredSurfaces
from jaxid.effects import (
    InputDelay,
    InputLag,
    Location,
    LocationKind,
    ParameterShift,
    SensorDelay,
    SensorScale,
)
from jaxid.simulation.simulate import simulate
from jaxid.simulation.steppers import Adaptive

WINDOW = 50
GUSTS, GUST_TIME = ("gust_v", "gust_w"), 1.0  # s, of the memory of a gust
EQUATIONS = {"CX": "u", "CY": "v", "CZ": "w", "Cl": "p", "Cm": "q", "Cn": "r"}


class Type(NamedTuple):
    """An aircraft of the benchmark.

    Attributes:
        name: of the system.
        frame: its airframe, tables included.
        controls: its control system.
        speed, altitude: of the level trim [m/s, m].
        size: of the manoeuvres, as a factor.
    """

    name: str
    frame: Callable[[], Airframe]
    controls: Callable[[Airframe], ControlSystem]
    speed: float
    altitude: float
    size: float


def system(of: Type, terms: Mapping[str, tuple[str, str, float]]) -> System:
    """The aircraft with its scenarios.

    Args:
        of: which.
        terms: coefficient, product and gain of a missing term by the scenario's name.
    """
    singles = tuple(scenario(name, _term(*one)) for name, one in terms.items())
    surface = (Location(LocationKind.INPUT, "stabilator"), Location(LocationKind.EQUATION, "q"))
    vane = (Location(LocationKind.SENSOR, "alpha"),)
    late = planted(InputDelay, "stabilator", gain=0.04, places=surface)
    wide = planted(SensorScale, "alpha", gain=0.05, places=vane)
    heavy = (Location(LocationKind.EQUATION, "u"), Location(LocationKind.EQUATION, "w"))
    others = (
        scenario("stabilator delay", late),
        scenario(
            "stabilator lag", planted(InputLag, "stabilator", gain=1.0, time=0.08, places=surface)
        ),
        scenario("scale of the vane", wide),
        scenario("late vane", planted(SensorDelay, "alpha", gain=0.05, places=vane)),
        scenario(
            "heavier",
            planted(
                ParameterShift,
                "mass",
                gain=0.05 * float(of.frame().mass_properties.mass),
                places=heavy,
            ),
        ),
    )
    first = singles[0].planted[0]
    doubles = (scenario(f"{singles[0].name}, and the vane", first, wide),)
    settings = {"plain": {}, "coloured noise": {"memory": 0.7}}
    controls = tuple(Scenario(name, "control", (), setting) for name, setting in settings.items())
    gusts = (Scenario("gusts", "process", (), {"gust": 1.0}),)
    every = (*singles, *others, *doubles, *controls, *gusts)
    products = {(coefficient, product) for coefficient, product, _ in terms.values()}
    return System(
        of.name, False, True, WINDOW, every, lambda wanted, seed: _fly(of, products, wanted, seed)
    )


def _term(coefficient: str, product: str, gain: float):
    affected = AFFECTED_STATES[coefficient]
    places = tuple(
        Location(LocationKind.EQUATION, state)
        for state in dict.fromkeys((EQUATIONS[coefficient], *affected))
    )
    return planted(CoefficientTerm, coefficient, product, affected, gain=gain, places=places)


def _fly(of: Type, products: set[tuple[str, str]], wanted: Scenario, seed: int) -> Flown:
    """Seven manoeuvres of 20 s, each larger or smaller by up to a third, to either side.

    Settings: `memory` colours the noise, `gust` is the size of lateral and vertical gusts [m/s].
    """
    have, generator = wanted.setting, wanted.generator(seed)
    count = TRAIN + CHECK + TEST
    size = of.size * generator.uniform(0.7, 1.3, count) * generator.choice([-1.0, 1.0], count)
    keep = np.exp(-FLIGHT_SAMPLE_TIME / GUST_TIME)
    gusts = have.get("gust", 0.0) * noise_of(generator, (count, SAMPLES, len(GUSTS)), keep)
    bias = np.array([DEMONSTRATION.bias[name] for name in RECORDED_CHANNELS]) * generator.normal(
        size=len(RECORDED_CHANNELS)
    )
    corrections = {name: dict(terms) for name, terms in TABLES_ARE_OFF_BY.items()}
    for coefficient, product in sorted(products):
        corrections.setdefault(coefficient, {})[product] = 0.0
    for one in wanted.effects:
        if isinstance(one, CoefficientTerm):
            corrections[one.coefficient][one.product] = float(one.gain)
    heavier = sum(float(one.gain) for one in wanted.effects if isinstance(one, ParameterShift))
    aircraft = true_aircraft(of, corrections, bias, heavier)
    t = FLIGHT_SAMPLE_TIME * np.arange(SAMPLES)
    trimmed = level(aircraft, of.speed, of.altitude)
    surfaces, clean = surfaces_and_outputs(
        trimmed.aircraft, jnp.asarray(t), jnp.asarray(size), jnp.asarray(gusts), trimmed.state
    )
    surfaces = _as_recorded(wanted.effects, t, np.asarray(surfaces))
    noise = np.array([DEMONSTRATION.noise[name] for name in RECORDED_CHANNELS])
    y = read(wanted.effects, t, np.asarray(clean), RECORDED_CHANNELS)
    z = y + noise * noise_of(generator, y.shape, have.get("memory", 0.0))
    return given(of, trimmed.aircraft, t, surfaces, z, bias)


def given(of: Type, flew: Aircraft, t, surfaces, z, bias) -> Flown:
    """Return the declared aircraft, with corrections and offsets of zero, and its records.

    Args:
        of: the aircraft.
        flew: the true one, whose engines are known.
        t: sample times [s].
        surfaces, z: recorded surfaces and outputs, shape (manoeuvre, time, channel).
        bias: true offsets of the instruments.
    """
    units = {
        name: unit for name, unit in flew.units().items() if name in RECORDED_CHANNELS
    } | dict.fromkeys(SURFACES, "rad")
    place = {"altitude": of.altitude}
    flown = [
        record(
            t,
            u,
            readings,
            inputs=SURFACES,
            outputs=RECORDED_CHANNELS,
            units=units,
            constants=place,
            name=f"record {i}",
        )
        for i, (u, readings) in enumerate(zip(surfaces, z, strict=True))
    ]
    offsets = tuple(f"instruments.bias.{name}" for name in RECORDED_CHANNELS)
    true = {
        f"{coefficient}.{term}": v
        for coefficient, terms in TABLES_ARE_OFF_BY.items()
        for term, v in terms.items()
    }
    zero = {
        coefficient: dict.fromkeys(terms, 0.0) for coefficient, terms in TABLES_ARE_OFF_BY.items()
    }
    frame, instruments = _corrected(of.frame(), zero), report_instruments(RECORDED_CHANNELS)
    model = Aircraft(
        frame, engines=flew.engines, controls=MeasuredSurfaces(), instruments=instruments
    )
    chosen = free(
        model, *true, *offsets, per_record=tuple(f"initial_state.{state}" for state in STARTS)
    )
    true |= dict(zip(offsets, bias.tolist(), strict=True))
    return Flown(
        model, chosen, flown[:TRAIN], flown[TRAIN : TRAIN + CHECK], flown[TRAIN + CHECK :], true
    )


def true_aircraft(of: Type, corrections, bias, heavier: float = 0.0) -> Aircraft:
    """Return the true aircraft.

    Args:
        of: the aircraft.
        corrections: errors of its tables, by coefficient and product.
        bias: offsets of the instruments.
        heavier: excess of its mass [kg].
    """
    frame = _corrected(of.frame(), corrections)
    frame = eqx.tree_at(
        lambda one: one.mass_properties.mass, frame, frame.mass_properties.mass + heavier
    )
    instruments = eqx.tree_at(
        lambda one: one.bias.values, report_instruments(RECORDED_CHANNELS), jnp.asarray(bias)
    )
    return Aircraft(frame, controls=of.controls(frame), instruments=instruments, disturbances=GUSTS)


def _corrected(frame: Airframe, corrections) -> Airframe:
    corrected = AerodynamicsWithIncrements(frame.aerodynamics, PolynomialAerodynamics(corrections))
    return eqx.tree_at(lambda one: one.aerodynamics, frame, corrected)


@eqx.filter_jit
def surfaces_and_outputs(aircraft: Aircraft, t, size, gusts, state):
    """Return surfaces and outputs of each manoeuvre."""
    pilot = size[:, None, None] * jnp.stack(list(manoeuvres(t).values()))
    u = jnp.concatenate([pilot, gusts], axis=-1)
    flights = jax.vmap(lambda one: simulate(aircraft, t, one, state, stepper=Adaptive()))(u)
    at = jnp.array([aircraft.states.index(surface) for surface in SURFACES])
    return flights.x[..., at], flights.y


def _as_recorded(effects, t: np.ndarray, surfaces: np.ndarray) -> np.ndarray:
    """Return the recorded surfaces; the acting surfaces are delayed or lag behind them.

    `u(t) = s(t + delay)` or `u = s + time ds/dt`.
    """
    histories = np.array(surfaces)
    for one in effects:
        if kind(one) in ("InputDelay", "InputLag"):
            at = SURFACES.index(one.channel)
            acted = CubicSpline(t, surfaces[..., at], axis=1)
            if kind(one) == "InputDelay":
                histories[..., at] = acted(np.minimum(t + float(one.gain), t[-1]))
            else:
                histories[..., at] = acted(t) + float(one.time) * acted(t, 1)
    return histories
