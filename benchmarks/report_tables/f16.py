"""The F-16 of the wind tunnel at 15 to 45 deg: a joint identification of flights, and a prediction.

Tables of NASA TP-1538, measured to 90 deg, leading-edge flap fully down (where its schedule has it
from 17 deg on), centre of gravity at 0.30 chord (at 0.35 it is unstable in pitch, and records of 15
s would need the aircraft's own control system). The report's yaw and roll dampers are on
throughout, so that flights above 30 deg remain stable for 15 s; surfaces are measured, so
the dampers do not affect the identification.

The question is how well polynomials fit measured tables, so the instruments have the
noise of the level `DEMONSTRATION` and no constant errors: at 60 m/s those of V alone would be worth
7 % in every coefficient. V is smoothed, because its noise alone hides CX and CZ. The thrust
differs from flight to flight and is measured. Longitudinal and lateral motion are identified by
themselves, each from three flights together, with the terms of Table 6.1. The step is that of the
least BIC: the largest overall F would leave Cn with one term.
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
from benchmarks.report_tables.settings import Setting
from benchmarks.report_tables.text import as_numbers, error_table, plain
from jaxid.aircraft.airframes import f16
from jaxid.aircraft.flight.aircraft import Aircraft
from jaxid.aircraft.flight.report_cases import REPORT_SAMPLE_TIME
from jaxid.aircraft.flight.simulate_flight import Flight, simulate_flight
from jaxid.aircraft.flight.trim_at_alpha import trim_at_alpha
from jaxid.aircraft.instruments.noise_levels import (
    DEMONSTRATION,
    NoiseLevel,
    draw,
    report_instruments,
)
from jaxid.aircraft.physics.frames import quaternion, velocity
from jaxid.aircraft.physics.imperial import DEGREE, FOOT
from jaxid.aircraft.vehicle.augmentation import ALWAYS, Augmentation, Switch
from jaxid.aircraft.vehicle.controls import ControlSystem, standard_actuators
from jaxid.aircraft.vehicle.engine import ConstantThrust, Engine
from jaxid.data.signals import pulses, sine
from jaxid.structure import Minimum

ALTITUDE = 20000.0 * FOOT  # m
FLAP_DEG, XCG = 25.0, 0.30

NOISE = NoiseLevel({}, {}, DEMONSTRATION.noise, {}, {})
COMMON = {"measured": ("thrust",), "smoothed": ("V",)}
SETTINGS = {
    "F-16 longitudinal": Setting(
        "longitudinal", ("V", "alpha", "ax", "az", "q"), ("u", "w", "q", "pitch"), **COMMON
    ),
    "F-16 lateral": Setting("lateral", ("beta", "ay", "p", "r"), ("v", "p", "r", "phi"), **COMMON),
}


class Manoeuvre(NamedTuple):
    """A flight from level flight at an angle of attack.

    Attributes:
        alpha: at the start [rad].
        seconds: length.
        stabilator, period: amplitude [rad] and period [s] of a sine.
        lateral: amplitude of a doublet of the rudder at 0.5 s and one of the aileron at 4 s [rad],
            1.5 s a half.
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
        seed: of the noise.
    """
    known = TRAIN | TEST
    chosen, number = known[name], list(known).index(name)
    aircraft = _aircraft(seed)
    equilibrium = trim_at_alpha(aircraft, chosen.alpha, ALTITUDE)
    trim = {"stabilator": equilibrium.value("stabilator"), "aileron": 0.0, "rudder": 0.0}
    aircraft = aircraft.trimmed(trim, equilibrium.value("thrust"))
    place = jnp.array([0.0, 0.0, ALTITUDE])
    attitude = quaternion(0.0, chosen.alpha, 0.0)
    state = aircraft.flight_state(
        velocity(equilibrium.value("V"), chosen.alpha, 0.0), jnp.zeros(3), attitude, place
    )
    key = jax.random.fold_in(jax.random.key(seed), number)
    t = REPORT_SAMPLE_TIME * jnp.arange(round(chosen.seconds / REPORT_SAMPLE_TIME), dtype=float)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Flight .* to be trusted")
        return simulate_flight(aircraft, t, _inputs(chosen, t), state, key=key, name=name)


def _aircraft(seed: int) -> Aircraft:
    frame = f16(flap_deg=FLAP_DEG, xcg=XCG)
    controls = ControlSystem(
        standard_actuators(frame.limits), augmentation=Augmentation(Switch(on=ALWAYS))
    )
    engines = (Engine(ConstantThrust(0.0)),)
    instruments = draw(jax.random.key(seed), report_instruments(), NOISE)
    return Aircraft(frame, engines=engines, controls=controls, instruments=instruments)


def _inputs(chosen: Manoeuvre, t: jax.Array) -> dict[str, jax.Array]:
    """The pilot's inputs about the trim."""
    doublet = (chosen.lateral, -chosen.lateral)
    return {
        "pilot_stabilator": sine(t, 1.0 / chosen.period, chosen.stabilator),
        "pilot_rudder": pulses(t, (0.5, 2.0, 3.5), doublet),
        "pilot_aileron": pulses(t, (4.0, 5.5, 7.0), doublet),
    }


