"""docs/effects.md names every effect of the package, and the parameters of each that are estimated
once it is in.
"""

import inspect
import re
import sys
from pathlib import Path

import jax.numpy as jnp

import jaxid
from jaxid import AbstractModel
from jaxid.aircraft import Aircraft, aircraft_effects, f4
from jaxid.effects import (
    CommonInputLag,
    CommonInputRateLimit,
    Effect,
    InputBias,
    InputHysteresis,
    InputScale,
    Placement,
    Saturation,
    parameter_effects,
)
from jaxid.loop.columns import own_parameters

PAGE = Path(__file__).resolve().parent.parent / "docs" / "effects.md"


class Rig(AbstractModel):
    """Two masses, driven by one force, seen by two instruments of one unit: a little of
    everything.
    """

    k: object
    states, inputs, outputs = ("x1", "v1", "x2", "v2"), ("force",), ("x1", "x2")

    def rhs(self, t, x, u):
        pull = self.k * (x[0] - x[2])
        return jnp.stack([x[1], u[0] - pull, x[3], pull])

    def output(self, t, x, u):
        return x[::2]

    def units(self):
        return {"x1": "m", "x2": "m"}


class Tank(AbstractModel):
    """A small model, which is offered bends and memory as well."""

    a: object
    states, inputs, outputs = ("h",), ("u",), ("h",)

    def rhs(self, t, x, u):
        return u - self.a * x

    def output(self, t, x, u):
        return x


def known() -> tuple[Effect, ...]:
    rig, tank = Rig(jnp.array(1.0)), Tank(jnp.array(1.0))
    of_inputs: tuple[Effect, ...] = (InputBias("u"), InputScale("u"), InputHysteresis("u"))
    of_inputs += tuple(kind(("u", "w"), "V") for kind in (CommonInputLag, CommonInputRateLimit))
    by_hand = (
        *of_inputs,
        Saturation(Placement.equation("h"), "h"),
        *parameter_effects(tank, ("a",)),
    )
    everything = aircraft_effects(Aircraft(f4()), ground=0.0)
    return (
        *jaxid.effects.general_effects(rig),
        *jaxid.effects.general_effects(tank),
        *by_hand,
        *everything,
    )


def rows() -> dict[str, str]:
    """All rows in which an effect is named, by its class."""
    found: dict[str, str] = {}
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        for name in re.findall(r"`(\w+)`", line.split("|")[1]) if line.startswith("| `") else ():
            found[name] = found.get(name, "") + line
    return found


def concrete(kind: type) -> set[str]:
    """Names of the final classes of effects in the package; those of other tests do not count."""
    below = [one for one in kind.__subclasses__() if _is_of_package(one)]
    own = {kind.__name__} if _is_of_package(kind) and not below else set()
    own = set() if inspect.isabstract(kind) else own
    return own.union(*map(concrete, below))


def _is_of_package(kind: type) -> bool:
    # a module that a test runs under a name of the package does not count
    return kind.__module__.startswith("jaxid.") and kind.__module__ in sys.modules


def test_every_effect_is_named_and_nothing_else():
    assert set(rows()) == concrete(Effect)


def test_every_parameter_that_is_estimated_is_named():
    told, pool = rows(), {type(effect).__name__: effect for effect in known()}
    assert set(pool) == set(told)
    for name, effect in pool.items():
        for own in own_parameters(effect)[1:]:
            assert f"`{own.rsplit('.', 1)[1]}`" in told[name], own
