"""`Workbench`: fits and scores of any set of effects, and analysis of the residual of a fit."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.evicting_jit import compile_together
from .._foundation.grid import typical_step
from .._foundation.host import to_device
from .._foundation.location import LocationKind
from .._foundation.results import RESULTS
from .._foundation.types import Array, Float
from ..data.record import Record
from ..diagnosis.free_form import Places, gusts_of
from ..diagnosis.localise import LocalisationResult, localise, resolution
from ..diagnosis.process_noise import ProcessNoise, process_noise
from ..diagnosis.residual_report import ResidualReport, analyse_residual
from ..diagnosis.scores import Scores, exchange_falls, scores_of, whitened
from ..diagnosis.validation import Prediction, Predictor
from ..effects.base import Effect
from ..effects.library import initialise_shapes
from ..effects.shape_initialisation import RESIDUAL, SIMULATED
from ..estimation.host_iteration import fit_by_steps
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.model_programs import PROGRAMS, FlatProblem
from ..estimation.problem import Problem
from ..estimation.solver import GaussNewton
from ..loop.compilation import signals_of
from ..loop.fit import worth_continuing
from ..loop.problem import regular
from ..loop.thresholds import MAX_COMPILED_FITS, MIN_CONTINUATION_SHARE
from ..models.base import AbstractModel, canonical
from ..models.free import Free, Parameters, initial_parameters, with_values
from ..models.noise import FixedNoise
from .fit import Fitted
from .loop_problem import LoopProblem


class Pass(NamedTuple):
    """Residuals `v` and sensitivities `S` to all columns at the values of a fit."""

    fitted: Fitted
    records: Record
    v: Float[Array, "case time output"]
    S: Float[Array, "case time output column"]


class Workbench(LoopProblem):
    """Fits and scores any set of effects.

    One compiled pass scores all effects. Fits share one compiled program too, or, if that is
    faster (`uses_reduced_model`), have one for each set of effects.

    Args:
        model: the declared model.
        free: its free parameters.
        effects: the library of candidates.
        likelihood: measure of the misfit.
        records: the training records, a stack.
        solver: the Gauss-Newton solver.

    Attributes:
        measured: valid samples of each measured output, by name.
        variables: signals against which the residual is tested: declared states, inputs and time.
        latest_pass: sensitivities to all columns at the latest fit that needed them.
    """

    def __init__(
        self,
        model: AbstractModel,
        free: Free,
        effects: Sequence[Effect],
        likelihood: AbstractLikelihood,
        records: Record,
        solver: GaussNewton,
    ):
        super().__init__(model, free, effects, likelihood, records, solver)
        self.measured: dict[str, np.ndarray] = {}
        self.variables: dict[str, Array] = {}
        self.latest_pass: Pass | None = None

    def compile(self, tests: Sequence[Record], window: int | None) -> None:
        """Compile the programs that every study needs, concurrently, before any of them runs.

        Args:
            tests: records that will be predicted.
            window: window of `predict`.
        """
        values = self.initial_values()
        problem, parameters, _ = self._fit_arguments((), values, None)
        case = FlatProblem.of(problem)
        programs: list[tuple[Any, tuple]] = [
            (PROGRAMS.outputs, case.outputs_arguments(parameters)),
            (PROGRAMS.sensitivities, case.sensitivities_arguments(parameters)),
        ]
        predictor, model = self._predictor(self.likelihood, window), self.model_at(values)
        for records in tests:
            programs += predictor.programs(model, records.anonymous())
        compile_together(programs)

    def base(self) -> Fitted:
        """Return the fit of the declared model without effects."""
        return self.fit((), self.initial_values())

    def set_shapes(self, fitted: Fitted) -> Fitted:
        """Set the initial shapes of the effects from the signals of the declared model's fit.

        Returns:
            The same fit, with the new shapes among its values.
        """
        signals, self.measured = self._signals(fitted)
        step = float(typical_step(self.records.t))
        effects = initialise_shapes(tuple(self.effects.values()), signals, self.measured, step)
        self.model = eqx.tree_at(lambda model: model.effects_in, self.model, canonical(effects))
        self.effects = {effect.name: effect for effect in effects}
        self.columns.bound(effects)
        values = self.initial_values()
        values[: len(self.free.shared)] = fitted.values[: len(self.free.shared)]
        return eqx.tree_at(lambda node: node.values, fitted, values)

    def fit(
        self,
        effects: Sequence[str],
        values: Float[np.ndarray, " column"],
        rows: Float[Array, "case own"] | None = None,
        creeping: float = MIN_CONTINUATION_SHARE,
    ) -> Fitted:
        """Estimate the declared parameters and those of some effects together.

        A fit stopped by its iteration limit is continued: comparing unconverged fits can select the
        wrong candidate.

        Args:
            effects: names of the effects in the model.
            values: starting values of all columns.
            rows: starting values of the per-record parameters; by default those that the model
                reads from the records.
            creeping: share of the fall of all continuations; a continuation that brings less is the
                last.
        """
        chosen, values = self.columns.chosen(effects), np.array(values)
        fit, costs = None, []
        while fit is None or (
            fit.result == RESULTS.steps_exhausted and worth_continuing(costs, creeping)
        ):
            problem, parameters, S = self._fit_arguments(effects, values, rows)
            fit = fit_by_steps(problem, parameters, self.solver, S)
            values[chosen] = np.asarray(fit.parameters.shared)[: len(chosen)]
            rows, costs = fit.parameters.rows, [*costs, float(fit.cost)]
        return Fitted(tuple(effects), values, fit, tuple(chosen))

    def finish(self, fitted: Fitted) -> Fitted:
        """Return a fit continued until it falls no more; reported figures need a converged fit."""
        if fitted.fit.result != RESULTS.steps_exhausted:
            return fitted
        return self.fit(fitted.effects, fitted.values, fitted.fit.parameters.rows, creeping=0.0)

    def prepare(self, fitted: Fitted, sets: Sequence[tuple[str, ...]]) -> None:
        """Compile the fits of some sets of effects concurrently, if each has a program of its own.

        Args:
            fitted: the fit from which they will start.
            sets: names of the effects of each set.
        """
        if self.uses_reduced_model:
            rows = fitted.fit.parameters.rows
            for program in PROGRAMS:
                program.make_room(len(sets), MAX_COMPILED_FITS)
            programs: list[tuple[Any, tuple]] = []
            for names in sets:
                problem, parameters, _ = self._fit_arguments(names, fitted.values, rows)
                case = FlatProblem.of(problem)
                programs.append((PROGRAMS.outputs, case.outputs_arguments(parameters)))
                programs.append((PROGRAMS.sensitivities, case.sensitivities_arguments(parameters)))
            compile_together(programs)

    def score(self, fitted: Fitted) -> Scores:
        """Return the scores of all columns that are not free in a fit."""
        return scores_of(
            *self._white_columns(fitted), self.records.mask, self.columns.marked(fitted.columns)
        )

    def exchange_falls(
        self, fitted: Fitted, sets: Sequence[tuple[str, ...]]
    ) -> Float[Array, "set column"]:
        """Return the predicted fall of chi-square with each column in place of each set of effects
        in the model.
        """
        out = to_device(
            np.stack([np.asarray(self.columns.marked(self.columns.of(names))) for names in sets])
        )
        is_gain = np.asarray(self.columns.marked(tuple(self.columns.gains.values())))
        white = self._white_columns(fitted)
        values = to_device(np.where(is_gain, fitted.values, 0.0))
        return exchange_falls(*white, self.columns.marked(fitted.columns), out, values)

    def predict(self, fitted: Fitted, records: Record, window: int | None) -> Prediction:
        """Return the prediction of records that were not fitted."""
        known = FixedNoise(regular(fitted.fit.noise))
        likelihood = eqx.tree_at(lambda node: node.noise, self.likelihood, known)
        model = self.model_at(fitted.values)
        return self._predictor(likelihood, window).predict(model, records.anonymous())

    def _predictor(self, likelihood: AbstractLikelihood, window: int | None) -> Predictor:
        """Return the predictor with the given window."""
        return Predictor(likelihood, window, self.starts, self.records.n_cases)

    def localise(
        self, fitted: Fitted, like: LocalisationResult | None = None
    ) -> LocalisationResult:
        """Return the location of the residual of a fit: declared equations, inputs or outputs.

        Args:
            fitted: a fit to the training records.
            like: an earlier result whose spline basis is reused.
        """
        _, v, S = self._pass(fitted)
        # A model with only the effects of the fit is small, so that this program compiles fast.
        model = self.model_at(fitted.values).only(fitted.effects)
        problem = Problem.of(model, Free((), self.free.per_record), self.records, self.likelihood)
        places = {LocationKind.EQUATION: self.equations, LocationKind.INPUT: model.inputs}
        places[LocationKind.SENSOR] = model.outputs
        if gusts := gusts_of(model):
            places[LocationKind.AIR] = gusts
        splines = resolution(self.records, fitted.fit.residuals) if like is None else like.splines
        own, padding = len(self.rows), self.padded_width(fitted.columns) - len(fitted.columns)
        free = np.asarray(S)[..., np.r_[np.arange(own), own + np.array(fitted.columns, int)]]
        free = to_device(np.pad(free, ((0, 0), (0, 0), (0, 0), (0, padding))))  # few widths
        parameters = Parameters(to_device(np.zeros(0)), fitted.fit.parameters.rows)
        return localise(problem, parameters, (v, free), regular(fitted.fit.noise), splines, places)

    def analyse_residual(self, fitted: Fitted) -> ResidualReport:
        """Return tests of the residual of a fit to the training records against the states, inputs
        and time of the declared model.
        """
        return analyse_residual(
            fitted.fit.residuals, self.records.mask, self.variables, self.records.outputs
        )

    def whiten_with_noise_model(
        self,
        fitted: Fitted,
        force: Float[Array, " place"],
        places: Places,
        known: bool,
        from_declared: bool = False,
    ) -> tuple[ProcessNoise, Scores]:
        """Return a noise model of the residual of a fit, and the scores of the absent effects in
        its innovations.

        Args:
            fitted: a fit to the training records.
            force, places, known: arguments of `process_noise`.
            from_declared: True if the search for the noise model starts from the values of the fit
                and from the declared values, instead of the default start.
        """
        problem, parameters, _ = self._fit_arguments(
            fitted.effects, fitted.values, fitted.fit.parameters.rows, reduced=True
        )
        values, chosen = np.array(fitted.values), [*fitted.columns]
        values[: self.declared_start.size] = self.declared_start
        starts = ()
        if from_declared:
            starts = (
                parameters,
                self._fit_arguments(fitted.effects, values, None, reduced=True)[1],
            )
        noise = process_noise(problem, parameters, force, places, known, starts)
        values[chosen] = noise.parameters.shared[: len(chosen)]
        _, S = self._all_columns(values, noise.parameters.rows)
        columns = jnp.concatenate([noise.of(problem, S), noise.probes], axis=-1)
        is_free = self.columns.marked(fitted.columns)
        is_free = jnp.pad(is_free, (0, noise.probes.shape[-1]))
        return noise, scores_of(noise.v, columns, self.records.mask, is_free)

    def _white_columns(self, fitted: Fitted):
        """Residuals and sensitivities to all columns, in units of the noise."""
        return whitened(*self._pass(fitted))

    def _pass(self, fitted: Fitted):
        """Problem of a fit, and residuals and sensitivities to all columns at its values.

        The latest result is kept, because several methods use it for the same fit.
        """
        if (
            self.latest_pass is None
            or self.latest_pass.fitted is not fitted
            or self.latest_pass.records is not self.records
        ):
            columns = self._all_columns(fitted.values, fitted.fit.parameters.rows)
            self.latest_pass = Pass(fitted, self.records, *columns)
        problem, _ = self.padded_problem((), self.padded_width(()), fitted.values)
        return problem, self.latest_pass.v, self.latest_pass.S

    def _all_columns(self, values, rows):
        """Residuals and sensitivities to all columns, in blocks as wide as a fit."""
        problem, shared = self.padded_problem((), self.padded_width(()), values)
        case = FlatProblem.of(problem)
        arguments = case.outputs_arguments(Parameters(shared, rows))
        at, width = np.r_[np.asarray(self.rows), self.at], case.at.size
        padded = np.r_[at, np.full(-at.size % width, len(self.names))]
        blocks = [
            PROGRAMS.sensitivities(*arguments, to_device(block), self.leaves)
            for block in padded.reshape(-1, width)
        ]
        S = np.concatenate([np.asarray(S) for _, S in blocks], axis=-1)[..., : at.size]
        return blocks[0][0], to_device(S)

    def _fit_arguments(self, effects: Sequence[str], values, rows, reduced: bool = False):
        """Problem of a fit, its initial parameters, and the sensitivities there if known.

        The model has no absent effects if `reduced` is True or such fits are faster.
        """
        chosen = self.columns.chosen(effects)
        if reduced or self.uses_reduced_model:
            problem, shared = self.reduced_problem(effects, chosen, values)
        else:
            problem, shared = self.padded_problem(chosen, self.padded_width(chosen), values)
        if rows is None:
            rows = initial_parameters(problem.model, problem.positions, problem.records).rows
        parameters = Parameters(shared, rows)
        return problem, parameters, self._known_sensitivities(chosen, values, parameters)

    def _known_sensitivities(self, chosen: Sequence[int], values, parameters: Parameters):
        """Sensitivities of the latest pass if a fit starts at its parameters, else None."""
        latest = self.latest_pass
        if latest is None or latest.records is not self.records:
            return None
        same = np.array_equal(latest.fitted.values, values)
        if not (same and latest.fitted.fit.parameters.rows is parameters.rows):
            return None
        own, padding = len(self.rows), parameters.shared.size - len(chosen)
        S = np.asarray(latest.S)[..., np.r_[np.arange(own), own + np.array(chosen, int)]]
        return to_device(np.pad(S, ((0, 0), (0, 0), (0, 0), (0, padding))))

    def _signals(self, fitted: Fitted):
        """Signals of the model over all training records, and the valid samples of the measured
        outputs.
        """
        shared = to_device(np.array(fitted.values[: len(self.free.shared)]))
        declared = with_values(self.model.model, self.free.shared, shared)
        problem = Problem.of(declared, self.free, self.records, self.likelihood)
        signals, real = signals_of(problem, Parameters(shared, fitted.fit.parameters.rows))
        self.variables = {
            name: signals[name] for name in (*self.model.model.states, *self.model.inputs, "t")
        }
        real = np.asarray(real)
        mask, z = np.asarray(self.records.mask), np.asarray(self.records.z)
        measured = {name: z[..., i][mask[..., i]] for i, name in enumerate(self.records.outputs)}
        left = np.where(mask, np.asarray(fitted.fit.residuals), 0.0)
        for i, name in enumerate(self.records.outputs):
            signals |= {
                RESIDUAL + name: left[..., i],
                SIMULATED + name: np.where(mask[..., i], z[..., i] - left[..., i], 0.0),
            }
        return {name: np.asarray(signal)[real] for name, signal in signals.items()}, measured
