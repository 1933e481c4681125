"""Do the intervals of `consistency` hold the truth? `python -m benchmarks.consistency [--json] [--flights 1000]`.

Simulated flights of the F-4-like aircraft in six degrees of freedom, each with its own pilot inputs, instrument errors (bias,
scale, delay; sizes from Table 6.6, base level) and noise, are reconstructed by `Kinematics`, with an estimate for each flight.
For each error the table shows how often its 95 % interval holds the planted value, beside the band that a right estimator
meets with 99.9 % probability, all errors together.

Twice: with noise in the outputs alone, which is what output error assumes; and with white noise of the base level in the
specific forces and rates too, which is integrated and which output error does not know of.
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

from jaxid.aircraft.atmosphere import StandardAtmosphere
from jaxid.aircraft.flights import CASES, start
from jaxid.aircraft.fly import flown
from jaxid.aircraft.instrument_channels import FORCE, RATES
from jaxid.aircraft.instruments import Instruments
from jaxid.aircraft.kinematics import SHOWN, Kinematics
from jaxid.aircraft.noise_levels import BASE, NoiseLevel, draw
from jaxid.data import Record
from jaxid.estimation import OutputError, estimate
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.input_noise import input_noise_covariance
from jaxid.models import free
from jaxid.models.base import canonical
from jaxid.models.names import read
from jaxid.simulation import RK4, Cubic

SEED, FLIGHTS, CHUNK = 1974, 1000, 100
SAMPLE_TIME, FINE = 0.04, 4  # s; steps of the simulated flight for each sample of the record
SECONDS = 10.0
LATE = 0.1  # s, delays are drawn between zero and this
ALTITUDE_NOISE = 3.0  # m; Table 6.6 has none for the altitude, and a channel without noise has no likelihood
INPUTS, DELAYED = (*FORCE, *RATES), ("alpha", "beta")
CASE = CASES["coupled 1"]
LEVEL, WIDTH, BAND = 0.95, 1.959963984540054, 0.999
KINDS = ("bound", "coloured", "input noise")
ADVICE = """\
bound: Cramer-Rao for white residuals. coloured: corrected for the colour that the residuals show. input noise: the bound with
what the known noise of the inputs adds. Noise of gyros and accelerometers is integrated, and the residuals hardly show it: give
`input_noise` to `consistency`. Smoothing the inputs does not help, as what is integrated is the slow part of their noise."""


class Flights(NamedTuple):
    """What was flown and found; the first axis counts flights.

    Attributes:
        names: of the errors.
        planted, values: the errors, true and estimated.
        standard_errors, coloured_errors: of the estimates, for white residuals and corrected for their colour.
        whole_errors: the first, with what the known noise of the inputs adds.
        successful: whether the estimate converged.
    """

    names: tuple[str, ...]
    planted: np.ndarray
    values: np.ndarray
    standard_errors: np.ndarray
    coloured_errors: np.ndarray
    whole_errors: np.ndarray
    successful: np.ndarray


def kinematics() -> Kinematics:
    """The model that is estimated."""
    return Kinematics(Instruments(SHOWN, delay=dict.fromkeys(DELAYED, 0.0)), atmosphere=StandardAtmosphere())


def planted_level(noisy_inputs: bool) -> NoiseLevel:
    """Table 6.6's base level, errors only for what is estimated; noise of the inputs where it is asked for."""
    scale = {name: BASE.scale[name] for name in ("V", "alpha", "beta")}
    bias = {name: BASE.bias[name] for name in (*INPUTS, "alpha", "beta")}
    noise = {name: BASE.noise.get(name, ALTITUDE_NOISE) for name in SHOWN}
    noise |= {name: BASE.noise[name] if noisy_inputs else 0.0 for name in INPUTS}
    return jax.tree.map(lambda value: jnp.asarray(value, float), NoiseLevel(scale, bias, noise, {}, {}))


def simulated(key, t, aircraft, state, level):
    """One flight: inputs and outputs of its record, and the kinematic model with the planted errors in it."""
    for_errors, for_delay, for_pilot, for_noise = jax.random.split(key, 4)
    instruments = draw(for_errors, aircraft.instruments, level)
    late = jax.random.uniform(for_delay, (2,), maxval=LATE)
    instruments = eqx.tree_at(lambda one: one.delay.values, instruments, late)
    aircraft = eqx.tree_at(lambda one: one.instruments, aircraft, instruments)
    size = jax.random.uniform(for_pilot, (len(CASE.pilot),), minval=0.5, maxval=1.0)
    pilot = {f"pilot_{surface}": k * signal(t) for k, (surface, signal) in zip(size, CASE.pilot.items(), strict=True)}
    u = jnp.stack([pilot.get(name, jnp.zeros_like(t)) for name in aircraft.inputs], axis=-1)
    z = flown(aircraft, t, u, state, for_noise, stepper=RK4(2, unrolled=False)).z[::FINE]
    own = Instruments(
        SHOWN,
        scale={name: instruments.scale[name] for name in SHOWN},
        bias={name: instruments.bias[name] for name in SHOWN},
        delay={name: instruments.delay[name] for name in DELAYED},
    )
    bias = {name: instruments.bias[name] for name in INPUTS}
    return z[:, len(SHOWN) :], z[:, : len(SHOWN)], Kinematics(own, input_bias=bias, atmosphere=StandardAtmosphere())


