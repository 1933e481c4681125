"""Effects on the parameters of the declared model: one that is not as declared, drifts with time, or changes at a moment."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are none.
# pyright: reportCallIssue=false, reportArgumentType=false

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require_known
from .._foundation.types import Array, Float
from .base import AbstractModel, canonical
from .effects import Effect, Signals, zero
from .names import array_leaves, parameter_names, with_array_leaves

MOMENTS = (0.2, 0.4, 0.6, 0.8)  # starts of the time of a change, within the records


class ParameterEffect(Effect):
    """Something that is added to one parameter of the declared model, and by fixed factors to others.

    Attributes:
        parameter: dotted name of one scalar, as `jaxid.models.parameter_names` has it.
        along: parameters that move with it, and by how many times as much.
        called: what it is in words; its dotted name by default.
        unit: of the parameter, and so of the gain.
    """

    parameter: eqx.AbstractVar[str]
    along: eqx.AbstractVar[tuple[tuple[str, float], ...]]
    called: eqx.AbstractVar[str]
    unit: eqx.AbstractVar[str]

    def amount(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """What is added to the parameter at a time [its unit]."""
        raise NotImplementedError(f"{type(self).__name__} adds nothing: give it a method `amount(t)`.")

    @property
    def what(self) -> str:
        """The parameter in words."""
        return self.called or self.parameter

    @property
    def place(self):
        return f"parameter {self.parameter}"

    def declared(self, t):
        amount = self.amount(t)
        return {self.parameter: amount} | {name: factor * amount for name, factor in self.along}


class ParameterShift(ParameterEffect):
    """A parameter of the declared model is another one: `parameter + gain`.

    A parameter that is free needs no such effect: `not_free` leaves it out.

    Args:
        parameter: dotted name of one scalar.
        along: parameters that move with it, and by how many times as much.
        called: what it is in words.
        unit: of the gain.
        channel: the output whose sensor the parameter belongs to, if any: that is where it acts.
    """

    parameter: str = eqx.field(static=True)
    along: tuple[tuple[str, float], ...] = eqx.field(static=True, default=())
    called: str = eqx.field(static=True, default="")
    unit: str = eqx.field(static=True, default="")
    channel: str = eqx.field(static=True, default="")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"shift of {self.what}"

    @property
    def place(self):
        return f"sensor {self.channel}" if self.channel else f"parameter {self.parameter}"

    @property
    def signals_used(self):
        return (self.channel,) if self.channel else ()

    @property
    def sentence(self):
        return f"{self.what} is not the declared one"

    def amount(self, t):
        return self.gain


class ParameterDrift(ParameterEffect):
    """A parameter of the declared model drifts with time: `parameter + gain (t - middle)/span`.

    Middle and span are those of the training records' time, so that the gain is the whole change over them.

    Args:
        parameter: dotted name of one scalar.
        along: parameters that move with it, and by how many times as much.
        called: what it is in words.
        unit: of the gain.
    """

    parameter: str = eqx.field(static=True)
    along: tuple[tuple[str, float], ...] = eqx.field(static=True, default=())
    called: str = eqx.field(static=True, default="")
    unit: str = eqx.field(static=True, default="")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    middle: Float[Array, ""] = eqx.field(default_factory=zero)
    span: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.ones(()))

    @property
    def name(self):
        return f"drift of {self.what}"

    @property
    def sentence(self):
        return f"{self.what} drifts with time"

    @property
    def complexity(self):
        return 2

    @property
    def fixed(self):
        return ("middle", "span")

    def start(self, signals, measured, step):
        low, high = np.min(signals["t"]), np.max(signals["t"])
        shape = jnp.asarray(0.5 * (low + high)), jnp.asarray(high - low if high > low else 1.0)
        return eqx.tree_at(lambda effect: (effect.middle, effect.span), self, shape)

    def amount(self, t):
        return self.gain * (t - self.middle) / self.span


class ParameterStep(ParameterEffect):
    """A parameter of the declared model changes at a moment: `parameter + gain / (1 + exp(-(t - time)/width))`.

    The width is one step between samples, short enough for a drop and long enough for a fixed step. The time is estimated once
    the effect is in.

    Args:
        parameter: dotted name of one scalar.
        fraction: where the time starts, as a fraction of the training records' samples: between two records there are none.
        along: parameters that move with it, and by how many times as much.
        called: what it is in words.
        unit: of the gain.
    """

    parameter: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.5)
    along: tuple[tuple[str, float], ...] = eqx.field(static=True, default=())
    called: str = eqx.field(static=True, default="")
    unit: str = eqx.field(static=True, default="")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    time: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.ones(()))

    @property
    def name(self):
        return f"{self.family} (from {self.fraction:.0%} of the time)"

    @property
    def family(self):
        return f"step of {self.what}"

    @property
    def sentence(self):
        return f"{self.what} changes at a moment"

    @property
    def complexity(self):
        return 2

    @property
    def fixed(self):
        return ("width",)

    def start(self, signals, measured, step):
        shape = jnp.asarray(np.quantile(signals["t"], self.fraction)), jnp.asarray(step)
        return eqx.tree_at(lambda effect: (effect.time, effect.width), self, shape)

    def amount(self, t):
        return self.gain * jax.nn.sigmoid((t - self.time) / self.width)


def parameter_effects(
    model: AbstractModel, parameters: Sequence[str], moments: Sequence[float] = MOMENTS
) -> tuple[ParameterEffect, ...]:
    """Each parameter as one that is not as declared, drifts, or changes at a moment.

    Args:
        model: the declared model, which says the units.
        parameters: dotted names of scalars.
        moments: where the time of a change starts, as fractions of the records' time.

    Raises:
        InputError: when the model has no such parameter.
    """
    require_known("parameter", parameters, parameter_names(canonical(model)))
    units = model.units()
    effects: list[ParameterEffect] = []
    for name in parameters:
        unit = units.get(name, "")
        effects += [ParameterShift(name, unit=unit), ParameterDrift(name, unit=unit)]
        effects += [ParameterStep(name, moment, unit=unit) for moment in moments]
    return tuple(effects)


def not_free(effects: Sequence[Effect], free: Sequence[str]) -> tuple[Effect, ...]:
    """The effects without those that shift a parameter which is free anyway.

    A drift or a step of a free parameter stays: it is another thing than its value. So does a shift that takes other parameters
    along.

    Args:
        effects: candidates.
        free: names of free parameters.
    """
    return tuple(
        effect
        for effect in effects
        if not (isinstance(effect, ParameterShift) and not effect.along and effect.parameter in free)
    )


def shifted(model: AbstractModel, additions: Mapping[str, Float[Array, ""]]) -> AbstractModel:
    """The model with something added to some of its parameters.

    Args:
        model: any.
        additions: by dotted name of one scalar [its unit].

    Raises:
        InputError: when the model has no such parameter.
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
        # One element of a constant, not a scatter: it compiles faster, and a scalar needs neither.
        unit = np.zeros(leaf.size)
        unit[position - ends[number]] = 1.0
        leaves[number] = leaf + (addition if leaf.ndim == 0 else addition * unit.reshape(leaf.shape))
    return with_array_leaves(model, leaves)


def all_additions(effects: Sequence[Effect], t: Float[Array, ""]) -> Signals:
    """What all effects together add to the declared model's parameters at a time."""
    total: Signals = {}
    for effect in effects:
        for name, addition in effect.declared(t).items():
            total[name] = total[name] + addition if name in total else addition
    return total
