"""Flights of harder truths: declared aircraft and planted effects, by the library's equations."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.missing_effects.truth_effects import kind, read, recorded
from benchmarks.missing_effects.truth_only import HeightDependence, TruthEffect
from jaxid import AbstractModel
from jaxid._foundation.types import Array, Float
from jaxid.effects import Augmented
from jaxid.effects.base import Effect
from jaxid.simulation.simulate import simulate
from jaxid.simulation.steppers import Adaptive


class AboveStart(AbstractModel):
    """An aircraft in its plane of symmetry whose CZ depends on the height above its start.

    dclimb/dt = u sin(pitch) - w cos(pitch),    CZ += gain (exp(-climb/scale) - 1)
    """

    model: AbstractModel
    gain: Float[Array, ""]
    scale: Float[Array, ""]
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    def __init__(self, model: AbstractModel, effect: HeightDependence):
        self.model = model
        self.gain, self.scale = jnp.asarray(effect.gain), jnp.asarray(effect.scale)
        self.states = (*model.states, "climb")
        self.inputs, self.outputs = model.inputs, model.outputs

    def rhs(self, t, x, u):
        rates, signals = self.model.rhs_and_signals(t, x[:-1], u)
        added = self.gain * (jnp.exp(-x[-1] / self.scale) - 1.0)
        climb = x[0] * jnp.sin(x[3]) - x[1] * jnp.cos(x[3])
        return jnp.append(rates.at[1].add(signals["w_per_CZ"] * added), climb)

    def output(self, t, x, u):
        return self.model.output_given(t, x[:-1], u, self.rhs(t, x, u)[:-1])


def flown(model: AbstractModel, effects: Sequence[Effect | TruthEffect], t, u, state) -> np.ndarray:
    """Return the outputs of all manoeuvres with the planted effects but for noise.

    Effects of the library act as in a model with them, but in sensors; those, and the ones that
    only the truth has, are computed in NumPy.

    Args:
        model: the true aircraft without the effects.
        effects: planted effects.
        t: sample times [s].
        u: recorded inputs, shape (manoeuvre, time, input).
        state: initial state of all manoeuvres; states that effects add start in equilibrium.
    """
    height = [one for one in effects if isinstance(one, HeightDependence)]
    moving = Augmented(AboveStart(model, *height) if height else model, _in_motion(effects))
    start = jnp.concatenate([jnp.asarray(state), jnp.zeros(len(height)), *_added(moving, u)])
    y = _simulated(moving, jnp.asarray(t), jnp.asarray(u), start)
    return read(effects, np.asarray(t), np.asarray(y), model.outputs)


def with_noise(
    effects: Sequence, clean: np.ndarray, noise: np.ndarray, outputs: tuple[str, ...]
) -> np.ndarray:
    """Return recorded outputs: with noise, and with the saturation of a sensor last."""
    return recorded(effects, clean + noise, outputs)


def _in_motion(effects: Sequence[Effect | TruthEffect]) -> tuple[Effect, ...]:
    return tuple(
        one for one in effects if isinstance(one, Effect) and not kind(one).startswith("Sensor")
    )


def _added(moving: Augmented, u) -> list[jnp.ndarray]:
    """Return the initial states of the effects: lags at the first input, the others at zero."""
    first = {name: u[0, 0, i] for i, name in enumerate(moving.inputs)}
    return [
        jnp.full(
            len(one.extra_states),
            first[one.channel] if kind(one) == "InputLag" else 0.0,
        )
        for one in moving.effects_in
    ]


@eqx.filter_jit
def _simulated(model: AbstractModel, t, u, start):
    return jax.vmap(lambda one: simulate(model, t, one, start, stepper=Adaptive()).y)(u)
