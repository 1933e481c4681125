"""`Augmented`: any model with effects added to it, the only wrapper there is for them."""

import itertools
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require_unique
from .._foundation.types import Array, Float
from ..data.record import Record
from .base import AbstractModel
from .effects import Effect
from .effects_sensor import SensorEffect, alike, read_together
from .polynomial import monomials


class Augmented(AbstractModel):
    """A model and a set of effects.

    Effects stand in the order of their names, so that the structure depends on the set alone. With all gains zero the
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
        self.effects_in = tuple(sorted(effects, key=lambda effect: effect.name))
        require_unique("effect", (effect.name for effect in effects))
        self.states = model.states + sum((effect.extra_states for effect in self.effects_in), ())
        require_unique("state", self.states)
        self.inputs, self.outputs = model.inputs, model.outputs

    def rhs(self, t, x, u):
        own, extra, acting = self._take_apart(x, u)
        rates, signals = self.model.rhs_and_signals(t, own, acting)
        signals = signals | extra
        rates = rates + self._terms(signals)
        dx = dict(zip(self.model.states, rates, strict=True))
        recorded = dict(zip(self.inputs, u, strict=True))
        for effect in self.effects_in:
            for state, addition in effect.equations(dx, signals).items():
                dx[state] = dx[state] + addition
        for effect in self.effects_in:
            dx |= effect.extra_rates(extra, recorded, signals)
        return jnp.stack([dx[state] for state in self.states])

    def _terms(self, signals) -> Float[Array, " own_state"]:
        """What all effects that are single terms add to the model's own equations."""
        single = [(effect.gain, *term) for effect in self.effects_in for term in effect.terms]
        if not single:
            return jnp.zeros(len(self.model.states))
        gains, states, products = zip(*single, strict=True)
        belongs = np.array([[state == name for state in states] for name in self.model.states], float)
        return jnp.asarray(belongs) @ (jnp.stack(gains) * monomials(products, signals))

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        own, _, acting = self._take_apart(x, u)
        return self.model.output_given(t, own, acting, dx[: own.size])

    def _take_apart(self, x, u):
        """The model's own state, the effects' states by name, and the input that acts on the plant."""
        own = x[: len(self.model.states)]
        extra = dict(zip(self.states[own.size :], x[own.size :], strict=True))
        for effect in self.effects_in:
            u = effect.input(u, extra, self.inputs)
        return own, extra, u

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
        return jnp.concatenate([own, jnp.zeros(len(self.states) - own.size)])

    def signals(self, t, x, u):
        own, extra, acting = self._take_apart(x, u)
        return self.model.signals(t, own, acting) | extra

    def input_path(self, path):
        path = self.model.input_path(path)
        for effect in self.effects_in:
            path = effect.input_path(path, self.inputs)
        return path

    def prepared(self, record: Record) -> Record:
        return self.model.prepared(record)

    def pseudo_measurements(self, record: Record):
        return self.model.pseudo_measurements(record)

    def effects(self):
        return self.model.effects()

    def equations_with_terms(self):
        return self.model.equations_with_terms()

    def units(self):
        return self.model.units()
