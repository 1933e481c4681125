"""The tables of docs/effects.md, from the cards and the docstrings of the effects.

`python docs/effect_tables.py` writes them into the page, between the lines
`<!-- effects: inputs -->` and `<!-- end of effects -->`, and so on for the other sections. Each
class is shown by one example, an effect of the default library of a small model or of an aircraft.
"""

import functools
import html
import inspect
import re
from collections.abc import Iterable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxid
from jaxid.aircraft import Aircraft, aircraft_effects, f4
from jaxid.effects import (
    Effect,
    LocationKind,
    Placement,
    Saturation,
    general_effects,
    parameter_effects,
)
from jaxid.loop.columns import own_parameters
from jaxid.report.equations import Formula, formulas
from jaxid.study.candidates import candidates

PAGE = Path(__file__).resolve().parent / "effects.md"
SECTIONS = {  # by the place of the example; every other place belongs to the parameters
    LocationKind.EQUATION: "equations",
    LocationKind.INPUT: "inputs",
    LocationKind.SENSOR: "outputs",
    LocationKind.COEFFICIENT: "coefficients",
}
PARAMETERS = "parameters"
COLUMNS = ("effect", "in a study", "place", "equation", "gain", "shape parameters", "library")
# Names of examples in place of the first effect of their class in the library.
EXAMPLES = ("x^2 in v", "alpha^2 in Cm", "upper saturation of y1", "upper limit of input u1")
BY_HAND = "by hand"
BLOCK = re.compile(r"(<!-- effects: (\w+) -->\n).*?(<!-- end of effects -->)", re.DOTALL)
ITEM = re.compile(r"^    (\w+(?:, \w+)*): (.*(?:\n     +.*)*)", re.MULTILINE)


class Pair(jaxid.AbstractModel):
    """Two states, two driven inputs of one unit, a recorded one, and two outputs of one unit."""

    a: jax.Array
    k: jax.Array
    states, inputs, outputs = ("x", "v"), ("u1", "u2", "w"), ("y1", "y2")

    def rhs(self, t, x, u):
        return jnp.stack([x[1] - self.a * x[0], u[0] + u[1] + u[2] - self.k * x[0]])

    def output(self, t, x, u):
        return x

    def actuated(self):
        return ("u1", "u2")

    def units(self):
        return {"u1": "N", "u2": "N", "y1": "m", "y2": "m"}


class Single(jaxid.AbstractModel):
    """One state and one input: small enough for all effects with memory."""

    a: jax.Array
    states, inputs, outputs = ("x",), ("u",), ("y",)

    def rhs(self, t, x, u):
        return u - self.a * x

    def output(self, t, x, u):
        return x


class Static(jaxid.AbstractModel):
    """A line through the origin: no states."""

    a: jax.Array
    states, inputs, outputs = (), ("u",), ("y",)

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return self.a * u


@functools.cache
def libraries() -> dict[str, tuple[Effect, ...]]:
    """Return the effects of each library, by its name in the page."""
    small, aircraft = jnp.array(1.0), Aircraft(f4())
    pair, single = Pair(small, small), Single(small)
    return {
        "general": (
            *candidates(pair, jaxid.free(pair, "a", "k")),
            *candidates(single, jaxid.free(single, "a")),
            *general_effects(Static(small)),
        ),
        BY_HAND: (*parameter_effects(single, ("a",)), Saturation(Placement.equation("x"), "x")),
        "aircraft": tuple(aircraft.effects()),
        "`aircraft_effects`": aircraft_effects(aircraft),
    }


def examples() -> dict[type[Effect], Effect]:
    """Return one effect of each class, sorted by the name of the class."""
    known = [effect for effects in libraries().values() for effect in effects]
    known.sort(key=lambda effect: effect.name not in EXAMPLES)
    first = {type(effect): effect for effect in reversed(known)}
    return dict(sorted(first.items(), key=lambda item: item[0].__name__))


def page(text: str) -> str:
    """Return the text of the page with its tables replaced."""
    return BLOCK.sub(lambda match: f"{match[1]}{_table(match[2])}\n{match[3]}", text)


