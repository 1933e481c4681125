"""Library of candidate effects of an aircraft model, by group.

The candidates follow from the names of the model's parameters, signals and terms.
"""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are
# none.
# pyright: reportCallIssue=false, reportArgumentType=false

from collections.abc import Callable, Collection, Mapping, Sequence

import jax
import jax.numpy as jnp

from ..._foundation.checks import require_known
from ...effects.base import Effect
from ...effects.dynamics import LaggedSignal, Resonance
from ...effects.placement import Placement
from ...models.base import AbstractModel, canonical
from ...models.names import parameter_names, read_parameters
from ..vehicle.aerodynamics import COEFFICIENTS
from .coefficient_term import CoefficientTerm
from .flow_dependence import CoefficientGradient, GroundEffect, in_coefficient
from .parameters import (
    INERTIA,
    SENSOR_ANGLES,
    SENSOR_COORDINATES,
    accelerometer_packages,
    air_effects,
    all_engines,
    centre_of_gravity,
    changes_of_mass,
    instrument_entries,
    mass_effects,
    sensor_misalignments,
    sensor_positions,
    shifts,
    thrust,
)
from .separation import Separation, StaticSeparation

GROUPS = ("coefficients", "unsteady", "structure", "mass", "thrust", "air", "instruments")
AffectedStates = Mapping[str, tuple[str, ...]]

# damping by the rate of the air angle, in addition to damping by the angular rate of the body
RATE_TERMS = {
    **{"CZ": ("alphadot_hat",), "Cm": ("alphadot_hat",)},
    **{"CY": ("betadot_hat",), "Cl": ("betadot_hat",), "Cn": ("betadot_hat",)},
}
WITH_MACH = (("CX", "1"), ("CZ", "alpha"), ("Cm", "1"), ("Cm", "alpha"), ("Cn", "beta"))
WITH_ALTITUDE = (("CZ", "1"), ("CZ", "alpha"), ("Cm", "1"))
MORE_WITH_MACH = (("CX", "alpha^2"), ("CY", "beta"), ("Cl", "beta"))
# surfaces whose loads bend the airframe
WITH_QBAR = (("Cm", "stabilator"), ("Cl", "aileron"), ("Cn", "rudder"))
LAGGED = {"alpha": ("CX", "CZ", "Cm"), "beta": ("CY", "Cl", "Cn")}
SEPARATION_COEFFICIENTS = ("CX", "CZ", "Cm")
# coefficients in which each surface excites a mode of the airframe
EXCITED_COEFFICIENTS = {"stabilator": ("CZ", "Cm"), "aileron": ("Cl",), "rudder": ("CY", "Cn")}


def default_effects(
    model: AbstractModel, affected: AffectedStates, names: Sequence[str]
) -> tuple[Effect, ...]:
    """Return the default candidates of an aircraft apart from terms of its coefficients.

    These few effects are the ones that a declared model lacks most often. The fractions below are
    chosen.

    Args:
        model: the model; effects that need a signal that it does not have are left out.
        affected: states whose rates each coefficient changes.
        names: names of its parameters on which an effect may act.
    """
    signals = signals_of(model)
    return (
        *(term for term in rate_terms(affected) if term.product in signals),
        *gradients(WITH_MACH, "mach", affected),
        *(gradients(WITH_ALTITUDE, "altitude", affected) if "altitude" in signals else ()),
        *ground_effects(model, affected, None),
        *separations(affected, static=(0.6, 0.8), lagging=(0.65,)),
        *shifts(names, {"mass": "mass"}, "kg"),
        *changes_of_mass(names, (0.25, 0.5, 0.75)),
        *shifts(names, INERTIA, "kg*m^2"),
        *centre_of_gravity(names, "xy"),
        *thrust(names),
        *shifts(names, {"wind.down": "downward wind"}, "m/s"),
        *accelerometer_packages(names),
        *sensor_positions(names, SENSOR_COORDINATES),
        *sensor_misalignments(names, SENSOR_ANGLES),
    )


def aircraft_effects(
    model: AbstractModel, *, groups: Sequence[str] = GROUPS, ground: float | None = None
) -> tuple[Effect, ...]:
    """Return all candidate effects of an aircraft, by group.

    They are many: a study with all of them takes long to compile.

    Args:
        model: an `Aircraft`, or another model; effects on parameters or signals that it does not
            have are left out.
        groups: groups of effects to return:

            - "coefficients": terms, and terms that vary with Mach, dynamic pressure and altitude;
            - "unsteady": terms with the rates of alpha and beta, lagged angles, separated flow;
            - "structure": a mode of the airframe that a surface excites, in the coefficients of
              that surface;
            - "mass": mass, its drift (fuel) and step (a dropped store), centre of gravity, inertia;
            - "thrust": thrust of all engines, asymmetry, line of action, angular momentum;
            - "air": steady wind, wind shear, temperature;
            - "instruments": positions, of each sensor and of all accelerometers together, and axes.
        ground: altitude of the ground [m]; None if it is not known.

    Returns:
        The effects, all at zero gain; give them to `close_loop` as `effects`, together with
        `jaxid.effects.general_effects(model)`.

    Raises:
        InputError: for an unknown group.
    """
    require_known("group of effects", groups, GROUPS)
    model = canonical(model)
    names, signals = parameter_names(model), signals_of(model)
    terms = tuple(effect for effect in model.effects() if isinstance(effect, CoefficientTerm))
    affected = _affected_states(model, signals)
    makers: dict[str, Callable[[], Sequence[Effect]]] = {
        "coefficients": lambda: (
            *_coefficients(terms, affected, signals),
            *ground_effects(model, affected, ground),
        ),
        "unsteady": lambda: _unsteady(terms, affected, signals),
        "structure": lambda: _modes(affected, signals),
        "mass": lambda: mass_effects(names),
        "thrust": lambda: (
            *thrust(names, "thrust" in model.inputs),
            *all_engines(names, "up", "tilt of the thrust line", "rad"),
        ),
        "air": lambda: air_effects(names),
        "instruments": lambda: (
            *accelerometer_packages(names),
            *sensor_positions(names, instrument_entries(names, "position")),
            *sensor_misalignments(names, instrument_entries(names, "misalignment")),
        ),
    }
    return tuple(effect for group in groups for effect in makers[group]())


