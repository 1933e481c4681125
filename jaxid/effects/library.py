"""The general library of candidate effects, built from the names of a model's channels."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are
# none.
# pyright: reportCallIssue=false, reportArgumentType=false

import itertools
from collections.abc import Collection

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.compiler import fast_compile_jit
from .._foundation.host import to_device
from .._foundation.types import Array, Bool
from ..models.base import AbstractModel, canonical, equations_of, right_hand_sides
from ..models.free import Positions, leaves_at
from ..models.free_model import insert
from ..models.names import flat_vector
from ..models.polynomial import require_readable
from ..models.signal_dependence import RANDOM_POINTS, absent_signals, differences, with_differences
from .actuator import (
    CommonInputRateLimit,
    InputDeadZone,
    InputHysteresis,
    InputPositionLimit,
    InputRateLimit,
)
from .augmented import absent_effects, split_effects
from .base import Effect
from .dynamics import Hysteresis, LaggedSignal, Resonance
from .equation import DryFriction, QuadraticDrag, StateLimit, Term
from .input import (
    CommonInputLag,
    InputBetweenSamples,
    InputBias,
    InputDelay,
    InputLag,
    InputScale,
)
from .placement import Placement
from .sensor import (
    SensorBias,
    SensorCrossTalk,
    SensorDelay,
    SensorDrift,
    SensorLag,
    SensorSaturation,
    SensorScale,
)
from .sensor_curve import SensorCurve
from .sensor_quantisation import SensorQuantisation
from .static_nonlinearity import DeadBand, Hinge

# Limits of the library's size, all chosen: each candidate costs one sensitivity per round.
MOST_SIGNALS_FOR_CUBIC_PRODUCTS = 3  # and for the higher powers of one signal
HIGHER_POWERS = (4, 5)
MOST_PAIRS_FOR_SHAPES = 12  # pairs of an equation and a state with a dead band and hinges
MOST_PAIRS_FOR_MEMORY = 6  # pairs of an equation and a state with additional states
# pairs of an equation and an input; each has three initial frequencies, of two states each
MOST_PAIRS_FOR_RESONANCE = 2
MOST_DIFFERENCES_FOR_SHAPES = 8  # pairs of an equation and a difference
MOST_OUTPUTS_OF_ONE_UNIT = 3  # outputs of one unit with cross-talk
# Initial shapes, all chosen.
LEVELS = (0.6, 0.75, 0.9)  # levels of overflow, as fractions of the state's range
KNOTS = (0.3, 0.7)  # levels of hinges, as fractions of the signal's range
# width of friction in an output, which is not integrated, as a fraction of the largest speed
SHARP = 1e-6
PEAKS = (1, 2, 3)  # peaks of the relative residual spectrum for a resonance
# Magnitudes of states and inputs for a test of dependence (chosen): some equations depend on a
# parameter only at large values, e.g. if a valve opens at 20 degrees.
STATE_MAGNITUDES = (1.0, 10.0, 100.0, 1000.0)


def general_effects(
    model: AbstractModel,
    equations: tuple[str, ...] | None = None,
    *,
    free: Collection[str] = (),
    uniform: bool = True,
) -> tuple[Effect, ...]:
    """Return the candidate effects for any model.

    They are terms, friction, limits, piecewise linear functions, effects with states, functions of
    differences of signals, and effects in inputs and sensors.

    Args:
        model: the model whose channels the effects use. Effects already in the model are left out.
        equations: states whose equations may have unknown terms; by default the equations with a
            parameter.
        free: names of the free parameters. A linear term whose coefficient is one of them is no
            candidate; with another coefficient of zero it is one.
        uniform: whether the records are sampled uniformly, so that an input may be band-limited.

    Returns:
        The effects, all with zero gain, sorted by name.

    Raises:
        InputError: if the name of a state or an input cannot be used in a term.
    """
    if equations is None:
        equations = uncertain_equations(
            canonical(model), np.arange(flat_vector(canonical(model)).size)
        )
    declared, _ = split_effects(model)
    require_readable(declared.states + declared.inputs)
    effects = _in_equations(declared, equations, free) + _of_differences(declared, equations, free)
    effects += [*_in_inputs(declared, uniform), *_in_outputs(declared)]
    return tuple(sorted(absent_effects(model, effects), key=lambda effect: effect.name))


def _in_equations(
    model: AbstractModel, equations: tuple[str, ...], free: Collection[str]
) -> list[Effect]:
    """Return the effects in each equation.

    They are terms, including linear terms in signals on which the equation does not depend,
    friction, overflow, and in small models static nonlinearities and effects with states. In a
    model without states they are terms, friction, drag and static nonlinearities of its inputs, as
    each may be a speed.
    """
    effects: list[Effect] = []
    arguments = model.states or model.inputs
    pairs = len(equations) * len(arguments)
    absent = absent_signals(canonical(model), equations, free)
    for name in equations:
        placement = Placement.equation(name)
        terms = (*absent[name], *products(model.states + model.inputs))
        effects += [Term(name, term) for term in terms]
        if name in model.states:
            effects += [*_of_speed(name, name), *_overflow(name, equations)]
        if pairs <= MOST_PAIRS_FOR_SHAPES:
            for signal in arguments:
                effects += [DeadBand(placement, signal)]
                effects += [Hinge(placement, signal, fraction) for fraction in KNOTS]
                effects += () if model.states else _of_speed(name, signal, fraction=SHARP)
        if name in model.states:
            effects += _with_memory(model, placement, equations)
    return effects


def _of_speed(name: str, speed: str, **width) -> tuple[Effect, ...]:
    """Return the friction, with a fixed and a free width, and the drag of a speed in an equation.

    Args:
        name: the equation.
        speed: the speed.
        **width: the fixed width (`fraction` of `DryFriction`).
    """
    fixed, free = DryFriction(name, speed, **width), DryFriction(name, speed, free_width=True)
    return fixed, free, QuadraticDrag(name, speed)


def _overflow(name: str, equations: tuple[str, ...]) -> list[StateLimit]:
    """Return the overflow of a state into each other one."""
    others = (into for into in equations if into != name)
    return [StateLimit(name, into, start) for into in others for start in LEVELS]


def _with_memory(
    model: AbstractModel, placement: Placement, equations: tuple[str, ...]
) -> list[Effect]:
    """Return the effects with additional states in one equation of a small model."""
    effects: list[Effect] = []
    if len(equations) * len(model.states) <= MOST_PAIRS_FOR_MEMORY:
        # No lag of a position: if the damping is free, it is equivalent to a lag of its rate.
        effects += [LaggedSignal(placement, signal) for signal in equations]
        effects += [
            Hysteresis(placement, signal, free_shape=free)
            for signal in model.states
            for free in (False, True)
        ]
    if len(equations) * len(model.inputs) <= MOST_PAIRS_FOR_RESONANCE:
        effects += [Resonance(placement, signal, peak) for signal in model.inputs for peak in PEAKS]
    return effects


def _of_differences(
    model: AbstractModel, equations: tuple[str, ...], free: Collection[str]
) -> list[Effect]:
    """Return the nonlinear functions of differences of signals that the declared model contains.

    They are powers, drag, dry friction and dead bands between two parts.
    """
    states_of = differences(canonical(model), equations, free)
    pairs = [(state, signal) for signal, states in states_of.items() for state in states]
    effects: list[Effect] = []
    for state, signal in pairs:
        effects += [Term(state, f"({signal})^{power}") for power in (2, 3)]
        if len(pairs) <= MOST_DIFFERENCES_FOR_SHAPES:
            effects += _of_speed(state, signal)
            effects += [DeadBand(Placement.equation(state), signal)]
        else:
            effects += [QuadraticDrag(state, signal)]
    return effects


def _in_inputs(model: AbstractModel, uniform: bool) -> list[Effect]:
    """Return the effects in inputs.

    Every input can have a delay and a lag. Inputs moved by an actuator can have limits, a dead zone
    and band-limited intersample behaviour, and those of one unit the same lag and the same rate
    limit. The other inputs are measured by instruments and can have a bias and a scale error, which
    for an actuator are a constant and a gain of the model. Actuated inputs of a model without
    states can have hysteresis.
    """
    effects: list[Effect] = []
    for unit, channels in _by_unit(model, model.actuated()):
        effects += [CommonInputLag(channels, unit), CommonInputRateLimit(channels, unit)]
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
    """Return the errors of every sensor, and the cross-talk between outputs of one unit."""
    effects: list[Effect] = []
    for channel in model.outputs:
        effects += [
            SensorBias(channel),
            SensorScale(channel),
            SensorDelay(channel),
            SensorLag(channel),
        ]
        effects += [SensorSaturation(channel, end) for end in ("upper", "lower")]
        effects += [SensorCurve(channel, curve) for curve in ("square", "absolute")]
        effects += [SensorDrift(channel), SensorQuantisation(channel)]
    return effects + [SensorCrossTalk(into, source) for into, source in _outputs_of_one_unit(model)]


def _outputs_of_one_unit(model: AbstractModel) -> tuple[tuple[str, str], ...]:
    """Return the ordered pairs of outputs with likely cross-talk.

    These are pairs among two or three outputs with one unit, such as three gyros.
    """
    return tuple(
        pair
        for _, group in _by_unit(model, model.outputs)
        if len(group) <= MOST_OUTPUTS_OF_ONE_UNIT
        for pair in itertools.permutations(group, 2)
    )


def _by_unit(
    model: AbstractModel, channels: tuple[str, ...]
) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return the units that several channels share, and these channels."""
    units = {name: model.units().get(name, "") for name in channels}
    groups = (
        (unit, tuple(name for name in channels if units[name] == unit))
        for unit in dict.fromkeys(units.values())
        if unit
    )
    return tuple((unit, names) for unit, names in groups if len(names) > 1)