def _table(section: str) -> str:
    rows = [
        _row(kind, effect)
        for kind, effect in examples().items()
        if SECTIONS.get(effect.card.location.kind, PARAMETERS) == section
    ]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (COLUMNS, ["---"] * 7, *rows))


def _row(kind: type[Effect], effect: Effect) -> list[str]:
    shown = {name: [e for e in all_ if type(e) is kind] for name, all_ in libraries().items()}
    every = [one for effects in shown.values() for one in effects]
    card = effect.card
    words = f"{code(card.name)}: {html.escape(card.description, quote=False)}"
    words += "; repeatable" * card.repeatable
    words += f"; refines {code(card.refines)}" * bool(card.refines)
    places = dict.fromkeys(one.card.location.kind.value for one in (effect, *every))
    names = [name for name, effects in shown.items() if effects]
    names = [name for name in names if name != BY_HAND] or names
    if "aircraft" in names:
        names = [name for name in names if name != "`aircraft_effects`"]
    return [
        f"`{kind.__name__}`",
        words.replace("|", "&#124;"),
        ", ".join(places),
        "<br>".join(map(_cell, formulas(kind))),
        _gain(effect),
        "<br>".join(_shapes(every)),
        ", ".join(names),
    ]


def code(text: str) -> str:
    """Return a text as code in a cell of a table, where a bar would end the cell."""
    if "|" not in text:
        return f"`{text}`"
    return f"<code>{html.escape(text, quote=False).replace('|', '&#124;')}</code>"


def _cell(formula: Formula) -> str:
    """Return a formula and the words after it as a part of a cell."""
    return " ".join(filter(None, (formula.formula and code(formula.formula), formula.words)))


def _gain(effect: Effect) -> str:
    """Return the unit and the bounds of the gain."""
    unit = _units(type(effect)).get("gain", effect.card.unit)
    bounds = _bounds(effect, "gain")
    if effect.card.unit_gain:
        return "0 or 1" + f" (bounds: {bounds})" * (bounds != ">= 0")
    return ", ".join(filter(None, (unit, bounds)))


def _shapes(effects: Iterable[Effect]) -> list[str]:
    """Return the shape parameters of effects of one class, with bounds and units."""
    found = {}
    for effect in effects:
        fields = [name.rpartition(".")[2] for name in own_parameters(effect)[1:]]
        for field in (*fields, *effect.card.by_record):
            unit = _units(type(effect)).get(field, "")
            parts = f"`{field}` {_bounds(effect, field)}".strip(), f"[{unit}]" if unit else ""
            record = ", by record" if field in effect.card.by_record else ""
            found.setdefault(field, " ".join(filter(None, parts)) + record)
    return list(found.values())


def _bounds(effect: Effect, field: str) -> str:
    """Return the bounds of a parameter in words; empty if it has none."""
    ends = effect.card.bounds.get(field, (-np.inf, np.inf))
    low, high = (_bound(effect, value) for value in ends)
    if low and high:
        return f"from {low} to {high}"
    return f">= {low}" if low else f"<= {high}" if high else ""


def _bound(effect: Effect, value) -> str:
    """Return one bound: the field that holds it, its value, or nothing."""
    held = [name for name in effect.card.fixed if getattr(effect, name) is value]
    if held:
        return f"`{held[0]}`"
    return f"{float(value):g}".replace("e-0", "e-") if np.isfinite(value) else ""


def _units(kind: type[Effect]) -> dict[str, str]:
    """Return the units in the docstrings of a class and its bases, by field."""
    units = {}
    for base in reversed(kind.__mro__):
        text = inspect.cleandoc(base.__doc__ or "") if issubclass(base, Effect) else ""
        items = [("gain", words) for words in re.findall(r"\bgain`? \[[^\]]+\]", text)]
        for names, words in (*items, *ITEM.findall(text)):
            brackets = re.findall(r"\[([^\]]+)\]", words)
            if brackets:
                units |= dict.fromkeys(names.split(", "), " ".join(brackets[-1].split()))
    return units


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