def identify_f16(name: str, seed: int = 0) -> tuple[CaseResult, Flight, Predicted]:
    """Identify the flights of `TRAIN` together, and predict the one of `TEST`.

    Args:
        name: in `SETTINGS`.
        seed: of the noise.

    Returns:
        Result, the flight of `TEST`, and its prediction.
    """
    flights = [fly_f16(one, seed) for one in TRAIN]
    result = fit(name, flights, SETTINGS[name], rule=Minimum("BIC"))
    (test,) = TEST
    other = fly_f16(test, seed)
    return result, other, predicted(result, other)


def main(seed: int, as_json: bool) -> int:
    """Run the second part; 0 where both fits converged."""
    begin, output = time.perf_counter(), {}
    for name in SETTINGS:
        result, other, prediction = identify_f16(name, seed)
        flown = {flight.record.names[0]: spans(flight) for flight in (*result.flights, other)}
        output[name] = {"flights": flown, "result": as_numbers(result), "prediction": prediction}
        if not as_json:
            print(_words(result, prediction, flown), flush=True)
    fine = all(one["result"]["fit"]["status"] == "converged" for one in output.values())
    if as_json:
        print(
            json.dumps(
                plain({"status": "converged" if fine else "not converged", "seed": seed} | output)
            )
        )
    else:
        print(f"Seed {seed}, {time.perf_counter() - begin:.0f} s.")
    return 0 if fine else 1


def _words(
    result: CaseResult,
    prediction: Predicted,
    flown: Mapping[str, Mapping[str, tuple[float, float]]],
) -> str:
    lines = [result.name, "=" * len(result.name)]
    for name, ranges in flown.items():
        lines.append(
            f"{name}: "
            + ", ".join(f"{one} {low:.1f} to {high:.1f}" for one, (low, high) in ranges.items())
        )
    theil = ", ".join(
        f"{name} {value:.2f} ({prediction.theil_of_fit[name]:.2f})"
        for name, value in prediction.theil.items()
    )
    total = [one for one in prediction.errors if one.part == "at the true motion"]
    errors = ", ".join(f"{one.coefficient} {100 * one.relative:.1f} %" for one in total)
    (test,) = TEST
    return "\n".join(
        [
            *lines,
            f"\n{result.identified}\n",
            error_table({result.name: result}, totals=True),
            f"\n{test}, predicted; Theil's coefficient (of the fit): {theil}",
            f"errors of whole coefficients there: {errors}\n",
        ]
    )


def spans(flight: Flight) -> dict[str, tuple[float, float]]:
    """Smallest and largest true angle [deg] and speed [m/s] of a flight."""
    ranges = {}
    for name, unit in (("alpha", DEGREE), ("beta", DEGREE), ("V", 1.0)):
        values = np.asarray(flight.truth.channel(name)) / unit
        ranges[name] = (float(values.min()), float(values.max()))
    return ranges
