"""Do the intervals of `consistency` hold the truth? `python -m benchmarks.consistency [--json]
[--flights 1000]`.

Simulated flights of the F-4-like aircraft in six degrees of freedom, each with its own pilot
inputs, instrument errors (bias, scale, delay; sizes of the level `DEMONSTRATION`) and noise, are
reconstructed by `Kinematics`, with an estimate for each flight. For each error the table shows how
often its 95 % interval holds the planted value, and the band that a right estimator meets with
99.9 % probability for all errors together.

The benchmark runs twice: with noise in the outputs alone, as output error assumes; and with white
noise of that level in the specific forces and rates too, which is integrated and which output
error does not model.
"""

import argparse
import json
import sys
import time
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import binom

from jaxid.aircraft.air.atmosphere import StandardAtmosphere
from jaxid.aircraft.flight.report_cases import CASES, initial_condition
from jaxid.aircraft.flight.simulate_flight import flight_solution
from jaxid.aircraft.instruments.channels import FORCE, RATES
from jaxid.aircraft.instruments.instruments import Instruments
from jaxid.aircraft.instruments.noise_levels import DEMONSTRATION, NoiseLevel, draw
from jaxid.aircraft.reconstruction.kinematics import KINEMATIC_OUTPUTS, Kinematics
from jaxid.data import Record
from jaxid.estimation import OutputError, estimate
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.input_noise import input_noise_covariance
from jaxid.models import free
from jaxid.models.base import canonical
from jaxid.models.names import read_parameters
from jaxid.simulation import RK4, Cubic

SEED, FLIGHTS, CHUNK = 1974, 1000, 100
SAMPLE_TIME, FINE = 0.04, 4  # s; simulation steps per sample of the record
SECONDS = 10.0
LATE = 0.1  # s, upper bound of the drawn delays
# m, chosen: the level has no altitude noise, and a channel without noise has no likelihood.
ALTITUDE_NOISE = 3.0
INPUTS, DELAYED = (*FORCE, *RATES), ("alpha", "beta")
CASE = CASES["coupled 1"]
LEVEL, WIDTH, BAND = 0.95, 1.959963984540054, 0.999
KINDS = ("bound", "coloured", "input noise")
ADVICE = """\
bound: Cramer-Rao bound for white residuals. coloured: corrected for the autocorrelation of the
residuals. input noise: the bound plus the contribution of the known noise of the inputs. Noise of
gyros and accelerometers is integrated and hardly appears in the residuals: pass `input_noise` to
`consistency`. Smoothing the inputs does not help, because the slow part of their noise is the part
that is integrated."""


class Flights(NamedTuple):
    """True and estimated errors of the instruments; the first axis counts flights.

    Attributes:
        names: names of the errors.
        planted, values: true and estimated errors.
        standard_errors, corrected_errors: standard errors of the estimates, for white residuals and
            corrected for their autocorrelation.
        whole_errors: the first, plus the contribution of the known noise of the inputs.
        successful: True where the estimate converged.
    """

    names: tuple[str, ...]
    planted: np.ndarray
    values: np.ndarray
    standard_errors: np.ndarray
    corrected_errors: np.ndarray
    input_noise_errors: np.ndarray
    successful: np.ndarray


def kinematics() -> Kinematics:
    """Return the kinematic model that is estimated."""
    return Kinematics(
        Instruments(KINEMATIC_OUTPUTS, delay=dict.fromkeys(DELAYED, 0.0)),
        atmosphere=StandardAtmosphere(),
        beta="vane",
    )


def planted_level(noisy_inputs: bool) -> NoiseLevel:
    """Return the level `DEMONSTRATION` with errors of the estimated channels only.

    The inputs have noise only if `noisy_inputs` is True.
    """
    scale = {name: DEMONSTRATION.scale[name] for name in ("V", "alpha", "beta")}
    bias = {name: DEMONSTRATION.bias[name] for name in (*INPUTS, "alpha", "beta")}
    noise = {name: DEMONSTRATION.noise.get(name, ALTITUDE_NOISE) for name in KINEMATIC_OUTPUTS}
    noise |= {name: DEMONSTRATION.noise[name] if noisy_inputs else 0.0 for name in INPUTS}
    return jax.tree.map(
        lambda value: jnp.asarray(value, float), NoiseLevel(scale, bias, noise, {}, {})
    )


