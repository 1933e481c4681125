"""Trims and inputs of the report's cases that it does not print: `python -m
benchmarks.report_choices [--json]`.

The report prints initial angles of attack and speeds, and neither the stabilator at the start nor
the stabilator's input of lateral 4. They decide on which side of the pitch-up a flight ends. Here
they are chosen: the flights are simulated on a grid of choices, and the choice of the least sum of
squares is taken,

    cost = sum (ours - printed)^2    over the means and deviations of alpha and beta of Figure 6.2,

of the true motion, without instrument errors. The aerodynamics are not touched.

- Lateral cases: one trim and one start of the ailerons' doublet ("followed by", 6.2.1) for all
  four, and in lateral 4 a stabilator ramp, which is held at its end ("a simultaneously applied
  stabilator input to force the aircraft through a larger range"). Lateral 3 is the mean of flights
  with gusts.
- Longitudinal cases: one trim each, because no common trim comes within 1 deg; the range of angle
  of attack of case 2 must lie within the range of case 1, because section 6.4.1 compares them.
- Coupled cases: no statistics are printed. The constants of CZ, values at the mean angle of attack,
  give the mean of coupled 1, between the longitudinal cases (`coupled_mean`); one trim for both.

The choices stand in `jaxid.aircraft.flight.report_cases`; the exit status is 0 if they
equal the result of the search.
"""

import argparse
import itertools
import json
import math
import sys
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks import report_numbers
from benchmarks.report_cases import GUSTS, PRINTED, setup
from jaxid.aircraft.air.turbulence import white_gusts
from jaxid.aircraft.flight.report_cases import (
    CASES,
    DOUBLET_START,
    LATERAL_4_PULL,
    Pull,
    doublet_from,
    pilot_inputs,
    pull_signal,
)
from jaxid.simulation import RK4, Linear
from jaxid.simulation.simulate import run

TRIMS_DEG = tuple(round(0.1 * k, 1) for k in range(-20, 6))
LATERAL_TRIMS_DEG = tuple(trim for trim in TRIMS_DEG if trim <= -0.5)
STARTS = (2.5, 3.0, 3.5, 4.0, 4.5)  # s, of the doublet
PULLS = tuple(Pull(-0.5 * size, float(seconds)) for size in range(6, 11) for seconds in range(2, 7))
LATERAL = ("lateral 1", "lateral 2", "lateral 3")
LONGITUDINAL = ("longitudinal 1", "longitudinal 2")
GUST_FLIGHTS = 8
LONGEST = 150  # samples; one length for all, the end is cut off


class Found(NamedTuple):
    """Choices of the least cost.

    Attributes:
        trims_deg: trim of the stabilator about its equilibrium at the initial angle of attack by
            case [deg].
        start: of the ailerons' doublet [s].
        pull: ramp of the stabilator in lateral 4.
        costs: least sum of squares by group of cases [deg^2].
    """

    trims_deg: dict[str, float]
    start: float
    pull: Pull
    costs: dict[str, float]


@eqx.filter_jit
def _angles(aircraft, state, t, u, trims):
    """Return alpha and beta of one flight for each row of u and trims, (flight, angle, time)."""
    at = aircraft.states.index("stabilator")

    def one(u, trim):
        trimmed = eqx.tree_at(
            lambda a: a.controls.trim, aircraft, aircraft.controls.trim.at[0].add(trim)
        )
        x = run(trimmed, t, u, state.at[at].add(trim), Linear(), RK4(5, unrolled=False)).x
        signals = jax.vmap(trimmed.signals)(t, x, u)
        return jnp.stack([signals["alpha"], signals["beta"]])

    return jax.vmap(one)(u, trims)


def angles(
    case: str,
    trims_deg: Sequence[float],
    pulls: Sequence[Pull] = (),
    start: float = DOUBLET_START,
    gusts: int = 0,
) -> np.ndarray:
    """Return true alpha and beta of flights of a case, shape (flight, angle, time) [deg].

    Args:
        case: name of the case.
        trims_deg: trim of each flight about the equilibrium [deg].
        pulls: ramp of the stabilator of each flight; the input of the case by default.
        start: of the ailerons' doublet in the lateral cases [s].
        gusts: key of the gusts, for a case with gusts.
    """
    chosen = CASES[case]._replace(trim=0.0)
    if case.startswith("lateral"):
        chosen = chosen._replace(pilot={**chosen.pilot, "aileron": doublet_from(start)})
    flown, count = setup(chosen), round(10 * chosen.seconds)
    t = 0.1 * jnp.arange(LONGEST, dtype=float)
    inputs = {name: _longer(signal) for name, signal in pilot_inputs(chosen)[1].items()}
    drawn = white_gusts(jax.random.key(gusts), t, flown.gust)
    inputs |= {name: drawn[:, i] for i, name in enumerate(GUSTS)}
    zero = jnp.zeros(LONGEST)
    u = jnp.stack([inputs.get(name, zero) for name in flown.aircraft.inputs], axis=-1)
    u = jnp.tile(u, (len(trims_deg), 1, 1))
    if pulls:
        pulled = jnp.stack([pull_signal(pull)(t) for pull in pulls])
        u = u.at[:, :, flown.aircraft.inputs.index("pilot_stabilator")].set(pulled)
    flights = _angles(flown.aircraft, flown.state, t, u, jnp.radians(jnp.asarray(trims_deg)))
    return np.degrees(np.asarray(flights))[:, :, :count]


def _longer(signal):
    return jnp.concatenate([signal, jnp.full(LONGEST - signal.size, signal[-1])])


