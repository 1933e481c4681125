"""`Augmented`: a model with effects added to it."""

from collections.abc import Callable, Collection, Iterable
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require_known, require_unique
from .._foundation.host import to_device
from .._foundation.types import Array, Bool, Float
from ..data.record import INITIAL_STATE, Record
from ..models.base import AbstractModel, equations_of
from ..models.polynomial import sums_of_monomials
from ..models.signal_dependence import with_differences
from ..models.wrapper import AbstractWrapper
from .base import Effect
from .parameter import total_offsets, with_parameter_offsets
from .present import Group, acts_in, groups_of
from .sensor import SensorEffect, apply_together, vectorisation_key


class _SplitState(NamedTuple):
    """State and input of an augmented model, split.

    Attributes:
        state: state of the model without effects.
        extra: states of the effects, by name.
        effect_inputs: input of each effect with states, after the effects before it, by its name.
        plant_input: input that the plant receives, after all effects.
    """

    state: Float[Array, " state"]
    extra: dict[str, Float[Array, ""]]
    effect_inputs: dict[str, Float[Array, " input"]]
    plant_input: Float[Array, " input"]


class Augmented(AbstractWrapper):
    """A model and a set of effects.

    Effects are sorted by stage and name, so that the structure depends on the set alone. With all
    gains zero the augmented model equals the model. Outputs that depend on state derivatives, such
    as accelerometers, include the terms that effects add to the equations
    (`AbstractModel.output_given`). Parameters of the model keep their names; the parameters of an
    effect are called `<effect>.gain` and so on.

    A search holds its whole library in one model, for which it compiles once, and names the effects
    that are present in each evaluation (`with_present`); the others are skipped, group by group.
    Their states stay where they begin.

    Args:
        model: the declared model.
        effects: effects that the model may lack; names must differ.
        present: for each effect, in the order of `effects_in`, True if it is evaluated; by default
            all are.

    Raises:
        InputError: if two effects, or an effect's extra state and a state, have the same name.
    """

    model: AbstractModel
    effects_in: tuple[Effect, ...]
    present: Bool[Array, " effect"] | None
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    arguments: tuple[str, ...] = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("model", "effects_in")

    def __init__(
        self,
        model: AbstractModel,
        effects: tuple[Effect, ...],
        present: Bool[Array, " effect"] | None = None,
    ):
        self.model, self.present = model, present
        self.effects_in = tuple(
            sorted(effects, key=lambda effect: (effect.card.stage, effect.name))
        )
        require_unique("effect", (effect.name for effect in effects))
        self.states = model.states + sum((effect.extra_states for effect in self.effects_in), ())
        require_unique("state", self.states)
        self.inputs, self.outputs = model.inputs, model.outputs
        cards = [effect.card for effect in self.effects_in]
        self.names = tuple(card.name for card in cards)
        self.arguments = tuple(sorted({name for card in cards for name in card.signals}))

    def only(self, names: Collection[str]) -> "Augmented":
        """Return the model with the named effects only."""
        return Augmented(
            self.model, tuple(effect for effect in self.effects_in if effect.name in names)
        )

    def with_present(self, names: Collection[str]) -> "Augmented":
        """Return the same model, in which only the named effects are evaluated.

        Args:
            names: names of the effects that are present.

        Raises:
            InputError: if the model has no effect of one of these names.
        """
        require_known("effect of the model", names, self.names)
        present = to_device(np.isin(self.names, [*names]))
        return eqx.tree_at(
            lambda node: node.present, self, present, is_leaf=lambda leaf: leaf is None
        )

    def _groups(self, chosen: Callable[[Effect], bool], key=None) -> list[Group]:
        """Return groups of effects (`groups_of`)."""
        return groups_of(self.effects_in, self.present, chosen, key)

    def rhs(self, t, x, u):
        state, extra, effect_inputs, plant_input = self._split_state(x, u)
        rates, signals = self._declared(t).rhs_and_signals(t, state, plant_input)
        signals = self._with_differences(signals | extra)
        dx = (
            self._added(rates, signals)
            if self._has_state_equations
            else dict(zip(self.model.states, rates, strict=True))
        )
        extra_rates = {}
        for group in self._groups(lambda effect: bool(effect.extra_states)):

            def rates_of(effects=group.effects):
                known = dx | self._rates_of_signals(effects, t, state, plant_input, dx)
                rates = {}
                for effect in effects:
                    effect_input = dict(zip(self.inputs, effect_inputs[effect.name], strict=True))
                    rates |= effect.extra_rates(extra, effect_input, signals, known)
                return [jnp.asarray(rates[name], float) for name in _states_of(effects)]

            def zeros(effects=group.effects):
                return [jnp.zeros(()) for _ in _states_of(effects)]

            names = _states_of(group.effects)
            extra_rates |= dict(zip(names, group.apply(rates_of, zeros), strict=True))
        dx |= extra_rates
        return jnp.array([dx[name] for name in self.states], float)

    @property
    def _has_state_equations(self) -> bool:
        """True if effects in equations add to state derivatives, and not to outputs."""
        return equations_of(self.model) == self.model.states

    def _added(self, values: Float[Array, " equation"], signals) -> dict[str, Float[Array, ""]]:
        """Return the values of the model's equations plus the terms of all effects, by equation."""
        total = dict(zip(equations_of(self.model), values + self._terms(signals), strict=True))
        for group in self._groups(acts_in("equations")):

            def added(total, members=group.effects):
                for effect in members:
                    for name, addition in effect.equations(total, signals).items():
                        total = total | {name: total[name] + addition}
                return total

            total = group.apply(added, lambda total: total, total)
        return total

    def _rates_of_signals(self, effects: tuple[Effect, ...], t, state, plant_input, dx):
        """Return the rates of the signals in `rates_of` of some effects that are not states.

        They follow from the rates of the states by the chain rule.
        """
        requested = sorted(
            {name for effect in effects for name in effect.rates_of} - set(self.model.states)
        )
        if not requested:
            return {}

        def signals(t, x):
            values = self._declared(t).immediate_signals(t, x, plant_input)
            known = [name for name in values if name not in self.inputs]
            require_known("signal with a rate", requested, known)
            return {name: values[name] for name in requested}

        state_rates = jnp.stack([dx[name] for name in self.model.states])
        return jax.jvp(signals, (t, state), (jnp.ones(()), state_rates))[1]

    def _terms(self, signals) -> Float[Array, " equation"]:
        """Return the sum of all monomial effects (`Effect.terms`), by equation of the model."""
        names = equations_of(self.model)
        total = jnp.zeros(len(names))
        for group in self._groups(lambda effect: bool(effect.terms)):
            terms = [(effect.gain, *term) for effect in group.effects for term in effect.terms]

            def added(total, terms=terms):
                gains, equations, products = zip(*terms, strict=True)
                rows = [[equation == name for equation in equations] for name in names]
                gains = jnp.stack(gains)
                return total + sums_of_monomials(np.array(rows, float), gains, products, signals)

            total = group.apply(added, lambda total: total, total)
        return total

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        state, extra, _, plant_input = self._split_state(x, u)
        y = self._declared(t).output_given(t, state, plant_input, dx[: state.size])
        if self._has_state_equations:
            return y
        signals = self._with_differences(self._declared(t).signals(t, state, plant_input) | extra)
        return jnp.stack(list(self._added(y, signals).values()))

    def _declared(self, t) -> AbstractModel:
        """Return the declared model with the parameter offsets of the effects."""
        return with_parameter_offsets(self.model, total_offsets(self.effects_in, t))

    def _split_state(self, x, u) -> _SplitState:
        """Return the parts of the augmented state, and the input after the effects."""
        state = x[: len(self.model.states)]
        extra = dict(zip(self.states[state.size :], x[state.size :], strict=True))
        effect_inputs = {}
        for group in self._groups(acts_in("input", "extra_states")):

            def passed(u, members=group.effects):
                inputs = {}
                for effect in members:
                    if effect.extra_states:
                        inputs[effect.name] = u
                    u = effect.input(u, extra, self.inputs)
                return u, inputs

            def unchanged(u, members=group.effects):
                return u, {effect.name: u for effect in members if effect.extra_states}

            u, inputs = group.apply(passed, unchanged, u)
            effect_inputs |= inputs
        return _SplitState(state, extra, effect_inputs, u)

    def observe(self, t, y):
        y = self.model.observe(t, y)
        # the order by names makes sensors of one kind neighbours
        for group in self._groups(acts_in("observe"), vectorisation_key):

            def observed(y, members=group.effects):
                if vectorisation_key(members[0]) is not None:
                    sensors = tuple(e for e in members if isinstance(e, SensorEffect))
                    return apply_together(sensors, t, y, self.outputs)
                for effect in members:
                    y = effect.observe(t, y, self.outputs)
                return y

            y = group.apply(observed, lambda y: y, y)
        return y

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        state = self.model.initial_state(record)
        known = {
            name: value
            for effect in self.effects_in
            for name, value in effect.initial_extra_states(record).items()
        }
        extra = [jnp.asarray(known.get(name, 0.0), float) for name in self.states[state.size :]]
        return jnp.concatenate([state, jnp.stack(extra)]) if extra else state

    def signals(self, t, x, u):
        state, extra, _, plant_input = self._split_state(x, u)
        return self._with_differences(self._declared(t).signals(t, state, plant_input) | extra)

    def _with_differences(self, signals):
        """Return the signals and the differences of signals that are arguments of effects."""
        return with_differences(signals, self.arguments)

    def input_signal(self, path):
        path = self.model.input_signal(path)
        for effect in self.effects_in:
            path = effect.input_signal(path, self.inputs)
        return path

    def with_disturbance_inputs(self):
        return Augmented(self.model.with_disturbance_inputs(), self.effects_in, self.present)

    def sensor_errors(self):
        """None: an effect may be another error of a sensor; name them all."""
        return ()

    def corrected(self, record):
        """Refused: the model inside does not correct the errors that are effects."""
        return AbstractModel.corrected(self, record)

    def equations(self):
        return self.states if split_effects(self)[0].states else self.outputs

    def units(self):
        cards = (effect.card for effect in self.effects_in)
        gains = {f"{card.name}.gain": card.unit for card in cards if card.unit}
        return self.model.units() | gains


