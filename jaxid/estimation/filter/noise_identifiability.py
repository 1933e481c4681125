r"""Noise parameters that no record can determine: found before an estimate, and refused in words.

For a model linearised along a record, the covariance of all outputs is a function of the noise
parameters p alone,

    Sigma(p) = H P H' + R,    dw_k = L^-1 dSigma/dp_k L^-T,    Sigma = L L'

and the information on p is `1/2 trace(dw_j dw_k)`. Noises with linearly dependent `dw_k` change
the outputs in the same manner: only their sum is known. (For stationary models this is the
condition of Mehra, IEEE Trans. Automatic Control 15, 1970.)
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from scipy.linalg import solve_triangular

from ..._foundation.checks import InputError
from ..._foundation.host import to_device
from ..._foundation.types import Array, Float, Int
from ...data.record import Record
from ...models.base import canonical
from ...models.free import Free, with_values
from ...models.names import flatten, parameter_names
from ...models.stochastic import StochasticModel
from .kalman import SERIES_TERMS

# Chosen: samples of a record that are examined, half of them adjacent, half spread over it.
EXAMINED = 24
# Derived: dependence within rounding of the columns; noises that differ in law stay above 1e-4 of
# each other when their correlation times differ by one per cent.
DEPENDENT = 1e-7
# Chosen: norm of a step of the series, whose eighth term is then below 1e-12.
SERIES_STEP = 0.1
# Chosen: relative change of states, inputs and parameters, as a value of zero is no general point.
POINT_SPREAD, FROM_ZERO = 0.05, 1e-3


class Linear(NamedTuple):
    """A model linearised at some samples: rates, noise inputs, outputs, white inputs of outputs."""

    A: Float[np.ndarray, "time state state"]
    G: Float[np.ndarray, "time state noise"]
    H: Float[np.ndarray, "time output state"]
    D: Float[np.ndarray, "time output white"]


def check_noise_identifiable(model: StochasticModel, free: Free, records: Record) -> None:
    """Refuse noises that the outputs cannot show, if model and records are known (not traced).

    Raises:
        InputError: for a disturbance without memory that an output measures directly, for a noise
            to which no output responds, and for estimated noises that act on the outputs alike.
    """
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((model, records))):
        return
    with jax.ensure_compile_time_eval():
        first = int(np.argmax(np.any(np.asarray(records.mask), axis=(1, 2))))
        record = jax.tree.map(lambda leaf: leaf[first], records.anonymous())
        rows = _examined(int(np.max(np.flatnonzero(np.any(np.asarray(record.mask), axis=-1)))) + 1)
        model = canonical(model)
        general = _without_zeros(model, free)
        linear = _finite_linearisation(general, record, rows)
    if linear is None:
        return
    _check_direct(model, linear)
    t = np.asarray(record.t)[rows]
    _check_dependence(model, free, linear, t)


def _check_direct(model: StochasticModel, linear: Linear) -> None:
    """Refuse white disturbances that enter an output without an equation between."""
    for column, name in enumerate(model.white_disturbances):
        touched = np.any(linear.D[..., column] != 0.0, axis=0)
        outputs = [o for o, hit in zip(model.outputs, touched, strict=True) if hit]
        if outputs:
            raise InputError(
                f"The disturbance {name!r} has no memory and acts directly on the output "
                f"{', '.join(map(repr, outputs))}, whose samples would have an infinite variance. "
                f"Give it a memory, `FirstOrder(deviation, correlation_time)`, or leave the "
                "output out of model and records."
            )


def _check_dependence(model: StochasticModel, free: Free, linear: Linear, t) -> None:
    """Refuse estimated noises whose effects on the outputs are zero or linearly dependent."""
    kinds = ("process.", "correlation_time.", "sensor.", "initial.")
    names = [name for name in free.shared if name.startswith(kinds)]
    names = [name for name in names if name in noise_values(model)]
    if not names:
        return
    columns = _whitened_derivatives(model, linear, t, names)
    if columns is None:
        return
    sizes = np.linalg.norm(columns, axis=0)
    for name, size in zip(names, sizes, strict=True):
        if size == 0.0:
            raise InputError(
                f"No output responds to the noise {name!r}, so that the records cannot determine "
                "it. Remove it, or give its value as `Fixed(value)`."
            )
    _, singular, right = np.linalg.svd(columns / sizes, full_matrices=False)
    if singular[-1] < DEPENDENT * singular[0]:
        dependent = [n for n, share in zip(names, right[-1], strict=True) if abs(share) > 0.01]
        raise InputError(
            f"The records cannot tell the noises {', '.join(dependent)} apart: they change the "
            "covariance of the outputs in the same manner, and only a combination of them can be "
            "determined. Give one of them as `Fixed(value)`, or remove it."
        )


def noise_values(model: StochasticModel) -> dict[str, Array]:
    """Return the noise parameters by name."""
    kinds = ("process", "correlation_time", "sensor", "initial")
    return {f"{kind}.{k}": v for kind in kinds for k, v in getattr(model, kind).items()}


def _whitened_derivatives(model, linear: Linear, t, names):
    """Return `L^-1 dSigma/dp L^-T` of each parameter, relative to its value, as columns.

    By the complex step. None where the covariance is not finite or not positive definite.
    """
    values = {name: float(value) for name, value in noise_values(model).items()}
    step = 1e-20
    with np.errstate(all="ignore"):
        total = _covariance(model, linear, t, values)
        if not np.all(np.isfinite(total)):
            return None
        try:
            L = np.linalg.cholesky(total.real)
        except np.linalg.LinAlgError:
            return None
        columns = []
        for name in names:
            moved = values | {name: values[name] * (1 + 1j * step)}
            change = _covariance(model, linear, t, moved).imag / step
            half = solve_triangular(L, change, lower=True)
            columns.append(np.ravel(solve_triangular(L, half.T, lower=True)))
    return np.stack(columns, axis=1)


def _covariance(model: StochasticModel, linear: Linear, t, values):
    """Return the covariance of all outputs at the samples, for complex noise parameters."""
    count, n = linear.A.shape[:2]
    A, G = linear.A.astype(complex), linear.G.astype(complex)
    for column, name in enumerate(model.with_memory):
        at, T = len(model.model.states) + column, values[f"correlation_time.{name}"]
        A[:, at, at] = -1.0 / T
        G[:, :, column] = 0.0
        G[:, at, column] = values[f"process.{name}"] * np.sqrt(2.0 / T)
    first = len(model.with_memory)
    for column, name in enumerate(model.white, start=first):
        at_start = float(model.process[name])
        if at_start:
            G[:, :, column] *= values[f"process.{name}"] / at_start
    deviations = [values.get(f"initial.{name}", 0.0) for name in model.model.states]
    deviations += [values[f"process.{name}"] for name in model.with_memory]
    P = np.diag(np.square(np.array(deviations, complex)))
    blocks = np.zeros((count, n, count, n), complex)
    blocks[0, :, 0] = P
    for i in range(count - 1):
        Phi, Q = _transition(A[i], G[i] @ G[i].T, t[i + 1] - t[i])
        blocks[i + 1, :, : i + 1] = np.einsum("ab,bjc->ajc", Phi, blocks[i, :, : i + 1])
        blocks[: i + 1, :, i + 1] = np.moveaxis(blocks[i + 1, :, : i + 1], (0, 1, 2), (2, 0, 1))
        blocks[i + 1, :, i + 1] = Phi @ blocks[i, :, i] @ Phi.T + Q
    outputs = np.einsum("iab,ibjc,jdc->iajd", linear.H, blocks, linear.H)
    R = np.square(np.array([values[f"sensor.{name}"] for name in model.outputs], complex))
    m = len(model.outputs)
    return outputs.reshape(count * m, count * m) + np.diag(np.tile(R, count))


def _transition(A, GG, h):
    """Return the transition over a time h and the covariance of its noise.

    By their series over a fraction of h, doubled until h is reached: accurate for fast modes too.
    """
    doublings = int(np.ceil(np.log2(max(np.linalg.norm(A) * h / SERIES_STEP, 1.0))))
    step = h / 2**doublings
    Phi = term = np.eye(len(A), dtype=complex)
    Q = noise = step * GG
    for k in range(1, SERIES_TERMS):
        term = step / k * A @ term
        half = step / (k + 1) * A @ noise
        noise = half + half.T
        Phi, Q = Phi + term, Q + noise
    for _ in range(doublings):
        Phi, Q = Phi @ Phi, Q + Phi @ Q @ Phi.T
    return Phi, Q


def _examined(count: int):
    """Return the rows of the examined samples: adjacent ones, then ever fewer."""
    adjacent = min(count, EXAMINED // 2)
    spread = np.geomspace(adjacent, max(count - 1, adjacent), EXAMINED - adjacent)
    rows = np.unique(np.concatenate([np.arange(adjacent), np.round(spread).astype(int)]))
    return rows[rows < count]


def _without_zeros(model: StochasticModel, free: Free) -> StochasticModel:
    """Return the model with small values in place of the zeros of its free parameters."""
    vector, available = np.asarray(flatten(model)[0]), parameter_names(model)
    zero = [n for n in free.shared if n in available and vector[available.index(n)] == 0.0]
    values = FROM_ZERO * (1.0 + POINT_SPREAD * np.arange(len(zero)))
    general = with_values(model, zero, to_device(values)) if zero else model
    assert isinstance(general, StochasticModel)
    return general


def _finite_linearisation(model: StochasticModel, record: Record, rows) -> Linear | None:
    """Return the model linearised at general points near the start of the record."""
    u = np.asarray(record.u)
    size = np.max(np.abs(u), axis=0, initial=0.0)
    pattern = np.sin(1.0 + np.arange(rows.size)[:, None] * (1.0 + 0.1 * np.arange(u.shape[1])))
    inputs = u[rows] + POINT_SPREAD * np.where(size > 0, size, 1.0) * pattern
    for share in (POINT_SPREAD, 0.0):
        points = record.t[rows], jnp.asarray(inputs if share else u[rows])
        linear = Linear(*jax.tree.map(np.asarray, _linearise(model, record, points, share)))
        if all(np.all(np.isfinite(part)) for part in linear):
            return linear
    return None


@eqx.filter_jit
def _linearise(model: StochasticModel, record: Record, points, share):
    """Return the matrices of `Linear` at given times and inputs, near the initial state."""
    begin = model.initial_state(record)

    def at(t: Float[Array, ""], u: Float[Array, " input"], number: Int[Array, ""]):
        pattern = jnp.sin(2.0 + number * (1.0 + 0.1 * jnp.arange(begin.size)))
        x = begin + share * jnp.where(begin != 0.0, jnp.abs(begin), 1.0) * pattern
        A = jax.jacfwd(lambda x: model.rhs(t, x, u))(x)
        H = jax.jacfwd(lambda x: model.output(t, x, u))(x)
        return A, model.diffusion(t, x, u), H, model.feedthrough(t, x, u)

    t, u = points
    return jax.vmap(at)(t, u, jnp.arange(t.size))
