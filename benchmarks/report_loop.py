"""The report's own situation, a linear model and tables as truth: `python -m benchmarks.report_loop [--json] [--seeds 1]`.

The motions of longitudinal case 2 and lateral case 1 are flown several times with the F-4-like aircraft, each with other
inputs, by one aircraft with one set of instruments. Declared is a model with linear coefficients; the loop may add the terms
of Table 6.1, from which subset regression chooses too, on the same records. Both are held against the tables and against
flights that neither has used. With `--calibrated` the instruments have the report's noise and no constant errors.
"""

import argparse
import json
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from benchmarks.report_tables.cases import SOLVER, record_of
from benchmarks.report_tables.coefficients import angles, true_part
from benchmarks.report_tables.settings import SETTINGS, Setting
from jaxid import FixedNoise, OutputError, close_loop, free
from jaxid.aircraft.effects import CoefficientTerm
from jaxid.aircraft.flights import CASES, Case, pilot_inputs, start
from jaxid.aircraft.fly import Flight, fly
from jaxid.aircraft.identification import IdentificationModel
from jaxid.aircraft.identification_flights import from_aircraft
from jaxid.aircraft.imperial import DEGREE
from jaxid.aircraft.noise_levels import BASE, NoiseLevel, draw, report_instruments
from jaxid.aircraft.regressors import TABLE_6_1
from jaxid.data import Record
from jaxid.data.signals import full_sine, half_sine, sine
from jaxid.diagnosis.validation import predict
from jaxid.estimation.estimate import as_stack
from jaxid.models import Augmented
from jaxid.models.base import AbstractModel
from jaxid.models.polynomial import Polynomial
from jaxid.models.replace import with_polynomials
from jaxid.structure import Minimum, columns, least_squares
from jaxid.study import IdentifyOptions, LoopOptions, Study, identify

WINDOW = 20  # samples in which the initial state of a check or test flight is fitted
MOST_TERMS = 12
NOISE_ALONE = NoiseLevel({}, {}, BASE.noise, {}, {})
SYMMETRIC, LATERAL = ("alpha", "qhat", "stabilator"), ("beta", "phat", "rhat", "aileron", "rudder")


class Motion(NamedTuple):
    """A case of the report and further flights of its kind.

    Attributes:
        case: whose start, noise and setting all flights have.
        linear: terms of the declared coefficients, beside the constants.
        train, check, test: the flights' inputs, by what distinguishes them.
    """

    case: str
    linear: tuple[str, ...]
    train: Mapping[str, Case]
    check: Mapping[str, Case]
    test: Mapping[str, Case]

    @property
    def setting(self) -> Setting:
        return SETTINGS[self.case]

    @property
    def flights(self) -> dict[str, Case]:
        return {**self.train, **self.check, **self.test}


def _longitudinal(*sines: tuple[float, float]) -> dict[str, Case]:
    """Longitudinal case 2 with a stabilator sine of other amplitude [deg] and period [s]."""
    base = CASES["longitudinal 2"]
    return {
        f"{size:g} deg, {period:g} s": base._replace(
            pilot={"stabilator": lambda t, size=size, period=period: sine(t, 1.0 / period, size * DEGREE)}
        )
        for size, period in sines
    }


def _lateral(*sizes: tuple[float, float]) -> dict[str, Case]:
    """Lateral case 1 with other sizes of the rudder's pulse and the ailerons' sine [deg]."""

    def pilot(rudder, aileron):
        return {
            "rudder": lambda t: half_sine(t, 0.0, 2.5, rudder * DEGREE),
            "aileron": lambda t: full_sine(t, 2.5, 2.5, aileron * DEGREE),
        }

    base = CASES["lateral 1"]
    return {f"rudder {one:g}, aileron {two:g} deg": base._replace(pilot=pilot(one, two)) for one, two in sizes}


MOTIONS = {
    "longitudinal 2": Motion(
        "longitudinal 2",
        SYMMETRIC,
        _longitudinal((-2.0, 4.0), (2.5, 5.0), (-3.0, 3.0)),
        _longitudinal((-2.5, 5.0)),
        _longitudinal((2.0, 4.0), (-4.0, 4.0)),
    ),
    "lateral 1": Motion(
        "lateral 1",
        LATERAL,
        _lateral((10.0, 7.0), (-8.0, 10.0), (5.0, 7.0)),
        _lateral((10.0, -7.0)),
        _lateral((7.0, 7.0), (-9.0, -6.0)),
    ),
}


