"""Prediction of held-out records in a study, by the programs that its fits use."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._foundation.host import to_device
from .._foundation.types import Array, Float
from ..data.record import Record
from ..diagnosis.validation import Prediction
from ..estimation.host_iteration import FlatProblem, minimise_by_steps
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Limits, Problem
from ..estimation.solver import GaussNewton
from ..models.base import AbstractModel
from ..models.free import INITIAL_STATE, Free, Parameters, initial_parameters
from ..models.noise import FixedNoise
from .compilation import PROGRAMS


class Predictor(eqx.Module):
    """Prediction of records by a model, each from an initial state fitted in a window.

    Attributes:
        likelihood: the likelihood, which simulates.
        window: samples at the start of a record in which its initial state is fitted, or None.
        states: states whose initial value is fitted; the others start at `model.initial_state`.
        n_cases: number of records that are simulated at once, that of the training records.
    """

    likelihood: AbstractLikelihood
    window: int | None = eqx.field(static=True)
    states: tuple[str, ...] = eqx.field(static=True)
    n_cases: int = eqx.field(static=True)

    def predict(
        self, model: AbstractModel, records: Record, noise: Float[Array, "output output"]
    ) -> Prediction:
        """Return the prediction of records, as `diagnosis.validation.predict`.

        Args:
            model: the model, with its parameter values.
            records: a stack, anonymous.
            noise: covariance of the measurement noise, which weights the residuals in the window.
        """
        rows = self._rows(model, records, noise)
        case = FlatProblem.of(self._problem(model, records, noise))
        arguments = case.outputs_arguments(Parameters(to_device(np.zeros(0)), rows))
        y = np.concatenate([PROGRAMS.outputs(*part) for part in self._parts(*arguments)])
        y = to_device(y[: records.n_cases])
        after_window = (np.arange(records.t.shape[1]) >= (self.window or 0))[None, :, None]
        scored = to_device(np.asarray(records.mask) & after_window)
        return Prediction(records.t, records.z, y, scored, rows)

    def programs(self, model: AbstractModel, records: Record) -> list[tuple[Any, tuple]]:
        """Return the programs of a prediction, each with its arguments, to compile them."""
        problem = self._problem(model, records, to_device(np.eye(len(model.outputs))))
        begin = initial_parameters(model, problem.positions, records)
        case = FlatProblem.of(problem)
        programs: list[tuple[Any, tuple]] = [
            (PROGRAMS.outputs, self._parts(*case.outputs_arguments(begin))[0])
        ]
        if self.window is not None:
            head = self._problem(
                model, self._head(records, 0), to_device(np.eye(len(model.outputs)))
            )
            begin = Parameters(begin.shared, to_device(np.asarray(begin.rows)[:1]))
            arguments = FlatProblem.of(head).sensitivities_arguments(begin)
            programs.append((PROGRAMS.sensitivities, arguments))
        return programs

    def _rows(self, model: AbstractModel, records: Record, noise) -> Float[Array, "case state"]:
        """Return the initial state of each record."""
        problem = self._problem(model, records, noise)
        rows = np.array(initial_parameters(model, problem.positions, records).rows)
        if self.window is not None:
            for k, row in enumerate(rows):
                head = self._problem(model, self._head(records, k), noise)
                begin = Parameters(to_device(np.zeros(0)), to_device(row[None].copy()))
                end = minimise_by_steps(head, begin, GaussNewton(), PROGRAMS)
                rows[k] = np.asarray(end.parameters.rows)[0]
        return to_device(rows)

    def _problem(self, model: AbstractModel, records: Record, noise) -> Problem:
        """Return the problem of fitting the initial states of records."""
        free = Free((), tuple(f"{INITIAL_STATE}.{state}" for state in self.states))
        known = eqx.tree_at(lambda node: node.noise, self.likelihood, FixedNoise(noise))
        limits = Limits.of(free, records.n_cases)
        return Problem(model, free.positions(model), records, known, limits)

    def _head(self, records: Record, case: int) -> Record:
        """Return the window of one record, as a stack."""

        def cut(leaf):
            part = np.asarray(leaf)[case : case + 1]
            return to_device(part[:, : self.window] if part.ndim > 1 else part)

        return _unnamed(jax.tree.map(cut, records))

    def _parts(self, model, flat, records: Record, likelihood) -> list[tuple]:
        """Return the arguments of `outputs` for groups of as many records as the training has.

        The last group is filled with repetitions of the last record.
        """
        count = records.n_cases
        parts = []
        for begin in range(0, count, self.n_cases):
            chosen = np.minimum(begin + np.arange(self.n_cases), count - 1)
            take = lambda leaf, chosen=chosen: to_device(np.asarray(leaf)[chosen])  # noqa: E731
            part = _unnamed(jax.tree.map(take, records))
            parts.append((model, take(flat), part, likelihood))
        return parts


def _unnamed(records: Record) -> Record:
    """Return a stack with one empty name per record; another number of names is another structure,
    which compiles again.
    """
    return dataclasses.replace(records, names=("",) * records.n_cases)
