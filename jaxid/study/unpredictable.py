"""What nothing predicts: whether random forces, or coloured noise of the sensors, explain what the
declared model leaves.
"""

from collections.abc import Sequence
from functools import partial

import jax.numpy as jnp
import numpy as np

from .._foundation.grid import typical_step
from .._foundation.location import LocationKind
from .._foundation.types import Array, Float
from ..diagnosis.autoregression import autoregressive_r2
from ..diagnosis.free_form import Places
from ..diagnosis.localise import LocalisationResult, Place
from ..diagnosis.process_noise import ProcessNoise
from ..diagnosis.scores import Scores, critical
from ..diagnosis.validation import root_mean_square
from .fit import Fitted
from .search import Search
from .study import ColouredNoise, RandomForces

# of a record: what remembers longer comes less than five times anew in it, and may as well be a
# constant or a drift
SLOW = 0.1


def random_forces(
    search: Search, declared: Fitted, where: LocalisationResult
) -> RandomForces | None:
    """The forces, where a filter that knows of them leaves noise, and nothing absent scores among
    its innovations.

    Args:
        search: with its workbench and options.
        declared: the declared model's fit.
        where: the places of its residual.
    """
    places, bench = where.disturbance_locations(), search.bench
    if not places:
        return None
    search.progress("whether random forces explain the residual")
    known = bench.likelihood.noise.is_known
    noise, scores = _with_forces(search, declared, places, known)
    # led astray, it may be, by what output error took for the forces
    if not float(noise.time[0]) <= _longest(search):
        noise, scores = _with_forces(search, declared, places, known, anew=True)
    if not (_nothing_is_left(search, noise, scores) and float(noise.time[0]) <= _longest(search)):
        return None
    shows = np.asarray(noise.worth) > critical(search.options.level / len(places))
    nearest = {
        one.location for one in where.near_best()
    }  # an equation and a sensor may have one name
    acting = tuple(
        one.location.name
        for one, clear in zip(places, shows, strict=True)
        if clear or one.location in nearest
    )
    air = tuple(one.location.name for one in places if one.location.kind is LocationKind.AIR)
    sizes = {
        place.location.name: float(one) for place, one in zip(places, noise.force, strict=True)
    }
    names = (bench.columns.names[column] for column in declared.columns)
    # behind them it is padded
    beside = dict(zip(names, map(float, noise.parameters.shared), strict=False))
    return RandomForces(acting, air, sizes, float(noise.time[0]), beside, float(noise.gain))


def coloured_noise(search: Search, found: Fitted) -> ColouredNoise | None:
    """That of the sensors, where a filter that knows of it leaves noise, and nothing absent scores
    among its innovations.

    It is asked about where the past of some sensor's residual predicts more of it than chance does.
    Noise that was given was given as white, so that its size is asked for anew.

    Args:
        search: with its workbench and options.
        found: the fit with what was added, or the declared model's.
    """
    bench, records, allowed = (
        search.bench,
        search.bench.records,
        search.judge.predictable_by_chance(),
    )
    coloured = tuple(
        name for name, share in search.judge.predictable(found).items() if share > allowed
    )
    if not coloured:
        return None
    search.progress("whether coloured noise of the sensors explains the residual")
    size = _floored(root_mean_square(found.fit.residuals, records.mask))
    noise, scores = bench.whiten_with_noise_model(
        found, size, ((LocationKind.SENSOR, records.outputs),), False
    )
    deviation, time = np.asarray(noise.force), np.asarray(noise.time)
    factor = np.linalg.cholesky(np.asarray(found.fit.noise))
    white = np.linalg.norm(factor * np.asarray(noise.instruments), axis=1)
    shows = np.sum(np.asarray(records.mask), axis=(0, 1)) * (deviation / white) ** 2 > critical(
        search.options.level
    )
    if not _nothing_is_left(search, noise, scores) or np.any(shows & (time > _longest(search))):
        return None
    a = np.exp(-float(typical_step(records.t)) / time)
    inflation = (deviation**2 * (1 + a) / (1 - a) + white**2) / (deviation**2 + white**2)
    by_sensor = partial(zip, records.outputs, strict=True)
    return ColouredNoise(
        coloured,
        dict(by_sensor(map(float, deviation))),
        dict(by_sensor(map(float, white))),
        dict(by_sensor(map(float, time))),
        dict(by_sensor(records.output_units)),
        float(np.max(inflation[[name in coloured for name in records.outputs]])),
        float(noise.gain),
    )


def act_on_the_motion(
    search: Search, found: Fitted, where: LocalisationResult, gain: float
) -> bool:
    """Whether random forces explain what effects leave better than coloured noise of sensors does:
    the likelihood decides.

    An effect of nearly the right shape leaves a motion, which all sensors see together; noise of a
    sensor is its own.

    Args:
        search: with its workbench.
        found: the fit with the effects.
        where: the places of its residual.
        gain: of coloured noise of the sensors, as `ColouredNoise` has it.
    """
    places = where.disturbance_locations()
    if not places:
        return False
    search.progress("whether what is left acts on the motion")
    forces, _ = _with_forces(search, found, places, False)
    return float(forces.gain) > gain


def _with_forces(
    search: Search, fitted: Fitted, places: Sequence[Place], known: bool, anew: bool = False
) -> tuple[ProcessNoise, Scores]:
    """A filter that knows of random forces at places, begun at the sizes that free-form
    disturbances have there.
    """
    size = _floored(jnp.array([place.size for place in places]))
    return search.bench.whiten_with_noise_model(fitted, size, _by_kind(places), known, anew)


def _floored(size: Float[Array, " place"]) -> Float[Array, " place"]:
    """Sizes with logarithms, where a search can start: none is less than a thousandth of the
    largest.
    """
    return jnp.maximum(size, 1e-3 * jnp.max(size) + jnp.finfo(float).tiny)


def _longest(search: Search) -> float:
    """The longest memory that these records can tell from a constant or a drift [s]."""
    t = np.asarray(search.bench.records.t)
    return SLOW * float(np.min(t[:, -1] - t[:, 0]))


def _by_kind(places: Sequence[Place]) -> Places:
    """Their names, kind by kind, in their order."""
    kinds = dict.fromkeys(one.location.kind for one in places)
    return tuple(
        (kind, tuple(one.location.name for one in places if one.location.kind is kind))
        for kind in kinds
    )


def _nothing_is_left(search: Search, noise: ProcessNoise, scores: Scores) -> bool:
    """Whether innovations look like noise, and nothing that is absent explains any part of them."""
    records = search.bench.records
    share = autoregressive_r2(noise.v, records.mask)
    # innovations are white, and none is shown by their colour
    shown = np.minimum(scores.score, scores.significance)
    tried = int(np.sum(np.asarray(scores.identifiable_fraction) > 0))
    silent = float(np.max(shown, initial=0.0)) <= critical(search.options.level / max(tried, 1))
    return (
        search.judge.looks_like_noise(dict(zip(records.outputs, map(float, share), strict=True)))
        and silent
    )
