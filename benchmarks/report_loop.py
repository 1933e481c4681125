"""Loop and subset regression on the report's problem, tables as truth.

`python -m benchmarks.report_loop [--json] [--seeds 1]`.

The motions of longitudinal case 2 and lateral case 1 are flown several times with the F-4-like
aircraft, each with other inputs, by one aircraft with one set of instruments. The declared
model has linear coefficients; the loop may add the terms of Table 6.1. Subset regression selects
from the same terms on the same records. Both results are compared with the tables and with flights
that neither has used. With `--calibrated` the instruments have the report's noise and
no constant errors.
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
from jaxid.aircraft.effects.coefficient_term import CoefficientTerm
from jaxid.aircraft.flight.report_cases import CASES, Case, initial_condition, pilot_inputs
from jaxid.aircraft.flight.simulate_flight import Flight, simulate_flight
from jaxid.aircraft.identification.flights import from_aircraft
from jaxid.aircraft.identification.model import IdentificationModel
from jaxid.aircraft.identification.regressors import TABLE_6_1
from jaxid.aircraft.instruments.noise_levels import BASE, NoiseLevel, draw, report_instruments
from jaxid.aircraft.physics.imperial import DEGREE
from jaxid.data import Record
from jaxid.data.signals import full_sine, half_sine, sine
from jaxid.diagnosis.validation import predict
from jaxid.effects import Augmented
from jaxid.estimation.estimate import as_stack
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
        case: case of the report that gives the start, noise and setting of all flights.
        linear: terms of the declared coefficients, in addition to the constants.
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
            pilot={
                "stabilator": lambda t, size=size, period=period: sine(
                    t, 1.0 / period, size * DEGREE
                )
            }
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
    return {
        f"rudder {one:g}, aileron {two:g} deg": base._replace(pilot=pilot(one, two))
        for one, two in sizes
    }


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


# The records ------------------------------------------------------------------------------------


def fly_all(motion: Motion, seed: int, level: NoiseLevel) -> dict[str, Flight]:
    """Return all flights of a motion, flown by one aircraft with constant instrument errors.

    Args:
        motion: motion to fly.
        seed: seed of instrument errors and noise.
        level: level of instrument errors and noise.
    """
    key = jax.random.fold_in(jax.random.key(seed), list(MOTIONS).index(motion.case))
    aircraft, state = initial_condition(CASES[motion.case])
    aircraft = eqx.tree_at(
        lambda one: one.instruments, aircraft, draw(key, report_instruments(), level)
    )
    flights = {}
    for number, (name, case) in enumerate(motion.flights.items(), 1):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Flight .* to be trusted")
            flights[name] = simulate_flight(
                aircraft, *pilot_inputs(case), state, key=jax.random.fold_in(key, number), name=name
            )
    return flights


def undetermined(motion: Motion, flown: Flight) -> IdentificationModel:
    """Return the analyst's initial model, without coefficients.

    It has the mass, size and nominal instruments of the aircraft that flew. Candidates are the
    terms of Table 6.1; in symmetric flight the terms with sideslip are left out.
    """
    nominal = eqx.tree_at(lambda one: one.instruments, flown.aircraft, report_instruments())
    setting = motion.setting
    admitted = {
        name: tuple(term for term in terms if motion.linear is not SYMMETRIC or "beta" not in term)
        for name, terms in TABLE_6_1.items()
    }
    return from_aircraft(
        nominal, states=setting.states, outputs=setting.outputs, candidates=admitted
    )


def declared(
    motion: Motion, model: IdentificationModel, records: Sequence[Record]
) -> IdentificationModel:
    """Return the model with linear coefficients, regressed on the training records."""
    measured = [model.pseudo_measurements(record) for record in records]
    valid = [np.asarray(one.valid) for one in measured]

    def joined(kind):
        names = getattr(measured[0], kind)
        pieces = {
            name: [
                np.asarray(getattr(one, kind)[name])[keep]
                for one, keep in zip(measured, valid, strict=True)
            ]
            for name in names
        }
        return {name: np.concatenate(parts) for name, parts in pieces.items()}

    signals = joined("signals")
    centre = {name: float(np.mean(signals[name])) for name in measured[0].centred}
    X = columns(motion.linear, signals, centre)
    polynomials = {}
    for name, response in joined("responses").items():
        fit = least_squares(X, response, motion.linear, response=name)
        values = dict(zip(fit.names, map(float, fit.values), strict=True))
        polynomials[name] = Polynomial({"1": fit.constant, **values}, centre=centre)
    return with_polynomials(model, polynomials)


def terms_to_try(motion: Motion, model: IdentificationModel) -> tuple[CoefficientTerm, ...]:
    """Return the candidate terms of the regression that the declared model lacks."""
    affected = {
        one.coefficient: one.affected_states
        for one in model.effects()
        if isinstance(one, CoefficientTerm)
    }
    return tuple(
        CoefficientTerm(coefficient=name, product=term, affected_states=affected[name])
        for name, terms in model.candidates
        if name in affected
        for term in terms
        if term not in motion.linear
    )


# Comparison -------------------------------------------------------------------------------------


class Result(NamedTuple):
    """A fitted model with its errors.

    Attributes:
        model: model with its estimated values.
        terms: terms by coefficient, without constants.
        predictions: root mean square error by test flight and channel, in units of the noise.
        errors: by coefficient and part ("static", "whole"): root mean square error over the range
            of the true value, over all test flights.
    """

    model: AbstractModel
    terms: dict[str, tuple[str, ...]]
    predictions: dict[str, dict[str, float]]
    errors: dict[str, dict[str, float]]


def polynomials(model: AbstractModel) -> dict[str, list[tuple[str, float, Mapping[str, float]]]]:
    """Return all terms by coefficient: product, value and centre of the signals."""
    effects = model.effects_in if isinstance(model, Augmented) else ()
    base = model.model if isinstance(model, Augmented) else model
    terms = {}
    for name in base.responses:
        polynomial = getattr(base.airframe.aerodynamics, name)
        centre = dict(polynomial.centre)
        terms[name] = [
            (term, float(value), centre)
            for term, value in zip(polynomial.terms, polynomial.coefficients, strict=True)
        ]
        terms[name] += [(e.product, float(e.gain), {}) for e in effects if e.coefficient == name]
    return terms


def coefficient(terms, at: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the value of a coefficient along signals, shape (time,)."""
    return sum(value * columns((term,), at, centre)[:, 0] for term, value, centre in terms)


