"""`simulate`: the model's answer to an input."""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.checks import InputError, require, require_float64
from .._foundation.types import Array, Float, Numbers
from ..models.base import AbstractModel, canonical
from .inputs import AbstractHold, AbstractPath, Linear
from .solution import Solution
from .steppers import RK4, AbstractStepper


def simulate(
    model: AbstractModel,
    t: Float[Numbers, "*case time"],
    u: Float[Numbers, "*case time input"],
    initial_state: Float[Numbers, "*case state"],
    *,
    hold: AbstractHold | None = None,
    stepper: AbstractStepper | None = None,
) -> Solution:
    """Simulate a model over given sample times.

        dx/dt = rhs(t, x, u(t)),  x(t_0) = initial_state,    y_i = output(t_i, x_i, u_i)

    Pure: works under `jit`, `vmap` and `jacfwd`. With a leading case axis the cases run side by side and share the model.

    Args:
        model: the model, whose array leaves may be traced.
        t: sample times [s], strictly increasing up to a padding that repeats the last one.
        u: inputs at the samples.
        initial_state: state at the first sample.
        hold: how the input runs between its samples; `Linear()` by default.
        stepper: `RK4(substeps)`, one step a sample by default, or `Adaptive(solver)`.

    Returns:
        States and outputs at the sample times, and whether all of them are finite.

    Raises:
        InputError: when a shape does not fit the model's channels, or JAX is not in 64 bit.
    """
    require_float64()
    hold, stepper = hold or Linear(), stepper or RK4()
    model = canonical(model)
    t, u, initial_state = (jnp.asarray(array, float) for array in (t, u, initial_state))
    for name, array, channels in (("u", u, model.inputs), ("initial_state", initial_state, model.states)):
        require(
            array.shape[-1] == len(channels),
            f"{name} has {array.shape[-1]} channels, but the model has {len(channels)}: {', '.join(channels)}.",
        )
    if t.ndim > 1:
        return jax.vmap(lambda *case: simulate(model, *case, hold=hold, stepper=stepper))(t, u, initial_state)
    require(t.ndim == 1 and u.shape[0] == t.size, f"u has {u.shape[0]} rows for {t.size} sample times.")
    return run(model, t, u, initial_state, hold, stepper)


def run(
    model: AbstractModel,
    t: Float[Array, " time"],
    u: Float[Array, "time input"],
    initial_state: Float[Array, " state"],
    hold: AbstractHold,
    stepper: AbstractStepper,
) -> Solution:
    """One case without the border's checks: what the estimation differentiates."""
    path, u = arriving(model, hold, t, u)
    x, dx = stepper.states(model, t, path, initial_state)
    y = _observed(model, t, x, u, dx)
    return Solution(t, x, y, jnp.all(jnp.isfinite(x)) & jnp.all(jnp.isfinite(y)))


def arriving(
    model: AbstractModel, hold: AbstractHold, t: Float[Array, " time"], u: Float[Array, "time input"]
) -> tuple[AbstractPath, Float[Array, "time input"]]:
    """The input as it arrives at the equations: its path, and its values at the samples, at which the outputs feel it."""
    recorded = hold.path(t, u)
    path = model.input_path(recorded)
    return path, u if path is recorded else jax.vmap(path)(t)


@eqx.filter_jit
def _observed(model, t, x, u, dx) -> Float[Array, "time output"]:
    """What the instruments show of a trajectory; a function of its own, to be traced once."""
    return model.observe(t, jax.vmap(model.output_given)(t, x, u, dx))


def explain_divergence(solution: Solution, model: AbstractModel, where: str) -> InputError:
    """The error that tells when and in which state a simulation first stopped being finite."""
    bad = ~jnp.isfinite(solution.x)
    row = int(jnp.argmax(jnp.any(bad, axis=-1)))
    states = [name for name, wrong in zip(model.states, bad[row], strict=True) if wrong] or list(model.outputs)
    return InputError(
        f"The simulation of {where} stops being finite at t = {float(solution.t[row]):g} s, in {', '.join(states)}. "
        "Start from parameters for which the model is stable over the record, shorten the record, or raise `substeps`."
    )
