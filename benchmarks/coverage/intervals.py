"""Intervals of all flights of a case, each as a user would compute it."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.coverage.flights import DERIVATIVES, SMALL, Airplane, Flights, ShortPeriod
from jaxid import AbstractModel, GaussNewton, OutputError, Record, free
from jaxid.estimation.estimate import estimate
from jaxid.estimation.likelihoods import AbstractLikelihood
from jaxid.estimation.result import Estimate
from jaxid.models import Free
from jaxid.uncertainty import consider, profile_likelihood

CHANNELS = (("elevator",), ("alpha", "q"), ("rad",), ("rad", "rad/s"), ("flight",))
START = 0.8  # share of the derivatives at which an iteration starts


class Answer(NamedTuple):
    """Intervals of the parameters of many flights.

    Attributes:
        names: names of the parameters.
        values, errors: estimates and standard errors, shape (draw, parameter).
        ends: ends of the 95 % intervals, shape (draw, parameter, 2).
        successful: true where the iteration converged.
    """

    names: tuple[str, ...]
    values: np.ndarray
    errors: np.ndarray
    ends: np.ndarray
    successful: np.ndarray


def asymptotic(likelihood: Callable[[], AbstractLikelihood], *, coloured: bool = False, **options):
    """Return a function that gives the intervals of `Estimate.interval`.

    Args:
        likelihood: makes the likelihood.
        coloured: correct for the colour of the residuals.
        options: of `jaxid.free`.
    """

    def answer(flights: Flights) -> Answer:
        fits = estimates(flights, likelihood(), *started(airplane=flights.airplane, **options))
        ends = fits.interval(coloured=coloured)
        errors = fits.corrected_errors if coloured else fits.standard_errors
        return answer_of(fits, errors, ends)

    return answer


def considered(likelihood: Callable[[], AbstractLikelihood], deviations: dict[str, float]):
    """Return a function that gives the intervals with fixed but uncertain constants.

    Args:
        likelihood: makes the likelihood.
        deviations: standard deviation of each constant, which keeps the value of `DERIVATIVES`.
    """

    def answer(flights: Flights) -> Answer:
        model, chosen = started(held=tuple(deviations))
        fits = estimates(flights, likelihood(), model, chosen)
        errors = np.array(
            [
                consider(fit, record, likelihood(), deviations).standard_errors
                for fit, record in _each(fits, flights)
            ]
        )
        ratio = np.asarray(errors / fits.standard_errors)[..., None]
        values = np.asarray(fits.values)[..., None]
        return answer_of(fits, errors, values + (np.asarray(fits.interval()) - values) * ratio)

    return answer


def profiled(name: str, distance: float):
    """Return a function that gives the intervals of one parameter by its profile likelihood, with a
    lower bound some standard errors below its true value.

    Args:
        name: the parameter.
        distance: of the bound, in standard errors of an estimate without it.
    """

    def answer(flights: Flights) -> Answer:
        one = Flights(flights.t, flights.u, flights.z[:1], flights.valid[:1], flights.derivatives)
        fit = estimates(one, OutputError(), *started())
        error = float(fit.standard_errors[0, fit.names.index(name)])
        bound = DERIVATIVES[name] - distance * error
        model, chosen = started(bounds={name: (bound, None)})
        fits = estimates(flights, OutputError(), model, chosen)
        return _profiles(fits, flights, OutputError(), name)

    return answer


def profile_of(name: str, likelihood: Callable[[], AbstractLikelihood]):
    """Return a function that gives the intervals of one parameter by its profile likelihood.

    Args:
        name: the parameter.
        likelihood: makes the likelihood.
    """

    def answer(flights: Flights) -> Answer:
        fits = estimates(flights, likelihood(), *started(airplane=flights.airplane))
        return _profiles(fits, flights, likelihood(), name)

    return answer


def _profiles(
    fits: Estimate, flights: Flights, likelihood: AbstractLikelihood, name: str
) -> Answer:
    """Return the profile intervals of one parameter of all flights."""
    ends = [
        profile_likelihood(fit, record, likelihood, name).ends
        for fit, record in _each(fits, flights)
    ]
    keep = [fits.names.index(name)]
    return Answer(
        (name,),
        np.asarray(fits.values)[:, keep],
        np.asarray(fits.standard_errors)[:, keep],
        np.array(ends)[:, None],
        np.asarray(fits.successful),
    )


def estimates(
    flights: Flights, likelihood: AbstractLikelihood, model: AbstractModel, chosen: Free
) -> Estimate:
    """Return the estimates of all flights from one program.

    They follow one another in it: each ends when it has converged.
    """
    t, u = jnp.asarray(flights.t), jnp.asarray(flights.u)

    def one(measured):
        record = Record(t, u, *measured, {}, *CHANNELS)
        return estimate(model, chosen, record, likelihood, solver=GaussNewton(max_steps=80))

    measured = jnp.asarray(flights.z), jnp.asarray(flights.valid)
    return eqx.filter_jit(lambda measured: jax.lax.map(one, measured))(measured)


def started(
    held: tuple[str, ...] = (), airplane: Airplane = SMALL, **options
) -> tuple[ShortPeriod, Free]:
    """Return the model at its start, and its free parameters.

    Args:
        held: derivatives that keep their true mean value.
        airplane: the aircraft.
        options: of `jaxid.free`.
    """
    true = airplane.derivatives
    model = airplane.model({n: true[n] if n in held else START * true[n] for n in DERIVATIVES})
    names = tuple(name for name in DERIVATIVES if name not in held)
    return model, free(model, *names, per_record=("initial_state",), **options)


def records_of(flights: Flights) -> Iterator[Record]:
    """Yield the record of each flight."""
    t, u = flights.t[None], flights.u[None]
    for draw in range(len(flights.z)):
        z, valid = flights.z[draw : draw + 1], flights.valid[draw : draw + 1]
        yield Record(*map(jnp.asarray, (t, u, z, valid)), {}, *CHANNELS)


def _each(fits: Estimate, flights: Flights):
    """Yield estimate and record of each flight."""
    for draw, record in enumerate(records_of(flights)):
        yield _of_draw(fits, draw), record


def _of_draw(fits: Estimate, draw: int) -> Estimate:
    return jax.tree.map(lambda leaf: leaf[draw], fits)


def answer_of(fits: Estimate, errors, ends) -> Answer:
    """Return the intervals of estimates.

    Args:
        fits: estimates of all flights.
        errors: standard errors, shape (draw, parameter).
        ends: ends of the intervals, shape (draw, parameter, 2).
    """
    arrays = map(np.asarray, (fits.values, errors, ends, fits.successful))
    return Answer(fits.names, *arrays)
