"""Designed inputs against conventional ones: `python -m benchmarks.input_design [--json]`.

A nonlinear longitudinal aircraft (short period) and a linear lateral one (dutch roll, aileron and
rudder); with `--cases coupled`, which takes much longer, the F-4-like aircraft in six degrees of
freedom at 15 deg of angle of attack. Each input is designed under three limits: equal energy, equal
peak, and an envelope of the motion. The conventional inputs (doublet, 3-2-1-1, 2-1-1, sine, sweep,
multisines), each with pulses for five frequencies about the mode's, and the families of aeroid
where it is installed, are scaled to the same limits. The table shows the total standard error,
`sqrt(sum (error / value)^2)`, of the design, divided by the total of the best input of each family,
at equal duration. Goal: at least 30 % below the best of all.

The standard errors that the design and the best conventional input within the envelope predict are
compared with the scatter of the estimates from simulated flights, 500 by default, in one `vmap`.
"""

import argparse
import importlib.util
import itertools
import json
import math
import sys
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxid import FixedNoise, LinearModel, OutputError, configure, estimate, free
from jaxid._foundation.types import Array
from jaxid.aircraft import (
    Aircraft,
    ConstantThrust,
    ControlSystem,
    Engine,
    MeasuredSurfaces,
    report_instruments,
    standard_actuators,
)
from jaxid.aircraft.flight.coupled_flight import (
    RECORDED_CHANNELS,
    STARTS,
    TABLES_ARE_OFF_BY,
    TRIM_ALTITUDE,
    corrected_f4,
)
from jaxid.aircraft.flight.longitudinal_flight import (
    LONGITUDINAL_SPEED,
    NOISE_DEG,
    NOISE_SI,
    level_trim,
    true_aircraft,
)
from jaxid.aircraft.flight.trim_at_alpha import trim_at_alpha
from jaxid.aircraft.instruments.noise_levels import DEMONSTRATION
from jaxid.aircraft.physics.frames import quaternion, velocity
from jaxid.aircraft.vehicle.controls import SURFACES
from jaxid.data import Record
from jaxid.design import (
    Design,
    InputSignal,
    Limits,
    PlannedInformation,
    Trace,
    conventional_inputs,
    design_input,
    information_of,
    planned_record,
    sample_times,
    spline,
)
from jaxid.models import AbstractModel, Free
from jaxid.models.names import read_parameters

AEROID_DRAWS = 40  # random values of the variables of each family and control (chosen)
COUPLED_ALPHA = math.radians(15.0)
FREQUENCY_FACTORS = (0.5, 0.7, 1.0, 1.4, 2.0)
UNBOUNDED = math.radians(80.0)  # envelope of the designs under equal energy and equal peak


class Case(NamedTuple):
    """An aircraft at a trim, with its instruments and limits.

    Attributes:
        peak: largest deflection from trim [rad].
        energy: of all deflections [rad^2 s].
        envelope: largest deviation from trim of some states or outputs [rad, rad/s].
        frequency: of the mode [Hz].
    """

    model: AbstractModel
    free: Free
    likelihood: OutputError
    t: Array
    trim_state: Array
    trim_input: Array
    peak: float
    energy: float
    envelope: dict[str, float]
    frequency: float
    knots: int

    @property
    def start(self) -> dict[str, Array]:
        """Keyword arguments that begin a simulation at trim."""
        return {"trim_input": self.trim_input, "initial_state": self.trim_state}


def short_period() -> Case:
    """Return the longitudinal aircraft in level flight, elevator with 3 deg and 10 s at 25 Hz."""
    aircraft = true_aircraft()
    state, elevator, thrust = level_trim(aircraft, LONGITUDINAL_SPEED)
    model = eqx.tree_at(lambda m: m.thrust, aircraft, thrust)
    names = [f"{c}.{term}" for c in ("CZ", "Cm") for term in ("alpha", "qhat", "elevator")]
    return Case(
        model,
        free(model, *names, per_record=("initial_state",)),
        longitudinal_likelihood(model),
        sample_times(10.0, 0.04),
        state,
        elevator[None],
        peak=math.radians(3.0),
        energy=0.006,
        envelope={"alpha": math.radians(4.0), "q": math.radians(12.0)},
        frequency=0.25,
        knots=24,
    )


