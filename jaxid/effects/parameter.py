"""Effects on parameters of the declared model: another value, a drift, or a step in time."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are
# none.
# pyright: reportCallIssue=false, reportArgumentType=false

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require_known
from .._foundation.location import Location, LocationKind
from .._foundation.types import Array, Float
from ..models.base import AbstractModel, canonical
from ..models.names import array_leaves, parameter_names, with_array_leaves
from .base import Effect, Signals, zero
from .card import EffectCard

# initial times of a step, as fractions of the training samples (chosen: evenly spaced)
STEP_FRACTIONS = (0.2, 0.4, 0.6, 0.8)


class ParameterEffect(Effect):
    """An offset of one parameter of the declared model, and of others in fixed proportion.

    Attributes:
        parameter: dotted name of one scalar, as returned by `jaxid.models.parameter_names`.
        linked: pairs of a further parameter and the factor on its offset.
        label: the parameter in words; its dotted name by default.
        unit: unit of the parameter and of the gain.
        gain: offset of the parameter, at its largest if it changes [unit of the parameter].
    """

    parameter: eqx.AbstractVar[str]
    linked: eqx.AbstractVar[tuple[tuple[str, float], ...]]
    label: eqx.AbstractVar[str]
    unit: eqx.AbstractVar[str]

    def amount(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Return the offset of the parameter at a time [unit of the parameter]."""
        raise NotImplementedError(
            f"{type(self).__name__} adds nothing: give it a method `amount(t)`."
        )

    @property
    def display_name(self) -> str:
        """The parameter in words."""
        return self.label or self.parameter

    def parameter_offsets(self, t):
        amount = self.amount(t)
        return {self.parameter: amount} | {name: factor * amount for name, factor in self.linked}


class ParameterShift(ParameterEffect):
    """Constant offset of a parameter of the declared model: `parameter + gain`.

    A free parameter needs no such effect: `not_free` removes it.

    Args:
        parameter: dotted name of one scalar.
        linked: pairs of a further parameter and the factor on its offset.
        label: the parameter in words.
        unit: unit of the gain.
        channel: output whose sensor has the parameter, if any; the effect then acts in that sensor.
    """

    parameter: str = eqx.field(static=True)
    linked: tuple[tuple[str, float], ...] = eqx.field(static=True, default=())
    label: str = eqx.field(static=True, default="")
    unit: str = eqx.field(static=True, default="")
    channel: str = eqx.field(static=True, default="")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        location = Location(LocationKind.PARAMETER, self.parameter)
        if self.channel:
            location = Location(LocationKind.SENSOR, self.channel)
        return EffectCard(
            name=f"shift of {self.display_name}",
            description=f"{self.display_name} differs from its declared value",
            location=location,
            unit=self.unit,
            signals=(self.channel,) if self.channel else (),
        )

    def amount(self, t):
        return self.gain


class ParameterDrift(ParameterEffect):
    """Linear drift of a parameter of the declared model: `parameter + gain (t - origin)/span`.

    Origin and span are taken from the times of the training records, so that the gain is the total
    change over them. The origin is the middle of these times, which suits a free parameter. For a
    parameter with a known initial value, such as the mass while fuel burns, it is their start
    (`from_start`); `not_free` moves it to the middle if the parameter is free.

    All records have the same line over time. Records that each begin at zero drift from the
    declared value one by one; records of one clock, such as the pieces of a flight, continue the
    drift.

    Args:
        parameter: dotted name of one scalar.
        linked: pairs of a further parameter and the factor on its offset.
        label: the parameter in words.
        unit: unit of the gain.
        from_start: True if the parameter has its declared value at the first training time.
        origin: time at which the parameter has its declared value [s].
        span: length of the time range [s].
    """

    parameter: str = eqx.field(static=True)
    linked: tuple[tuple[str, float], ...] = eqx.field(static=True, default=())
    label: str = eqx.field(static=True, default="")
    unit: str = eqx.field(static=True, default="")
    from_start: bool = eqx.field(static=True, default=False)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    origin: Float[Array, ""] = eqx.field(default_factory=zero)
    span: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.ones(()))

    @property
    def card(self):
        family = f"drift of {self.display_name}"
        name, start = family, ""
        if self.from_start:
            name, start = f"{family} from its declared value", " from its declared value on"
        return EffectCard(
            name=name,
            description=f"{self.display_name} drifts with time{start}",
            location=Location(LocationKind.PARAMETER, self.parameter),
            family=family,
            unit=self.unit,
            complexity=2,
            fixed=("origin", "span"),
        )

    def initialise_shape(self, signals, measured, step):
        low, high = np.min(signals["t"]), np.max(signals["t"])
        origin = low if self.from_start else 0.5 * (low + high)
        shape = jnp.asarray(origin), jnp.asarray(high - low if high > low else 1.0)
        return eqx.tree_at(lambda effect: (effect.origin, effect.span), self, shape)

    def amount(self, t):
        return self.gain * (t - self.origin) / self.span