# The records ----------------------------------------------------------------------------------------------------------


def fly_all(motion: Motion, seed: int, level: NoiseLevel) -> dict[str, Flight]:
    """All flights of a motion with one aircraft, whose instruments keep their errors from flight to flight.

    Args:
        motion: which.
        seed: of errors and noise.
        level: of both.
    """
    key = jax.random.fold_in(jax.random.key(seed), list(MOTIONS).index(motion.case))
    aircraft, state = start(CASES[motion.case])
    aircraft = eqx.tree_at(lambda one: one.instruments, aircraft, draw(key, report_instruments(), level))
    found = {}
    for number, (name, case) in enumerate(motion.flights.items(), 1):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Flight .* to be trusted")
            found[name] = fly(aircraft, *pilot_inputs(case), state, key=jax.random.fold_in(key, number), name=name)
    return found


def undetermined(motion: Motion, flown: Flight) -> IdentificationModel:
    """What the analyst starts from: mass, size and nominal instruments of the aircraft that flew, and no coefficient.

    Candidates are those of Table 6.1; in symmetric flight none with sideslip.
    """
    nominal = eqx.tree_at(lambda one: one.instruments, flown.aircraft, report_instruments())
    setting = motion.setting
    admitted = {
        name: tuple(term for term in terms if motion.linear is not SYMMETRIC or "beta" not in term)
        for name, terms in TABLE_6_1.items()
    }
    return from_aircraft(nominal, states=setting.states, outputs=setting.outputs, candidates=admitted)


def declared(motion: Motion, model: IdentificationModel, records: Sequence[Record]) -> IdentificationModel:
    """The model with linear coefficients, its values from a regression on the training records."""
    measured = [model.pseudo_measurements(record) for record in records]
    valid = [np.asarray(one.valid) for one in measured]

    def joined(kind):
        names = getattr(measured[0], kind)
        pieces = {
            name: [np.asarray(getattr(one, kind)[name])[keep] for one, keep in zip(measured, valid, strict=True)]
            for name in names
        }
        return {name: np.concatenate(several) for name, several in pieces.items()}

    signals = joined("signals")
    centre = {name: float(np.mean(signals[name])) for name in measured[0].centred}
    X = columns(motion.linear, signals, centre)
    polynomials = {}
    for name, response in joined("responses").items():
        found = least_squares(X, response, motion.linear, response=name)
        values = dict(zip(found.names, map(float, found.values), strict=True))
        polynomials[name] = Polynomial({"1": found.constant, **values}, centre=centre)
    return with_polynomials(model, polynomials)


def terms_to_try(motion: Motion, model: IdentificationModel) -> tuple[CoefficientTerm, ...]:
    """The terms from which the regression chooses and that the declared model lacks."""
    moved = {one.coefficient: one.moved for one in model.effects() if isinstance(one, CoefficientTerm)}
    return tuple(
        CoefficientTerm(coefficient=name, product=term, moved=moved[name])
        for name, terms in model.candidates
        if name in moved
        for term in terms
        if term not in motion.linear
    )


# What is compared -----------------------------------------------------------------------------------------------------


class Result(NamedTuple):
    """A model and how it was come by.

    Attributes:
        model: with its values.
        terms: by coefficient, constants left out.
        predictions: root mean square error by test flight and channel, in units of the noise.
        errors: by coefficient and part ("static", "whole"): root mean square error over the range of the true value, over all
            test flights.
    """

    model: AbstractModel
    terms: dict[str, tuple[str, ...]]
    predictions: dict[str, dict[str, float]]
    errors: dict[str, dict[str, float]]


def polynomials(model: AbstractModel) -> dict[str, list[tuple[str, float, Mapping[str, float]]]]:
    """Every term of every coefficient: its product, its value, and from where its signals count."""
    effects = model.effects_in if isinstance(model, Augmented) else ()
    base = model.model if isinstance(model, Augmented) else model
    found = {}
    for name in base.responses:
        own = getattr(base.airframe.aerodynamics, name)
        centre = dict(own.centre)
        found[name] = [(term, float(value), centre) for term, value in zip(own.terms, own.coefficients, strict=True)]
        found[name] += [(e.product, float(e.gain), {}) for e in effects if e.coefficient == name]
    return found


