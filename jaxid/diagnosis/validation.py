"""Prediction of held-out records by a fixed model, started at each record's own initial state."""

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.host import to_device
from .._foundation.notebook import Table
from .._foundation.types import Array, Float, Int
from ..data.record import Record
from ..effects.augmented import starts_of
from ..estimation.argument_checks import check_arguments
from ..estimation.estimate import as_stack, check_channels, check_sampling
from ..estimation.filter.kalman import require_outputs_without_memory
from ..estimation.host_iteration import minimise_by_steps
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.limits import Limits
from ..estimation.model_programs import PROGRAMS, FlatProblem
from ..estimation.problem import Problem
from ..estimation.solver import GaussNewton
from ..models.base import AbstractModel, canonical
from ..models.free import INITIAL_STATE, Free, Parameters, Positions, initial_parameters
from .statistics import FitStatistics, statistics


class Prediction(eqx.Module):
    """Prediction of records that were not used for fitting.

    Attributes:
        t, z, y: times, measured and predicted outputs.
        scored: samples that are scored: valid ones after the window in which the initial state was
            fitted.
        initial_state: initial state of each record, all states of the model.
        outputs, units: names and units of the channels.
        names: names of the records.
        simulated: False if each sample is predicted from the samples before it (Kalman filter).
    """

    t: Float[Array, "case time"]
    z: Float[Array, "case time output"]
    y: Float[Array, "case time output"]
    scored: Array
    initial_state: Float[Array, "case state"]
    outputs: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    simulated: bool = eqx.field(static=True, default=True)

    def anonymous(self) -> "Prediction":
        """The same prediction without the names of its records, as `Record.anonymous`."""
        return dataclasses.replace(self, names=("",) * len(self.names))

    @property
    def residuals(self) -> Float[Array, "case time output"]:
        """`v = z - y` at scored samples, else zero."""
        return jnp.where(self.scored, self.z - self.y, 0.0)

    @property
    def rms(self) -> Float[Array, " output"]:
        """Root mean square error of each channel over the scored samples of all records."""
        return _scored_rms(self.z, self.y, self.scored)

    @property
    def statistics(self) -> FitStatistics:
        """Measures of fit of each channel over the scored samples of all records."""
        return statistics(self.z, self.y, self.scored, outputs=self.outputs, units=self.units)

    def _title(self) -> str:
        """Return the number of records and scored samples in words."""
        names = ", ".join(name for name in self.names if name)
        cases, count = self.z.shape[0], int(np.sum(np.asarray(self.scored)))
        return (
            f"Prediction of {cases} record{'s' * (cases > 1)}{f' ({names})' if names else ''}, "
            f"{count} scored samples"
            f"{'' if self.simulated else ', each predicted from the samples before it'}"
        )

    def _table(self) -> Table:
        """Return error and fit of each channel in words."""
        rms, fit = np.asarray(self.rms), np.asarray(self.statistics.fit)
        rows = zip(self.outputs, rms, fit, self.units, strict=True)
        return Table(
            ("output", "RMS error", "fit [%]", "unit"),
            (6, 12, 9),
            tuple((name, f"{rms:.5g}", f"{fit:.2f}", unit) for name, rms, fit, unit in rows),
        )

    def __str__(self) -> str:
        return "\n".join([self._title(), *self._table().lines()])

    def to_dict(self) -> dict[str, Any]:
        """Return errors, fits and histories as plain numbers and words."""
        histories = {key: np.asarray(getattr(self, key)).tolist() for key in ("t", "z", "y")}
        return {
            "rms": dict(zip(self.outputs, np.asarray(self.rms).tolist(), strict=True)),
            "fit": dict(zip(self.outputs, np.asarray(self.statistics.fit).tolist(), strict=True)),
            "units": dict(zip(self.outputs, self.units, strict=True)),
            "records": list(self.names),
            "scored": np.asarray(self.scored).tolist(),
            **histories,
        }

    def to_xarray(self) -> Any:
        """Return measured and predicted outputs as an `xarray.Dataset` with labelled axes."""
        import xarray as xr  # imported here because it is slow to import

        axes = ("case", "row", "output")
        return xr.Dataset(
            {
                "measured": (axes, np.asarray(self.z)),
                "predicted": (axes, np.asarray(self.y)),
                "scored": (axes, np.asarray(self.scored)),
                "rms": ("output", np.asarray(self.rms)),
            },
            coords={
                "t": (axes[:2], np.asarray(self.t)),
                "case": list(self.names),
                "output": list(self.outputs),
                "unit": ("output", list(self.units)),
            },
        )

    def _repr_html_(self) -> str:
        return self._table().html(above=[self._title()])

    def plot(self, case: int = 0) -> Any:
        """Return a figure of measured and predicted outputs, by matplotlib (`jaxid[report]`).

        Args:
            case: which record.
        """
        from ..report.figures_signals import predicted_outputs

        return predicted_outputs(self, case)


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

    With `FilterError` each sample is predicted from the samples before it. The simulation by the
    same model is `predict(fit.model, records, OutputError(), window=20)`; in gusts its error is
    larger, as the gusts are unknown.

    Args:
        model: the model, with its parameter values. An estimate by a filter has noises, or gains,
            among them; a model without takes the starting values of `likelihood`.
        records: one record or a stack.
        likelihood: computes the predictions and, in the window, their weights.
        window: number of samples at the start of each record; None for none.
        states: states whose initial value is fitted in the window, all by default; the others start
            at `model.initial_state`, necessarily so if no instrument measures them (a position, a
            heading). The memory of an effect at the first sample (`EffectCard.by_record`) is fitted
            with them.

    Returns:
        Predicted outputs and the scored samples.

    Raises:
        InputError: if channels differ, the likelihood cannot serve the sample times, a filter is
            to predict a sensor with a memory, a state does not exist, or a window is shorter than
            needed to determine the state, or longer than a record.
    """
    records = as_stack(records)
    check_arguments(model, records, likelihood)
    check_channels(model, records)
    check_sampling(model, records, likelihood)
    if not likelihood.simulates:
        require_outputs_without_memory(model, records)
    states = model.states if states is None else tuple(states)
    require_known("state", states, model.states)
    if window is not None:
        check_window(records, window, len(states))
    held = {f"{INITIAL_STATE}.{name}" for name in model.states if name not in states}
    starts = tuple(name for name in starts_of(model) if name not in held)
    predictor = Predictor(canonical(likelihood), window, starts, records.n_cases)
    filtered, _ = likelihood.prepared(canonical(model), Free(()), records)
    prediction = predictor.predict(canonical(filtered), records.anonymous())
    return dataclasses.replace(prediction, names=records.names, simulated=likelihood.simulates)


def check_window(records: Record, window: int, unknown: int) -> None:
    """Refuse a window that cannot determine an initial state, or leaves nothing to score.

    Raises:
        InputError: the message gives the samples needed and present.
    """
    shortest = int(np.min(np.asarray(records.samples)))
    valid = np.sum(np.asarray(records.mask)[:, : max(window, 0)], axis=(1, 2))
    fewest = int(np.argmin(valid))
    require(
        int(valid[fewest]) >= unknown and window < shortest,
        f"The window has {window} samples, with {valid[fewest]} valid values of the outputs in "
        f"record {records.names[fewest]!r}; it needs at least {unknown} for {unknown} states, and "
        f"must be shorter than the shortest record, which has {shortest} samples.",
    )


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


class Predictor(eqx.Module):
    """Prediction of records by a model, each from an initial state fitted in a window.

    Attributes:
        likelihood: the likelihood, which simulates.
        window: samples at the start of a record in which its initial state is fitted, or None.
        starts: parameters that are fitted, such as initial states; the others keep their value.
        n_cases: number of records that are simulated at once, that of the training records of a
            study.
        prior: mean and standard deviation of a Gaussian prior on each fitted initial value. It
            holds back a value that a short window does not determine, such as a level that no
            instrument measures.
    """

    likelihood: AbstractLikelihood
    window: int | None = eqx.field(static=True)
    starts: tuple[str, ...] = eqx.field(static=True)
    n_cases: int = eqx.field(static=True)
    prior: Float[Array, "2 start"] | None = None

    def predict(self, model: AbstractModel, records: Record) -> Prediction:
        """Return the prediction of records.

        Args:
            model: the model, with its parameter values.
            records: a stack, anonymous.
        """
        problem = self._problem(model, records)
        rows = self._rows(problem)
        case = FlatProblem.of(problem)
        arguments = case.outputs_arguments(Parameters(to_device(np.zeros(0)), rows))
        y = np.concatenate([PROGRAMS.outputs(*part)[1] for part in self._parts(*arguments)])
        y = to_device(y[: records.n_cases])
        after_window = (np.arange(records.t.shape[1]) >= (self.window or 0))[None, :, None]
        scored = to_device(np.asarray(records.mask) & after_window)
        channels = records.outputs, records.output_units, records.names
        flat = np.asarray(arguments[1])
        initial_state = to_device(flat[:, flat.shape[1] - len(model.states) :])
        return Prediction(records.t, records.z, y, scored, initial_state, *channels)

    def programs(self, model: AbstractModel, records: Record) -> list[tuple[Any, tuple]]:
        """Return the programs of a prediction, each with its arguments, to compile them."""
        problem = self._problem(model, records)
        begin = initial_parameters(model, problem.positions, records)
        case = FlatProblem.of(problem)
        programs: list[tuple[Any, tuple]] = [
            (PROGRAMS.outputs, self._parts(*case.outputs_arguments(begin))[0])
        ]
        if self.window is not None:
            begin = _as_shared(np.asarray(begin.rows)[0])
            arguments = FlatProblem.of(self._head(problem, 0)).sensitivities_arguments(begin)
            programs.append((PROGRAMS.sensitivities, arguments))
        return programs

    def _rows(self, problem: Problem) -> Float[Array, "case start"]:
        """Return the fitted initial values of each record (`starts`)."""
        begin = initial_parameters(problem.model, problem.positions, problem.records)
        rows = np.array(begin.rows)
        if self.window is not None:
            for k, row in enumerate(rows):
                end = minimise_by_steps(self._head(problem, k), _as_shared(row), GaussNewton())
                rows[k] = np.asarray(end.parameters.shared)
        return to_device(rows)

    def _problem(self, model: AbstractModel, records: Record) -> Problem:
        """Return the problem of fitting the initial states of records."""
        chosen = Free((), self.starts)
        limits = Limits.of(chosen, records.n_cases)
        return Problem(model, chosen.positions(model), records, self.likelihood, limits)

    def _head(self, problem: Problem, case: int) -> Problem:
        """Return the problem of the window of one record, whose initial values are shared
        parameters, for their priors.
        """

        def cut(leaf):
            part = np.asarray(leaf)[case : case + 1]
            return to_device(part[:, : self.window] if part.ndim > 1 else part)

        records = _unnamed(jax.tree.map(cut, problem.records))
        pairs = () if self.prior is None else np.asarray(self.prior).T
        priors = [(to_device(mean), to_device(deviation)) for mean, deviation in pairs]
        chosen = Free(self.starts, prior=dict(zip(self.starts, priors, strict=False)))
        at = problem.positions
        return dataclasses.replace(
            problem,
            positions=Positions(at.rows, at.shared, at.leaves),
            records=records,
            limits=Limits.of(chosen, 1),
        )

    def _parts(self, model, flat, records: Record, likelihood) -> list[tuple]:
        """Return the arguments of `outputs` for groups of as many records as the training has.

        The last group is filled with repetitions of the last record.
        """
        count = records.n_cases
        parts = []
        for begin in range(0, count, self.n_cases):
            chosen = np.minimum(begin + np.arange(self.n_cases), count - 1)
            take = partial(_take, chosen=chosen)
            part = _unnamed(jax.tree.map(take, records))
            parts.append((model, take(flat), part, likelihood))
        return parts


def _as_shared(row: Float[np.ndarray, " start"]) -> Parameters:
    """Return the initial values of one record as shared parameters."""
    return Parameters(to_device(row.copy()), to_device(np.zeros((1, 0))))


def _take(leaf, chosen):
    """Return chosen rows of an array."""
    return to_device(np.asarray(leaf)[chosen])


def _unnamed(records: Record) -> Record:
    """Return a stack with one empty name per record; another number of names is another structure,
    which compiles again.
    """
    return dataclasses.replace(records, names=("",) * records.n_cases)