def errors(model: AbstractModel, flights: Sequence[Flight]) -> dict[str, dict[str, float]]:
    """Return the RMS errors of static and whole coefficients over the range of the true value.

    Static coefficients are evaluated at the true angles, whole ones at the true motion.
    """
    relative = {}
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
        relative[name] = {
            part: float(np.sqrt(np.mean(a**2)) / np.ptp(b)) for part, (a, b) in joined.items()
        }
    return relative


def motion_of(flight: Flight) -> dict[str, np.ndarray]:
    """Return the true signals of the coefficients, each of shape (time,)."""
    names = ("alpha", "beta", "stabilator", "aileron", "rudder")
    at = {name: np.asarray(flight.truth.channel(name)) for name in names}
    V, lengths = np.asarray(flight.truth.channel("V")), np.asarray(flight.aircraft.airframe.lengths)
    rates = {
        f"{rate}hat": np.asarray(flight.truth.channel(rate)) * length / (2.0 * V)
        for rate, length in zip("pqr", lengths, strict=True)
    }
    return at | rates


def judged(motion: Motion, model: AbstractModel, noise, flights: Mapping[str, Flight]) -> Result:
    """Return the errors of a model on the test flights."""
    tests = {name: flights[name] for name in motion.test}
    states, outputs = motion.setting.initial, motion.setting.outputs
    predictions = {}
    for name, flight in tests.items():
        record = model.prepared(record_of(flight, motion.setting))
        rms = predict(
            model, record, OutputError(FixedNoise(noise)), window=WINDOW, states=states
        ).rms
        predictions[name] = {
            one: float(value) / BASE.noise[one] for one, value in zip(outputs, rms, strict=True)
        }
    named = {
        name: tuple(term for term, _, _ in terms if term != "1")
        for name, terms in polynomials(model).items()
    }
    return Result(model, named, predictions, errors(model, list(tests.values())))