def longitudinal_likelihood(model: AbstractModel) -> OutputError:
    """Return output error with the noise of the small flight in the plane of symmetry."""
    deviations = [
        math.radians(NOISE_DEG[name]) if name in NOISE_DEG else NOISE_SI[name]
        for name in model.outputs
    ]
    return OutputError(FixedNoise(jnp.array(deviations) ** 2))


def dutch_roll() -> Case:
    """Return a linear lateral aircraft of a fighter's magnitude, our choice; 12 s at 25 Hz."""
    model = LinearModel(
        A=[
            [-0.12, 0.1, -1.0, 0.05],
            [-9.0, -1.4, 0.6, 0.0],
            [4.0, -0.05, -0.3, 0.0],
            [0, 1, 0.1, 0],
        ],
        B=[[0.0, 0.03], [9.0, 2.0], [0.4, -2.5], [0.0, 0.0]],
        C=np.eye(4),
        D=np.zeros((4, 2)),
        states=("beta", "p", "r", "phi"),
        inputs=("aileron", "rudder"),
        outputs=("beta_vane", "p_gyro", "r_gyro", "phi_gyro"),
    )
    elements = [f"{m}[{i},{j}]" for i in (1, 2) for m, j in (("A", 0), ("A", 1), ("A", 2))]
    controls = [f"B[{i},{j}]" for i in (1, 2) for j in (0, 1)]
    return Case(
        model,
        free(model, *elements, *controls, per_record=("initial_state",)),
        OutputError(FixedNoise(jnp.radians(jnp.array([0.1, 0.15, 0.1, 0.1])) ** 2)),
        sample_times(12.0, 0.04),
        jnp.zeros(4),
        jnp.zeros(2),
        peak=math.radians(4.0),
        energy=0.012,
        envelope={"beta": math.radians(4.0), "p": math.radians(30.0), "phi": math.radians(40.0)},
        frequency=0.33,
        knots=20,
    )


def coupled() -> Case:
    """Return the F-4-like aircraft in six degrees of freedom at 15 deg of angle of attack; all
    surfaces, with corrections of its tables to estimate; 10 s at 25 Hz.
    """
    frame = corrected_f4(TABLES_ARE_OFF_BY)
    engine, instruments = Engine(ConstantThrust(0.0)), report_instruments(RECORDED_CHANNELS)
    controls = ControlSystem(standard_actuators(frame.limits))
    flown = Aircraft(frame, engines=(engine,), controls=controls, instruments=instruments)
    trim = trim_at_alpha(flown, COUPLED_ALPHA, TRIM_ALTITUDE)
    surfaces = dict.fromkeys(SURFACES, jnp.zeros(())) | {"stabilator": trim.value("stabilator")}
    engines = flown.trimmed(surfaces, trim.value("thrust")).engines
    model = Aircraft(frame, engines=engines, controls=MeasuredSurfaces(), instruments=instruments)
    state = model.flight_state(
        velocity(trim.value("V"), COUPLED_ALPHA, 0.0),
        jnp.zeros(3),
        quaternion(0.0, COUPLED_ALPHA, 0.0),
        jnp.array([0.0, 0.0, TRIM_ALTITUDE]),
    )
    noise = jnp.array([DEMONSTRATION.noise[name] for name in RECORDED_CHANNELS])
    terms = [f"{c}.{term}" for c, terms in TABLES_ARE_OFF_BY.items() for term in terms]
    return Case(
        model,
        free(model, *terms, per_record=tuple(f"initial_state.{name}" for name in STARTS)),
        OutputError(FixedNoise(noise**2)).compact(),
        sample_times(10.0, 0.04),
        state,
        jnp.stack([surfaces[name] for name in SURFACES]),
        peak=math.radians(3.0),
        energy=0.012,
        envelope={"alpha": math.radians(4.0), "beta": math.radians(5.0)},
        frequency=0.25,
        knots=24,
    )


