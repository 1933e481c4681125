"""The report's test cases as flights of our F-4-like aircraft (Figure 6.2, sections 3.3.1, 5.4.1).

Settings that the report prints are kept (initial conditions, amplitudes, periods, record lengths,
the time at which the stability augmentation is switched on, noise levels). Settings that it does
not print are our choice, and `settings()` lists them.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._foundation.checks import require_known
from ..._foundation.types import Array, Float
from ...data.signals import full_sine, half_sine, pulses, ramp, sine
from ..air.turbulence import REPORT_GUST, white_gusts
from ..airframes.f4 import f4
from ..instruments.noise_levels import BASE, HIGH, NoiseLevel, draw, report_instruments
from ..physics.frames import quaternion, velocity
from ..physics.imperial import DEGREE, FOOT
from ..vehicle.augmentation import Augmentation, Switch
from ..vehicle.controls import ControlSystem, standard_actuators
from ..vehicle.engine import ConstantThrust, Engine
from .aircraft import Aircraft
from .simulate_flight import Flight, simulate_flight
from .trim_at_alpha import trim_at_alpha

# chosen: this aircraft is near level flight at the printed speeds and angles of attack
CASE_ALTITUDE = 35000.0 * FOOT  # m
REPORT_SAMPLE_TIME = 0.1  # s (section 6.2.1: ten samples a second)

Signals = dict[str, Float[Array, " time"]]


class Case(NamedTuple):
    """One of the report's test cases.

    Attributes:
        source: place in the report.
        seconds: duration of the record [s].
        V: initial speed [m/s]; None for the speed of level flight, if the report prints none.
        alpha: initial angle of attack and pitch [rad].
        pilot: the pilot's inputs about the trim as functions of time, by surface [rad].
        description: description of the pilot's inputs.
        augmentation_on: time at which the stability augmentation is switched on [s]; None for
            never.
        noise: level of the instruments' errors; None for error-free instruments.
        gust: standard deviation of the white disturbances of the vertical and horizontal velocity
            [m/s].
        trim: stabilator at the start, less the one that balances the pitching moment [rad].
        choices: description of the settings that are our choice.
    """

    source: str
    seconds: float
    V: float | None
    alpha: float
    pilot: Mapping[str, Callable[[Array], Array]]
    description: str
    augmentation_on: float | None = None
    noise: NoiseLevel | None = BASE
    gust: float = 0.0
    trim: float = 0.0
    choices: str = ""


class Pull(NamedTuple):
    """A ramp of the stabilator from the start, held at its end.

    Attributes:
        size_deg: at the end [deg].
        seconds: length of the ramp [s].
    """

    size_deg: float
    seconds: float


def _deg(value: float) -> float:
    """Return degrees as radians, as a Python number."""
    return value * DEGREE


def _rudder_pulse(t: Array) -> Array:
    return half_sine(t, 0.0, 2.5, _deg(10.0))


def doublet_from(start: float) -> Callable[[Array], Array]:
    """Return the ailerons' doublet from a time on [s], as a function of time [rad]."""
    return lambda t: full_sine(t, start, 2.5, _deg(7.0))


def _stabilator_sine(amplitude_deg: float, period: float) -> Callable[[Array], Array]:
    return lambda t: sine(t, 1.0 / period, _deg(amplitude_deg))


def pull_signal(pull: Pull) -> Callable[[Array], Array]:
    """Return a pull as a function of time [rad]."""
    return lambda t: ramp(t, 0.0, pull.seconds, _deg(pull.size_deg))


def _doublet(amplitude_deg: float, period: float) -> Callable[[Array], Array]:
    """Return a doublet from 0.5 s on, positive for the first half of the period."""
    level = _deg(amplitude_deg)
    return lambda t: pulses(t, (0.5, 0.5 + period / 2, 0.5 + period), (level, -level))


# chosen by `python -m benchmarks.report_choices`: least squares on the statistics of Figure 6.2
DOUBLET_START = 4.0  # s
LATERAL_TRIM, COUPLED_TRIM = _deg(-1.3), _deg(-0.6)
LONGITUDINAL_1_TRIM, LONGITUDINAL_2_TRIM = _deg(0.1), _deg(-0.6)
LATERAL_4_PULL = Pull(-3.0, 4.0)

LATERAL_INPUTS = {"rudder": _rudder_pulse, "aileron": doublet_from(DOUBLET_START)}
LATERAL_DESCRIPTION = (
    "rudder: half sine of 10 deg over 0 to 2.5 s; aileron: one sine of 7 deg over "
    f"{DOUBLET_START:g} to {DOUBLET_START + 2.5:g} s"
)
LATERAL_CHOICES = (
    "the pulse lasts 2.5 s (the text may also mean half of that), start of the doublet"
)
COUPLED_INPUTS = {**LATERAL_INPUTS, "stabilator": _stabilator_sine(-4.0, 4.0)}

