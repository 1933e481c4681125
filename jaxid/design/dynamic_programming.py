"""Square waves by dynamic programming: the best levels of the inputs, stage after stage.

Time is divided into stages, and in each stage every input has one of a few levels. A partial
sequence of levels carries its state `x`, the sensitivities `S = dx/dtheta` of this state and the
triangle `T` of the information of its outputs. One more stage is

    x' = f(x, u),    S' = Phi S + Theta,    T' = triangle([T; L^-1 (H S + D)])

with `Phi, H` the derivatives of the stage's end and of its outputs by `x`, and `Theta, D` those by
the parameters. Each stage extends every partial sequence by every combination of levels, drops the
sequences outside the limits, and of those with about the same state keeps the best.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_float64
from .._foundation.compiler import fast_compile_jit
from .._foundation.dependence import returns_argument
from .._foundation.linalg import triangle
from .._foundation.types import Array, Float, Int, Numbers
from ..estimation.likelihoods import AbstractLikelihood, OutputError
from ..models.base import AbstractModel, as_float
from ..models.free import Free
from ..models.noise import whiten
from ..sensitivity.jacobian import value_and_jacobian
from ..simulation.hold import Linear, ZeroOrder
from ..simulation.simulate import run
from ..simulation.solution import Solution
from .design import Design
from .input_design import checked_starts, design_of, task_of
from .limits import Limits, exact_maximum, quantities
from .measures import AbstractMeasure
from .objectives import InformationObjective, logarithmic_cost
from .optimisation import REACHED, Task, deviations_of, in_chunks, integration_of, summaries
from .shapes import Stages, stages
from .signals import InputSignal

WAVE_LEVELS = (-1.0, 0.0, 1.0)  # usual in flight test
# Sequences that a stage keeps, and cells into which it divides the range of each state (chosen).
WIDTH, CELLS = 600, 12
EXTENSIONS = 128  # sequences that one compiled program extends at once (chosen)
FINALISTS = 32  # complete sequences whose costs are computed without the weak prior (chosen)
# Ratio of the standard error that a parameter alone would have from a random wave to the deviation
# of the weak prior, by which sequences rank that do not determine all parameters (chosen).
WEAK = 1e-4
SEED = 0  # of the random waves


class PartialSequence(eqx.Module):
    """A partial sequence of levels with everything that its continuation needs.

    Attributes:
        levels: levels of its last stage, over the amplitudes.
        x: state at its end.
        S: sensitivities of this state to own and shared parameters.
        factor: triangle of the information on these parameters, earlier flights and the weak prior
            included.
        used: worst use of each limit until now; of the energy the sum.
        cost: measure of the information on the shared parameters; a variance as its logarithm.
    """

    levels: Float[Array, "*sequence axis"]
    x: Float[Array, "*sequence state"]
    S: Float[Array, "*sequence state column"]
    factor: Float[Array, "*sequence column column"]
    used: Float[Array, "*sequence limit"]
    cost: Float[Array, "*sequence"]


def square_wave_design(
    model: AbstractModel,
    free: Free,
    t: Float[Numbers, " time"],
    stage: int,
    measure: AbstractMeasure,
    limits: Limits,
    likelihood: AbstractLikelihood,
    *,
    levels: Sequence[float] = WAVE_LEVELS,
    axes: Sequence[str] | None = None,
    trim_input: Float[Numbers, " input"] | None = None,
    initial_state: Float[Numbers, " state"] | None = None,
    earlier: Float[Numbers, "row parameter"] | None = None,
    conventional: Sequence[InputSignal] = (),
    cells: int = CELLS,
    width: int = WIDTH,
) -> Design:
    """Return the sequence of input levels that shows the free parameters best within the limits.

        min measure( M(u) ),    u_i = level_k amplitude  at the samples i of stage k

    The first sample is at trim. Each stage begins with a ramp of one sample time, longer where the
    largest step needs it to keep the limit of the rate. The search needs no start and no derivative
    by the input, and is global up to the sequences that it drops: of those that end with the same
    levels and in the same cell of states (and of energy, where that is limited) only the best
    stays, and the best `width` of all. Bellman's principle would need equal states and
    sensitivities in place of a cell of states: a sequence that is worse now may be continued
    better. With cells and a width that drop none, the search is exhaustive. Sequences that do not
    determine all parameters yet are ranked with a weak prior, 10^4 times wider than the error of
    each parameter alone. The costs of the best complete sequences are exact. Where a simulation at
    four times the sample rate exceeds a limit, the wave is scaled to it.

    Source: E. A. Morelli, Flight test of optimal inputs and comparison with conventional inputs,
    Journal of Aircraft 36(2), 1999; V. Klein, E. A. Morelli, Aircraft System Identification, AIAA,
    2006, chapter 9.

    Args:
        model: the model with declared values, whose motion must stay in the envelope.
        free: the parameters of the later estimate, with priors.
        t: sample times, uniform [s].
        stage: samples of a stage; the samples after the first are a multiple of it.
        measure: the measure to be minimised.
        limits: the limits; the amplitude is the size of the wave, not only its limit.
        likelihood: output error with known noise, and a linear or a zero-order hold.
        levels: levels of each input over its amplitude, from -1 to 1.
        axes: inputs that move; all by default. A stage has the levels of all axes independently.
        trim_input: inputs at trim; zero by default.
        initial_state: state at trim; states beyond the given ones are zero.
        earlier: factor of the information of records already flown, in place of the priors.
        conventional: inputs to compare.
        cells: number of cells into which each stage divides the range of each state.
        width: largest number of sequences that a stage keeps.

    Raises:
        InputError: when no axis moves, the stages do not divide the samples, the limits exclude
            the trim or all sequences, the model or the likelihood has a memory apart from the
            state, or no sequence determines the parameters.
    """
    require_float64()
    times = as_float(t)
    _require_options(levels, cells, width)
    task, information = task_of(
        *(model, free, times, stages(times, stage), measure, limits, likelihood),
        axes=axes,
        trim_input=trim_input,
        initial_state=initial_state,
        earlier=earlier,
        conventional=conventional,
    )
    largest = max(*levels, 0.0) - min(*levels, 0.0)
    ramp = task.limits.ramp(largest, float(times[1] - times[0]))
    require(
        ramp <= stage,
        f"At the limits of the rates the largest step lasts {ramp} samples, and a stage has "
        f"{stage}. Lengthen the stages, widen these limits, or lower the amplitude.",
    )
    task = dataclasses.replace(task, shape=stages(times, stage, ramp))
    _require_state_as_memory(information, times)
    waves, costs = checked_starts(task, information, free, SEED, ())
    wave = deviations_of(task, jnp.asarray(waves[[np.argmin(costs)]]))[0]
    choices = np.array(list(itertools.product(levels, repeat=len(task.limits.axes))), float)
    search = _Search(task, information, choices, stage, cells, width)
    sequences, excluded = search.run(_start(task, information, wave))
    costs, _ = summaries(task, information, deviations_of(task, jnp.asarray(sequences)))
    order = np.argsort(costs)
    best = [sequences[index] for index in order]
    result = design_of(task, information, free, best, (float(costs[order[0]]),), conventional)
    undetermined = ", ".join(result.information.undetermined)
    if undetermined:
        raise search.refusal(f"inside the limits shows {undetermined}", excluded)
    return result


class _Search(NamedTuple):
    """A search over the sequences of levels.

    Attributes:
        task, information: the task of the design.
        choices: combinations of the levels of all axes.
        stage, cells, width: as for `square_wave_design`.
    """

    task: Task
    information: InformationObjective
    choices: Float[np.ndarray, "choice axis"]
    stage: int
    cells: int
    width: int

    def run(self, start: PartialSequence) -> tuple[np.ndarray, np.ndarray]:
        """Return the levels of the best complete sequences, shape (sequence, axis, stage), and the
        number of sequences that each limit excluded.

        Args:
            start: the sequence without a stage.

        Raises:
            InputError: when the limits exclude all sequences.
        """
        partial = jax.tree.map(lambda leaf: np.asarray(leaf)[None], start)
        history = np.zeros((1, 0, self.choices.shape[1]))
        excluded = np.zeros(len(self.task.limits.labels()), int)
        ends = range(self.stage, self.task.t.size, self.stage)
        for end in ends:
            pairs = np.arange(len(history) * len(self.choices))
            parent, choice = np.divmod(pairs, len(self.choices))
            partial = self._extended(_rows(partial, parent), self.choices[choice], end)
            outside = ~(partial.used <= self._bounds())
            excluded += outside.sum(axis=0)
            inside = np.flatnonzero(~outside.any(axis=1) & np.isfinite(partial.cost))
            if not inside.size:
                until = float(self.task.t[end])
                raise self.refusal(f"stays inside the limits until {until:g} s", excluded)
            kept = inside[self._kept(_rows(partial, inside), is_last=end == ends[-1])]
            history = np.concatenate(
                [history[parent[kept]], self.choices[choice[kept]][:, None]], axis=1
            )
            partial = _rows(partial, kept)
        return history.transpose(0, 2, 1), excluded

    def _extended(self, partial: PartialSequence, levels, end: int) -> PartialSequence:
        """Return partial sequences after one more stage."""
        t = self.task.t[end - self.stage : end + 1]
        return in_chunks(
            lambda chunk: _after_stage(self.task, self.information, t, *chunk),
            (partial, levels),
            EXTENSIONS,
        )

    def _bounds(self) -> Float[np.ndarray, " limit"]:
        """Return the largest use of each limit, with a margin for the motion between samples."""
        limits = self.task.limits
        count = 2 * len(limits.axes) + 1
        return np.concatenate([np.ones(count), np.full(2 * len(limits.names), REACHED)])

    def _kept(self, partial: PartialSequence, is_last: bool) -> Int[np.ndarray, " kept"]:
        """Return the positions of the best sequence of each cell, the best `width` of them; after
        the last stage the best of all.
        """
        order = np.argsort(partial.cost, kind="stable")
        if is_last:
            return order[:FINALISTS]
        energy = partial.used[:, [2 * len(self.task.limits.axes)]]
        place = np.concatenate([partial.x, energy], axis=1)
        low, span = place.min(axis=0), np.ptp(place, axis=0)
        share = (place - low) / np.where(span > 0.0, span, 1.0)
        cell = np.minimum(np.floor(share * self.cells), self.cells - 1)
        code = np.concatenate([cell, partial.levels], axis=1)[order]
        _, first = np.unique(code, axis=0, return_index=True)
        return order[np.sort(first)[: self.width]]

    def refusal(self, failure: str, excluded: Int[np.ndarray, " limit"]) -> InputError:
        """Return the error that no sequence serves, with the limit that excludes most of them."""
        name = self.task.limits.labels()[int(np.argmax(excluded))]
        remedy = (
            f"The limit {name!r} excludes most sequences: widen it, or give smaller levels."
            if excluded.any()
            else "No limit excludes any: give other levels, or stages of another length."
        )
        return InputError(
            f"No sequence of levels {failure}. {remedy} More sequences (`cells`, `width`) may "
            "contain one that does."
        )


def _rows(partial: PartialSequence, index) -> PartialSequence:
    return jax.tree.map(lambda leaf: leaf[index], partial)


@fast_compile_jit
def _start(
    task: Task, information: InformationObjective, wave: Float[Array, "time input"]
) -> PartialSequence:
    """Return the sequence without a stage: the state at trim, and the information of its outputs at
    the first sample, of earlier flights, and of the weak prior.

    Args:
        task, information: the task.
        wave: deviations of an input whose sensitivities give the scale of the weak prior.
    """
    hypothesis, trim = information.hypothesis, task.trim_input[None]
    own, shared = hypothesis.sensitivities(task.t, wave + trim, information.likelihood)
    length = jnp.linalg.norm(jnp.concatenate([own, shared], axis=1), axis=0)
    weak = jnp.diag(WEAK * jnp.where(jnp.isfinite(length) & (length > 0.0), length, 1.0))
    known = jnp.pad(information.earlier, ((0, 0), (own.shape[1], 0)))
    family, theta = hypothesis.family()
    x, S = value_and_jacobian(lambda theta: family(theta)[1], theta)
    _, sensitivities = _motion(information, task.t[:2], jnp.tile(trim, (2, 1)), x, S)
    rows = _white_rows(information, sensitivities[:1])
    none = jnp.zeros(len(task.limits.axes)), jnp.zeros(len(task.limits.labels()))
    factor = triangle(jnp.concatenate([weak, known, rows]))
    return PartialSequence(none[0], x, S, factor, none[1], jnp.zeros(()))


@fast_compile_jit
def _after_stage(task: Task, information: InformationObjective, t, partial, levels):
    """Return partial sequences after a stage of given levels, with the times of its samples and of
    the last one before it.
    """
    return jax.vmap(lambda *one: _extended(task, information, t, *one))(partial, levels)


def _extended(
    task: Task,
    information: InformationObjective,
    t: Float[Array, " time"],
    partial: PartialSequence,
    levels: Float[Array, " axis"],
) -> PartialSequence:
    """Return one partial sequence after one more stage."""
    limits, hypothesis = task.limits, information.hypothesis
    assert isinstance(task.shape, Stages)
    share = task.shape.basis[: t.size, :1]
    before, after = partial.levels * limits.amplitude, levels * limits.amplitude
    moved = (1.0 - share) * before[None] + share * after[None]
    deviation = jnp.zeros((t.size, task.trim_input.size))
    deviation = deviation.at[:, np.array(limits.axes, int)].set(moved)
    u = deviation + task.trim_input[None]
    motion, sensitivities = _motion(information, t, u, partial.x, partial.S)
    values = quantities(hypothesis.model, limits.names, motion, u)
    # The times of the first stage: the step of all others differs from it by rounding.
    used = limits.of(task.t[: t.size], deviation, values, exact_maximum)
    energy, step = 2 * before.size, task.t[1] - task.t[0]
    added = used[energy] - jnp.sum(before**2) * step / limits.energy
    worst = jnp.maximum(partial.used, used).at[energy].set(partial.used[energy] + added)
    rows = _white_rows(information, sensitivities[1:])
    factor = triangle(jnp.concatenate([partial.factor, rows]))
    own = hypothesis.positions.rows.size
    cost, _ = logarithmic_cost(information.measure, factor[own:, own:])
    S = sensitivities[-1, : partial.x.size]
    return PartialSequence(levels, motion.x[-1], S, factor, worst, cost)


def _motion(
    information: InformationObjective,
    t: Float[Array, " time"],
    u: Float[Array, "time input"],
    x: Float[Array, " state"],
    S: Float[Array, "state column"],
) -> tuple[Solution, Float[Array, "time channel column"]]:
    """Return the motion from a state, and the sensitivities of states and outputs to own and shared
    parameters.

    Args:
        information: the information, with model and likelihood.
        t, u: sample times and inputs.
        x, S: the state at the first of them, and its sensitivities.
    """
    hold, stepper = integration_of(information.likelihood)
    family, theta = information.hypothesis.family()

    def channels(change):
        solution = run(family(theta + change)[0], t, u, x + S @ change, hold, stepper)
        return jnp.concatenate([solution.x, solution.y], axis=1)

    both, sensitivities = value_and_jacobian(channels, jnp.zeros_like(theta))
    states, outputs = both[:, : x.size], both[:, x.size :]
    return Solution(t, states, outputs, jnp.all(jnp.isfinite(both))), sensitivities


def _white_rows(
    information: InformationObjective, sensitivities: Float[Array, "time channel column"]
) -> Float[Array, "row column"]:
    """Return the whitened sensitivities of the outputs, from those of states and outputs."""
    S = sensitivities[:, len(information.hypothesis.model.states) :]
    mask = jnp.ones((1, *S.shape[:2]), bool)
    L = information.likelihood.noise.cholesky(jnp.zeros(mask.shape), mask)
    return whiten(L, S[None], mask).reshape(-1, S.shape[2])


def _require_options(levels: Sequence[float], cells: int, width: int) -> None:
    require(
        len(set(levels)) == len(levels) > 1 and all(-1.0 <= level <= 1.0 for level in levels),
        f"The levels {tuple(levels)} must be at least two different numbers from -1 to 1, "
        "relative to the amplitude.",
    )
    require(
        cells >= 1 and width >= 1,
        f"`cells` is {cells} and `width` is {width}. Give at least 1 for both.",
    )


def _require_state_as_memory(information: InformationObjective, t: Float[Array, " time"]) -> None:
    """Refuse a likelihood and a model with a memory that the state at a stage's end lacks."""
    likelihood, model = information.likelihood, information.hypothesis.model
    require(
        isinstance(likelihood, OutputError) and isinstance(likelihood.hold, Linear | ZeroOrder),
        "Dynamic programming needs OutputError with the hold Linear() or ZeroOrder(): a stage then "
        "depends on the earlier ones by the state alone. Use `design_input` with another one.",
    )
    path = integration_of(likelihood)[0].path(t, jnp.zeros((t.size, len(model.inputs))))
    outputs = jnp.zeros((t.size, len(model.outputs)))
    require(
        model.input_signal(path) is path
        and returns_argument(lambda y: model.observe(t, y), outputs),
        "The model has effects on its input signal or on its sampled outputs (a delay, a sensor's "
        "lag), which have a memory that the state lacks. Use `design_input`, or remove them.",
    )