CASES = {"short period": short_period, "dutch roll": dutch_roll, "coupled": coupled}
QUICK = ("short period", "dutch roll")


def limits_of(case: Case) -> dict[str, Limits]:
    """Return the limits of the three comparisons."""
    inputs = case.model.inputs
    trim = trim_values(case)
    wide = {name: (value - UNBOUNDED, value + UNBOUNDED) for name, value in trim.items()}
    tight = {
        name: (value - case.envelope[name], value + case.envelope[name])
        for name, value in trim.items()
    }
    large = dict.fromkeys(inputs, math.radians(25.0))
    rate = dict.fromkeys(inputs, math.radians(100.0))
    peak = dict.fromkeys(inputs, case.peak)
    return {
        "equal energy": Limits(large, rate, case.energy, wide),
        "equal peak": Limits(peak, rate, None, wide),
        "envelope": Limits(large, rate, None, tight),
    }


def trim_values(case: Case) -> dict[str, float]:
    """Return the limited quantities at trim."""
    y = case.model.output(jnp.zeros(()), case.trim_state, case.trim_input)
    known = dict(zip(case.model.outputs, y, strict=True))
    known |= dict(zip(case.model.states, case.trim_state, strict=True))
    return {name: float(known[name]) for name in case.envelope}


def families(case: Case) -> list[InputSignal]:
    """Return the conventional inputs for several frequencies about the mode's."""
    signals = []
    for factor in FREQUENCY_FACTORS:
        f = factor * case.frequency
        inputs = conventional_inputs(case.t, f, (0.4 * f, 4.0 * f), case.model.inputs, start=0.2)
        signals += list(inputs.values())
    return signals + aeroid_families(case)


def aeroid_families(case: Case) -> list[InputSignal]:
    """Return inputs of the families of aeroid, which move one control each, with random values of
    their variables; none where aeroid is not installed.
    """
    if importlib.util.find_spec("aeroid") is None:
        return []
    import aeroid

    f, t, duration = case.frequency, np.asarray(case.t), float(case.t[-1])
    rng, signals = np.random.default_rng(0), []
    lines = np.arange(1, 1 + int(4.0 * f * duration)) / duration
    for axis, control in enumerate(case.model.inputs):
        families = (
            aeroid.Doublet(control, (0.5, 1.0), (0.1 / f, 1.5 / f), start=0.2),
            aeroid.Multisine(control, tuple(lines), (0.0, 1.0)),
            aeroid.Chirp(control, (0.5, 1.0), (0.1 * f, 2.0 * f), (0.2 * f, 4.0 * f)),
        )
        for family, _ in itertools.product(families, range(AEROID_DRAWS)):
            u = np.zeros((t.size, len(case.model.inputs)))
            u[:, axis] = family.signal(rng.uniform(*np.transpose(family.bounds)), t)
            name = f"aeroid {type(family).__name__.lower()}"
            signals.append(InputSignal(case.t, jnp.asarray(u), case.model.inputs, name))
    return signals


def compare(case: Case, seed: int) -> tuple[dict[str, Any], Design]:
    """Return the ratios of total standard errors for the three limits, and the last design."""
    values = read_parameters(case.model, case.free.shared)
    measure = Trace(1.0 / values**2)
    signals = families(case)
    table: dict[str, Any] = {}
    for name, limits in limits_of(case).items():
        begin = time.process_time()
        design = design_input(
            case.model,
            case.free,
            case.t,
            spline(case.t, case.knots),
            measure,
            limits,
            case.likelihood,
            conventional=signals,
            seed=seed,
            **case.start,
        )
        best: dict[str, float] = {}
        for comparison in design.comparisons:
            lowest = min(best.get(comparison.name, np.inf), comparison.within_limits)
            best[comparison.name] = lowest
        ratios = {family: math.exp(0.5 * (design.cost - cost)) for family, cost in best.items()}
        table[name] = {
            "total_relative_error": math.exp(0.5 * design.cost),
            "ratio_to_family": ratios,
            "ratio_to_best": max(ratios.values()),
            "largest_use_of_a_limit": max(design.limits_used.values()),
            "processor_seconds": time.process_time() - begin,
        }
    return table, design


