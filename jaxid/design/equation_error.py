"""Information of measured states and accelerations by the equation error (C.3.2 of the report).

The error of an equation at the measured states is linear in the parameters to first order,

    a_m - f(x_m, u, theta) = h dtheta + g v,    h = df/dtheta,  g = [I, -df/dx],  v = (v_a, v_x)

with the noise `v_a` of the measured rates and `v_x` of the measured states, so that

    M = sum_i h_i' (g_i R g_i')^-1 h_i        (Eq. C.39, C.40; the sum over samples)

follows from a history of states and inputs without a simulation and without sensitivities. The sign
of `df/dx` follows from the derivation (Eq. C.36 prints the other one); M does not depend on it.

The information is approximate: the states count as known up to white noise at every sample, and an
estimate by output error uses their dynamics as well.
"""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_float64, require_known
from .._foundation.types import Array, Float, Numbers
from ..models.base import AbstractModel, as_float, canonical
from ..models.equation_shapes import check_equations
from ..models.free import Free
from ..simulation.steppers import rate
from .explanations import hypothesis_of, known_information
from .information import PlannedInformation, planned_information
from .objectives import Hypothesis

SINGULAR = 1e-12  # smallest eigenvalue of the noise of the equations, scaled to one (chosen)


class EquationError(eqx.Module):
    """The regression of measured rates on the parameters, at given states and inputs.

    Attributes:
        hypothesis: the model with its free parameters.
        rate_variance: variance of the noise of each measured rate.
        state_variance: variance of the noise of each state.
        equations: positions of the states whose rate is measured.
    """

    hypothesis: Hypothesis
    rate_variance: Float[Array, " equation"]
    state_variance: Float[Array, " state"]
    equations: tuple[int, ...] = eqx.field(static=True)

    def at(self, t, x, u) -> tuple[Float[Array, "row parameter"], Float[Array, "row row"]]:
        """Return `h` and the covariance `g R g'` of the equation error at an instant."""
        shared, flat = self.hypothesis.positions.shared, self.hypothesis.flat
        rows = jnp.array(self.equations)

        def equations(theta, x):
            model = self.hypothesis.at(flat.at[shared].set(theta)).model
            return rate(model, t, x, u)[rows]

        h, slopes = jax.jacfwd(equations, argnums=(0, 1))(flat[shared], x)
        covariance = jnp.diag(self.rate_variance) + (slopes * self.state_variance[None]) @ slopes.T
        return h, covariance

    def rows(
        self, t: Float[Array, " time"], x: Float[Array, "time state"], u: Float[Array, "time input"]
    ) -> Float[Array, "row parameter"]:
        """Return rows of information, `M = rows' rows`, of a history of states and inputs."""

        def white(t, x, u):
            h, covariance = self.at(t, x, u)
            L = jnp.linalg.cholesky(covariance)
            return jax.scipy.linalg.solve_triangular(L, h, lower=True)

        rows = jax.vmap(white)(t, x, u)
        return rows.reshape(-1, rows.shape[-1])

    def require_noise(self, t, x, u) -> None:
        """Refuse a history in which an equation, or a combination of some, has no noise."""
        covariances = np.asarray(_covariances(self, t, x, u))
        names = [self.hypothesis.model.states[row] for row in self.equations]
        require(
            bool(np.all(np.isfinite(covariances))),
            f"The derivatives of the equations of {', '.join(names)} are not finite at all of "
            "these states and inputs. Narrow the limits, or leave out the samples.",
        )
        deviation = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        exact = np.flatnonzero(np.any(deviation == 0.0, axis=0))
        require(exact.size == 0, _no_noise([names[row] for row in exact]))
        scaled = covariances / deviation[:, :, None] / deviation[:, None, :]
        values, vectors = np.linalg.eigh(scaled)
        worst = int(np.argmin(values[:, 0]))
        share = np.abs(vectors[worst, :, 0])
        part = [name for name, size in zip(names, share, strict=True) if size > 0.1]
        require(bool(values[worst, 0] > SINGULAR), _no_noise(part))