def products(signals: tuple[str, ...]) -> tuple[str, ...]:
    """Return the terms that a linear equation lacks.

    They are the constant, all squares, products and cubes, and for few signals all cubic products
    and the powers up to the fifth.
    """
    cubic, higher = itertools.combinations_with_replacement(signals, 3), [*HIGHER_POWERS]
    if len(signals) > MOST_SIGNALS_FOR_CUBIC_PRODUCTS:
        cubic, higher = ((name,) * 3 for name in signals), []
    powers = ((name,) * power for name in signals for power in higher)
    factors = [(), *itertools.combinations_with_replacement(signals, 2), *cubic, *powers]
    return tuple(_term_of(product) for product in factors)


def uncertain_equations(model: AbstractModel, free_positions: np.ndarray) -> tuple[str, ...]:
    """Return the states whose equation depends on a free parameter.

    The other equations are kinematics, exact by definition. The derivative of the right-hand side
    with respect to the free parameters is evaluated at arbitrary states and inputs of several
    magnitudes, at positive ones and at ones of both signs. An equation does not depend on a free
    parameter if its derivative vanishes wherever it is finite. Equations of states added by effects
    are exact as well.

    Args:
        model: the model.
        free_positions: positions of the free shared parameters in the model's flat vector.
    """
    vector, none = np.asarray(flat_vector(model)), np.zeros(0, int)
    flat = to_device(np.concatenate([vector, np.zeros(len(model.states))]))
    at = to_device(np.array(free_positions, int))
    positions = Positions(at, to_device(none), leaves_at(model, free_positions))
    uncertain = np.asarray(_depends(model, flat, positions))
    declared = equations_of(split_effects(model)[0])
    return tuple(
        name
        for name, depends in zip(equations_of(model), uncertain, strict=True)
        if depends and name in declared
    )


