"""General effects in the equations of motion: terms, friction, drag, overflow of a state."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are
# none.
# pyright: reportCallIssue=false

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.location import Location, LocationKind
from .._foundation.types import Array, Float
from ..models.polynomial import factor_of, factors, next_powers, signals_in
from .base import Effect, zero
from .card import EffectCard
from .shape_initialisation import level_in

# decay rate times sample interval (chosen below 2.78, the stability limit of the classical
# Runge-Kutta method)
MAX_RATE_TIMES_STEP = 2.0
# lower bound of a width of friction [unit of the speed] (chosen: the sign itself)
LEAST_WIDTH = 1e-9


class Term(Effect):
    """A monomial in one state equation: `d(state)/dt += gain * product`.

    In a model without states the monomial is added to an output.

    Args:
        state: the equation; the output if the model has no states.
        product: a product of powers of signals, such as `"x^2 v"`, or `"1"` for a constant.
        gain: coefficient of the product [unit of the rate/unit of the product].
    """

    state: str = eqx.field(static=True)
    product: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        term = "a constant" if self.product == "1" else self.product
        return EffectCard(
            name=f"{self.product} in {self.state}",
            description=f"{term} in the equation of {self.state}",
            location=Location(LocationKind.EQUATION, self.state),
            signals=signals_in((self.product,)),
            complexity=max(1, sum(power for _, power in factors(self.product))),
        )

    @property
    def terms(self):
        return ((self.state, self.product),)

    def neighbouring_shapes(self):
        raised = tuple(
            dataclasses.replace(self, product=power, gain=zero())
            for power in next_powers(self.product)
        )
        is_cube_of_state = factors(self.product) == factors(f"{self.state}^3")
        return (
            (*raised, QuadraticDrag(state=self.state, speed=self.state))
            if is_cube_of_state
            else raised
        )


class DryFriction(Effect):
    """Dry (Coulomb) friction: `d(state)/dt += gain * tanh(speed / width)`, a smoothed sign.

    The width is a fraction of the largest speed in the training records. One hundredth is small
    enough for nearly constant friction, and large enough for fixed integration steps. With a free
    width it is estimated from there; this effect refines the one with a fixed width. In a model
    without states the friction is added to an output.

    Args:
        state: the equation; the output if the model has no states.
        speed: the signal whose sign acts.
        gain: rate of change at full friction [unit of the rate].
        width: speed at which the smoothed sign is tanh(1) = 0.76 [unit of the speed].
        free_width: estimate the width.
        fraction: initial width, as a fraction of the largest speed.
    """

    state: str = eqx.field(static=True)
    speed: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.ones(()))
    free_width: bool = eqx.field(static=True, default=False)
    fraction: float = eqx.field(static=True, default=0.01)

    @property
    def card(self):
        name = f"sign({self.speed}) in {self.state}"
        simple = EffectCard(
            name=name,
            description=f"dry (Coulomb) friction: the sign of {self.speed} in the equation of "
            f"{self.state}",
            location=Location(LocationKind.EQUATION, self.state),
            signals=(self.speed,),
            complexity=2,  # equal to drag: neither is simpler a priori
            fixed=("width",),
        )
        if not self.free_width:
            return simple
        return dataclasses.replace(
            simple,
            name=f"smooth {name}",
            family=f"smooth {name}",
            description=f"{simple.description}, over a range of {self.speed}",
            complexity=3,
            fixed=(),
            refines=name,
            bounds={"width": (LEAST_WIDTH, np.inf)},
            degenerate_at_bounds=("width",),
        )

    def initialise_shape(self, signals, measured, step):
        width = self.fraction * np.max(np.abs(signals[self.speed]))
        return eqx.tree_at(
            lambda effect: effect.width, self, jnp.asarray(width if width > 0 else 1.0)
        )

    def equations(self, dx, signals):
        return {self.state: self.gain * jnp.tanh(signals[self.speed] / self.width)}


class QuadraticDrag(Effect):
    """Quadratic drag: `d(state)/dt += gain * |speed| speed`.

    Args:
        state: the equation.
        speed: the speed that the drag opposes.
        gain: coefficient of the drag [unit of the rate/unit of the speed^2].
    """

    state: str = eqx.field(static=True)
    speed: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"|{self.speed}|{self.speed} in {self.state}",
            description=f"quadratic drag: |{self.speed}| {self.speed} in the equation of "
            f"{self.state}",
            location=Location(LocationKind.EQUATION, self.state),
            signals=(self.speed,),
            complexity=2,
        )

    @property
    def terms(self):
        return ((self.state, f"|{self.speed}| {factor_of(self.speed)}"),)

    def neighbouring_shapes(self):
        return (Term(state=self.state, product=f"{factor_of(self.speed)}^3"),)


class StateLimit(Effect):
    """Overflow of one state above a level, in part into another state.

        excess = max(state - level, 0)
        d(state)/dt -= gain * excess,    d(into)/dt += share * gain * excess

    A typical cause is an overflowing tank. `gain` [1/s] is the rate at which the excess drains,
    bounded so that fixed integration steps can follow it.

    Args:
        state: the state that overflows.
        into: the state that receives the share.
        fraction: initial level, as a fraction of the state's range in the training records.
        level: level of overflow [unit of the state].
        share: share of the overflow that arrives in `into`.
        fastest: upper bound of the gain [1/s].
    """

    state: str = eqx.field(static=True)
    into: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.8)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    level: Float[Array, ""] = eqx.field(default_factory=zero)
    share: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.5))
    fastest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(jnp.inf))

    @property
    def card(self):
        family = f"overflow of {self.state} into {self.into}"
        return EffectCard(
            name=f"{family} (from {self.fraction:.0%})",
            description=f"{self.state} has a limit above which it runs over, in part into "
            f"{self.into}",
            location=Location(LocationKind.EQUATION, self.state),
            family=family,
            complexity=3,
            bounds={"gain": (0.0, self.fastest), "share": (0.0, 1.0)},
            fixed=("fastest",),
            initial_gain=0.1,
        )

    def score_blind(self, measured):
        return True

    def initialise_shape(self, signals, measured, step):
        shape = (
            level_in(signals[self.state], self.fraction),
            jnp.asarray(MAX_RATE_TIMES_STEP / step),
        )
        return eqx.tree_at(lambda effect: (effect.level, effect.fastest), self, shape)

    def equations(self, dx, signals):
        spill = self.gain * jnp.maximum(signals[self.state] - self.level, 0.0)
        return {self.state: -spill, self.into: self.share * spill}