def simulated(key, t, aircraft, state, level):
    """Return inputs and outputs of one flight, and the kinematic model with its planted errors."""
    error_key, delay_key, pilot_key, noise_key = jax.random.split(key, 4)
    instruments = draw(error_key, aircraft.instruments, level)
    late = jax.random.uniform(delay_key, (2,), maxval=LATE)
    instruments = eqx.tree_at(lambda one: one.delay.values, instruments, late)
    aircraft = eqx.tree_at(lambda one: one.instruments, aircraft, instruments)
    size = jax.random.uniform(pilot_key, (len(CASE.pilot),), minval=0.5, maxval=1.0)
    pilot = {
        f"pilot_{surface}": k * signal(t)
        for k, (surface, signal) in zip(size, CASE.pilot.items(), strict=True)
    }
    u = jnp.stack([pilot.get(name, jnp.zeros_like(t)) for name in aircraft.inputs], axis=-1)
    z = flight_solution(aircraft, t, u, state, noise_key, stepper=RK4(2, unrolled=False)).z[::FINE]
    model_instruments = Instruments(
        KINEMATIC_OUTPUTS,
        scale={name: instruments.scale[name] for name in KINEMATIC_OUTPUTS},
        bias={name: instruments.bias[name] for name in KINEMATIC_OUTPUTS},
        delay={name: instruments.delay[name] for name in DELAYED},
    )
    bias = {name: instruments.bias[name] for name in INPUTS}
    return (
        z[:, len(KINEMATIC_OUTPUTS) :],
        z[:, : len(KINEMATIC_OUTPUTS)],
        Kinematics(
            model_instruments, input_bias=bias, atmosphere=StandardAtmosphere(), beta="vane"
        ),
    )


def reconstructed(key, model, chosen, t, aircraft, state, level):
    """Return the estimate of one flight as arrays in the order of `Flights`."""
    u, z, true = simulated(key, t, aircraft, state, level)
    none, likelihood = ("",), OutputError(hold=Cubic())
    units = {"input_units": none * len(INPUTS), "output_units": none * len(KINEMATIC_OUTPUTS)}
    channels = {"inputs": INPUTS, "outputs": KINEMATIC_OUTPUTS, "names": none, **units}
    record = Record(t[::FINE], u, z, jnp.ones(z.shape, bool), {}, **channels)
    fit = estimate(model, chosen, record, likelihood)
    noise = {name: level.noise[name] for name in INPUTS}
    added = input_noise_covariance(model, fit, as_stack(record), likelihood, noise)
    input_noise_errors = jnp.sqrt(jnp.diagonal(fit.covariance + added))
    return (
        read_parameters(true, chosen.shared),
        fit.values,
        fit.standard_errors,
        fit.corrected_errors,
        input_noise_errors,
        fit.successful,
    )


@eqx.filter_jit
def reconstruct_batch(keys, *flown_by):
    """Return the estimates of all flights of `keys` (jitted, vectorised)."""
    return jax.vmap(lambda key: reconstructed(key, *flown_by))(keys)


def flights(
    count: int = FLIGHTS,
    *,
    noisy_inputs: bool = False,
    chunk: int = CHUNK,
    seconds: float = SECONDS,
) -> Flights:
    """Simulate flights and estimate the errors of each.

    Args:
        count: number of flights; a multiple of `chunk`, or fewer.
        noisy_inputs: if True, specific forces and rates have the noise of the level.
        chunk: number of flights in one batch.
        seconds: length of each flight [s].
    """
    aircraft, state = initial_condition(CASE)
    instruments = Instruments((*KINEMATIC_OUTPUTS, *INPUTS), delay=dict.fromkeys(DELAYED, 0.0))
    aircraft = canonical(eqx.tree_at(lambda one: one.instruments, aircraft, instruments))
    t = SAMPLE_TIME / FINE * jnp.arange(FINE * round(seconds / SAMPLE_TIME), dtype=float)
    level, model, keys = (
        planted_level(noisy_inputs),
        canonical(kinematics()),
        jax.random.split(jax.random.key(SEED), count),
    )
    chosen = free(model, *model.sensor_errors(), per_record=("initial_state",))
    given = (model, chosen, t, aircraft, state, level)
    parts = [reconstruct_batch(keys[at : at + chunk], *given) for at in range(0, count, chunk)]
    return Flights(
        chosen.shared, *(np.concatenate(columns) for columns in zip(*parts, strict=True))
    )


