"""The card of an effect: complete for every library effect, an error where it is missing."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import jaxid
from jaxid.aircraft.airframes import f4
from jaxid.aircraft.effects.library import aircraft_effects
from jaxid.aircraft.flight.aircraft import Aircraft
from jaxid.effects import (
    Effect,
    EffectCard,
    Hinge,
    InputDelay,
    InputHysteresis,
    LaggedSignal,
    Location,
    LocationKind,
    Placement,
    Resonance,
    Saturation,
    SensorDelay,
    StateLimit,
    Term,
)
from jaxid.effects.card import PRESENT
from jaxid.effects.parameter import parameter_effects

KINDS = {
    "bias of input u": (LocationKind.INPUT, "u"),
    "hysteresis of input u": (LocationKind.INPUT, "u"),
    "delay of y": (LocationKind.SENSOR, "y"),
    "cross-talk of y into w": (LocationKind.SENSOR, "w"),
    "x^2 in v": (LocationKind.EQUATION, "v"),
    "dead band of x in v": (LocationKind.EQUATION, "v"),
    "shift of k": (LocationKind.PARAMETER, "k"),
    "beta^2 in Cm": (LocationKind.COEFFICIENT, "Cm"),
    "shift of position of the sensor of alpha along x": (LocationKind.SENSOR, "alpha"),
}
MOTION = EffectCard(name="motion", description="words", location=Location(LocationKind.MODEL, ""))


class Oscillator(jaxid.AbstractModel):
    k: jax.Array
    states, inputs, outputs = ("x", "v"), ("u",), ("y", "w")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.k * x[1]])

    def output(self, t, x, u):
        return x

    def units(self):
        return {"y": "m", "w": "m"}


def library_effects() -> tuple[Effect, ...]:
    model = Oscillator(jnp.array(1.0))
    more = (
        InputHysteresis("u"),
        Saturation(Placement.equation("v"), "x"),
        jaxid.effects.InputBias("u"),
        StateLimit("x", "v"),
    )
    effects = (*jaxid.effects.general_effects(model), *more, *parameter_effects(model, ("k",)))
    return (*effects, *aircraft_effects(Aircraft(f4()), ground=0.0))


LIBRARY = library_effects()


@pytest.mark.parametrize(
    "kind", sorted({type(effect) for effect in LIBRARY}, key=lambda kind: kind.__name__)
)
def test_card_of_library_effect_holds_facts_of_right_types(kind):
    for effect in (other for other in LIBRARY if type(other) is kind):
        card = effect.card
        assert effect.name == card.name
        assert all(
            isinstance(text, str) and text for text in (card.name, card.description, card.family)
        )
        assert isinstance(card.unit, str)
        assert isinstance(card.refines, str)
        assert isinstance(card.location, Location)
        assert isinstance(card.location.kind, LocationKind)
        assert card.location.name
        assert isinstance(card.complexity, int)
        assert card.complexity >= 1
        assert isinstance(card.stage, int)
        assert all(isinstance(flag, bool) for flag in (card.unit_gain, card.repeatable))
        assert isinstance(card.initial_gain, float)
        arrays = {
            name
            for name in effect.__dataclass_fields__
            if eqx.is_inexact_array(getattr(effect, name))
        }
        assert {*card.fixed, *card.degenerate_at_bounds, *card.bounds} <= arrays
        assert all(
            isinstance(names, tuple)
            for names in (card.signals, card.fixed, card.degenerate_at_bounds)
        )
        assert all(float(low) <= float(high) for low, high in card.bounds.values())


def test_locations_of_library_effects_have_the_right_kind():
    locations = {effect.name: effect.card.location for effect in LIBRARY}
    assert {name: locations[name] for name in KINDS} == KINDS


@pytest.mark.parametrize(
    ("kind", "words", "label"),
    [
        ("EQUATION", "equation of v", "equation v"),
        ("COEFFICIENT", "coefficient v", "coefficient v"),
        ("INPUT", "input v", "input v"),
        ("SENSOR", "sensor v", "output v"),
        ("PARAMETER", "parameter v", "parameter v"),
        ("AIR", "air v", "air v"),
    ],
)
def test_location_prints_words_and_label(kind, words, label):
    location = Location(LocationKind[kind], "v")
    assert (str(location), location.label) == (words, label)
    assert str(Location(LocationKind.MODEL, "")) == "model"


def test_defaults_of_card_follow_from_name_and_unit_gain():
    assert MOTION.family == "motion"
    assert (MOTION.bounds, MOTION.degenerate_at_bounds) == ({}, ())
    facts = {"name": "lag", "description": "words", "location": MOTION.location, "unit_gain": True}
    lag = EffectCard(**facts, bounds={"time": (0.0, 1.0)})
    assert lag.bounds == {**PRESENT, "time": (0.0, 1.0)}
    assert lag.degenerate_at_bounds == ("gain",)
    assert EffectCard(**facts, bounds={"gain": (-1.0, 3.0)}).bounds == {"gain": (-1.0, 3.0)}


def test_card_is_only_public_fact_except_slots():
    slots = {
        "input_signal",
        "input",
        "parameter_offsets",
        "equations",
        "terms",
        "extra_states",
        "rates_of",
    }
    slots |= {"initial_extra_states", "extra_rates", "observe"}
    methods = {"neighbouring_shapes", "score_blind", "evident_in_data", "initialise_shape", "check"}
    public = {name for name in vars(Effect) if not name.startswith("_")}
    assert public == slots | methods | {"card", "name", "starts"}


def test_effect_without_card_is_refused_with_what_to_add():
    class Nameless(Effect):
        gain: jax.Array = eqx.field(default_factory=lambda: jnp.zeros(()))

    with pytest.raises(
        NotImplementedError,
        match=r"Nameless has no "
        r"card.*EffectCard\(name=.*location=",
    ):
        jaxid.Augmented(Oscillator(jnp.array(1.0)), (Nameless(),))


@pytest.mark.parametrize(
    "effect",
    [
        StateLimit("x", "v"),
        Hinge(Placement.equation("v"), "x"),
        LaggedSignal(Placement.equation("v"), "x"),
        Resonance(Placement.equation("v"), "u"),
        InputDelay("u"),
        SensorDelay("y"),
    ],
    ids=lambda effect: type(effect).__name__,
)
def test_card_of_traced_effect_has_the_same_names(effect):
    """Bounds and description of these effects depend on arrays."""
    cards = []
    eqx.filter_jit(lambda traced: cards.append(traced.card))(effect)
    (card,) = cards
    assert (card.name, card.family, card.location) == (
        effect.name,
        effect.card.family,
        effect.card.location,
    )
    assert list(card.bounds) == list(effect.card.bounds)


def test_sign_of_a_delay_is_described():
    gain = jnp.array(-0.1)
    assert (
        InputDelay("u", gain=gain).card.description
        == "the input u acts earlier than it is recorded"
    )
    assert SensorDelay("y", gain=gain).card.description == "the sensor of y is early"
    assert SensorDelay("y", gain=-gain).card.description == "the sensor of y is late"


def test_gain_is_not_in_the_name():
    assert Term("v", "x", gain=jnp.array(2.0)).name == Term("v", "x").name