def reconstructed(key, model, chosen, t, aircraft, state, level):
    """One flight and its estimate, as arrays in the order of `Flights`."""
    u, z, true = simulated(key, t, aircraft, state, level)
    none, likelihood = ("",), OutputError(hold=Cubic())
    units = {"input_units": none * len(INPUTS), "output_units": none * len(SHOWN)}
    channels = {"inputs": INPUTS, "outputs": SHOWN, "names": none, **units}
    record = Record(t[::FINE], u, z, jnp.ones(z.shape, bool), {}, **channels)
    found = estimate(model, chosen, record, likelihood)
    noise = {name: level.noise[name] for name in INPUTS}
    added = input_noise_covariance(model, found, as_stack(record), likelihood, noise)
    whole = jnp.sqrt(jnp.diagonal(found.covariance + added))
    return (
        read(true, chosen.shared),
        found.values,
        found.standard_errors,
        found.coloured_errors,
        whole,
        found.successful,
    )


@eqx.filter_jit
def several(keys, *flown_by):
    """Many flights at once."""
    return jax.vmap(lambda key: reconstructed(key, *flown_by))(keys)


def flights(
    count: int = FLIGHTS, *, noisy_inputs: bool = False, chunk: int = CHUNK, seconds: float = SECONDS
) -> Flights:
    """Simulate flights and estimate the errors of each.

    Args:
        count: how many; a multiple of `chunk`, or fewer.
        noisy_inputs: whether specific forces and rates have the noise of the base level.
        chunk: how many at once.
        seconds: length of each.
    """
    aircraft, state = start(CASE)
    instruments = Instruments((*SHOWN, *INPUTS), delay=dict.fromkeys(DELAYED, 0.0))
    aircraft = canonical(eqx.tree_at(lambda one: one.instruments, aircraft, instruments))
    t = SAMPLE_TIME / FINE * jnp.arange(FINE * round(seconds / SAMPLE_TIME), dtype=float)
    level, model, keys = (
        planted_level(noisy_inputs),
        canonical(kinematics()),
        jax.random.split(jax.random.key(SEED), count),
    )
    chosen = free(model, *model.sensor_errors(), per_record=("initial_state",))
    given = (model, chosen, t, aircraft, state, level)
    parts = [several(keys[at : at + chunk], *given) for at in range(0, count, chunk)]
    return Flights(chosen.shared, *(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def coverage(found: Flights) -> dict:
    """Shares of the 95 % intervals that hold the planted error, by kind of standard error, and the band for them."""
    kinds = {"bound": found.standard_errors, "coloured": found.coloured_errors, "input noise": found.whole_errors}
    off, count = np.abs(found.values - found.planted), len(found.planted)
    tail = (1.0 - BAND) / 2 / len(found.names)
    band = [float(binom.ppf(share, count, LEVEL) / count) for share in (tail, 1.0 - tail)]
    rows = [
        {
            "error": name,
            "planted": float(np.std(found.planted[:, k])),
            "scatter": float(np.std(found.values[:, k] - found.planted[:, k])),
            "bound": float(np.mean(found.standard_errors[:, k])),
            "coverage": {kind: float(np.mean(off[:, k] < WIDTH * s[:, k])) for kind, s in kinds.items()},
        }
        for k, name in enumerate(found.names)
    ]
    return {"flights": count, "converged": int(np.sum(found.successful)), "band": band, "rows": rows}


def within(told: dict, kind: str) -> bool:
    """Whether all shares of one kind are inside the band."""
    low, high = told["band"]
    return all(low <= row["coverage"][kind] <= high for row in told["rows"])


def table(title: str, told: dict, judged: str) -> str:
    """One table for people."""
    low, high = told["band"]
    lines = [
        f"{title}: {told['flights']} flights, {told['converged']} converged, {told['seconds']:.0f} s",
        f"{'error':<26} {'planted':>9} {'scatter':>9} {'bound':>9} | 95 % intervals hold the truth by {', '.join(KINDS)}",
    ]
    for row in told["rows"]:
        shares = " ".join(f"{row['coverage'][kind]:>11.3f}" for kind in KINDS)
        lines.append(
            f"{row['error']:<26} {row['planted']:>9.3g} {row['scatter']:>9.3g} {row['bound']:>9.3g} | {shares}"
        )
    verdict = "all inside" if within(told, judged) else "NOT all inside"
    return "\n".join([*lines, f"band of a right estimator, 99.9 %: {low:.3f} to {high:.3f}; by {judged}: {verdict}"])


def main(arguments: list[str] | None = None) -> int:
    """Fly, estimate, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.add_argument("--flights", type=int, default=FLIGHTS, help="how many")
    given = parser.parse_args(arguments)
    told = {}
    for title, noisy, judged in (("exact inputs", False, "bound"), ("noisy inputs", True, "input noise")):
        begin = time.perf_counter()
        told[title] = coverage(flights(given.flights, noisy_inputs=noisy))
        told[title] |= {"seconds": time.perf_counter() - begin, "judged by": judged}
        told[title]["inside"] = within(told[title], judged)
    good = all(one["inside"] for one in told.values())
    if given.json:
        print(json.dumps({"status": "inside the band" if good else "outside the band", "seed": SEED, **told}))
    else:
        print("\n\n".join(table(title, one, one["judged by"]) for title, one in told.items()))
        print(f"\n{ADVICE}")
    return 0 if good else 1


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.exit(main())
