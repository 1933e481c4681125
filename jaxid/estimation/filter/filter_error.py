"""`FilterError`: the likelihood of models with process noise, by an extended Kalman filter."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require
from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.base import AbstractModel
from ...models.free import Free
from ...models.free_model import FreeModel
from ...models.noise import InnovationNoise
from ...models.stochastic import StochasticModel
from ...sensitivity.jacobian import value_and_jacobian
from ...simulation.hold import AbstractHold, Linear
from ...simulation.solution import Solution
from ...simulation.steppers import RK4
from ..likelihoods import AbstractLikelihood
from .backward_pass import smooth_filtered
from .drawn import drawn
from .filter_sensitivities import FilterSensitivities, filter_sensitivities
from .frozen_gain import frozen_gain
from .innovation_rows import innovation_rows, white_rows
from .kalman import (
    Filtered,
    filter_signals,
    inverse_cholesky,
    kalman_filter,
    require_outputs_without_memory,
)
from .noise_identifiability import check_noise_identifiable
from .noise_options import FirstOrder, Number, number, sensor_parts
from .noise_parameters import (
    NOISE_GROUPS,
    by_parameter,
    check_kept,
    check_names,
    check_values,
    with_noise_parameters,
)


class FilterError(AbstractLikelihood):
    r"""Filter error: part of the misfit is process noise, which moves the states.

        J = 1/2 sum_i ( v_i' B_i^-1 v_i + log det B_i )     (Eq. A.15)

    with the innovations `v_i = z_i - y(i|i-1)` of an extended Kalman filter and their covariance
    `B_i` (A.16 to A.25). The standard deviations of process noise, sensors and initial state are
    parameters like all others: with bounds, standard errors and names, such as `process.w`,
    `sensor.alpha`. The rows of the information are, with `B = L L'` and `w = L^-1 v`,

        [ L^-1 dv,  w ],    [ vec(L^-1 dB L^-T)/sqrt(2),  vec(I - w w')/sqrt(2) ]

    which give the gradient (4.17) and the Fisher matrix (4.18). A number is the start of an
    estimate; `Fixed(number)` is a known value.

    Args:
        process: process noise by state, in its equation, or by disturbance input of
            `model.with_disturbance_inputs()`: white [unit of the state per sqrt(s); unit of the
            input times sqrt(s)], or with memory, as `FirstOrder(deviation, correlation_time)`
            [unit of the state per second; unit of the input].
        noise: noise of each sensor, by output [its unit]: the standard deviation of white noise,
            `FirstOrder(deviation, correlation_time)` for noise with memory, or several of them,
            whose sum is the noise, such as `(0.01, FirstOrder(0.02, 0.5))`. Each sensor has a white
            part; one that is not given is estimated, from a start by the second differences of the
            record. The deviation of a part with memory is the parameter `process.noise_NAME`.
        initial: standard deviation of the initial state, by state [its unit]. A state that is not
            named starts as the model (or the free initial state) has it, without error.
        hold: interpolation of the inputs between their samples.
        stepper: the integration of the state from sample to sample.
        steady: start in statistical steady state (A.45 to A.49), for time-invariant models; it
            replaces `initial`.
        updates: number of linearisations of the outputs at each sample; more than one iterates
            the update for strongly nonlinear outputs.
        unscented: update by outputs at points around the predicted state, as far apart as its
            covariance states, in place of their derivative: for outputs that are curved within the
            uncertainty of the state.
        frozen_gain: `estimate` starts the iteration with the gain frozen within each step, as
            `FrozenGain` does, and ends it with the exact derivatives: the same estimates and
            standard errors. `Estimate.iterations` counts the exact part alone.
    """

    simulates: ClassVar[bool] = False
    process: dict[str, Number | FirstOrder]
    sensors: dict[str, Number]
    coloured: dict[str, dict[str, FirstOrder]]
    initial: dict[str, Number]
    hold: AbstractHold
    stepper: RK4
    steady: bool = eqx.field(static=True)
    updates: int = eqx.field(static=True)
    unscented: bool = eqx.field(static=True)
    frozen_gain: bool = eqx.field(static=True)
    noise: InnovationNoise

    def __init__(
        self,
        process: Mapping | None = None,
        noise: Mapping | None = None,
        initial: Mapping | None = None,
        *,
        hold: AbstractHold | None = None,
        stepper: RK4 | None = None,
        steady: bool = False,
        updates: int = 1,
        unscented: bool = False,
        frozen_gain: bool = False,
    ):
        for argument, values in {"process": process, "noise": noise, "initial": initial}.items():
            require(
                values is None or isinstance(values, Mapping),
                f"`{argument}` is {values!r}. Give a number by name, such as {{'v': 0.01}}.",
            )
        self.process = {
            name: option if isinstance(option, FirstOrder) else number(option)
            for name, option in (process or {}).items()
        }
        parts = {name: sensor_parts(name, option) for name, option in (noise or {}).items()}
        self.sensors = {name: white for name, (white, _) in parts.items() if white is not None}
        self.coloured = {name: coloured for name, (_, coloured) in parts.items() if coloured}
        self.initial = {name: number(option) for name, option in (initial or {}).items()}
        self.hold, self.stepper = hold or Linear(), stepper or RK4()
        self.steady, self.updates, self.noise = steady, updates, InnovationNoise()
        self.frozen_gain, self.unscented = frozen_gain, unscented
        require(
            isinstance(self.stepper, RK4),
            "FilterError needs the derivative of a fixed step. Use `stepper=RK4(substeps)`.",
        )
        require(updates >= 1, f"updates is {updates}; at least one update is needed.")
        require(
            not (steady and self.initial),
            "A filter in steady state has the covariance of the Riccati equation at its start. "
            "Leave out `initial`, or `steady`.",
        )
        require(
            not (frozen_gain and (updates > 1 or unscented)),
            "A frozen gain belongs to one linearisation of the outputs at each sample. Leave out "
            "`updates` and `unscented`, or `frozen_gain`.",
        )
        require(
            not (unscented and updates > 1),
            "The unscented update has no linearisation to iterate. Leave out `updates`, or "
            "`unscented`.",
        )
        check_values(self.process, self.sensors, self.initial, self.coloured)

    def prepared(
        self, model: AbstractModel, free: Free, records: Record
    ) -> tuple[AbstractModel, Free]:
        noises = self.process, self.sensors, self.initial, self.coloured
        if isinstance(model, StochasticModel):
            check_kept(model, free, by_parameter(*noises))
            return model, free
        sensors = (*self.sensors, *self.coloured)
        check_names(model, free, self.process, sensors, self.initial)
        stochastic, chosen = with_noise_parameters(model, free, records, *noises)
        check_noise_identifiable(stochastic, chosen, records)
        return stochastic, chosen

    def filter(
        self, model: AbstractModel, record: Record, initial_state: Float[Array, " state"]
    ) -> Filtered:
        """Return the filter's states and innovations for one record."""
        assert isinstance(model, StochasticModel), "a model from `prepared`"
        options = {"updates": self.updates, "steady": self.steady, "unscented": self.unscented}
        substeps = self.stepper.substeps
        return kalman_filter(model, record, initial_state, self.hold, substeps, **options)

    def solve(self, model, record, initial_state):
        filtered = self.filter(model, record, initial_state)
        x, y = filtered.x_predicted, filtered.y
        return Solution(record.t, x, y, jnp.all(jnp.isfinite(x)) & jnp.all(jnp.isfinite(y)))

    def smoothed(self, model, record, initial_state):
        x, factor = smooth_filtered(self.filter(model, record, initial_state))
        samples, _ = filter_signals(model, record, self.hold, self.stepper.substeps)
        y = jax.vmap(model.output)(record.t, x, samples.u)
        succeeded = jnp.all(jnp.isfinite(x)) & jnp.all(jnp.isfinite(y))
        return Solution(record.t, x, y, succeeded), factor @ jnp.swapaxes(factor, -1, -2)

    def drawn(self, model, record, initial_state, root, key):
        assert isinstance(model, StochasticModel), "a model from `prepared`"
        substeps = self.stepper.substeps
        return drawn(model, record, initial_state, self.hold, substeps, steady=self.steady, key=key)

    def rows(self, model, record, initial_state):
        filtered = self.filter(model, record, initial_state)
        return innovation_rows(filtered.v, inverse_cholesky(filtered.B), record.mask)

    def sensitivities(self, family, theta, record):
        v, B, rows = self._derivatives(family, theta, record)
        return innovation_rows(v, inverse_cholesky(B), record.mask), rows

    def _derivatives(self, family: FreeModel, theta, record: Record) -> FilterSensitivities:
        """Return the innovations, their covariances and the derivatives of the rows."""
        if self.updates == 1 and not self.unscented:
            return filter_sensitivities(
                family, theta, record, self.hold, self.stepper.substeps, steady=self.steady
            )
        m = record.z.shape[-1]

        def innovations(theta):
            model, initial_state = family(theta)
            filtered = self.filter(model, record, initial_state)
            covariances = filtered.B.reshape(filtered.B.shape[0], -1)
            return jnp.concatenate([filtered.v, covariances], axis=-1)

        flat, derivative = value_and_jacobian(innovations, theta)
        B, dB = (part[:, m:].reshape(-1, m, m, *part.shape[2:]) for part in (flat, derivative))
        inverse = inverse_cholesky(B)
        dB = jnp.einsum("tij,tjkp,tlk->tilp", inverse, dB, inverse)
        return FilterSensitivities(flat[:, :m], B, white_rows(-inverse @ derivative[:, :m], dB))

    def approximation(self):
        return FrozenGain(self) if self.frozen_gain else None

    def row_mask(self, mask):
        first, second = np.triu_indices(mask.shape[-1])
        both = mask[..., first] & mask[..., second]
        return jnp.concatenate([mask, both, jnp.ones_like(mask[..., :1]), mask], axis=-1)

    def n_sensitive(self, n_outputs):
        return n_outputs * (n_outputs + 3) // 2

    def residuals(self, rows, mask):
        return rows[..., -mask.shape[-1] :]

    def knows_noise(self, free):
        return not any(name.split(".")[0] in NOISE_GROUPS for name in free.shared)

    def measurement_covariance(self, model, rows, mask):
        assert isinstance(model, StochasticModel), "a model from `prepared`"
        return jnp.diag(model.sensor_deviations() ** 2)

    def check(self, model, records):
        self.check_times(records.t)
        require_outputs_without_memory(model, records)

    def check_times(self, t):
        self.hold.check(t)


class FrozenGain(AbstractLikelihood):
    """Filter error whose derivatives hold the gain of the filter at the present parameters.

    The cost is that likelihood's. The derivatives leave out the changes of gain and covariances
    with the parameters of the model, so that the gradient vanishes near the minimum of the cost and
    not at it: at consistent estimates, which do not have the least variance.

    Args:
        of: the likelihood with the moving gain.
    """

    of: FilterError
    noise: InnovationNoise

    def __init__(self, of: FilterError):
        self.of, self.noise = of, of.noise

    def prepared(self, model, free, records):
        return self.of.prepared(model, free, records)

    def solve(self, model, record, initial_state):
        return self.of.solve(model, record, initial_state)

    def rows(self, model, record, initial_state):
        return self.of.rows(model, record, initial_state)

    def folded(self, family, theta, record):
        substeps, steady = self.of.stepper.substeps, self.of.steady
        return frozen_gain(family, theta, record, self.of.hold, substeps, steady=steady)

    def row_mask(self, mask):
        return self.of.row_mask(mask)

    def n_sensitive(self, n_outputs):
        return self.of.n_sensitive(n_outputs)

    def knows_noise(self, free):
        return self.of.knows_noise(free)

    def check(self, model, records):
        self.of.check(model, records)

    def check_times(self, t):
        self.of.check_times(t)