def equation_error_of(
    hypothesis: Hypothesis,
    rate_noise: Mapping[str, float],
    state_noise: Mapping[str, float] | None,
) -> EquationError:
    """Return the regression for measured rates and states; arguments as in the public functions."""
    states = hypothesis.model.states
    state_noise = state_noise or {}
    require_known("state", (*rate_noise, *state_noise), states)
    require(
        len(rate_noise) > 0,
        "No rate is measured. Give the standard deviation of at least one in `rate_noise`.",
    )
    for name, value in (*rate_noise.items(), *state_noise.items()):
        require(
            0.0 <= value < np.inf,
            f"The standard deviation of {name!r} is {value}; it must be finite and not negative.",
        )
    equations = tuple(row for row, name in enumerate(states) if name in rate_noise)
    rates = np.array([rate_noise[states[row]] for row in equations], float)
    noise = np.array([state_noise.get(name, 0.0) for name in states], float)
    return EquationError(hypothesis, jnp.asarray(rates**2), jnp.asarray(noise**2), equations)


def equation_error_information(
    model: AbstractModel,
    free: Free,
    t: Float[Numbers, " time"],
    x: Float[Numbers, "time state"],
    u: Float[Numbers, "time input"],
    rate_noise: Mapping[str, float],
    state_noise: Mapping[str, float] | None = None,
    *,
    earlier: Float[Numbers, "row parameter"] | None = None,
) -> PlannedInformation:
    """Return the information of a history of states and inputs by the equation error.

        M = sum_i h_i' (g_i R g_i')^-1 h_i,    h = df/dtheta,  g R g' = R_a + F R_x F',  F = df/dx

    Exact for equations that are linear in the parameters, with the states measured without noise;
    else of first order. The history need not be a motion of the model.

    Source: the report, Eq. C.35 to C.40.

    Args:
        model: the model with declared values.
        free: the parameters of the later estimate, with priors. An initial state has no part here.
        t: sample times [s].
        x: states [the units of the states].
        u: inputs [the units of the inputs].
        rate_noise: standard deviation of the measured rate of each state, by name of the state;
            equations without one are left out [unit of the state per second].
        state_noise: standard deviation of the measured states, zero without one.
        earlier: factor of the information of records already flown, in place of the priors.

    Raises:
        InputError: for an unknown state, a shape that does not fit, or equations without noise.
    """
    require_float64()
    model = canonical(model)
    check_equations(model)
    t, x, u = as_float(t), as_float(x), as_float(u)
    for name, array, channels in (("x", x, model.states), ("u", u, model.inputs)):
        require(
            array.shape == (t.size, len(channels)),
            f"{name} has shape {array.shape}, and the history needs ({t.size}, {len(channels)}): "
            f"{t.size} samples of {', '.join(channels)}.",
        )
    hypothesis = hypothesis_of(model, free, jnp.zeros(len(model.states)))
    regression = equation_error_of(hypothesis, rate_noise, state_noise)
    regression.require_noise(t, x, u)
    rows = np.concatenate([_rows(regression, t, x, u), known_information(free, earlier)])
    values = np.asarray(hypothesis.flat[hypothesis.positions.shared])
    return planned_information(model, free, values, rows, "equation error")


def require_equations(
    regression: EquationError, free: Free, known: Float[Array, "row parameter"], t, x, u
) -> None:
    """Refuse parameters that no history of states and inputs shows in the measured equations."""
    rows = np.concatenate([np.asarray(_rows(regression, t, x, u)), np.asarray(known)])
    model = regression.hypothesis.model
    names = ", ".join(model.states[row] for row in regression.equations)
    absent = [name for name, column in zip(free.shared, rows.T, strict=True) if not np.any(column)]
    if absent:
        raise InputError(
            f"{', '.join(absent)}: in no equation whose rate is measured ({names}). Add the rate "
            "of another state to `rate_noise`, fix the parameter, or use `design_input`."
        )
    shown = planned_information(model, free, np.zeros(len(free.shared)), rows, "all states")
    require(
        not shown.undetermined,
        f"The equations of {names} do not determine {', '.join(shown.undetermined)} together: "
        f"{'; '.join(shown.weak_directions)}. Fix a parameter, or give a prior.",
    )


@eqx.filter_jit
def _rows(regression: EquationError, t, x, u):
    return regression.rows(t, x, u)


@eqx.filter_jit
def _covariances(regression: EquationError, t, x, u):
    return jax.vmap(lambda t, x, u: regression.at(t, x, u)[1])(t, x, u)


def _no_noise(names: list[str]) -> str:
    return (
        f"The equations of {', '.join(names)} have no noise at some state, so that their weight "
        "(g R g')^-1 is infinite. Give their rates, or the states that they depend on, a standard "
        "deviation in `rate_noise` or `state_noise`."
    )
