"""The F-16 of the wind tunnel at 15 to 45 deg: several flights identified together, and one that is predicted.

Tables of NASA TP-1538, measured to 90 deg, leading-edge flap fully down (where its schedule has it from 17 deg on), centre of
gravity at 0.30 chord (at 0.35 it is unstable in pitch, and records of 15 s would need the aircraft's own control system). The
report's yaw and roll dampers are on throughout, so that flights above 30 deg stay together for 15 s; surfaces are measured, so
identification does not mind. Base noise; one set of instruments for all flights.

All equations are propagated and all channels of E.13 to E.20 fitted, V too. At 60 m/s its errors are worth 7 % in every
coefficient, so that biases of V, alpha and beta are estimated: what the motion itself says of the speed then decides.
"""

import json
import time
import warnings
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.report_tables.cases import CaseResult, fit
from benchmarks.report_tables.comparisons import Predicted, predicted
from benchmarks.report_tables.settings import BIAS, Setting
from benchmarks.report_tables.text import as_numbers, error_table, plain
from jaxid.aircraft.aircraft import Aircraft
from jaxid.aircraft.airframes import f16
from jaxid.aircraft.augmentation import ALWAYS, Augmentation, Switch
from jaxid.aircraft.controls import ControlSystem, standard_actuators
from jaxid.aircraft.engine import ConstantThrust, Engine
from jaxid.aircraft.flights import SAMPLE_TIME, hold_alpha
from jaxid.aircraft.fly import Flight, fly
from jaxid.aircraft.frames import quaternion, velocity
from jaxid.aircraft.imperial import DEGREE, FOOT
from jaxid.aircraft.noise_levels import BASE, draw, report_instruments
from jaxid.data.signals import pulses, sine

ALTITUDE = 20000.0 * FOOT  # m
FLAP_DEG, XCG = 25.0, 0.30

SETTING = Setting(
    "coupled",
    ("V", "alpha", "beta", "ax", "ay", "az", "p", "q", "r"),
    ("u", "v", "w", "p", "q", "r", "phi", "pitch"),
    tuple(BIAS + name for name in ("V", "alpha", "beta")),
)


class Manoeuvre(NamedTuple):
    """A flight from level flight at an angle of attack.

    Attributes:
        alpha: at the start [rad].
        seconds: length.
        stabilator, period: amplitude [rad] and period [s] of a sine.
        lateral: amplitude of a doublet of the rudder at 0.5 s and one of the aileron at 4 s [rad], 1.5 s a half.
    """

    alpha: float
    seconds: float
    stabilator: float
    period: float
    lateral: float


TRAIN = {
    "from 20 deg": Manoeuvre(20 * DEGREE, 15.0, -4 * DEGREE, 5.0, 5 * DEGREE),
    "from 28 deg": Manoeuvre(28 * DEGREE, 15.0, -5 * DEGREE, 5.0, 5 * DEGREE),
    "from 38 deg": Manoeuvre(38 * DEGREE, 9.0, -5 * DEGREE, 4.0, 3 * DEGREE),  # it departs at 10 s
}
TEST = {"from 32 deg": Manoeuvre(32 * DEGREE, 15.0, -6 * DEGREE, 6.0, -3 * DEGREE)}


def fly_f16(name: str, seed: int = 0) -> Flight:
    """One of the flights.

    Args:
        name: in `TRAIN` or `TEST`.
        seed: of the instruments' errors, which all flights share, and of their noise.
    """
    known = TRAIN | TEST
    chosen, number = known[name], list(known).index(name)
    aircraft = _aircraft(seed)
    found = hold_alpha(aircraft, chosen.alpha, ALTITUDE)
    trim = {"stabilator": found.value("stabilator"), "aileron": 0.0, "rudder": 0.0}
    aircraft = aircraft.trimmed(trim, found.value("thrust"))
    place = jnp.array([0.0, 0.0, ALTITUDE])
    attitude = quaternion(0.0, chosen.alpha, 0.0)
    state = aircraft.flight_state(velocity(found.value("V"), chosen.alpha, 0.0), jnp.zeros(3), attitude, place)
    key = jax.random.fold_in(jax.random.key(seed), number)
    t = SAMPLE_TIME * jnp.arange(round(chosen.seconds / SAMPLE_TIME), dtype=float)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Flight .* to be trusted")
        return fly(aircraft, t, _inputs(chosen, t), state, key=key, name=name)


def _aircraft(seed: int) -> Aircraft:
    frame = f16(flap_deg=FLAP_DEG, xcg=XCG)
    controls = ControlSystem(standard_actuators(frame.limits), augmentation=Augmentation(Switch(on=ALWAYS)))
    engines = (Engine(ConstantThrust(0.0)),)
    instruments = draw(jax.random.key(seed), report_instruments(), BASE)
    return Aircraft(frame, engines=engines, controls=controls, instruments=instruments)


def _inputs(chosen: Manoeuvre, t: jax.Array) -> dict[str, jax.Array]:
    """The pilot's inputs about the trim."""
    doublet = (chosen.lateral, -chosen.lateral)
    return {
        "pilot_stabilator": sine(t, 1.0 / chosen.period, chosen.stabilator),
        "pilot_rudder": pulses(t, (0.5, 2.0, 3.5), doublet),
        "pilot_aileron": pulses(t, (4.0, 5.5, 7.0), doublet),
    }


def identify_f16(seed: int = 0) -> tuple[CaseResult, Flight, Predicted]:
    """Identify the flights of `TRAIN` together, and predict the one of `TEST`.

    Args:
        seed: of errors and noise.
    """
    flights = [fly_f16(name, seed) for name in TRAIN]
    result = fit("F-16, 15 to 45 deg", flights, SETTING)
    (test,) = TEST
    other = fly_f16(test, seed)
    return result, other, predicted(result, other)


def main(seed: int, as_json: bool) -> int:
    """Run the second part; 0 where the fit converged."""
    begin = time.perf_counter()
    result, other, found = identify_f16(seed)
    fine = bool(result.identified.estimate.successful)
    if as_json:
        told = {"status": "converged" if fine else "not converged", "seed": seed}
        flown = {flight.record.names[0]: spans(flight) for flight in (*result.flights, other)}
        print(json.dumps(plain(told | {"flights": flown, "result": as_numbers(result), "prediction": found})))
        return 0 if fine else 1
    for flight in (*result.flights, other):
        said = ", ".join(f"{name} {low:.1f} to {high:.1f}" for name, (low, high) in spans(flight).items())
        print(f"{flight.record.names[0]} [deg, m/s]: {said}")
    print(f"\n{result.identified}\n")
    for totals in (True, False):
        print(error_table({result.name: result}, totals) + "\n")
    print(f"{other.record.names[0]}, predicted; Theil's coefficient (of the fit): " + _said(found))
    static = ", ".join(f"{one.coefficient} {100 * one.relative:.1f} %" for one in found.errors if one.part == "static")
    print(f"static coefficients there, error: {static}")
    print(f"\nSeed {seed}, {time.perf_counter() - begin:.0f} s.")
    return 0 if fine else 1


def spans(flight: Flight) -> Mapping[str, tuple[float, float]]:
    """Smallest and largest true angle [deg] and speed [m/s] of a flight."""
    found = {}
    for name, unit in (("alpha", DEGREE), ("beta", DEGREE), ("V", 1.0)):
        values = np.asarray(flight.truth.channel(name)) / unit
        found[name] = (float(values.min()), float(values.max()))
    return found


def _said(found: Predicted) -> str:
    return ", ".join(f"{name} {value:.2f} ({found.theil_of_fit[name]:.2f})" for name, value in found.theil.items())