LATERAL_1 = Case(
    "Fig. 6.2a, section 6.2.1",
    10.0,
    445 * FOOT,
    _deg(17.5),
    LATERAL_INPUTS,
    LATERAL_DESCRIPTION,
    7.5,
    trim=LATERAL_TRIM,
    choices=LATERAL_CHOICES,
)

CASES: dict[str, Case] = {
    "lateral 1": LATERAL_1,
    "lateral 2": LATERAL_1._replace(source="Fig. 6.2a, section 6.3.1", noise=HIGH),
    "lateral 3": LATERAL_1._replace(
        source="Fig. 6.2a, section 6.3.2",
        gust=REPORT_GUST,
        choices=f"{LATERAL_CHOICES}; disturbances in v and w (the text's horizontal and vertical), "
        "linear between samples",
    ),
    "lateral 4": Case(
        "Fig. 6.2a, section 6.4.2",
        10.0,
        445 * FOOT,
        _deg(17.5),
        {**LATERAL_INPUTS, "stabilator": pull_signal(LATERAL_4_PULL)},
        f"{LATERAL_DESCRIPTION}; stabilator: to {LATERAL_4_PULL.size_deg:g} deg in "
        f"{LATERAL_4_PULL.seconds:g} s, held",
        trim=LATERAL_TRIM,
        choices=LATERAL_CHOICES + "; form, size and time of the stabilator",
    ),
    "longitudinal 1": Case(
        "Fig. 6.2b, section 6.2.1",
        10.0,
        550 * FOOT,
        _deg(10.0),
        {"stabilator": _stabilator_sine(-4.0, 4.0)},
        "stabilator: sine of -4 deg, period 4 s",
        trim=LONGITUDINAL_1_TRIM,
        choices="base noise: named in the text, not printed in the figure",
    ),
    "longitudinal 2": Case(
        "Fig. 6.2b, section 6.4.1",
        10.0,
        550 * FOOT,
        _deg(10.0),
        {"stabilator": _stabilator_sine(-2.0, 4.0)},
        "stabilator: sine of -2 deg, period 4 s",
        trim=LONGITUDINAL_2_TRIM,
        choices="sign and period as in case 1; base noise",
    ),
    "coupled 1": Case(
        "Fig. 6.2c, section 6.4.3",
        15.0,
        464 * FOOT,
        _deg(15.0),
        COUPLED_INPUTS,
        LATERAL_DESCRIPTION + "; stabilator: sine of -4 deg, period 4 s",
        10.0,
        trim=COUPLED_TRIM,
        choices="all inputs: the figure's are lost; base noise",
    ),
    "coupled 2": Case(
        "Fig. 6.2c, section 6.5",
        10.0,
        464 * FOOT,
        _deg(15.0),
        {
            "rudder": _doublet(5.0, 3.0),
            "aileron": lambda t: half_sine(t, 4.0, 2.0, _deg(-5.0)),
            "stabilator": _stabilator_sine(-2.0, 5.0),
        },
        "rudder: doublet of 5 deg, 3 s; aileron: half sine of -5 deg over 4 to 6 s; stabilator: "
        "sine of -2 deg, period 5 s",
        trim=COUPLED_TRIM,
        choices="all inputs: the figure's are lost; by the text they differ from case 1 in form "
        "and amplitude; base noise",
    ),
}

EXAMPLES: dict[str, Case] = {
    **{
        f"{surface} doublet at {alpha:g} deg": Case(
            "section 3.3.1, Tables 3.3 and 3.4",
            10.0,
            None,
            _deg(alpha),
            {surface: _doublet(5.0, 2.0)},
            f"{surface}: doublet of 5 deg, 2 s",
            noise=None,
            choices="speed: level flight; start at 0.5 s",
        )
        for surface in ("aileron", "rudder")
        for alpha in (5.0, 15.0, 25.0)
    },
    **{
        f"stabilator doublet at {alpha:g} deg": Case(
            "section 5.4.1, Table 5.1",
            7.0,
            None,
            _deg(alpha),
            {"stabilator": _doublet(amplitude, 2.0)},
            f"stabilator: doublet of {amplitude:g} deg, 2 s",
            noise=None,
            choices="speed: level flight; start at 0.5 s, width 1 s",
        )
        for alpha, amplitude in ((1.0, 1.0), (10.0, 1.0), (20.0, 5.0))
    },
    "stabilator ramp from 10 deg": Case(
        "section 5.4.1",
        10.0,
        None,
        _deg(10.0),
        {"stabilator": lambda t: ramp(t, 0.5, 5.5, _deg(-5.0))},
        "stabilator: -1 deg/s from 0.5 s to 5.5 s",
        noise=None,
        choices="speed: level flight; length of the ramp",
    ),
    "stabilator sine of 10 deg": Case(
        "section 5.4.1, Fig. 5.1",
        10.0,
        None,
        _deg(13.5),
        {"stabilator": _stabilator_sine(-10.0, 3.0)},
        "stabilator: -10 deg sin(2 pi t / 3)",
        noise=None,
        choices="speed: level flight",
    ),
    "stabilator sine of 5 deg": Case(
        "section 5.4.1, Fig. 5.3",
        10.0,
        None,
        _deg(13.5),
        {"stabilator": _stabilator_sine(-5.0, 6.0)},
        "stabilator: -5 deg sin(2 pi t / 6)",
        noise=None,
        choices="speed: level flight",
    ),
}