def measure(
    motion: Motion, seed: int, level: NoiseLevel, *, most: int = MOST_TERMS, progress=None
) -> dict:
    """Fly a motion and identify a model by each method; return the results."""
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
    models = {
        "declared, linear": (study.before.estimate.model, study.before.estimate.noise),
        "the loop": (study.after.estimate.model, noise),
    }
    for words, rule in (("largest F", {}), ("least BIC", {"rule": Minimum("BIC"), "share": 0.0})):
        clock = time.perf_counter()
        options = IdentifyOptions(add=setting.add, keep=empty.responses, **rule)
        initial = tuple(f"initial_state.{state}" for state in setting.initial)
        identification = identify(empty, train, options=options, per_record=initial, solver=SOLVER)
        seconds[words] = time.perf_counter() - clock
        models[f"regression, {words}"] = identification.start_model, noise
        models[f"the same, then likelihood, {words}"] = (
            identification.model,
            identification.estimate.noise,
        )
    results = {name: judged(motion, model, R, flights) for name, (model, R) in models.items()}
    return {
        "case": motion.case,
        "seed": seed,
        "outcome": study.outcome.value,
        "verdict": study.verdict,
        "rounds": [one.added for one in study.rounds],
        "seconds": seconds,
        "ways": {
            name: {**one._asdict(), "model": None, **summary(one)} for name, one in results.items()
        },
    }


def closed(
    motion: Motion, linear: IdentificationModel, records: Mapping[str, Record], most: int, progress
) -> Study:
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
    """Return the number of terms, the prediction error and the coefficient errors of a result.

    Errors are geometric means, so that all channels have the same weight.
    """
    rms = [value for flight in one.predictions.values() for value in flight.values()]
    parts = {part: [error[part] for error in one.errors.values()] for part in ("static", "whole")}
    return {
        "terms_in_all": sum(map(len, one.terms.values())),
        "prediction": _mean(rms),
        **{part: _mean(values) for part, values in parts.items()},
    }


def _mean(values: Sequence[float]) -> float:
    """Return the geometric mean; infinity if a value is not finite."""
    return float(np.exp(np.mean(np.log(values)))) if np.all(np.isfinite(values)) else float("inf")


def table(rows: Sequence[dict]) -> str:
    """Return one block of text per case: medians over seeds and the terms of the first seed."""
    lines = []
    for case in dict.fromkeys(row["case"] for row in rows):
        case_rows = [row for row in rows if row["case"] == case]
        lines += [case, f"  {'':<42}{'terms':>7}{'prediction':>12}{'static':>10}{'whole':>10}"]
        for method in case_rows[0]["ways"]:
            numbers = [
                np.median([row["ways"][method][key] for row in case_rows])
                for key in ("terms_in_all", "prediction", "static", "whole")
            ]
            cells = "".join(
                f"{number:>{width}.3g}"
                for number, width in zip(numbers, (7, 12, 10, 10), strict=True)
            )
            lines.append(f"  {method:<42}{cells}")
        for method in case_rows[0]["ways"]:
            terms = case_rows[0]["ways"][method]["terms"]
            lines += ["", f"  {method}:"] + [
                f"    {name}: {', '.join(some)}" for name, some in terms.items()
            ]
        lines += ["", f"  {case_rows[0]['verdict']}", ""]
    return "\n".join(lines) + NOTES


NOTES = """\
prediction: RMS error on the test flights in units of the noise, geometric mean over channels and
flights. static, whole: RMS error of a coefficient over its true range, at the true angles (rates
and surfaces at zero) and at the true motion of the test flights, geometric mean over
coefficients."""


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.report_loop", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else"
    )
    parser.add_argument(
        "--seeds", type=int, default=1, help="number of draws of noise and instruments (default: 1)"
    )
    parser.add_argument("--calibrated", action="store_true", help="instruments with noise alone")
    parser.add_argument("--case", choices=MOTIONS, help="one of them (default: all)")
    parser.add_argument(
        "--progress", action="store_true", help="print the progress on standard error"
    )
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    progress = (
        (lambda words: print(words, file=sys.stderr, flush=True)) if options.progress else None
    )
    level = NOISE_ALONE if options.calibrated else BASE
    cases = [options.case] if options.case else list(MOTIONS)
    rows = [
        measure(MOTIONS[case], seed, level, progress=progress)
        for case in cases
        for seed in range(options.seeds)
    ]
    if options.json:
        print(json.dumps({"status": "measured", "calibrated": options.calibrated, "rows": rows}))
    else:
        print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
