"""`simulate`: the response of a model to an input."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._foundation.checks import InputError, require, require_float64
from .._foundation.compiler import fast_compile_jit
from .._foundation.grid import standing_row
from .._foundation.types import Array, Float, Numbers
from ..models.base import AbstractModel, as_float, canonical
from ..models.equation_shapes import check_equations
from .hold import AbstractHold, Linear
from .input_signal import AbstractInputSignal
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

    Pure: works under `jit`, `vmap` and `jacfwd`. With a leading case axis the cases run in
    parallel and share the model. It is compiled once for each structure of model, hold and stepper
    and each number of samples: other values do not compile again.

    Args:
        model: the model, whose array leaves may be traced.
        t: sample times [s], strictly increasing up to a padding that repeats the last one.
        u: inputs at the samples [the units of the inputs].
        initial_state: state at the first sample [the units of the states].
        hold: interpolation of the input between its samples; `Linear()` by default.
        stepper: `RK4(substeps)`, by default one step per sample, or `Adaptive(solver)`.

    Returns:
        States and outputs at the sample times, and whether all of them are finite.

    Raises:
        InputError: when a shape does not fit the model's channels, `rhs` or `output` does not
            return one number for each of its channels or cannot be traced, the sample times do not
            increase, the hold or the stepper cannot serve them (`RK4` refuses holes), or JAX is not
            in 64 bit.
    """
    require_float64()
    between, integrator = canonical(hold or Linear()), canonical(stepper or RK4())
    model = canonical(model)
    t, u, initial_state = as_float(t), as_float(u), as_float(initial_state)
    for name, array, channels in (
        ("u", u, model.inputs),
        ("initial_state", initial_state, model.states),
    ):
        require(
            array.ndim > 0 and array.shape[-1] == len(channels),
            f"{name} has {array.shape[-1] if array.ndim else 'no'} channels, "
            f"but the model has {len(channels)}: {', '.join(channels)}.",
        )
    require(t.ndim > 0, "t is a single number. Give the sample times, shape (time,).")
    require(
        u.ndim > 1 and u.shape[-2] == t.shape[-1],
        f"u has {u.shape[-2] if u.ndim > 1 else 'no'} rows for {t.shape[-1]} sample times.",
    )
    for name, cases in (("u", u.shape[:-2]), ("initial_state", initial_state.shape[:-1])):
        require(
            cases == t.shape[:-1],
            f"t has the case axes {t.shape[:-1]}, but {name} has {cases}. "
            "Give each case its own row of t, u and initial_state.",
        )
    if not isinstance(t, Tracer):
        _check_times(np.asarray(t))
        between.check(t)
        if model.states:
            integrator.check(t)
    check_equations(model)
    return _cases(model, t, u, initial_state, between, integrator)


def _check_times(t: Float[np.ndarray, "*case time"]) -> None:
    """Refuse times that do not increase."""
    require(t.shape[-1] > 1, "There is one sample time. A simulation needs two or more.")
    row = standing_row(t)
    if row is not None:
        now, before = t.reshape(-1, t.shape[-1])[row[0], [row[1], row[1] - 1]]
        raise InputError(
            f"The sample times of case {row[0]} do not increase at row {row[1]}: {now:.10g} s "
            f"after {before:.10g} s. Sort them, and leave out repeated ones."
        )


@fast_compile_jit
def _cases(model, t, u, initial_state, hold, stepper) -> Solution:
    """Return the solution of one case or, with leading axes, of many.

    All calls share this compiled function.
    """
    if t.ndim > 1:
        case = partial(_cases, model, hold=hold, stepper=stepper)
        return jax.vmap(case)(t, u, initial_state)
    return run(model, t, u, initial_state, hold, stepper)


def run(
    model: AbstractModel,
    t: Float[Array, " time"],
    u: Float[Array, "time input"],
    initial_state: Float[Array, " state"],
    hold: AbstractHold,
    stepper: AbstractStepper,
) -> Solution:
    """Return the solution of one case without checks; the estimation differentiates this."""
    path, u = effective_input(model, hold, t, u)
    x, dx = stepper.states(model, t, path, initial_state)
    y = _observed(model, t, x, u, dx)
    return Solution(t, x, y, jnp.all(jnp.isfinite(x)) & jnp.all(jnp.isfinite(y)))


def effective_input(
    model: AbstractModel,
    hold: AbstractHold,
    t: Float[Array, " time"],
    u: Float[Array, "time input"],
) -> tuple[AbstractInputSignal, Float[Array, "time input"]]:
    """Return the input of the equations as a signal, and its values at the samples.

    The outputs are evaluated with these values.
    """
    recorded = hold.path(t, u)
    path = model.input_signal(recorded)
    return path, u if path is recorded else jax.vmap(path)(t)


@eqx.filter_jit
def _observed(model, t, x, u, dx) -> Float[Array, "time output"]:
    """Return the measured outputs of a trajectory; a separate function, to be traced once."""
    return model.observe(t, jax.vmap(model.output_given)(t, x, u, dx))


def explain_divergence(solution: Solution, model: AbstractModel, where: str) -> InputError:
    """Return the error with time and states at which a simulation first is not finite; with its
    outputs where all states are finite.
    """
    names, bad = model.states, ~np.isfinite(np.asarray(solution.x))
    if not bad.any():
        names, bad = model.outputs, ~np.isfinite(np.asarray(solution.y))
    row = int(np.argmax(np.any(bad, axis=-1)))
    channels = [name for name, wrong in zip(names, bad[row], strict=True) if wrong]
    return InputError(
        f"The simulation of {where} stops being finite at t = {float(solution.t[row]):g} s, in "
        f"{', '.join(channels)}. "
        "Start from parameters for which the model is stable over the record, shorten the record, "
        "or integrate a fast model in finer steps: `RK4(10)` as `stepper`, `substeps` in a study "
        "file."
    )