def signals_of(model: AbstractModel) -> frozenset[str]:
    """Return the names of the signals of a model.

    Args:
        model: any model.
    """
    empty = jnp.zeros(()), jnp.zeros(len(model.states)), jnp.zeros(len(model.inputs))
    return frozenset(jax.eval_shape(model.signals, *empty))


def _affected_states(model: AbstractModel, signals: Collection[str]) -> AffectedStates:
    """Return the states whose rates each coefficient changes, from the names of the signals."""
    affected = {
        name: tuple(state for state in model.states if f"{state}_per_{name}" in signals)
        for name in COEFFICIENTS
    }
    return {name: states for name, states in affected.items() if states}


# Coefficients -------------------------------------------------------------------------------------


def _coefficients(terms, affected: AffectedStates, signals: Collection[str]) -> tuple[Effect, ...]:
    rates = {name for products in RATE_TERMS.values() for name in products}
    varying = (*WITH_MACH, *MORE_WITH_MACH)
    by_signal = {
        "mach": varying,
        "qbar": (*varying, *WITH_QBAR),
        "altitude": tuple(dict.fromkeys((*WITH_ALTITUDE, *WITH_MACH))),
    }
    return (
        *(term for term in terms if term.product not in rates),
        *(
            gradient
            for signal, products in by_signal.items()
            if signal in signals
            for gradient in gradients(products, signal, affected)
        ),
    )


def ground_effects(
    model: AbstractModel, affected: AffectedStates, ground: float | None
) -> tuple[GroundEffect, ...]:
    """Return the ground effect in each coefficient that the angle of attack determines.

    Args:
        model: a model; without a span or an altitude the result is empty.
        affected: states whose rates each coefficient changes.
        ground: altitude of the ground [m]; None makes it a shape parameter.
    """
    if "b" not in parameter_names(model) or "altitude" not in signals_of(model):
        return ()
    span = float(read_parameters(model, ("b",))[0])
    at = {} if ground is None else {"known": True, "ground": jnp.asarray(float(ground))}
    return tuple(
        GroundEffect(in_coefficient(name, affected[name]), span, **at)
        for name in SEPARATION_COEFFICIENTS
        if name in affected
    )


def gradients(
    varying: Sequence[tuple[str, str]], signal: str, affected: AffectedStates
) -> tuple[Effect, ...]:
    """Return variations of terms with a signal.

    Args:
        varying: coefficient and product of each term.
        signal: signal with which the terms vary.
        affected: states whose rates each coefficient changes.
    """
    return tuple(
        CoefficientGradient(in_coefficient(name, affected[name]), signal, product)
        for name, product in varying
        if name in affected
    )


# Unsteady aerodynamics ----------------------------------------------------------------------------


def _unsteady(terms, affected: AffectedStates, signals: Collection[str]) -> tuple[Effect, ...]:
    rates = tuple(term for term in terms if term.product in RATE_TERMS.get(term.coefficient, ()))
    lagged = tuple(
        LaggedSignal(in_coefficient(name, affected[name]), angle)
        for angle, names in LAGGED.items()
        for name in names
        if name in affected and angle in signals
    )
    separated = separations(affected, (0.5, 0.6, 0.7, 0.8, 0.9), (0.5, 0.65, 0.8, 0.95))
    return (*rates, *lagged, *separated)


def rate_terms(affected: AffectedStates) -> tuple[CoefficientTerm, ...]:
    """Return terms with the rates of alpha and beta, `alphadot_hat in Cm` and so on.

    Args:
        affected: states whose rates each coefficient changes.
    """
    return tuple(
        CoefficientTerm(coefficient=name, product=product, affected_states=affected[name])
        for name, products in RATE_TERMS.items()
        for product in products
        if name in affected
    )


def separations(
    affected: AffectedStates, static: Sequence[float], lagging: Sequence[float]
) -> tuple[Effect, ...]:
    """Return models of separated flow with different initial angles of separation.

    Args:
        affected: states whose rates each coefficient changes; without CZ the result is empty.
        static, lagging: initial angles as fractions of the range of alpha, of the static model and
            of the model with a lag.
    """
    placements: tuple[Placement, ...] = tuple(
        in_coefficient(name, affected[name]) for name in SEPARATION_COEFFICIENTS if name in affected
    )
    if "CZ" not in affected:
        return ()
    return (
        *(StaticSeparation(placements, fraction) for fraction in static),
        *(Separation(placements, fraction) for fraction in lagging),
    )


def _modes(affected: AffectedStates, signals: Collection[str]) -> tuple[Effect, ...]:
    return tuple(
        Resonance(in_coefficient(name, affected[name]), surface)
        for surface, names in EXCITED_COEFFICIENTS.items()
        for name in names
        if name in affected and surface in signals
    )
