"""Simulated flight in six degrees of freedom with an effect that the declared model lacks.

The aircraft is the F-4-like aircraft with its tables. Manoeuvres, errors of the tables and the
planted effect are our choice.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.compiler import fast_compile_jit
from ..._foundation.types import Array, Float
from ...data.build import record
from ...data.multisine import multisine
from ...data.record import Record
from ...data.signals import doublet, linear_sweep, pulses, ramp, three_two_one_one
from ...models.free import free
from ...simulation.simulate import simulate
from ...simulation.steppers import RK4
from ..airframes.f4 import f4
from ..instruments.instruments import Instruments
from ..instruments.noise_levels import DEMONSTRATION, report_instruments
from ..vehicle.aerodynamics_increments import AerodynamicsWithIncrements
from ..vehicle.aerodynamics_polynomial import PolynomialAerodynamics
from ..vehicle.controls import SURFACES, ControlSystem, MeasuredSurfaces, standard_actuators
from .aircraft import Aircraft
from .simulated_flight import SimulatedFlight, smoothed
from .trims import level

# m/s and m: 550 ft/s at 35,000 ft, as in the report's longitudinal cases
TRIM_SPEED, TRIM_ALTITUDE = 167.64, 10668.0
FLIGHT_SAMPLE_TIME, SAMPLES = 0.04, 501  # s
RECORDED_CHANNELS = ("alpha", "beta", "V", "p", "q", "r", "phi", "pitch", "ax", "ay", "az")
COUPLED_TRAIN = ("longitudinal", "lateral", "all surfaces")
COUPLED_CHECK = ("3-2-1-1 and doublets", "pulls with sideslip")
COUPLED_TEST = ("slow doublets", "sweeps")
PLANTED = {"Cm": {"beta^2": -0.8}}  # a nose-down moment in sideslip, to either side
TABLES_ARE_OFF_BY = {
    "CX": {"1": 0.004},
    "CY": {"beta": -0.06},
    "CZ": {"1": -0.02, "alpha": 0.2, "stabilator": -0.04},
    "Cl": {"beta": 0.012, "phat": -0.04, "aileron": -0.004},
    "Cm": {"1": 0.004, "alpha": -0.03, "qhat": -0.8, "stabilator": -0.06},
    "Cn": {"beta": 0.015, "rhat": -0.05, "rudder": -0.006},
}
# free elements of the initial state; no instrument measures heading and position
STARTS = ("u", "v", "w", "p", "q", "r", "e1", "e2")


def coupled_flight(key: Array, samples: int = SAMPLES) -> SimulatedFlight:
    r"""Simulate seven manoeuvres of 20 s at 25 Hz with an undeclared pitching moment in sideslip.

        C = C_tables + corrections,    z_i = y(t_i) + bias + e_i
        Cm = ... - 0.8 beta^2 in the truth only

    The records are simulated with four times the steps of the estimation and with actuators between
    pilot and surfaces, from level trim at 550 ft/s and 35,000 ft. White noise and offsets of the
    instruments have the level `DEMONSTRATION`; the offsets are drawn once, because all manoeuvres
    are of one flight. Scales, positions and axes of the instruments are assumed to be
    calibrated.

    Args:
        key: random key of the offsets and the noise.
        samples: number of samples of each record; a longer flight continues with constant controls.

    Returns:
        Declared model, free parameters, records, truth and noise-free outputs.

    Raises:
        InputError: if JAX is not in 64 bit.
    """
    for_bias, for_noise = jax.random.split(key)
    t, surfaces, clean, truth = _fly(_drawn(for_bias), samples)
    names = (*COUPLED_TRAIN, *COUPLED_CHECK, *COUPLED_TEST)
    noise = jnp.array([DEMONSTRATION.noise[name] for name in RECORDED_CHANNELS])
    z = np.asarray(clean) + np.asarray(noise) * np.asarray(
        jax.random.normal(for_noise, clean.shape)
    )
    records = {name: _record(name, t, surfaces[i], z[i], truth) for i, name in enumerate(names)}
    model = declared(truth)
    offsets = tuple(f"instruments.bias.{name}" for name in RECORDED_CHANNELS)
    terms = tuple(
        f"{coefficient}.{term}"
        for coefficient, terms in TABLES_ARE_OFF_BY.items()
        for term in terms
    )
    chosen = free(
        model, *terms, *offsets, per_record=tuple(f"initial_state.{state}" for state in STARTS)
    )
    train, check, test = (
        tuple(records[name] for name in group)
        for group in (COUPLED_TRAIN, COUPLED_CHECK, COUPLED_TEST)
    )
    return SimulatedFlight(
        model, chosen, train, check, test, truth, noise, dict(zip(names, clean, strict=True))
    )


def _record(name: str, t, surfaces, z: np.ndarray, truth: Aircraft) -> Record:
    """Return the record of one manoeuvre."""
    units = {
        name: unit for name, unit in truth.units().items() if name in RECORDED_CHANNELS
    } | dict.fromkeys(SURFACES, "rad")
    return record(
        t,
        surfaces,
        z,
        inputs=SURFACES,
        outputs=RECORDED_CHANNELS,
        units=units,
        constants=_place(),
        name=name,
    )


def declared(truth: Aircraft) -> Aircraft:
    """Return the aircraft of the tables, with zero corrections and without the planted effect.

    Args:
        truth: the model that simulated the records.
    """
    zero = {
        coefficient: dict.fromkeys(terms, 0.0) for coefficient, terms in TABLES_ARE_OFF_BY.items()
    }
    return _recorded(corrected_f4(zero), report_instruments(RECORDED_CHANNELS), truth)


def corrected_f4(corrections):
    """Return the F-4-like airframe with corrected tables."""
    frame = f4(interpolation="cubic")
    corrected = AerodynamicsWithIncrements(frame.aerodynamics, PolynomialAerodynamics(corrections))
    return eqx.tree_at(lambda airframe: airframe.aerodynamics, frame, corrected)


def _recorded(airframe, instruments: Instruments, like: Aircraft) -> Aircraft:
    """Return the model for identification: surfaces are inputs, engines those of `like`."""
    return Aircraft(
        airframe, engines=like.engines, controls=MeasuredSurfaces(), instruments=instruments
    )


def _drawn(key: Array) -> Instruments:
    """Return instruments with the offsets of one flight."""
    sigma = jnp.array([DEMONSTRATION.bias[name] for name in RECORDED_CHANNELS])
    bias = sigma * jax.random.normal(key, sigma.shape)
    return eqx.tree_at(
        lambda instruments: instruments.bias.values, report_instruments(RECORDED_CHANNELS), bias
    )


def _place() -> dict[str, float]:
    return {"altitude": TRIM_ALTITUDE}


def manoeuvres(t: Float[Array, " time"]) -> dict[str, Float[Array, "time surface"]]:
    """Return the pilot's stabilator, aileron and rudder about trim by manoeuvre [rad].

    They are smoothed over two samples.

    Args:
        t: sample times [s].
    """
    gentle = ramp(t, 0.0, 1.0)
    random_like = multisine(t, 20.0, 0.1, 1.2, amplitude=1.0, count=3)
    still = jnp.zeros_like(t)
    two_doublets = doublet(t, 1.0, 1.5, 2.0) - doublet(t, 9.0, 1.2, 2.0)
    commanded = {
        "longitudinal": (two_doublets, still, doublet(t, 13.0, 1.5, 2.0)),
        "lateral": (
            still,
            doublet(t, 8.0, 1.2, 3.0),
            doublet(t, 1.0, 1.5, 5.0) - doublet(t, 14.0, 1.0, 4.0),
        ),
        "all surfaces": tuple(
            gentle * random_like[:, i] * size for i, size in enumerate((1.2, 1.5, 3.0))
        ),
        "3-2-1-1 and doublets": (
            three_two_one_one(t, 1.0, 0.6, -1.5),
            doublet(t, 11.0, 1.0, 3.0),
            doublet(t, 7.0, 1.5, 5.0),
        ),
        "pulls with sideslip": (
            pulses(t, (1.0, 3.0, 9.0, 12.0), (-1.5, 0.0, -2.0)),
            still,
            pulses(t, (2.0, 5.0, 8.0), (4.0, -4.0)),
        ),
        "slow doublets": (
            doublet(t, 1.0, 2.0, -1.5),
            doublet(t, 13.0, 1.0, -3.0),
            doublet(t, 6.0, 2.0, -4.5),
        ),
        "sweeps": (
            gentle * linear_sweep(t, 20.0, 0.1, 1.0, 1.2),
            still,
            gentle * linear_sweep(t, 20.0, 0.1, 0.8, 3.5),
        ),
    }
    return {
        name: jnp.radians(jnp.stack([smoothed(signal) for signal in signals], axis=1))
        for name, signals in commanded.items()
    }


def _fly(instruments: Instruments, samples: int):
    """Return sample times, surfaces and noise-free outputs of all manoeuvres, and the truth.

    The truth is a model for identification.
    """
    frame = corrected_f4(
        {name: terms | PLANTED.get(name, {}) for name, terms in TABLES_ARE_OFF_BY.items()}
    )
    aircraft = Aircraft(
        frame, controls=ControlSystem(standard_actuators(frame.limits)), instruments=instruments
    )
    trimmed = level(aircraft, TRIM_SPEED, TRIM_ALTITUDE)
    t = FLIGHT_SAMPLE_TIME * jnp.arange(samples)
    pilot = jnp.stack(list(jax.jit(manoeuvres)(t).values()))
    surfaces, clean = _surfaces_and_outputs(trimmed.aircraft, t, pilot, trimmed.state)
    return t, surfaces, clean, _recorded(frame, instruments, trimmed.aircraft)


@fast_compile_jit
def _surfaces_and_outputs(aircraft: Aircraft, t, pilot, state):
    """Return surfaces and outputs of each manoeuvre."""
    at = jnp.array([aircraft.states.index(surface) for surface in SURFACES])
    stepper = RK4(4, unrolled=False)
    flights = jax.vmap(lambda u: simulate(aircraft, t, u, state, stepper=stepper))(pilot)
    return flights.x[..., at], flights.y
