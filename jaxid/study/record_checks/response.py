"""The linear response of the model at its present values, with which a record is compared."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy

from ...data.record import Record
from ...estimation.likelihoods import OutputError
from ...models.base import AbstractModel
from ...models.free import first_state
from ...simulation.hold import ZeroOrder
from ...simulation.linearise import linearise
from ...simulation.simulate import simulate
from ...simulation.steppers import RK4
from .channels import Measured

# Chosen: rate of a mode, relative to the fastest one, below which it is an integrator.
INTEGRATOR = 1e-6
# Chosen: points of the fine grid in one step of the impulse response.
FINE = 8


class Response(NamedTuple):
    """Response of the model at its present values.

    Attributes:
        A, B, C, D: linear model at the first sample and the mean input.
        y: simulated outputs.
        ends: time at which the simulation is no longer finite [s], NaN if it is.
        rests_at_zero: True if state and output are zero at rest under zero input, and only there.
        held: True if each sample of the input is held until the next.
        substeps: steps of integration between two samples, infinite with adaptive steps.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    y: np.ndarray
    ends: float
    rests_at_zero: bool
    held: bool
    substeps: float

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues of A; none where A is not finite, as at the root of a state that is zero."""
        exist = self.A.size and np.isfinite(self.A).all()
        return np.linalg.eigvals(self.A) if exist else np.zeros(0)

    @property
    def is_finite(self) -> bool:
        """True if all numbers of the linear model are finite."""
        return all(bool(np.isfinite(part).all()) for part in (self.A, self.B, self.C, self.D))

    @property
    def rates(self) -> np.ndarray:
        """Absolute values of the poles, integrators left out, in increasing order [rad/s]."""
        sizes = np.sort(np.abs(self.poles))
        return sizes[sizes > INTEGRATOR * np.max(sizes, initial=0.0)]


def response(
    model: AbstractModel, record: Record, measured: Measured, likelihood: OutputError
) -> Response:
    """Return the response of a model to the inputs of a record, at its present values.

    Args:
        model: the model.
        record: a single record with the channels of the model.
        measured: the same record as NumPy arrays.
        likelihood: its hold and stepper simulate.
    """
    hold, stepper = likelihood.hold, likelihood.stepper
    state = first_state(model, record)
    at = linearise(model, measured.t[0], state, measured.u.mean(axis=0))
    solution = simulate(model, measured.t, measured.u, state, hold=hold, stepper=stepper)
    y = np.asarray(solution.y)
    bad = ~np.isfinite(y).all(axis=1)
    ends = float(measured.t[np.argmax(bad)]) if bad.any() else np.nan
    return Response(
        A=np.asarray(at.A),
        B=np.asarray(at.B),
        C=np.asarray(at.C),
        D=np.asarray(at.D),
        y=y,
        ends=ends,
        rests_at_zero=_rests_at_zero(model, float(measured.t[0])),
        held=isinstance(hold, ZeroOrder),
        substeps=stepper.substeps if isinstance(stepper, RK4) else np.inf,
    )


def _rests_at_zero(model: AbstractModel, t: float) -> bool:
    """True if zero state and zero input are a point of rest, and no other state is near it."""
    x, u, now = jnp.zeros(len(model.states)), jnp.zeros(len(model.inputs)), jnp.asarray(t, float)
    moving = bool(jnp.any(model.rhs(now, x, u) != 0)) if model.states else False
    if moving or not bool(jnp.all(model.output(now, x, u) == 0)):
        return False
    A = np.asarray(linearise(model, t, x, u).A)
    if not np.isfinite(A).all():
        return False
    poles = np.abs(np.linalg.eigvals(A))
    return bool(np.all(poles > INTEGRATOR * np.max(poles, initial=0.0)))


def sampled_response(
    of: Response, step: float, count: int, delays: np.ndarray, output: int, channel: int
) -> np.ndarray:
    """Return the response to an input that is one at one sample, for some delays.

        m(k h - d) = integral of g(k h - d - s) w(s) ds,    g the impulse response

    The input between the samples, w, is the triangle max(0, 1 - |s|/h), or a held sample: one for
    0 <= s < h.

    Args:
        of: the linear model.
        step: h, the step of the samples [s].
        count: number of samples.
        delays: d, multiples of h / FINE [s].
        output, channel: positions of the output and of the input.

    Returns:
        Three responses and its first two integrals over time, shape (delay, sample, 3).
    """
    fine, size = step / FINE, count * FINE
    shift = scipy.linalg.expm(of.A * fine)
    x, impulse = of.B[:, channel], np.empty(size)
    for k in range(size):
        impulse[k] = of.C[output] @ x
        x = shift @ x
    place = np.arange(-FINE, FINE + 1)
    shape = ((place >= 0) & (place < FINE)) if of.held else 1.0 - np.abs(place) / FINE
    h = fine * np.convolve(impulse, shape)
    h[: 2 * FINE + 1] += of.D[output, channel] * shape
    columns = np.stack([h, np.cumsum(h), np.cumsum(np.cumsum(h))], axis=1)
    columns /= np.maximum(np.max(np.abs(columns), axis=0), 1e-300)
    # The sample of the input, point FINE of the convolution, is at time zero.
    at = FINE * (1 + np.arange(count))[None] - np.round(delays / fine).astype(int)[:, None]
    return np.where((at >= 0)[..., None], columns[np.clip(at, 0, len(columns) - 1)], 0.0)
