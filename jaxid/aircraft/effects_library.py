"""The library of effects that an aircraft may lack, by group, made from the names of its parameters and of its own terms."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are none.
# pyright: reportCallIssue=false, reportArgumentType=false

from collections.abc import Callable, Collection, Mapping, Sequence

import jax
import jax.numpy as jnp

from .._foundation.checks import require_known
from ..models.acting import Acting
from ..models.base import AbstractModel, canonical
from ..models.effects import Effect
from ..models.effects_memory import LaggedSignal, Resonance
from ..models.effects_parameter import MOMENTS, ParameterDrift, ParameterShift, ParameterStep
from ..models.names import parameter_names, read
from .aerodynamics import COEFFICIENTS
from .effects import CoefficientTerm
from .effects_flow import CoefficientGradient, GroundEffect, in_coefficient
from .effects_separation import Separation, StaticSeparation

GROUPS = ("coefficients", "unsteady", "structure", "mass", "thrust", "air", "instruments")
Moved = Mapping[str, tuple[str, ...]]

RATE_TERMS = {  # beside each other damping in pitch and yaw acts on the rate of the angle, not on that of the body
    **{"CZ": ("alphadot_hat",), "Cm": ("alphadot_hat",)},
    **{"CY": ("betadot_hat",), "Cl": ("betadot_hat",), "Cn": ("betadot_hat",)},
}
WITH_MACH = (("CX", "1"), ("CZ", "alpha"), ("Cm", "1"), ("Cm", "alpha"), ("Cn", "beta"))
MORE_WITH_MACH = (("CX", "alpha^2"), ("CY", "beta"), ("Cl", "beta"))
WITH_QBAR = (("Cm", "stabilator"), ("Cl", "aileron"), ("Cn", "rudder"))  # surfaces that bend the airframe
LAGGED = {"alpha": ("CX", "CZ", "Cm"), "beta": ("CY", "Cl", "Cn")}
SEPARATED = ("CX", "CZ", "Cm")
SHAKEN = {"stabilator": ("CZ", "Cm"), "aileron": ("Cl",), "rudder": ("CY", "Cn")}  # by each surface

INERTIA = {
    **{name: f"moment of inertia {name}" for name in ("Ix", "Iy", "Iz")},
    "Ixz": "product of inertia Ixz",
}
MORE_INERTIA = {name: f"product of inertia {name}" for name in ("Ixy", "Iyz")}
PLACES = ("alpha.x", "beta.x", "ax.z", "ay.x", "az.x")  # of each instrument the co-ordinate that is felt most
SKEW = ("p.theta", "r.theta", "ax.theta", "ay.phi")


def usual_effects(names: Sequence[str], moved: Moved, signals: Collection[str]) -> tuple[Effect, ...]:
    """What an aircraft lacks most often, beside terms of its coefficients: the few that are tried by default.

    Args:
        names: of its parameters; effects on those that it does not have are left out.
        moved: the states that each coefficient moves.
        signals: that it computes; what needs another is left out.
    """
    return (
        *(term for term in rate_terms(moved) if term.product in signals),
        *gradients(WITH_MACH, "mach", moved),
        *separations(moved, static=(0.6, 0.8), lagging=(0.65,)),
        *shifts(names, {"mass": "mass"}, "kg"),
        *changes_of_mass(names, (0.25, 0.5, 0.75)),
        *shifts(names, INERTIA, "kg*m^2"),
        *centre_of_gravity(names, "xy"),
        *thrust(names),
        *shifts(names, {"wind.down": "downward wind"}, "m/s"),
        *places(names, PLACES),
        *skewed(names, SKEW),
    )


def aircraft_effects(
    model: AbstractModel, *, groups: Sequence[str] = GROUPS, ground: float | None = None
) -> tuple[Effect, ...]:
    """All effects that are known of aircraft, by group; many, so that a study with all of them compiles long.

    Args:
        model: an `Aircraft`, or another model; there are effects on those parameters and signals that it has.
        groups: of them

            - "coefficients": terms, and terms that vary with Mach, dynamic pressure and altitude;
            - "unsteady": terms with the rates of alpha and beta, lagged angles, separated flow;
            - "structure": a mode of the airframe that a surface excites, in the coefficients of that surface;
            - "mass": mass, its drift (fuel) and step (a store is dropped), centre of gravity, inertia;
            - "thrust": of all engines, asymmetry, line of action, angular momentum;
            - "air": steady wind, its shear, temperature;
            - "instruments": places and axes.
        ground: altitude of the ground for a flight near it [m]; without it there is no ground effect.

    Returns:
        The effects, all absent; give them to `close_loop` as `effects`, with those of `jaxid.models.general_effects`.

    Raises:
        InputError: for a group that does not exist.
    """
    require_known("group of effects", groups, GROUPS)
    model = canonical(model)
    names, signals = parameter_names(model), signals_of(model)
    terms = tuple(effect for effect in model.effects() if isinstance(effect, CoefficientTerm))
    moved = _moved(model, signals)
    makers: dict[str, Callable[[], Sequence[Effect]]] = {
        "coefficients": lambda: (*_coefficients(terms, moved, signals), *_ground_effects(model, moved, ground)),
        "unsteady": lambda: _unsteady(terms, moved, signals),
        "structure": lambda: _modes(moved, signals),
        "mass": lambda: _mass(names),
        "thrust": lambda: (
            *thrust(names, "thrust" in model.inputs),
            *_all_engines(names, "up", "tilt of the thrust line", "rad"),
        ),
        "air": lambda: _air(names),
        "instruments": lambda: (
            *places(names, _below(names, "position")),
            *skewed(names, _below(names, "misalignment")),
        ),
    }
    return tuple(effect for group in groups for effect in makers[group]())


def signals_of(model: AbstractModel) -> frozenset[str]:
    """Names of the signals that a model computes."""
    empty = jnp.zeros(()), jnp.zeros(len(model.states)), jnp.zeros(len(model.inputs))
    return frozenset(jax.eval_shape(model.signals, *empty))


def _moved(model: AbstractModel, signals: Collection[str]) -> Moved:
    """The states that each coefficient moves, where the signals say by how much."""
    moved = {name: tuple(one for one in model.states if f"{one}_per_{name}" in signals) for name in COEFFICIENTS}
    return {name: states for name, states in moved.items() if states}


# Coefficients ---------------------------------------------------------------------------------------------------------


def _coefficients(terms, moved: Moved, signals: Collection[str]) -> tuple[Effect, ...]:
    rates = {name for products in RATE_TERMS.values() for name in products}
    varying = (*WITH_MACH, *MORE_WITH_MACH)
    found = {"mach": varying, "qbar": (*varying, *WITH_QBAR), "altitude": WITH_MACH}
    return (
        *(term for term in terms if term.product not in rates),
        *(one for signal, these in found.items() if signal in signals for one in gradients(these, signal, moved)),
    )


def _ground_effects(model: AbstractModel, moved: Moved, ground: float | None) -> tuple[Effect, ...]:
    if ground is None or "b" not in parameter_names(model):
        return ()
    span = float(read(model, ("b",))[0])
    return tuple(GroundEffect(in_coefficient(name, moved[name]), ground, span) for name in SEPARATED if name in moved)


def gradients(varying: Sequence[tuple[str, str]], signal: str, moved: Moved) -> tuple[Effect, ...]:
    """Terms that vary with a signal.

    Args:
        varying: coefficient and product of each.
        signal: with what.
        moved: the states that each coefficient moves.
    """
    return tuple(
        CoefficientGradient(in_coefficient(name, moved[name]), signal, product)
        for name, product in varying
        if name in moved
    )


# Unsteady aerodynamics ------------------------------------------------------------------------------------------------


def _unsteady(terms, moved: Moved, signals: Collection[str]) -> tuple[Effect, ...]:
    own = tuple(term for term in terms if term.product in RATE_TERMS.get(term.coefficient, ()))
    late = tuple(
        LaggedSignal(in_coefficient(name, moved[name]), angle)
        for angle, names in LAGGED.items()
        for name in names
        if name in moved and angle in signals
    )
    return (*own, *late, *separations(moved, (0.5, 0.6, 0.7, 0.8, 0.9), (0.5, 0.65, 0.8, 0.95)))


def rate_terms(moved: Moved) -> tuple[CoefficientTerm, ...]:
    """Terms with the rates of alpha and beta, `alphadot_hat in Cm` and so on.

    Args:
        moved: the states that each coefficient moves.
    """
    return tuple(
        CoefficientTerm(coefficient=name, product=product, moved=moved[name])
        for name, products in RATE_TERMS.items()
        for product in products
        if name in moved
    )


def separations(moved: Moved, static: Sequence[float], lagging: Sequence[float]) -> tuple[Effect, ...]:
    """Separated flow with several starts of its angle.

    Args:
        moved: the states that each coefficient moves; without CZ there is none.
        static, lagging: fractions of the range of alpha.
    """
    acting: tuple[Acting, ...] = tuple(in_coefficient(name, moved[name]) for name in SEPARATED if name in moved)
    if "CZ" not in moved:
        return ()
    return (
        *(StaticSeparation(acting, fraction) for fraction in static),
        *(Separation(acting, fraction) for fraction in lagging),
    )


def _modes(moved: Moved, signals: Collection[str]) -> tuple[Effect, ...]:
    return tuple(
        Resonance(in_coefficient(name, moved[name]), surface)
        for surface, names in SHAKEN.items()
        for name in names
        if name in moved and surface in signals
    )


# Parameters -----------------------------------------------------------------------------------------------------------


def _mass(names: Sequence[str]) -> tuple[Effect, ...]:
    return (
        *shifts(names, {"mass": "mass"}, "kg"),
        *changes_of_mass(names, MOMENTS),
        *shifts(names, INERTIA | MORE_INERTIA, "kg*m^2"),
        *centre_of_gravity(names, "xyz"),
    )


def _air(names: Sequence[str]) -> tuple[Effect, ...]:
    steady = {f"wind.{name}": f"{word} wind" for name, word in (("north", "northward"), ("east", "eastward"))}
    shear = {f"wind.{name}_shear": f"shear of the {name} wind" for name in ("north", "east", "down")}
    return (
        *shifts(names, steady | {"wind.down": "downward wind"}, "m/s"),
        *shifts(names, shear, "1/s"),
        *shifts(names, {"atmosphere.warmer": "temperature of the air"}, "K"),
    )


def shifts(names: Sequence[str], called: Mapping[str, str], unit: str) -> tuple[Effect, ...]:
    """Parameters that are not the declared ones.

    Args:
        names: of all parameters; others are left out.
        called: words by dotted name.
        unit: of all of them.
    """
    return tuple(ParameterShift(name, called=words, unit=unit) for name, words in called.items() if name in names)


def changes_of_mass(names: Sequence[str], moments: Sequence[float]) -> tuple[Effect, ...]:
    """Mass that burns, and mass that is dropped.

    Args:
        names: of all parameters.
        moments: starts of the time of a drop, as fractions of the records' time.
    """
    if "mass" not in names:
        return ()
    return (ParameterDrift("mass", unit="kg"), *(ParameterStep("mass", moment, unit="kg") for moment in moments))


def centre_of_gravity(names: Sequence[str], axes: str) -> tuple[Effect, ...]:
    """The centre of gravity in another place: reference point, engines and instruments all move the other way.

    A positive gain moves them forward, to the right and down, and so the centre of gravity aft, to the left and up.

    Args:
        names: of all parameters.
        axes: "x", "y", "z".
    """
    found = []
    for axis in axes:
        parts = [
            name
            for name in names
            if name.endswith(f".{axis}") and ("position." in name or name.startswith("reference."))
        ]
        if f"reference.{axis}" in parts:
            along = tuple((name, 1.0) for name in parts if not name.startswith("reference."))
            called = f"place of the centre of gravity along {axis}"
            found.append(ParameterShift(f"reference.{axis}", along, called=called, unit="m"))
    return tuple(found)


def thrust(names: Sequence[str], measured: bool = False) -> tuple[Effect, ...]:
    """Push of all engines, its asymmetry, its height, and their angular momentum.

    With one engine the thrust line passes to the side; with several the first pushes more and the last less. Engines that share
    a push that is held have that push in common; of one that is measured a scale of the input is the error.

    Args:
        names: of all parameters.
        measured: whether the push of all engines is an input.
    """
    push = shifts(names, {"thrust": "thrust"}, "N")
    if not (push or measured):
        push = _all_engines(names, "share", "thrust", "")
    own = _engines(names, "share")
    asymmetry: tuple[Effect, ...] = ()
    if len(own) > 1:
        asymmetry = (ParameterShift(own[0], ((own[-1], -1.0),), called="symmetry of thrust"),)
    elif own:
        asymmetry = shifts(names, {"engines.0.position.y": "sideways place of the thrust line"}, "m")
    return (
        *push,
        *asymmetry,
        *_all_engines(names, "position.z", "height of the thrust line", "m"),
        *_all_engines(names, "momentum", "angular momentum of the engines", "kg*m^2/s"),
    )


def places(names: Sequence[str], which: Sequence[str]) -> tuple[Effect, ...]:
    """Instruments that stand elsewhere.

    Args:
        names: of all parameters.
        which: channels and co-ordinates, such as "alpha.x".
    """
    called = {one: f"place of the sensor of {one.replace('.', ' along ')}" for one in which}
    return _in_instruments(names, "position", called, "m")


def skewed(names: Sequence[str], which: Sequence[str]) -> tuple[Effect, ...]:
    """Instruments whose axis points askew.

    Args:
        names: of all parameters.
        which: channels and angles, such as "p.theta".
    """
    called = {one: f"axis of the sensor of {one.replace('.', ' in ')}" for one in which}
    return _in_instruments(names, "misalignment", called, "rad")


def _in_instruments(names: Sequence[str], part: str, called: Mapping[str, str], unit: str) -> tuple[Effect, ...]:
    """Shifts of one part of the instruments, each of which acts in a channel's sensor."""
    return tuple(
        ParameterShift(f"instruments.{part}.{one}", called=words, unit=unit, channel=one.partition(".")[0])
        for one, words in called.items()
        if f"instruments.{part}.{one}" in names
    )


def _all_engines(names: Sequence[str], part: str, called: str, unit: str) -> tuple[Effect, ...]:
    """One number of all engines together."""
    own = _engines(names, part)
    if not own:
        return ()
    return (ParameterShift(own[0], tuple((name, 1.0) for name in own[1:]), called=called, unit=unit),)


def _engines(names: Sequence[str], part: str) -> tuple[str, ...]:
    """Dotted names of one number of each engine."""
    return tuple(name for name in names if name.startswith("engines.") and name.endswith(f".{part}"))


def _below(names: Sequence[str], part: str) -> tuple[str, ...]:
    """Channels and parts of what instruments hold."""
    prefix = f"instruments.{part}."
    return tuple(name.removeprefix(prefix) for name in names if name.startswith(prefix))
