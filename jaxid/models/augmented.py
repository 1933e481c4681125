"""`Augmented`: any model with effects added to it, the only wrapper there is for them."""

import itertools
from collections.abc import Collection, Iterable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require_known, require_unique
from .._foundation.types import Array, Float
from ..data.record import Record
from .base import AbstractModel, equations_of
from .differences import with_differences
from .effects import Effect
from .effects_parameter import all_additions, shifted
from .effects_sensor import SensorEffect, alike, read_together
from .polynomial import monomials


class Augmented(AbstractModel):
    """A model and a set of effects.

    Effects stand in the order of their stages and names, so that the structure depends on the set alone. With all gains zero the
    augmented model is the model. What effects add to the equations is seen by instruments that feel the state's rate
    (`AbstractModel.output_given`). Parameters keep the names they have in the model; those of an effect are called
    `<effect>.gain` and so on.

    Args:
        model: the declared model.
        effects: what may be missing in it; names must differ.

    Raises:
        InputError: when two effects, or an effect's extra state and a state, have the same name.
    """

    model: AbstractModel
    effects_in: tuple[Effect, ...]
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("model", "effects_in")

    def __init__(self, model: AbstractModel, effects: tuple[Effect, ...]):
        self.model = model
        self.effects_in = tuple(sorted(effects, key=lambda effect: (effect.stage, effect.name)))
        require_unique("effect", (effect.name for effect in effects))
        self.states = model.states + sum((effect.extra_states for effect in self.effects_in), ())
        require_unique("state", self.states)
        self.inputs, self.outputs = model.inputs, model.outputs

    def only(self, names: Collection[str]) -> "Augmented":
        """The model with some of its effects and no other."""
        return Augmented(self.model, tuple(effect for effect in self.effects_in if effect.name in names))

    def rhs(self, t, x, u):
        own, extra, arriving, acting = self._take_apart(x, u)
        rates, signals = self._declared(t).rhs_and_signals(t, own, acting)
        signals = self._with_differences(signals | extra)
        dx = self._added(rates, signals) if self._in_motion else dict(zip(self.model.states, rates, strict=True))
        moving = dx | self._rates_of_signals(t, own, acting, dx)
        for effect, arrived in zip(self.effects_in, arriving, strict=True):
            if effect.extra_states:
                dx |= effect.extra_rates(extra, dict(zip(self.inputs, arrived, strict=True)), signals, moving)
        return jnp.array([dx[state] for state in self.states], float)

    @property
    def _in_motion(self) -> bool:
        """Whether effects in equations add to rates of states; of a model without states to its outputs."""
        return equations_of(self.model) == self.model.states

    def _added(self, values: Float[Array, " equation"], signals) -> dict[str, Float[Array, ""]]:
        """The model's own equations with what all effects add to them."""
        found = dict(zip(equations_of(self.model), values + self._terms(signals), strict=True))
        for effect in self.effects_in:
            for name, addition in effect.equations(found, signals).items():
                found[name] = found[name] + addition
        return found

    def _rates_of_signals(self, t, own, acting, dx):
        """Rates of the signals that effects ask for and that are no states, by the chain rule from those of the states."""
        asked = sorted({name for effect in self.effects_in for name in effect.rates_of} - set(self.model.states))
        if not asked:
            return {}

        def signals(t, x):
            found = self._declared(t).immediate_signals(t, x, acting)
            require_known("signal with a rate", asked, [name for name in found if name not in self.inputs])
            return {name: found[name] for name in asked}

        return jax.jvp(signals, (t, own), (jnp.ones(()), jnp.stack([dx[state] for state in self.model.states])))[1]

    def _terms(self, signals) -> Float[Array, " equation"]:
        """What all effects that are single terms add to the model's own equations."""
        names = equations_of(self.model)
        single = [(effect.gain, *term) for effect in self.effects_in for term in effect.terms]
        if not single:
            return jnp.zeros(len(names))
        gains, equations, products = zip(*single, strict=True)
        belongs = np.array([[equation == name for equation in equations] for name in names], float)
        return jnp.asarray(belongs) @ (jnp.stack(gains) * monomials(products, signals))

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        own, extra, _, acting = self._take_apart(x, u)
        y = self._declared(t).output_given(t, own, acting, dx[: own.size])
        if self._in_motion:
            return y
        signals = self._with_differences(self._declared(t).signals(t, own, acting) | extra)
        return jnp.stack(list(self._added(y, signals).values()))

    def _declared(self, t) -> AbstractModel:
        """The declared model, with what effects add to its parameters."""
        return shifted(self.model, all_additions(self.effects_in, t))

    def _take_apart(self, x, u):
        """The model's own state, the effects' states by name, the input as each effect finds it, and as the plant does."""
        own = x[: len(self.model.states)]
        extra = dict(zip(self.states[own.size :], x[own.size :], strict=True))
        arriving = []
        for effect in self.effects_in:
            arriving.append(u)
            u = effect.input(u, extra, self.inputs)
        return own, extra, arriving, u

    def observe(self, t, y):
        y = self.model.observe(t, y)
        for kind, members in itertools.groupby(self.effects_in, alike):
            group = tuple(members)
            sensors = tuple(effect for effect in group if isinstance(effect, SensorEffect))
            if kind is not None:  # computed as one, as the order by names brings them together
                y = read_together(sensors, t, y, self.outputs)
            else:
                for effect in group:
                    y = effect.observe(t, y, self.outputs)
        return y

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        own = self.model.initial_state(record)
        known = {state: value for effect in self.effects_in for state, value in effect.initial(record).items()}
        extra = [jnp.asarray(known.get(state, 0.0), float) for state in self.states[own.size :]]
        return jnp.concatenate([own, jnp.stack(extra)]) if extra else own

    def signals(self, t, x, u):
        own, extra, _, acting = self._take_apart(x, u)
        return self._with_differences(self._declared(t).signals(t, own, acting) | extra)

    def _with_differences(self, signals):
        """Signals and those differences of them of which effects are made."""
        return with_differences(signals, (name for effect in self.effects_in for name in effect.signals_used))

    def input_path(self, path):
        path = self.model.input_path(path)
        for effect in self.effects_in:
            path = effect.input_path(path, self.inputs)
        return path

    def prepared(self, record: Record) -> Record:
        return self.model.prepared(record)

    def pseudo_measurements(self, record: Record):
        return self.model.pseudo_measurements(record)

    def gusty(self):
        return Augmented(self.model.gusty(), self.effects_in)

    def effects(self):
        return self.model.effects()

    def equations(self):
        return self.states if taken_apart(self)[0].states else self.outputs

    def equations_with_terms(self):
        return self.model.equations_with_terms()

    def actuated(self):
        return self.model.actuated()

    def units(self):
        gains = {f"{effect.name}.gain": effect.unit for effect in self.effects_in if effect.unit}
        return self.model.units() | gains


def taken_apart(model: AbstractModel) -> tuple[AbstractModel, tuple[Effect, ...]]:
    """The model that holds no effects, and all that were added to it, however often."""
    effects: tuple[Effect, ...] = ()
    while isinstance(model, Augmented):
        model, effects = model.model, (*effects, *model.effects_in)
    return model, effects


def not_in(model: AbstractModel, effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """The effects of which a model holds none of the family yet; of those that can act several times over, not the same."""
    known = taken_apart(model)[1]
    names, families = {one.name for one in known}, {one.family for one in known if not one.several}
    return tuple(one for one in effects if one.name not in names and one.family not in families)
