"""General effects in the equations of motion: polynomial terms, friction, a limit of a state that spills into another."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are none.
# pyright: reportCallIssue=false

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float
from .effects import Effect, zero
from .polynomial import factor_of, factors, next_powers, signals_in
from .starts import level_in

FASTEST = 2.0  # of a rate times the step between samples: the classical Runge-Kutta method is stable to 2.78


class Term(Effect):
    """A monomial in one state equation: `d(state)/dt += gain * product`; in a model without states, in an output.

    Args:
        state: the equation; of a model without states the output.
        product: a product of powers of signals, such as `"x^2 v"`, or `"1"` for a constant.
    """

    state: str = eqx.field(static=True)
    product: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"{self.product} in {self.state}"

    @property
    def place(self):
        return f"equation of {self.state}"

    @property
    def sentence(self):
        what = "a constant" if self.product == "1" else self.product
        return f"{what} in the equation of {self.state}"

    @property
    def signals_used(self):
        return signals_in((self.product,))

    @property
    def complexity(self):
        return max(1, sum(power for _, power in factors(self.product)))

    @property
    def terms(self):
        return ((self.state, self.product),)

    def kin(self):
        raised = tuple(dataclasses.replace(self, product=one, gain=zero()) for one in next_powers(self.product))
        cube_of_its_own = factors(self.product) == factors(f"{self.state}^3")
        return (*raised, QuadraticDrag(state=self.state, speed=self.state)) if cube_of_its_own else raised


class DryFriction(Effect):
    """Dry (Coulomb) friction: `d(state)/dt += gain * tanh(speed / width)`, a smoothed sign of a speed.

    The width is one hundredth of the speed's largest value on the training records, narrow enough to leave the friction
    constant and wide enough for a fixed step.

    Args:
        state: the equation.
        speed: the signal whose sign counts.
    """

    state: str = eqx.field(static=True)
    speed: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.ones(()))

    @property
    def name(self):
        return f"sign({self.speed}) in {self.state}"

    @property
    def place(self):
        return f"equation of {self.state}"

    @property
    def sentence(self):
        return f"dry (Coulomb) friction: the sign of {self.speed} in the equation of {self.state}"

    @property
    def signals_used(self):
        return (self.speed,)

    @property
    def complexity(self):
        return 2  # as drag: neither is the simpler thing to believe

    @property
    def fixed(self):
        return ("width",)

    def start(self, signals, measured, step):
        width = 0.01 * np.max(np.abs(signals[self.speed]))
        return eqx.tree_at(lambda effect: effect.width, self, jnp.asarray(width if width > 0 else 1.0))

    def equations(self, dx, signals):
        return {self.state: self.gain * jnp.tanh(signals[self.speed] / self.width)}


class QuadraticDrag(Effect):
    """Drag that grows with the square of a speed: `d(state)/dt += gain * |speed| speed`.

    Args:
        state: the equation.
        speed: the signal that is squared with its sign.
    """

    state: str = eqx.field(static=True)
    speed: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"|{self.speed}|{self.speed} in {self.state}"

    @property
    def place(self):
        return f"equation of {self.state}"

    @property
    def sentence(self):
        return f"quadratic drag: |{self.speed}| {self.speed} in the equation of {self.state}"

    @property
    def signals_used(self):
        return (self.speed,)

    @property
    def complexity(self):
        return 2

    @property
    def terms(self):
        return ((self.state, f"|{self.speed}| {factor_of(self.speed)}"),)

    def kin(self):
        return (Term(state=self.state, product=f"{factor_of(self.speed)}^3"),)


class StateLimit(Effect):
    """A limit of one state above which it runs over, in part into another.

        excess = max(state - level, 0)
        d(state)/dt -= gain * excess,    d(into)/dt += share * gain * excess

    An overflowing tank is the pattern: `gain` [1/s] is the rate at which what stands above the level runs off, no faster than
    fixed steps between the samples can follow.

    Args:
        state: the state that has a limit.
        into: the state that receives the share.
        fraction: where the level starts, as a fraction of the state's range on the training records.
    """

    state: str = eqx.field(static=True)
    into: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.8)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    level: Float[Array, ""] = eqx.field(default_factory=zero)
    share: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.5))
    fastest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(jnp.inf))

    @property
    def name(self):
        return f"{self.family} (from {self.fraction:.0%})"

    @property
    def family(self):
        return f"overflow of {self.state} into {self.into}"

    @property
    def place(self):
        return f"equation of {self.state}"

    @property
    def sentence(self):
        return f"{self.state} has a limit above which it runs over, in part into {self.into}"

    @property
    def complexity(self):
        return 3

    @property
    def begin(self):
        return 0.1

    def worth_trying(self, measured):
        return True

    @property
    def fixed(self):
        return ("fastest",)

    @property
    def bounds(self):
        return {"gain": (0.0, float(self.fastest)), "share": (0.0, 1.0)}

    def start(self, signals, measured, step):
        shape = level_in(signals[self.state], self.fraction), jnp.asarray(FASTEST / step)
        return eqx.tree_at(lambda effect: (effect.level, effect.fastest), self, shape)

    def equations(self, dx, signals):
        spill = self.gain * jnp.maximum(signals[self.state] - self.level, 0.0)
        return {self.state: -spill, self.into: self.share * spill}