class ParameterStep(ParameterEffect):
    """Smooth step of a parameter of the declared model.

        parameter + gain / (1 + exp(-(t - time)/width))

    The width is one sample interval: short enough to represent a sudden change, and long enough for
    fixed integration steps. The time is estimated once the effect is in the model.

    Args:
        parameter: dotted name of one scalar.
        fraction: initial time, as a quantile of the times of the training samples, so that it does
            not lie in a gap between two records.
        linked: pairs of a further parameter and the factor on its offset.
        label: the parameter in words.
        unit: unit of the gain.
        time: time of the step [s].
        width: time constant of the step [s].
    """

    parameter: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.5)
    linked: tuple[tuple[str, float], ...] = eqx.field(static=True, default=())
    label: str = eqx.field(static=True, default="")
    unit: str = eqx.field(static=True, default="")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    time: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.ones(()))

    @property
    def card(self):
        family = f"step of {self.display_name}"
        return EffectCard(
            name=f"{family} (from {self.fraction:.0%} of the time)",
            description=f"{self.display_name} changes suddenly",
            location=Location(LocationKind.PARAMETER, self.parameter),
            family=family,
            unit=self.unit,
            complexity=2,
            fixed=("width",),
        )

    def initialise_shape(self, signals, measured, step):
        shape = jnp.asarray(np.quantile(signals["t"], self.fraction)), jnp.asarray(step)
        return eqx.tree_at(lambda effect: (effect.time, effect.width), self, shape)

    def amount(self, t):
        return self.gain * jax.nn.sigmoid((t - self.time) / self.width)


def parameter_effects(
    model: AbstractModel, parameters: Sequence[str], moments: Sequence[float] = STEP_FRACTIONS
) -> tuple[ParameterEffect, ...]:
    """Return a shift, a drift from the declared value, and steps for each parameter.

    Args:
        model: the declared model, which has the units.
        parameters: dotted names of scalars.
        moments: initial times of the steps, as fractions of the training samples.

    Raises:
        InputError: if the model has no such parameter.
    """
    require_known("parameter", parameters, parameter_names(canonical(model)))
    units = model.units()
    effects: list[ParameterEffect] = []
    for name in parameters:
        unit = units.get(name, "")
        effects += [ParameterShift(name, unit=unit)]
        effects += [ParameterDrift(name, unit=unit, from_start=True)]
        effects += [ParameterStep(name, moment, unit=unit) for moment in moments]
    return tuple(effects)


def not_free(effects: Sequence[Effect], free: Sequence[str]) -> tuple[Effect, ...]:
    """Return the effects without shifts of free parameters.

    A drift or a step of a free parameter is kept, as it differs from a constant value. A drift from
    the declared value becomes one about the middle of the records, as the value at their start is
    free. A shift or a drift that moves further parameters is kept unchanged.

    Args:
        effects: candidates.
        free: names of free parameters.
    """
    left = []
    for effect in effects:
        own = isinstance(effect, ParameterEffect) and not effect.linked and effect.parameter in free
        if own and isinstance(effect, ParameterDrift):
            left.append(dataclasses.replace(effect, from_start=False))
        elif not (own and isinstance(effect, ParameterShift)):
            left.append(effect)
    return tuple(left)


def with_parameter_offsets(
    model: AbstractModel, additions: Mapping[str, Float[Array, ""]]
) -> AbstractModel:
    """Return the model with offsets added to some of its parameters.

    Args:
        model: any model.
        additions: offsets by dotted name of a scalar [unit of the parameter].

    Raises:
        InputError: if the model has no such parameter.
    """
    if not additions:
        return model
    model = canonical(model)
    names = parameter_names(model)
    require_known("parameter", additions, names)
    leaves = array_leaves(model)
    ends = np.cumsum([leaf.size for leaf in leaves])
    for name, addition in additions.items():
        position = names.index(name)
        number = int(np.searchsorted(ends, position, side="right"))
        leaf = leaves[number]
        # A constant unit vector compiles faster than a scatter; a scalar needs neither.
        unit = np.zeros(leaf.size)
        unit[position - ends[number]] = 1.0
        leaves[number] = leaf + (
            addition if leaf.ndim == 0 else addition * unit.reshape(leaf.shape)
        )
    return with_array_leaves(model, leaves)


def total_offsets(effects: Sequence[Effect], t: Float[Array, ""]) -> Signals:
    """Return the sum of all effects' offsets of the declared model's parameters at a time."""
    total: Signals = {}
    for effect in effects:
        for name, addition in effect.parameter_offsets(t).items():
            total[name] = total[name] + addition if name in total else addition
    return total