def coverage(batch: Flights) -> dict:
    """Return the shares of the 95 % intervals that hold the planted error, and their band.

    Each kind of standard error has its own share.
    """
    kinds = {
        "bound": batch.standard_errors,
        "coloured": batch.corrected_errors,
        "input noise": batch.input_noise_errors,
    }
    off, count = np.abs(batch.values - batch.planted), len(batch.planted)
    tail = (1.0 - BAND) / 2 / len(batch.names)
    band = [float(binom.ppf(share, count, LEVEL) / count) for share in (tail, 1.0 - tail)]
    rows = [
        {
            "error": name,
            "planted": float(np.std(batch.planted[:, k])),
            "scatter": float(np.std(batch.values[:, k] - batch.planted[:, k])),
            "bound": float(np.mean(batch.standard_errors[:, k])),
            "coverage": {
                kind: float(np.mean(off[:, k] < WIDTH * s[:, k])) for kind, s in kinds.items()
            },
        }
        for k, name in enumerate(batch.names)
    ]
    return {
        "flights": count,
        "converged": int(np.sum(batch.successful)),
        "band": band,
        "rows": rows,
    }


def within(summary: dict, kind: str) -> bool:
    """Return True if all shares of one kind are inside the band."""
    low, high = summary["band"]
    return all(low <= row["coverage"][kind] <= high for row in summary["rows"])


def table(title: str, summary: dict, judged: str) -> str:
    """Return the summary of one run as a text table."""
    low, high = summary["band"]
    lines = [
        f"{title}: {summary['flights']} flights, {summary['converged']} converged, "
        f"{summary['seconds']:.0f} s",
        f"{'error':<26} {'planted':>9} {'scatter':>9} {'bound':>9} | 95 % intervals hold the truth "
        f"by {', '.join(KINDS)}",
    ]
    for row in summary["rows"]:
        shares = " ".join(f"{row['coverage'][kind]:>11.3f}" for kind in KINDS)
        lines.append(
            f"{row['error']:<26} {row['planted']:>9.3g} {row['scatter']:>9.3g} "
            f"{row['bound']:>9.3g} | {shares}"
        )
    verdict = "all inside" if within(summary, judged) else "NOT all inside"
    return "\n".join(
        [
            *lines,
            f"band of a right estimator, 99.9 %: {low:.3f} to {high:.3f}; by {judged}: {verdict}",
        ]
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if all shares are inside the band, else 1."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.add_argument("--flights", type=int, default=FLIGHTS, help="number of flights")
    given = parser.parse_args(arguments)
    summary = {}
    for title, noisy, judged in (
        ("exact inputs", False, "bound"),
        ("noisy inputs", True, "input noise"),
    ):
        begin = time.perf_counter()
        summary[title] = coverage(flights(given.flights, noisy_inputs=noisy))
        summary[title] |= {"seconds": time.perf_counter() - begin, "judged by": judged}
        summary[title]["inside"] = within(summary[title], judged)
    good = all(one["inside"] for one in summary.values())
    if given.json:
        print(
            json.dumps(
                {
                    "status": "inside the band" if good else "outside the band",
                    "seed": SEED,
                    **summary,
                }
            )
        )
    else:
        print("\n\n".join(table(title, one, one["judged by"]) for title, one in summary.items()))
        print(f"\n{ADVICE}")
    return 0 if good else 1


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.exit(main())
