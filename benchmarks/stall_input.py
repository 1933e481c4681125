"""The stabilator sine that shows Cm(alpha) near the stall best:
`python -m benchmarks.stall_input [--json]`.

The report flew two sines from a trim at 13.5 deg of angle of attack, and saw the curve of the
static pitching moment in the second only (section 5.4.1, Figures 5.1 and 5.3):

    -10 deg sin(2 pi t / 3),    -5 deg sin(2 pi t / 6)

Here amplitude and period of a sine, and the coefficients of a spline, are designed for the smallest
mean squared standard error of the curve over a range of alpha (Eq. C.46), within an envelope of
alpha. The aircraft has the coefficients that the report estimated from its second longitudinal case
(Table 6.11). Each input is flown, with noise, and the curve estimated with powers of alpha up to
the fifth. The table shows its predicted standard error, and the error of the estimates, both root
mean squares over the range, in thousandths of Cm.
"""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from benchmarks.input_design import flown, longitudinal_likelihood
from jaxid import configure, free
from jaxid._foundation.types import Array, Float
from jaxid.aircraft.air.atmosphere import GRAVITY
from jaxid.aircraft.flight.longitudinal import Longitudinal
from jaxid.aircraft.flight.longitudinal_flight import true_aircraft
from jaxid.data import signals
from jaxid.design import (
    AbstractShape,
    InputSignal,
    Limits,
    curve_width,
    design_input,
    information_of,
    planned_record,
    sample_times,
    spline,
)
from jaxid.models import Free, Polynomial
from jaxid.models.names import read_parameters

CENTRE = math.radians(13.5)  # the trim of section 5.4.1
RANGE = (math.radians(9.0), math.radians(18.0))  # of the curve, about the loss of stability; chosen
ENVELOPE = (math.radians(5.0), math.radians(22.0))  # of alpha; chosen
AMPLITUDE, RATE = math.radians(12.0), math.radians(40.0)  # of the stabilator; chosen
POWERS = ("1", "alpha", "alpha^2", "alpha^3", "alpha^4", "alpha^5")
SECONDS, SAMPLE_TIME, KNOTS = 12.0, 0.04, 16
REPORT = {"report, first": (-10.0, 3.0), "report, second": (-5.0, 6.0)}  # deg, s
SHORTEST, LONGEST = 1.5, 12.0  # periods of the designed sine [s]; chosen


class Sine(AbstractShape):
    """A sine with free amplitude and period.

    p_0 sin(2 pi t / T),    T = SHORTEST (LONGEST / SHORTEST)^s,    s = (1 + tanh p_1) / 2
    """

    t: Float[Array, " time"]

    @property
    def count(self):
        return 2

    def period(self, p: Float[Array, " parameter"]) -> Float[Array, ""]:
        """Return the period [s]."""
        share = 0.5 * (1.0 + jnp.tanh(p[1]))
        return SHORTEST * (LONGEST / SHORTEST) ** share

    def samples(self, p):
        return signals.sine(self.t, 1.0 / self.period(p), p[0])

    def starts(self, rng, number):
        sign = rng.choice([-1.0, 1.0], size=number)
        return np.stack([sign * rng.uniform(0.2, 1.0, number), rng.uniform(-2, 2, number)], axis=1)

    def scaled(self, p, factor):
        return p.at[..., 0].multiply(factor)


def aircraft() -> Longitudinal:
    """Return the aircraft in level flight at the trim, with the coefficients of Table 6.11.

    Mass and dimensions are those of the small flight of `python -m jaxid longitudinal`. Our reading
    of the table: alpha is counted from the trim, where the moment is balanced with the stabilator
    at zero. Terms of beta, products of alpha, and its ninth power are left out.
    """
    base, centre = true_aircraft(), {"alpha": CENTRE}
    forces = {"1": -0.965, "alpha": -1.51, "alpha^2": 10.3, "qhat": -11.8, "elevator": -0.455}
    moment = {"1": 0.0, "alpha": 0.0529, "alpha^2": -2.41, "alpha^3": -33.3, "alpha^4": 0.0}
    moment |= {"alpha^5": 0.0, "qhat": -6.19, "elevator": -0.5}
    return Longitudinal(
        CX=Polynomial({"1": -0.0341}),
        CZ=Polynomial(forces, centre),
        Cm=Polynomial(moment, centre),
        mass=base.mass,
        Iy=base.Iy,
        S=base.S,
        cbar=base.cbar,
        thrust=thrust_at_trim(base, -0.0341, forces["1"]),
        density=base.density,
    )


def thrust_at_trim(base: Longitudinal, CX: float, CZ: float) -> float:
    """Return the thrust of level flight, with the stabilator at zero."""
    weight = float(base.mass) * GRAVITY
    lift = weight * math.cos(CENTRE) / -CZ
    return weight * math.sin(CENTRE) - lift * CX


