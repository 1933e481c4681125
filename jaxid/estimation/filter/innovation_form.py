"""`InnovationForm`: the likelihood of models with process noise, with the filter's gain unknown."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require, require_known
from ..._foundation.grid import uneven_steps
from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.base import AbstractModel, as_float
from ...models.free import Free
from ...models.innovation import InnovationModel
from ...models.noise import AbstractNoise, FullNoise
from ...simulation.hold import AbstractHold, Linear
from ...simulation.solution import Solution
from ...simulation.steppers import RK4, runge_kutta_step
from ..likelihoods import AbstractLikelihood
from .kalman import filter_signals, require_outputs_without_memory


class InnovationForm(AbstractLikelihood):
    r"""Filter error in steady state, with the gain of the filter among the parameters.

        J = 1/2 sum_i ( v_i' B^-1 v_i + log det B ),    B = 1/N sum_i v_i v_i'     (A.54)
        x(i|i) = x(i|i-1) + K v_i,    x(i+1|i) = x(i|i) moved through one step     (A.56, A.57)

    No covariance is propagated, and nothing need be known of the sources of the noise: K and B
    stand for Q and R. A pass costs little more than one of output error. The price (section A.5 of
    the report): K and B have more elements than Q and R, so that the estimates have no minimum
    variance, and no Q need belong to them. Take `FilterError` where the structure of the noise is
    known. The gain is that of a filter in steady state, which is wrong at the first samples and
    after a gap, so that the intervals of the gain itself are too narrow: in 400 simulated records
    of an oscillator, 87 to 92 % of those of 95 % held the truth at 400 samples, and 92 % at 1,600;
    of those of the coefficients 92 to 93 %, and 94 to 96 %. Where a step makes the filter
    unstable, the simulation diverges and the step is refused.

    Args:
        gains: by state, the outputs whose innovations correct it; by default all states by all
            outputs. Their elements of K are parameters named `gain.STATE.OUTPUT`. They start at
            zero, as output error, or from the numbers given by output [unit of the state per unit
            of the output]: an unstable model needs them.
        noise: B, by default full and re-estimated at every iteration; a full one needs records
            without gaps in single channels, `DiagonalNoise()` does not.
        hold: interpolation of the inputs between their samples.
        stepper: the integration of the state from sample to sample.
    """

    simulates: ClassVar[bool] = False
    gains: dict[str, dict[str, Float[Array, ""]]] | None
    noise: AbstractNoise
    hold: AbstractHold
    stepper: RK4

    def __init__(
        self,
        gains: Mapping[str, Iterable[str] | Mapping[str, float]] | None = None,
        noise: AbstractNoise | None = None,
        *,
        hold: AbstractHold | None = None,
        stepper: RK4 | None = None,
    ):
        self.gains = None
        if gains is not None:
            self.gains = {state: _starts(outputs) for state, outputs in gains.items()}
        self.noise, self.hold = noise or FullNoise(), hold or Linear()
        self.stepper = stepper or RK4()
        require(
            isinstance(self.stepper, RK4),
            "InnovationForm corrects the state between fixed steps. Use `stepper=RK4(substeps)`.",
        )

    def prepared(
        self, model: AbstractModel, free: Free, records: Record
    ) -> tuple[AbstractModel, Free]:
        if isinstance(model, InnovationModel):
            _check_kept(_names(self.gains or {}), _names(model.gain))
            return model, free
        gains = self.gains
        if gains is None:
            gains = {state: _starts(model.outputs) for state in model.states}
        require(bool(model.states), f"{type(model).__name__} has no states, and needs no filter.")
        require_known("state (in `gains`)", gains, model.states)
        for state, outputs in gains.items():
            require_known(f"output (in `gains` of {state!r})", outputs, model.outputs)
        chosen = dataclasses.replace(free, shared=(*free.shared, *_names(gains)))
        return InnovationModel(model, gains), chosen

    def solve(self, model, record, initial_state):
        x, y = self._path(model, record, initial_state, None)
        return Solution(record.t, x, y, jnp.all(jnp.isfinite(x)) & jnp.all(jnp.isfinite(y)))

    def drawn(self, model, record, initial_state, root, key):
        e = jax.random.normal(key, record.z.shape) @ root.T
        return self._path(model, record, initial_state, e)[1] + e

    def _path(self, model, record, initial_state, drawn):
        """Return predicted states and outputs, by the innovations of the record or by drawn ones.

        A drawn innovation corrects the state where the record has a sample.
        """
        assert isinstance(model, InnovationModel), "a model from `prepared`"
        samples, steps = filter_signals(model, record, self.hold, self.stepper.substeps)
        K = model.matrix()

        def interval(x: Float[Array, " state"], now):
            (t, u, z, mask), steps, e = now
            y = model.output(t, x, u)
            corrected = x + K @ jnp.where(mask, z - y if e is None else e, 0.0)
            later, _ = jax.lax.scan(
                lambda x, step: runge_kutta_step(model.model, x, *step), corrected, steps
            )
            return later, (x, y)

        return jax.lax.scan(interval, initial_state, (samples, steps, drawn))[1]

    def check(self, model, records):
        self.noise.check(records.mask, records.outputs)
        self.noise.check_times(records.t)
        self.check_times(records.t)
        require_outputs_without_memory(model, records)

    def check_times(self, t):
        self.hold.check(t)
        steps = uneven_steps(np.asarray(t))
        require(
            steps is None, f"A constant gain belongs to one step, and {steps}. Use FilterError."
        )


def _starts(outputs: Iterable[str] | Mapping[str, float]) -> dict[str, Float[Array, ""]]:
    """Return the starts of the gains of one state, zero where no number is given."""
    numbers = outputs if isinstance(outputs, Mapping) else dict.fromkeys(outputs, 0.0)
    return {name: as_float(value) for name, value in numbers.items()}


def _names(gains: Mapping[str, Iterable[str]]) -> list[str]:
    """Return the names of the parameters of gains by state and output."""
    return [f"gain.{state}.{output}" for state, row in gains.items() for output in row]


def _check_kept(given: list[str], own: list[str]) -> None:
    """Refuse gains for a model that has its own, from an earlier estimate, and would keep them."""
    new = [name for name in given if name not in own]
    require(
        not new,
        f"The model has its own gains, from an earlier estimate, and {', '.join(new)} is none of "
        "them. Give the model without gains, `fit.model.model`.",
    )