class PlannedFlight(NamedTuple):
    """A record to fly, and what it is predicted to show."""

    record: Record
    information: PlannedInformation


def best_conventional(case: Case, design: Design) -> PlannedFlight:
    """Return the best conventional input, scaled to the peak of the design."""
    index = int(np.argmin([comparison.equal_peak for comparison in design.comparisons]))
    signal = families(case)[index].with_peak(float(jnp.max(design.signal.peak)))
    record = planned_record(case.model, signal, case.likelihood, **case.start)
    shown = information_of(
        case.model, case.free, record, case.likelihood, initial_state=case.trim_state
    )
    return PlannedFlight(record, shown)


def realised(case: Case, flight: PlannedFlight, draws: int, seed: int) -> dict[str, float]:
    """Return the scatter of estimates from simulated flights over the predicted error, by name."""
    values = flown(case.model, case.free, case.likelihood, flight.record, draws, seed)
    ratio = np.std(values, axis=0) / flight.information.standard_errors
    return dict(zip(case.free.shared, ratio.tolist(), strict=True))


def flown(model, chosen: Free, likelihood, record: Record, draws: int, seed: int) -> np.ndarray:
    """Return the estimates from flights of one record with noise of their own."""
    deviation = jnp.sqrt(jnp.diagonal(likelihood.noise.R))
    noise = jax.random.normal(jax.random.key(seed), (draws, *record.z.shape)) * deviation

    def values(noise):
        noisy = eqx.tree_at(lambda one: one.z, record, record.z + noise)
        return estimate(model, chosen, noisy, likelihood).values

    return np.asarray(eqx.filter_jit(jax.vmap(values))(noise))


def measure(draws: int, seed: int, names: Sequence[str] = QUICK) -> dict[str, Any]:
    """Return all comparisons of the given cases."""
    results: dict[str, Any] = {}
    for name in names:
        case = CASES[name]()
        table, design = compare(case, seed)
        results[name] = {"designs": table}
        if draws:
            planned = {
                "design": PlannedFlight(design.record, design.information),
                "best conventional": best_conventional(case, design),
            }
            results[name]["realised_over_predicted"] = {
                label: realised(case, flight, draws, seed) for label, flight in planned.items()
            }
    return results


def table(results: dict[str, Any]) -> str:
    """Return the comparisons as text."""
    lines = []
    for name, result in results.items():
        lines.append(f"{name}: total standard error of the design over that of")
        families = list(next(iter(result["designs"].values()))["ratio_to_family"])
        lines.append(f"{'':<22}" + "".join(f"{limit:>14}" for limit in result["designs"]))
        for family in families:
            cells = [d["ratio_to_family"][family] for d in result["designs"].values()]
            lines.append(f"{family:<22}" + "".join(f"{cell:>14.2f}" for cell in cells))
        cells = [d["ratio_to_best"] for d in result["designs"].values()]
        lines.append(f"{'the best of them':<22}" + "".join(f"{cell:>14.2f}" for cell in cells))
        for label, ratios in result.get("realised_over_predicted", {}).items():
            low, high = min(ratios.values()), max(ratios.values())
            lines.append(f"scatter over predicted error, {label}: {low:.2f} to {high:.2f}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the comparisons and print them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--draws", type=int, default=500, help="simulated flights per input")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", nargs="*", choices=CASES, default=list(QUICK))
    options = parser.parse_args(arguments)
    configure()
    results = measure(options.draws, options.seed, options.cases)
    sys.stdout.write((json.dumps(results, indent=2) if options.json else table(results)) + "\n")


if __name__ == "__main__":
    main()
