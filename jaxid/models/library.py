"""The general library of candidate effects, made from a model's own channel names."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are none.
# pyright: reportCallIssue=false, reportArgumentType=false

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Bool
from .acting import Acting
from .augmented import not_in, taken_apart
from .base import AbstractModel, canonical, equations_of, right_hand_sides
from .differences import ARBITRARY, absent_signals, differences, with_differences
from .effects import Effect
from .effects_actuator import InputDeadZone, InputHysteresis, InputPositionLimit, InputRateLimit
from .effects_equation import DryFriction, QuadraticDrag, StateLimit, Term
from .effects_input import InputBetweenSamples, InputBias, InputDelay, InputLag, InputScale
from .effects_memory import Hysteresis, LaggedSignal, Resonance
from .effects_sensor import SensorBias, SensorDelay, SensorLag, SensorSaturation, SensorScale
from .effects_sensor_more import SensorCrossTalk, SensorDrift, SensorQuantisation
from .effects_shape import DeadBand, Hinge
from .free import Positions, insert, leaves_at
from .names import flatten
from .polynomial import require_readable

MOST_SIGNALS_FOR_CUBIC_PRODUCTS = 3
MOST_PAIRS_FOR_SHAPES = 12  # of an equation and a state, from which on bends in each would be too many candidates
MOST_PAIRS_FOR_MEMORY = 6  # and states of effects too many to simulate
MOST_PAIRS_FOR_RESONANCE = 2  # of an equation and an input: each has three peaks to start at, of two states
MOST_DIFFERENCES_FOR_SHAPES = 8  # of an equation and a difference
MOST_OF_ONE_KIND = 3
LEVELS = (0.6, 0.75, 0.9)  # starts of a limit within the range of its signal
KNOTS = (0.3, 0.7)  # starts of a knot within the range of its signal
SIZES = (
    1.0,
    10.0,
    100.0,
    1000.0,
)  # of states and inputs at which a model is asked: a valve may open at 20 degrees only
PEAKS = (1, 2, 3)  # of the misfit's spectrum, at which a resonance starts


def general_effects(
    model: AbstractModel, equations: tuple[str, ...] | None = None, *, uniform: bool = True
) -> tuple[Effect, ...]:
    """Candidates that make sense for any model: terms, friction, limits, bends and memory, what acts between two parts, inputs
    and sensors.

    Args:
        model: the model whose channels are named. Of one that holds effects already those of the model inside, and of the
            candidates what is not in.
        equations: states in whose equations unknown terms may stand; by default those that hold a parameter.
        uniform: whether the records are sampled uniformly, so that an input may be band-limited.

    Returns:
        The effects, all absent, in the order of their names.

    Raises:
        InputError: when a state's or an input's name cannot stand in a term.
    """
    if equations is None:
        equations = uncertain_equations(canonical(model), np.arange(flatten(canonical(model))[0].size))
    declared, _ = taken_apart(model)
    require_readable(declared.states + declared.inputs)
    effects = [*_in_equations(declared, equations), *_of_differences(declared, equations)]
    effects += [*_in_inputs(declared, uniform), *_in_outputs(declared)]
    return tuple(sorted(not_in(model, effects), key=lambda effect: effect.name))


def _in_equations(model: AbstractModel, equations: tuple[str, ...]) -> list[Effect]:
    """Terms (linear ones of what the equation does not know), friction and limits; shapes that no polynomial has, and memory,
    where there are few equations and states. In a model without states, terms and bends of its inputs."""
    effects: list[Effect] = []
    moving = model.states or model.inputs
    pairs = len(equations) * len(moving)
    unknown = absent_signals(canonical(model), equations)
    for name in equations:
        acting = Acting.equation(name)
        effects += [Term(name, term) for term in (*unknown[name], *products(model.states + model.inputs))]
        if name in model.states:
            effects += [DryFriction(name, name), QuadraticDrag(name, name)]  # of the equation's own speed
            effects += [StateLimit(name, into, start) for into in equations if into != name for start in LEVELS]
        for signal in moving if pairs <= MOST_PAIRS_FOR_SHAPES else ():
            effects += [DeadBand(acting, signal), *(Hinge(acting, signal, fraction) for fraction in KNOTS)]
        if name in model.states and pairs <= MOST_PAIRS_FOR_MEMORY:
            # A place that acts late is its speed that acts late, in other words: their lags are one, where damping is free.
            effects += [LaggedSignal(acting, signal) for signal in equations]
            effects += [Hysteresis(acting, signal) for signal in model.states]
        if name in model.states and len(equations) * len(model.inputs) <= MOST_PAIRS_FOR_RESONANCE:
            effects += [Resonance(acting, signal, peak) for signal in model.inputs for peak in PEAKS]
    return effects


def _of_differences(model: AbstractModel, equations: tuple[str, ...]) -> list[Effect]:
    """Curved, dry and slack, what acts between two parts: functions of differences that the declared model knows."""
    found = differences(canonical(model), equations)
    pairs = [(state, signal) for signal, states in found.items() for state in states]
    effects: list[Effect] = []
    for state, signal in pairs:
        effects += [Term(state, f"({signal})^2"), Term(state, f"({signal})^3"), QuadraticDrag(state, signal)]
        if len(pairs) <= MOST_DIFFERENCES_FOR_SHAPES:
            effects += [DryFriction(state, signal), DeadBand(Acting.equation(state), signal)]
    return effects


def _in_inputs(model: AbstractModel, uniform: bool) -> list[Effect]:
    """Delay and lag of every input; limits, a dead zone and the run between samples of those that an actuator moves, offset and
    scale of those that an instrument shows (in an actuator's they are a constant and a gain of the model). Hysteresis of an input
    where no state can have it."""
    effects: list[Effect] = []
    for channel in model.inputs:
        effects += [InputDelay(channel), InputLag(channel)]
        effects += [InputBias(channel), InputScale(channel)] * (channel not in model.actuated())
    for channel in model.actuated():
        effects += [InputBetweenSamples(channel)] * uniform
        effects += [InputRateLimit(channel), InputDeadZone(channel)]
        effects += [InputHysteresis(channel)] * (not model.states)
        effects += [InputPositionLimit(channel, end) for end in ("upper", "lower")]
    return effects


def _in_outputs(model: AbstractModel) -> list[Effect]:
    """Errors of every instrument, and cross-talk between those of one kind."""
    effects: list[Effect] = []
    for channel in model.outputs:
        effects += [SensorBias(channel), SensorScale(channel), SensorDelay(channel), SensorLag(channel)]
        effects += [SensorSaturation(channel, end) for end in ("upper", "lower")]
        effects += [SensorDrift(channel), SensorQuantisation(channel)]
    return effects + [SensorCrossTalk(into, source) for into, source in _of_one_kind(model)]


def _of_one_kind(model: AbstractModel) -> tuple[tuple[str, str], ...]:
    """Ordered pairs of outputs in which cross-talk is likely: of two or three with one unit, as three gyros are."""
    units = {name: model.units().get(name, "") for name in model.outputs}
    kinds = [
        tuple(name for name in model.outputs if units[name] == unit) for unit in dict.fromkeys(units.values()) if unit
    ]
    return tuple(pair for kind in kinds if len(kind) <= MOST_OF_ONE_KIND for pair in itertools.permutations(kind, 2))


def products(signals: tuple[str, ...]) -> tuple[str, ...]:
    """Terms that a linear equation lacks: the constant, all squares and products, cubes, and mixed cubes of few signals."""
    cubic = itertools.combinations_with_replacement(signals, 3)
    if len(signals) > MOST_SIGNALS_FOR_CUBIC_PRODUCTS:
        cubic = ((name,) * 3 for name in signals)
    found = [(), *itertools.combinations_with_replacement(signals, 2), *cubic]
    return tuple(_written(product) for product in found)


def uncertain_equations(model: AbstractModel, free_positions: np.ndarray) -> tuple[str, ...]:
    """States whose equation holds a free parameter: the others are kinematics, exact by definition.

    The derivative of the right-hand side in the free parameters is taken at arbitrary states and inputs of several sizes; an
    equation in which it vanishes wherever it is finite holds none. Those of states that effects brought are exact as well.

    Args:
        model: the model.
        free_positions: positions of the free shared parameters in the model's flat vector.
    """
    flat = jnp.concatenate([flatten(model)[0], jnp.zeros(len(model.states))])
    positions = Positions(jnp.asarray(free_positions, int), jnp.zeros(0, int), leaves_at(model, free_positions))
    uncertain = np.asarray(_depends(model, flat, positions))
    own = equations_of(taken_apart(model)[0])
    return tuple(name for name, one in zip(equations_of(model), uncertain, strict=True) if one and name in own)


@eqx.filter_jit
def _depends(model: AbstractModel, flat: Array, positions: Positions) -> Bool[Array, " state"]:
    """Whether each rate depends on a parameter at the positions, at one of some arbitrary states and inputs."""

    def slopes(key, size):
        x, u = jnp.split(size * jax.random.uniform(key, (len(model.states) + len(model.inputs),)), [len(model.states)])

        def rate(values):
            return right_hand_sides(insert(model, flat, positions, values, jnp.zeros(0))[0], jnp.zeros(()), x, u)

        return jax.jacfwd(rate)(flat[positions.shared])

    sizes = jnp.repeat(jnp.array(SIZES), ARBITRARY)
    found = jax.vmap(slopes)(jax.random.split(jax.random.key(0), sizes.size), sizes)
    # NaN says nothing where it is as well zero times infinity: a root that holds no parameter, outside of what it is for.
    return jnp.any(jnp.where(jnp.isnan(found), 0.0, found) != 0, axis=(0, 2)) | jnp.any(
        jnp.all(jnp.isnan(found), 0), -1
    )


def started(effects: tuple[Effect, ...], signals, measured, step) -> tuple[Effect, ...]:
    """The effects with their shapes set from the signals of the training records, and their gains zero."""
    signals = with_differences(signals, (name for effect in effects for name in effect.signals_used))
    fresh = (effect.start(signals, measured, step) for effect in effects)
    return tuple(eqx.tree_at(lambda effect: effect.gain, effect, jnp.zeros(())) for effect in fresh)


def _written(product: tuple[str, ...]) -> str:
    """A product of names as a term: `("x", "x", "v")` is `"x^2 v"`."""
    powers = {name: product.count(name) for name in dict.fromkeys(product)}
    return " ".join(name if power == 1 else f"{name}^{power}" for name, power in powers.items()) or "1"
