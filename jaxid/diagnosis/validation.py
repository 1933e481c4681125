"""Prediction of held-out records by a fixed model, started at each record's own initial state."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Float, Int
from ..data.record import Record
from ..estimation.estimate import as_stack, check_channels, check_sampling
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Limits, Problem
from ..estimation.solver import GaussNewton, minimise
from ..models.base import AbstractModel, canonical
from ..models.free import INITIAL_STATE, Free, initial_parameters


class Prediction(eqx.Module):
    """Prediction of records that were not used for fitting.

    Attributes:
        t, z, y: times, measured and predicted outputs.
        scored: samples that are scored: valid ones after the window in which the initial state was
            fitted.
        initial_state: initial state of each record.
    """

    t: Float[Array, "case time"]
    z: Float[Array, "case time output"]
    y: Float[Array, "case time output"]
    scored: Array
    initial_state: Float[Array, "case state"]

    @property
    def residuals(self) -> Float[Array, "case time output"]:
        """`v = z - y` at scored samples, else zero."""
        return jnp.where(self.scored, self.z - self.y, 0.0)

    @property
    def rms(self) -> Float[Array, " output"]:
        """Root mean square error of each channel over the scored samples of all records."""
        return _scored_rms(self.z, self.y, self.scored)


def predict(
    model: AbstractModel,
    records: Record,
    likelihood: AbstractLikelihood,
    *,
    window: int | None = None,
    states: Sequence[str] | None = None,
) -> Prediction:
    """Predict records with a fixed model, each from an initial state fitted at its start.

        x_0 = argmin sum_(i < window) v_i' R^-1 v_i,    then simulate the whole record from x_0

    The window is not scored. Without a window the record starts at `model.initial_state(record)`,
    and every valid sample is scored. (An initial state fitted on the whole record would give
    another figure, which is not computed here.)

    Args:
        model: the model, with its parameter values.
        records: one record or a stack.
        likelihood: computes the predictions and, in the window, their weights.
        window: number of samples at the start of each record; None for none.
        states: states whose initial value is fitted in the window, all by default; the others start
            at `model.initial_state`, necessarily so if no instrument measures them (a position, a
            heading).

    Returns:
        Predicted outputs and the scored samples.

    Raises:
        InputError: if channels differ, the likelihood cannot serve the sample times, a state does
            not exist, or a window is shorter than needed to determine the state, or longer than a
            record.
    """
    records = as_stack(records)
    check_channels(model, records)
    check_sampling(model, records, likelihood)
    states = model.states if states is None else tuple(states)
    require_known("state", states, model.states)
    if window is not None:
        check_window(model, records, window, len(states))
    return predict_stack(
        canonical(model), records.anonymous(), canonical(likelihood), window, states
    )


def check_window(model: AbstractModel, records: Record, window: int, unknown: int) -> None:
    """Refuse a window that cannot determine an initial state, or leaves nothing to score.

    Raises:
        InputError: the message gives the samples needed and present.
    """
    shortest = int(np.min(np.asarray(records.samples)))
    need = -(-unknown // len(model.outputs))
    require(
        need <= window < shortest,
        f"The window has {window} samples; it needs at least {need} for {unknown} states, and must "
        "be shorter "
        f"than the shortest record, which has {shortest}.",
    )


@fast_compile_jit
def predict_stack(
    model: AbstractModel,
    records: Record,
    likelihood: AbstractLikelihood,
    window: int | None,
    states: tuple[str, ...],
) -> Prediction:
    """Array computation of `predict`."""
    names = tuple(f"{INITIAL_STATE}.{state}" for state in states)
    positions = Free((), names).positions(model)
    limits = Limits.of(Free((), names), 1)

    def predict_one(record: Record):
        begin = initial_parameters(model, positions, record)
        if window is not None:
            head = jax.tree.map(lambda leaf: leaf[:, :window] if leaf.ndim > 1 else leaf, record)
            problem = Problem(model, positions, head, likelihood, limits)
            begin, _ = minimise(problem, begin, GaussNewton())
        problem = Problem(model, positions, record, likelihood, limits)
        return problem.outputs(begin)[0], begin.rows[0]

    single = jax.tree.map(lambda leaf: leaf[:, None], records)
    y, initial = jax.vmap(predict_one)(single)
    after_window = (jnp.arange(records.t.shape[1]) >= (window or 0))[None, :, None]
    return Prediction(records.t, records.z, y, records.mask & after_window, initial)


@eqx.filter_jit
def _scored_rms(z, y, scored) -> Float[Array, " output"]:
    """Root mean square error of each channel, NaN without a scored sample (jitted)."""
    rms = root_mean_square(jnp.where(scored, z - y, 0.0), scored)
    return jnp.where(jnp.any(scored, axis=(0, 1)), rms, jnp.nan)


@eqx.filter_jit
def root_mean_square(v: Float[Array, "case time output"], mask: Array) -> Float[Array, " output"]:
    """Root mean square of each channel over valid samples."""
    count: Int[Array, " output"] = jnp.maximum(jnp.sum(mask, axis=(0, 1)), 1)
    return jnp.sqrt(jnp.sum(jnp.where(mask, v, 0.0) ** 2, axis=(0, 1)) / count)