def coefficient(terms, at: Mapping[str, np.ndarray]) -> np.ndarray:
    """The value of a coefficient along signals, shape (time,)."""
    return sum(value * columns((term,), at, centre)[:, 0] for term, value, centre in terms)


def errors(model: AbstractModel, flights: Sequence[Flight]) -> dict[str, dict[str, float]]:
    """Of static coefficients at the true angles and of whole ones at the true motion, over the range of the true value."""
    found = {}
    for name, terms in polynomials(model).items():
        apart: dict[str, list] = {"static": [], "whole": []}
        true: dict[str, list] = {"static": [], "whole": []}
        for flight in flights:
            at = motion_of(flight)
            still = {one: value * (one in ("alpha", "beta")) for one, value in at.items()}
            tables = flight.aircraft.airframe.aerodynamics
            true["static"].append(true_part(tables, name, angles(flight)))
            true["whole"].append(np.asarray(flight.truth.channel(name)))
            for part, signals in (("static", still), ("whole", at)):
                apart[part].append(coefficient(terms, signals) - true[part][-1])
        joined = {part: (np.concatenate(apart[part]), np.concatenate(true[part])) for part in apart}
        found[name] = {part: float(np.sqrt(np.mean(a**2)) / np.ptp(b)) for part, (a, b) in joined.items()}
    return found


def motion_of(flight: Flight) -> dict[str, np.ndarray]:
    """The true signals of the coefficients, each of shape (time,)."""
    names = ("alpha", "beta", "stabilator", "aileron", "rudder")
    at = {name: np.asarray(flight.truth.channel(name)) for name in names}
    V, lengths = np.asarray(flight.truth.channel("V")), np.asarray(flight.aircraft.airframe.lengths)
    rates = {
        f"{rate}hat": np.asarray(flight.truth.channel(rate)) * length / (2.0 * V)
        for rate, length in zip("pqr", lengths, strict=True)
    }
    return at | rates


def judged(motion: Motion, model: AbstractModel, noise, flights: Mapping[str, Flight]) -> Result:
    """A model on the test flights."""
    tests = {name: flights[name] for name in motion.test}
    states, outputs = motion.setting.initial, motion.setting.outputs
    found = {}
    for name, flight in tests.items():
        record = model.prepared(record_of(flight, motion.setting))
        rms = predict(model, record, OutputError(FixedNoise(noise)), window=WINDOW, states=states).rms
        found[name] = {one: float(value) / BASE.noise[one] for one, value in zip(outputs, rms, strict=True)}
    named = {name: tuple(term for term, _, _ in terms if term != "1") for name, terms in polynomials(model).items()}
    return Result(model, named, found, errors(model, list(tests.values())))


def measure(motion: Motion, seed: int, level: NoiseLevel, *, most: int = MOST_TERMS, progress=None) -> dict:
    """Fly, and find a model in each of the ways."""
    flights = fly_all(motion, seed, level)
    first, setting = next(iter(flights.values())), motion.setting
    records = {name: record_of(flight, setting) for name, flight in flights.items()}
    train = [records[name] for name in motion.train]
    empty = undetermined(motion, first)
    linear = declared(motion, empty, train)
    clock = time.perf_counter()
    study = closed(motion, linear, records, most, progress)
    seconds = {"loop": time.perf_counter() - clock}
    noise = study.after.estimate.noise
    ways = {
        "declared, linear": (study.before.estimate.model, study.before.estimate.noise),
        "the loop": (study.after.estimate.model, noise),
    }
    for words, rule in (("largest F", {}), ("least BIC", {"rule": Minimum("BIC"), "share": 0.0})):
        clock = time.perf_counter()
        options = IdentifyOptions(add=setting.add, keep=empty.responses, **rule)
        initial = tuple(f"initial_state.{state}" for state in setting.initial)
        found = identify(empty, train, options=options, per_record=initial, solver=SOLVER)
        seconds[words] = time.perf_counter() - clock
        ways[f"regression, {words}"] = found.started, noise
        ways[f"the same, then likelihood, {words}"] = found.model, found.estimate.noise
    results = {name: judged(motion, model, R, flights) for name, (model, R) in ways.items()}
    return {
        "case": motion.case,
        "seed": seed,
        "outcome": study.outcome,
        "verdict": study.verdict,
        "rounds": [one.added for one in study.rounds],
        "seconds": seconds,
        "ways": {name: {**one._asdict(), "model": None, **summary(one)} for name, one in results.items()},
    }