def _states_of(effects: tuple[Effect, ...]) -> tuple[str, ...]:
    return tuple(name for effect in effects for name in effect.extra_states)


def split_effects(model: AbstractModel) -> tuple[AbstractModel, tuple[Effect, ...]]:
    """Return the model without effects, and the effects of all nested `Augmented` models."""
    effects: tuple[Effect, ...] = ()
    while isinstance(model, Augmented):
        model, effects = model.model, (*effects, *model.effects_in)
    return model, effects


def starts_of(model: AbstractModel) -> tuple[str, ...]:
    """Return the names of the parameters that state how a record begins: the initial state, and
    the memory of the effects of the model (`EffectCard.by_record`).
    """
    states = tuple(f"{INITIAL_STATE}.{state}" for state in model.states)
    remembered = (name for effect in split_effects(model)[1] for name in effect.starts)
    return tuple(dict.fromkeys((*states, *remembered)))


def absent_effects(model: AbstractModel, effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """Return the effects whose family is not yet in the model.

    For repeatable effects only the same name is excluded.
    """
    cards = [effect.card for effect in split_effects(model)[1]]
    names = {card.name for card in cards}
    families = {card.family for card in cards if not card.repeatable}
    return tuple(
        effect
        for effect in effects
        if effect.name not in names and effect.card.family not in families
    )
