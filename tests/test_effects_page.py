"""The tables of docs/effects.md are the ones that the cards of the effects give, with an entry for
every effect of the package.
"""

import importlib.util
import inspect
import re
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from jaxid import effects
from jaxid.effects import Effect, EffectCard, Location, LocationKind
from jaxid.loop.columns import own_parameters

DOCS = Path(__file__).resolve().parent.parent / "docs"
TEXT = (DOCS / "effects.md").read_text(encoding="utf-8")
COMMAND = "run `python docs/effect_tables.py`"


@pytest.fixture(scope="module")
def generator():
    spec = importlib.util.spec_from_file_location("effect_tables", DOCS / "effect_tables.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rows(text: str) -> dict[str, list[str]]:
    """Cells of each row of an effect, by the name of its class."""
    lines = re.findall(r"^\| `([A-Z]\w+)` (\|.*) \|$", text, re.MULTILINE)
    assert len(lines) == len(dict(lines)), "a class has two rows"
    return {name: cells.removeprefix("|").split("|") for name, cells in lines}


def concrete(kind: type) -> set[type]:
    """Final classes of effects in the package; those of other tests do not count."""
    below = set().union(*map(concrete, kind.__subclasses__()))
    # a module that a test runs under a name of the package does not count
    ours = kind.__module__.startswith("jaxid.") and kind.__module__ in sys.modules
    return below if below or not ours or inspect.isabstract(kind) else {kind}


class Sticking(Effect):
    """A planted effect: `d(v)/dt += gain |v|`, gain [m/s^2].

    Args:
        level: where it sets in [m/s].
    """

    gain: jax.Array = eqx.field(default_factory=lambda: jnp.zeros(()))
    level: jax.Array = eqx.field(default_factory=lambda: jnp.ones(()))
    card = EffectCard(
        name="|v| in v",
        description="the carriage sticks at |v|",
        location=Location(LocationKind.EQUATION, "v"),
        bounds={"level": (0.0, 2.5)},
    )


@pytest.fixture
def with_planted_effect(generator, monkeypatch):
    planted = generator.libraries() | {"planted": (Sticking(),)}
    monkeypatch.setattr(generator, "libraries", lambda: planted)
    return generator


def test_page_has_the_tables_that_the_cards_give(generator):
    assert generator.page(TEXT) == TEXT, COMMAND


def test_every_effect_of_the_package_has_an_entry(generator):
    exported = {getattr(effects, name) for name in effects.__all__} & concrete(Effect)
    tried = {type(one) for library in generator.libraries().values() for one in library}
    assert len(exported) > 20
    for classes in (exported, tried):
        missing = {kind.__name__ for kind in classes} - set(rows(TEXT))
        assert not missing, f"{COMMAND}, or give an example of these classes in it: {missing}"
    assert set(rows(TEXT)) == {kind.__name__ for kind in concrete(Effect)}


def test_every_parameter_that_is_estimated_is_named(generator):
    told = rows(TEXT)
    for library in generator.libraries().values():
        for effect in library:
            for own in own_parameters(effect)[1:]:
                shape = told[type(effect).__name__][4]
                assert f"`{own.rsplit('.', 1)[1]}`" in shape, own


def test_every_row_states_words_equation_and_unit_of_the_gain():
    for name, cells in rows(TEXT).items():
        _, _, equation, gain, _, _ = (cell.strip() for cell in cells)
        assert equation, f"the docstring of {name} begins without an equation"
        assert gain, f"the docstring of {name} states no unit: `gain: strength [N]`, `[1]` for none"


def test_a_new_effect_changes_the_page(with_planted_effect):
    changed = with_planted_effect.page(TEXT)
    assert changed != TEXT
    assert set(rows(changed)) == {*rows(TEXT), "Sticking"}
    bar = "&#124;"
    words, *others = (cell.strip() for cell in rows(changed)["Sticking"])
    assert words == f"<code>{bar}v{bar} in v</code>: the carriage sticks at {bar}v{bar}"
    assert others == [
        "equation",
        f"<code>d(v)/dt += gain {bar}v{bar}</code>",
        "m/s^2",
        "`level` from 0 to 2.5 [m/s]",
        "planted",
    ]


def test_another_card_changes_the_page(generator, monkeypatch):
    other = EffectCard(
        name="bias of y1", description="a tare", location=Location(LocationKind.SENSOR, "y1")
    )
    monkeypatch.setattr(effects.SensorBias, "card", other)
    assert "| `bias of y1`: a tare |" in generator.page(TEXT)


def test_an_effect_at_any_place_has_a_table(generator):
    marked = set(re.findall(r"<!-- effects: (\w+) -->", TEXT))
    places = {generator.SECTIONS.get(kind, generator.PARAMETERS) for kind in LocationKind}
    assert marked == places