def closed(motion: Motion, linear: IdentificationModel, records: Mapping[str, Record], most: int, progress) -> Study:
    """Close the loop over the linear model."""
    terms = tuple(f"{name}.{term}" for name in linear.responses for term in ("1", *motion.linear))
    initial = tuple(f"initial_state.{state}" for state in motion.setting.initial)
    prepared = {name: linear.prepared(record) for name, record in records.items()}
    train, check, test = (as_stack([prepared[one] for one in part]) for part in motion[2:])
    return close_loop(
        linear,
        free(linear, *terms, *motion.setting.add, per_record=initial),
        OutputError(),
        train=train,
        check=check,
        test=test,
        effects=terms_to_try(motion, linear),
        window=WINDOW,
        options=LoopOptions(max_rounds=most),
        progress=progress,
    )


def summary(one: Result) -> dict[str, float]:
    """Number of terms, prediction error and coefficient errors, as means of logarithms, so that all channels count alike."""
    rms = [value for flight in one.predictions.values() for value in flight.values()]
    parts = {part: [error[part] for error in one.errors.values()] for part in ("static", "whole")}
    return {
        "terms_in_all": sum(map(len, one.terms.values())),
        "prediction": _mean(rms),
        **{part: _mean(values) for part, values in parts.items()},
    }


def _mean(values: Sequence[float]) -> float:
    """The geometric mean; infinite where one is not finite."""
    return float(np.exp(np.mean(np.log(values)))) if np.all(np.isfinite(values)) else float("inf")


def table(rows: Sequence[dict]) -> str:
    """One block for each case, medians over seeds; the terms of the first seed."""
    lines = []
    for case in dict.fromkeys(row["case"] for row in rows):
        own = [row for row in rows if row["case"] == case]
        lines += [case, f"  {'':<42}{'terms':>7}{'prediction':>12}{'static':>10}{'whole':>10}"]
        for way in own[0]["ways"]:
            numbers = [
                np.median([row["ways"][way][key] for row in own])
                for key in ("terms_in_all", "prediction", "static", "whole")
            ]
            cells = "".join(f"{number:>{width}.3g}" for number, width in zip(numbers, (7, 12, 10, 10), strict=True))
            lines.append(f"  {way:<42}{cells}")
        for way in own[0]["ways"]:
            terms = own[0]["ways"][way]["terms"]
            lines += ["", f"  {way}:"] + [f"    {name}: {', '.join(some)}" for name, some in terms.items()]
        lines += ["", f"  {own[0]['verdict']}", ""]
    return "\n".join(lines) + NOTES


NOTES = """prediction: RMS error on the test flights in units of the noise, geometric mean over channels and flights.
static, whole: RMS error of a coefficient over its true range, at the true angles (rates and surfaces at zero) and at the true
motion of the test flights, geometric mean over coefficients."""


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; 0 where it ran."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.report_loop", description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    parser.add_argument("--seeds", type=int, default=1, help="how many draws of noise and instruments (default: 1)")
    parser.add_argument("--calibrated", action="store_true", help="instruments with noise alone")
    parser.add_argument("--case", choices=MOTIONS, help="one of them (default: all)")
    parser.add_argument("--progress", action="store_true", help="say on standard error what is going on")
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    progress = (lambda words: print(words, file=sys.stderr, flush=True)) if options.progress else None
    level = NOISE_ALONE if options.calibrated else BASE
    cases = [options.case] if options.case else list(MOTIONS)
    rows = [measure(MOTIONS[case], seed, level, progress=progress) for case in cases for seed in range(options.seeds)]
    if options.json:
        print(json.dumps({"status": "measured", "calibrated": options.calibrated, "rows": rows}))
    else:
        print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