def trim_state(model: Longitudinal) -> Float[Array, " state"]:
    """Return the state of level flight, with the stabilator at zero."""
    pressure = float(model.mass) * GRAVITY * math.cos(CENTRE) / (0.965 * float(model.S))
    V = math.sqrt(2.0 * pressure / float(model.density))
    return jnp.array([V * math.cos(CENTRE), V * math.sin(CENTRE), 0.0, CENTRE])


def free_parameters(model: Longitudinal) -> Free:
    """Return the coefficients of both polynomials that move with the short period."""
    force = [f"CZ.{term}" for term in ("alpha", "alpha^2", "qhat", "elevator")]
    moment = [f"Cm.{term}" for term in (*POWERS, "qhat", "elevator")]
    return free(model, *moment, *force, per_record=("initial_state",))


def curve_rows(alpha, count: int) -> Float[Array, "point parameter"]:
    """Return the derivatives of the curve by all free parameters, the powers of alpha first."""
    powers = (alpha[:, None] - CENTRE) ** jnp.arange(len(POWERS))[None]
    return jnp.pad(powers, ((0, 0), (0, count - len(POWERS))))


def curve_error(values, truth) -> float:
    """Return the root mean square error of the curve of an estimate over the range."""
    alpha = jnp.linspace(*RANGE, 91)
    error = np.asarray(curve_rows(alpha, values.size) @ (values - truth))
    return float(np.sqrt(np.mean(error**2)))


def sine(t, amplitude_deg: float, period: float, name: str) -> InputSignal:
    """Return a sine of the stabilator."""
    u = signals.sine(t, 1.0 / period, math.radians(amplitude_deg))
    return InputSignal(t, u[:, None], ("elevator",), name)


def measure(flights: int, seed: int) -> dict[str, Any]:
    """Return the figures of all inputs."""
    model = aircraft()
    chosen, noise, state = free_parameters(model), longitudinal_likelihood(model), trim_state(model)
    t, names = sample_times(SECONDS, SAMPLE_TIME), chosen.shared
    width = curve_width(lambda alpha: curve_rows(alpha, len(names)), *RANGE)
    limits = Limits({"elevator": AMPLITUDE}, {"elevator": RATE}, envelope={"alpha": ENVELOPE})
    truth = read_parameters(model, names)
    inputs = [sine(t, *given, name) for name, given in REPORT.items()]
    for name, form in (("designed sine", Sine(t)), ("designed spline", spline(t, KNOTS))):
        design = design_input(
            model, chosen, t, form, width, limits, noise, initial_state=state, seed=seed
        )
        inputs.append(InputSignal(t, design.signal.u, ("elevator",), name))
    rows = {}
    for signal in inputs:
        record = planned_record(model, signal, noise, initial_state=state)
        shown = information_of(model, chosen, record, noise, initial_state=state)
        alpha = np.degrees(np.asarray(record.z[:, 0]))
        rows[signal.name] = {
            "predicted": math.sqrt(shown.measure(width)),
            "errors": [
                curve_error(values, truth)
                for values in flown(model, chosen, noise, record, flights, seed)
            ],
            "alpha_deg": [float(alpha.min()), float(alpha.max())],
            "peak_deg": math.degrees(float(jnp.max(jnp.abs(signal.u)))),
            "period": period_of(signal),
        }
    return rows


def period_of(signal: InputSignal) -> float:
    """Return the period of the strongest harmonic [s]."""
    u = np.asarray(signal.u[:, 0])
    power = np.abs(np.fft.rfft(u - u.mean(), 16 * u.size))
    return 16.0 * u.size * SAMPLE_TIME / int(np.argmax(power))


def table(rows: dict[str, Any]) -> str:
    """Return the figures as text."""
    lines = [
        f"{'input':<16} {'peak':>6} {'period':>7} {'alpha':>14} {'predicted':>10} {'flown':>8}"
    ]
    for name, row in rows.items():
        low, high = row["alpha_deg"]
        error = 1e3 * float(np.sqrt(np.mean(np.square(row["errors"]))))
        lines.append(
            f"{name:<16} {row['peak_deg']:>6.1f} {row['period']:>7.1f} {low:>6.1f} to {high:>4.1f}"
            f" {1e3 * row['predicted']:>10.3f} {error:>8.3f}"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Design, fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--flights", type=int, default=50, help="with noise, of each input")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    configure()
    rows = measure(options.flights, options.seed)
    sys.stdout.write((json.dumps(rows, indent=2) if options.json else table(rows)) + "\n")


if __name__ == "__main__":
    main()