def statistics(flights: np.ndarray) -> np.ndarray:
    """Return mean and deviation of alpha and beta, shape (flight, statistic) [deg].

    Args:
        flights: alpha and beta, shape (flight, angle, time) [deg].
    """
    return np.stack([flights.mean(axis=2), flights.std(axis=2)], axis=2).reshape(-1, 4)


def cost(case: str, ours: np.ndarray) -> np.ndarray:
    """Return the sum of squared differences from the printed statistics, shape (flight,) [deg^2].

    Args:
        case: name of the case.
        ours: statistics, shape (flight, statistic) [deg].
    """
    printed = np.array([np.nan if one is None else one for one in PRINTED[case]])
    return np.nansum((ours - printed) ** 2, axis=1)


def coupled_mean() -> float:
    """Return the mean angle of attack of coupled 1 by the constants of CZ [deg].

    The constants of Tables 6.5, 6.12 and 6.16 are values at the records' means; straight line
    between the longitudinal cases.
    """
    at = {
        row.case: row.final
        for row in report_numbers.likelihood()
        if (row.response, row.term) == ("CZ", "1")
    }
    low, high = (PRINTED[case][0] for case in LONGITUDINAL)
    share = (at["coupled 1"] - at[LONGITUDINAL[0]]) / (at[LONGITUDINAL[1]] - at[LONGITUDINAL[0]])
    return low + share * (high - low)


def lateral() -> tuple[float, float, Pull, float]:
    """Return trim [deg], start of the doublet [s] and ramp of the lateral cases, and their cost."""
    best = (math.nan, math.nan, PULLS[0], math.inf)
    pairs = list(itertools.product(range(len(LATERAL_TRIMS_DEG)), PULLS))
    trims, pulls = [LATERAL_TRIMS_DEG[k] for k, _ in pairs], [pull for _, pull in pairs]
    for start in STARTS:
        calm = angles("lateral 1", LATERAL_TRIMS_DEG, start=start)
        gusty = [
            statistics(angles("lateral 3", LATERAL_TRIMS_DEG, start=start, gusts=key))
            for key in range(GUST_FLIGHTS)
        ]
        three = (
            cost("lateral 1", statistics(calm))
            + cost("lateral 2", statistics(calm))
            + cost("lateral 3", np.mean(gusty, axis=0))
        )
        total = cost("lateral 4", statistics(angles("lateral 4", trims, pulls, start)))
        total = total + three[[k for k, _ in pairs]]
        k = int(np.argmin(total))
        if total[k] < best[-1]:
            best = (trims[k], start, pulls[k], float(total[k]))
    return best


def longitudinal() -> tuple[tuple[float, float], float]:
    """Return the trims of the two longitudinal cases [deg], and their cost."""
    both = [angles(case, TRIMS_DEG) for case in LONGITUDINAL]
    costs = [cost(case, statistics(one)) for case, one in zip(LONGITUDINAL, both, strict=True)]
    low, high = ([edge(one[:, 0], axis=1) for one in both] for edge in (np.min, np.max))
    inside = (low[0][:, None] <= low[1]) & (high[1] <= high[0][:, None])
    total = np.where(inside, costs[0][:, None] + costs[1], np.inf)
    one, two = np.unravel_index(np.argmin(total), total.shape)
    return (TRIMS_DEG[one], TRIMS_DEG[two]), float(total[one, two])


def coupled() -> tuple[float, float]:
    """Return the trim of the coupled cases [deg], and its cost."""
    costs = (angles("coupled 1", TRIMS_DEG)[:, 0].mean(axis=1) - coupled_mean()) ** 2
    best = int(np.argmin(costs))
    return TRIMS_DEG[best], float(costs[best])


def search() -> Found:
    """Return the choices of the least cost for all cases."""
    trim, start, pull, lateral_cost = lateral()
    pair, longitudinal_cost = longitudinal()
    both, coupled_cost = coupled()
    trims = {
        **dict.fromkeys((*LATERAL, "lateral 4"), trim),
        **dict(zip(LONGITUDINAL, pair, strict=True)),
        **dict.fromkeys(("coupled 1", "coupled 2"), both),
    }
    costs = {"lateral": lateral_cost, "longitudinal": longitudinal_cost, "coupled": coupled_cost}
    return Found(trims, start, pull, costs)


def declared() -> tuple[dict[str, float], float, Pull]:
    """Return trims [deg], start [s] and ramp of `jaxid.aircraft.flight.report_cases`."""
    trims = {name: round(math.degrees(case.trim), 6) for name, case in CASES.items()}
    return trims, DOUBLET_START, LATERAL_4_PULL


def main(arguments: list[str] | None = None) -> int:
    """Run the search; return 0 if its choices are those of the package."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.report_choices", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    found = search()
    same = found[:3] == declared()
    if options.json:
        print(
            json.dumps({"status": "as declared" if same else "not as declared"} | found._asdict())
        )
        return 0 if same else 1
    for name, trim in found.trims_deg.items():
        print(f"{name:<16} trim {trim:+.1f} deg (declared {declared()[0][name]:+.1f})")
    print(f"doublet from {found.start:g} s (declared {DOUBLET_START:g} s)")
    print(
        f"lateral 4: stabilator to {found.pull.size_deg:g} deg in {found.pull.seconds:g} s "
        f"(declared {LATERAL_4_PULL.size_deg:g} deg in {LATERAL_4_PULL.seconds:g} s)"
    )
    print("sums of squares: " + ", ".join(f"{k} {v:.2f} deg^2" for k, v in found.costs.items()))
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