@fast_compile_jit
def _depends(model: AbstractModel, flat: Array, positions: Positions) -> Bool[Array, " state"]:
    """Return whether each rate depends on a parameter at the positions.

    The derivatives are evaluated at arbitrary states and inputs.
    """

    def slopes(key, lowest, highest):
        count = len(model.states) + len(model.inputs)
        point = jax.random.uniform(key, (count,), minval=lowest, maxval=highest)
        x, u = jnp.split(point, [len(model.states)])

        def rate(values):
            return right_hand_sides(
                insert(model, flat, positions, values, jnp.zeros(0))[0], jnp.zeros(()), x, u
            )

        return jax.jacfwd(rate)(flat[positions.shared])

    sizes = jnp.repeat(jnp.array(STATE_MAGNITUDES), RANDOM_POINTS)
    # At positive points roots and logarithms of all signals are finite.
    lowest, highest = jnp.concatenate([0.0 * sizes, -sizes]), jnp.tile(sizes, 2)
    values = jax.vmap(slopes)(jax.random.split(jax.random.key(0), lowest.size), lowest, highest)
    # A single NaN is no evidence: outside of its domain a root without a parameter has the
    # derivative zero times infinity.
    nonzero = jnp.any(jnp.where(jnp.isnan(values), 0.0, values) != 0, axis=(0, 2))
    return nonzero | jnp.any(jnp.all(jnp.isnan(values), 0), -1)


def initialise_shapes(effects: tuple[Effect, ...], signals, measured, step) -> tuple[Effect, ...]:
    """Return the effects with shapes set from the training records, and with zero gains."""
    signals = with_differences(
        signals, (name for effect in effects for name in effect.card.signals)
    )
    shaped = (effect.initialise_shape(signals, measured, step) for effect in effects)
    return tuple(
        eqx.tree_at(lambda effect: effect.gain, effect, jnp.zeros(())) for effect in shaped
    )


def _term_of(product: tuple[str, ...]) -> str:
    """Return a product of names as a term: `("x", "x", "v")` is `"x^2 v"`."""
    powers = {name: product.count(name) for name in dict.fromkeys(product)}
    return (
        " ".join(name if power == 1 else f"{name}^{power}" for name, power in powers.items()) or "1"
    )
