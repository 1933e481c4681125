"""Cases of the benchmark: how the flights are made, and which intervals are counted."""

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

from scipy.stats import norm

from benchmarks.coverage.dryden import second_order, second_order_truth
from benchmarks.coverage.flights import (
    DERIVATIVES,
    F16,
    GUST,
    GUST_TIME,
    NOISE,
    SMALL,
    Airplane,
    Flights,
    fly,
)
from benchmarks.coverage.gusts import dryden
from benchmarks.coverage.intervals import Answer, asymptotic, considered, profile_of, profiled
from benchmarks.coverage.selection import after_selection, fly_missing
from jaxid import FilterError, FirstOrder, FixedNoise, OutputError

LEVEL = 0.95
AFTER_SELECTION = "after a study that finds a missing effect"


class Case(NamedTuple):
    """A case of the benchmark.

    Attributes:
        samples: samples of a record.
        fly: from draws, samples and seed to the records.
        intervals: from the records to the intervals.
        truth: true values by name of all parameters but the derivatives.
        expected: share of intervals that should hold the truth.
        claimed: False for errors that are known to be wrong, given for comparison.
    """

    samples: int
    fly: Callable[..., Flights]
    intervals: Callable[[Flights], Answer]
    truth: Mapping[str, float] = MappingProxyType({})
    expected: float = LEVEL
    claimed: bool = True


def expected_at_bound(distance: float) -> float:
    """Return the share of profile intervals that hold a true value above a lower bound.

    With d the distance and Z the error of an estimate without the bound, in standard errors, the
    estimate is on the bound for Z < -d, and the cost there exceeds that at the truth by
    -(2 d Z + d^2) / 2 less than nothing. The truth is outside for Z > q, and for

        Z < -(q^2 + d^2) / (2 d)  if d < q,    Z < -q  otherwise

    Args:
        distance: d.
    """
    q = norm.ppf(0.5 * (1.0 + LEVEL))
    if distance == 0.0:
        return float(norm.cdf(q))
    lower = (q**2 + distance**2) / (2.0 * distance) if distance < q else q
    return float(norm.cdf(q) - norm.cdf(-lower))


def _filter_error():
    return FilterError(process={"gust": FirstOrder(0.7, 1.0)})


def _known_noise():
    return OutputError(FixedNoise([size**2 for size in NOISE.values()]))


def _in_dryden_gusts(title: str, airplane: Airplane, gust: float) -> dict[str, Case]:
    """Return the cases of one aircraft in Dryden's gusts of one intensity, by name.

    Filter error of first order has another spectrum than the gusts; its intensity and duration are
    compared with theirs.

    Args:
        title: name of the aircraft.
        airplane: the aircraft.
        gust: standard deviation of the gust [m/s].
    """
    flight = partial(fly, gust=gust, airplane=airplane, shape=dryden)
    first = SENSORS | {"process.gust": gust, "correlation_time.gust": airplane.gust_time}
    second = SENSORS | second_order_truth(airplane, gust)
    cases = {
        "output error": Case(2000, flight, asymptotic(OutputError), claimed=False),
        "filter error of first order": Case(
            2000, flight, asymptotic(_filter_error), first, claimed=False
        ),
        "filter error of second order": Case(2000, flight, second_order, second),
    }
    return {f"{name}, Dryden, {gust:g} m/s, {title}": case for name, case in cases.items()}


SENSORS = {f"sensor.{name}": size for name, size in NOISE.items()}
GUSTS = {"process.gust": GUST, "correlation_time.gust": GUST_TIME}
CORRELATION = 0.8  # of a sensor's noise from one sample to the next, in the coloured cases
MISSING = 0.3
# of the constant that is held, and of the prior: a tenth of the derivative
HELD = {"Zw": 0.1}
PRIOR = {"Mq": 0.15}
BOUNDED, DISTANCES = "Mq", (0.0, 0.5, 1.0, 3.0)

STRONG = (3.0, 6.0)  # m/s, intensities of further gusts
AIRPLANES = {"small aircraft": SMALL, "F-16": F16}
in_gusts = partial(fly, gust=GUST)
coloured = partial(fly, colour=CORRELATION)
corrected = asymptotic(OutputError, coloured=True)
CASES = {
    "output error, white noise": Case(300, fly, asymptotic(OutputError)),
    "output error, 30 % missing": Case(300, partial(fly, missing=MISSING), asymptotic(OutputError)),
    **{
        f"output error, coloured noise, {samples} samples": Case(samples, coloured, corrected)
        for samples in (200, 600, 2400)
    },
    "output error, coloured noise, not corrected": Case(
        600, coloured, asymptotic(OutputError), claimed=False
    ),
    "a constant held, considered, R known": Case(
        300, partial(fly, spread=HELD), considered(_known_noise, HELD)
    ),
    # the estimate of R takes in the misfit of the constant, so that it counts twice
    "a constant held, considered, R estimated": Case(
        300, partial(fly, spread=HELD), considered(OutputError, HELD), claimed=False
    ),
    "a constant held, not considered": Case(
        300, partial(fly, spread=HELD), asymptotic(OutputError, held=tuple(HELD)), claimed=False
    ),
    "a prior": Case(
        300,
        partial(fly, spread=PRIOR),
        asymptotic(OutputError, prior={n: (DERIVATIVES[n], s) for n, s in PRIOR.items()}),
    ),
    **{
        f"a bound {distance:g} standard errors away, profile": Case(
            300, fly, profiled(BOUNDED, distance), expected=expected_at_bound(distance)
        )
        for distance in DISTANCES
    },
    # slow, and not in a vmap: a study of each flight, such as 270
    AFTER_SELECTION: Case(400, fly_missing, after_selection),
    "filter error, first-order gusts, Q and R estimated": Case(
        2000, in_gusts, asymptotic(_filter_error), SENSORS | GUSTS
    ),
    # asymptotic intervals of the noise's parameters on a short record
    "filter error, the same gusts for 30 s": Case(
        600, in_gusts, asymptotic(_filter_error), SENSORS | GUSTS, claimed=False
    ),
    # the wrong likelihood
    "output error, the same gusts": Case(2000, in_gusts, asymptotic(OutputError), claimed=False),
    **{
        f"filter error, gusts of {size:g} m/s": Case(
            2000,
            partial(fly, gust=size),
            asymptotic(_filter_error),
            SENSORS | GUSTS | {"process.gust": size},
        )
        for size in STRONG
    },
    # small against the gusts: its asymptotic interval covers too little
    f"filter error, gusts of {STRONG[-1]:g} m/s, noise of the vane, profile": Case(
        2000, partial(fly, gust=STRONG[-1]), profile_of("sensor.alpha", _filter_error), SENSORS
    ),
    **{
        f"output error, gusts of {size:g} m/s": Case(
            2000, partial(fly, gust=size), asymptotic(OutputError), claimed=False
        )
        for size in STRONG
    },
    **{
        name: case
        for title, airplane in AIRPLANES.items()
        for size in (GUST, *STRONG)
        for name, case in _in_dryden_gusts(title, airplane, size).items()
    },
}