def report_flight(case: str, key: Array, seconds: float | None = None) -> Flight:
    """Simulate one of the report's test cases with our F-4-like aircraft.

    Args:
        case: a name in `CASES` (the eight of Figure 6.2) or `EXAMPLES` (sections 3.3.1 and 5.4.1).
        key: random key of the instruments' errors, their noise and the disturbances.
        seconds: duration [s]; by default as long as in the report. Periodic inputs go on.

    Returns:
        Record, truth and aircraft; ten samples a second.

    Raises:
        InputError: for an unknown case, or if JAX is in 32 bit.

    Warns:
        UserWarning: if the flight leaves the range in which the tables are to be trusted.
    """
    known = CASES | EXAMPLES
    require_known("case", [case], known)
    chosen = known[case] if seconds is None else known[case]._replace(seconds=seconds)
    for_errors, for_noise, for_gusts = jax.random.split(key, 3)
    t, inputs = pilot_inputs(chosen)
    if chosen.gust > 0:
        gusts = white_gusts(for_gusts, t, {"gust_v": chosen.gust, "gust_w": chosen.gust})
        inputs |= {"gust_v": gusts[:, 1], "gust_w": gusts[:, 2]}
    aircraft, state = initial_condition(chosen)
    if chosen.noise is not None:
        instruments = draw(for_errors, aircraft.instruments, chosen.noise)
        aircraft = eqx.tree_at(lambda a: a.instruments, aircraft, instruments)
    return simulate_flight(aircraft, t, inputs, state, key=for_noise, name=case)


def pilot_inputs(case: Case) -> tuple[Float[Array, " time"], Signals]:
    """Return sample times of a case [s], and the pilot's inputs by name [rad].

    Args:
        case: the case.
    """
    t = REPORT_SAMPLE_TIME * jnp.arange(round(case.seconds / REPORT_SAMPLE_TIME), dtype=float)
    return t, {f"pilot_{surface}": signal(t) for surface, signal in case.pilot.items()}


def initial_condition(
    case: Case, altitude: float = CASE_ALTITUDE
) -> tuple[Aircraft, Float[Array, " state"]]:
    """Return the trimmed aircraft of a case, and its initial state.

    At the printed speed stabilator and thrust balance pitching moment and forward force, but for
    the trim of the case, a choice. If no speed is printed, the speed is trimmed too, so that the
    normal force carries the weight.

    Args:
        case: the case.
        altitude: altitude [m].
    """
    airframe = f4()
    switch = Switch() if case.augmentation_on is None else Switch(on=case.augmentation_on)
    controls = ControlSystem(standard_actuators(airframe.limits), augmentation=Augmentation(switch))
    aircraft = Aircraft(
        airframe,
        engines=(Engine(ConstantThrust(0.0)),),
        controls=controls,
        instruments=report_instruments(),
    )
    trim = trim_at_alpha(aircraft, case.alpha, altitude, case.V)
    V = case.V if case.V is not None else trim.value("V")
    surfaces = {
        "stabilator": trim.value("stabilator") + case.trim,
        "aileron": jnp.zeros(()),
        "rudder": jnp.zeros(()),
    }
    trimmed = aircraft.trimmed(surfaces, trim.value("thrust"))
    position = jnp.array([0.0, 0.0, altitude])
    e = quaternion(0.0, case.alpha, 0.0)
    return trimmed, trimmed.flight_state(velocity(V, case.alpha, 0.0), jnp.zeros(3), e, position)


def settings() -> str:
    """Return all settings of all cases, with our choices, as a table in Markdown."""
    lines = [
        "| case | source | s | V ft/s | alpha deg | inputs about trim | SAS on at s | noise | gust "
        "ft/s | trim deg | our choice |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, case in (CASES | EXAMPLES).items():
        speed = "level flight" if case.V is None else f"{case.V / FOOT:.0f}"
        noise = "none" if case.noise is None else "base" if case.noise is BASE else "high"
        on = "never" if case.augmentation_on is None else f"{case.augmentation_on:g}"
        degrees = case.alpha / DEGREE
        cells = (
            name,
            case.source,
            f"{case.seconds:g}",
            speed,
            f"{degrees:g}",
            case.description,
            on,
            noise,
        )
        last = (f"{case.gust / FOOT:g}", f"{case.trim / DEGREE:g}", case.choices)
        lines.append("| " + " | ".join((*cells, *last)) + " |")
    return (
        "\n".join(lines) + "\n\nAll cases: altitude 35,000 ft, actuators of first order (0.05 s, "
        "60 deg/s), and the trim: our choice. The trim is the stabilator at the start, less the "
        "one that balances the pitching moment."
    )
