"""Estimates in Dryden's vertical gusts, by a model that has the states of the gust."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from benchmarks.coverage.flights import Airplane, Flights, ShortPeriod
from benchmarks.coverage.gusts import ROOT3, dryden
from benchmarks.coverage.intervals import Answer, answer_of, estimates, started
from jaxid import AbstractModel, FilterError, Fixed, free
from jaxid._foundation.types import Array

GUST_START, TIME_START = 0.7, 1.0  # m/s, s: where an iteration starts, as for first-order gusts
# Chosen: standard deviation of the gust at the start of a record, whose intensity is not known
# beforehand [m/s]; larger than any of the cases. With 0.7 m/s in gusts of 6 m/s the intervals of Zw
# hold the truth in 0.58 of the flights: the first samples contradict the start.
GUST_AT_START = 10.0


class InDrydenGusts(AbstractModel):
    """The short period in Dryden's gust, white noise n through the states of `gusts.dryden`.

    dlead/dt = -lead/T + s n,    dlag/dt = (lead - lag)/T
    gust = sqrt(3) lead + (1 - sqrt(3)) lag,    standard deviation s sqrt(T)
    """

    aircraft: ShortPeriod
    gust_time: Array
    states, inputs, outputs = ("w", "q", "lead", "lag"), ("elevator",), ("alpha", "q")
    transparent: ClassVar[tuple[str, ...]] = ("aircraft",)

    def rhs(self, t, x, u):
        lead, lag = x[2:]
        own = self.aircraft.rhs(t, x[:2], self._inputs(x, u))
        return jnp.stack([*own, -lead / self.gust_time, (lead - lag) / self.gust_time])

    def output(self, t, x, u):
        return self.aircraft.output(t, x[:2], self._inputs(x, u))

    def _inputs(self, x, u):
        return jnp.stack([u[0], ROOT3 * x[2] + (1.0 - ROOT3) * x[3]])


def second_order(flights: Flights) -> Answer:
    """Return the intervals of filter error with the gust's own filter.

    The states of the gust start with variances of `GUST_AT_START`, uncorrelated.
    """
    aircraft, chosen = started(airplane=flights.airplane)
    model = InDrydenGusts(aircraft.with_disturbance_inputs(), jnp.asarray(TIME_START))
    own = ("initial_state.w", "initial_state.q")
    chosen = free(
        model, *chosen.shared, "gust_time", per_record=own, bounds={"gust_time": (0.01, 100.0)}
    )
    deviations = GUST_AT_START * np.sqrt(np.diag(dryden(TIME_START).P))
    likelihood = FilterError(
        process={"lead": GUST_START / np.sqrt(TIME_START)},
        initial={name: Fixed(d) for name, d in zip(("lead", "lag"), deviations, strict=True)},
    )
    fits = estimates(flights, likelihood, model, chosen)
    return answer_of(fits, fits.standard_errors, fits.interval())


def second_order_truth(airplane: Airplane, gust: float) -> dict[str, float]:
    """Return the true values of the gust's parameters in `InDrydenGusts`.

    Args:
        airplane: the aircraft.
        gust: standard deviation of the gust [m/s].
    """
    time = airplane.gust_time
    return {"process.lead": gust / np.sqrt(time), "gust_time": time}
