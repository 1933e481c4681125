"""`Workbench`: fits and scores of any set of effects, and analysis of the residual of a fit."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.grid import typical_step
from .._foundation.location import LocationKind
from .._foundation.results import RESULTS
from .._foundation.types import Array, Float
from ..data.record import Record
from ..diagnosis.free_form import Places, gusts_of
from ..diagnosis.localise import LocalisationResult, localise, resolution
from ..diagnosis.process_noise import ProcessNoise, process_noise
from ..diagnosis.residual_report import ResidualReport, analyse_residual
from ..diagnosis.scores import Scores, exchange_falls, scores_of, whitened
from ..diagnosis.validation import Prediction
from ..effects.base import Effect
from ..effects.library import initialise_shapes
from ..effects.shape_initialisation import RESIDUAL, SIMULATED
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.solver import GaussNewton
from ..models.base import AbstractModel, canonical
from ..models.free import Free, Parameters, initial_parameters, with_values
from .compilation import FITS, PASSES, PREDICTIONS, compile_together, signals_of
from .fit import Fitted, worth_continuing
from .loop_problem import LoopProblem, regular
from .thresholds import MAX_COMPILED_FITS, MIN_CONTINUATION_SHARE


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
        latest_pass: the latest fit, its problem, parameters, and residuals with sensitivities.
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
        self.latest_pass: tuple | None = None

    def compile(self, tests: Sequence[Record], window: int | None) -> None:
        """Compile the programs that every study needs, concurrently, before any of them runs.

        Args:
            tests: records that will be predicted.
            window: window of `predict`.
        """
        values = self.initial_values()
        declared = self._fit_arguments((), values, None)
        noise = jnp.eye(len(self.records.outputs))
        by_shape = {(records.z.shape, records.u.shape): records for records in tests}
        programs = [
            (FITS, declared),
            (PASSES, self.all_columns_free(values, declared[1].rows)),
            *(
                (PREDICTIONS, self.prediction_arguments(values, noise, records, window))
                for records in by_shape.values()
            ),
        ]
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
            fit = FITS(*self._fit_arguments(effects, values, rows))
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
            FITS.make_room(len(sets), MAX_COMPILED_FITS)
            compile_together(
                [(FITS, self._fit_arguments(names, fitted.values, rows)) for names in sets]
            )

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
        out = jnp.stack([self.columns.marked(self.columns.of(names)) for names in sets])
        is_gain = self.columns.marked(tuple(self.columns.gains.values()))
        white = self._white_columns(fitted)
        values = jnp.where(is_gain, jnp.asarray(fitted.values), 0.0)
        return exchange_falls(*white, self.columns.marked(fitted.columns), out, values)

    def predict(self, fitted: Fitted, records: Record, window: int | None) -> Prediction:
        """Return the prediction of records that were not fitted."""
        return PREDICTIONS(
            *self.prediction_arguments(fitted.values, fitted.fit.noise, records, window)
        )

    def localise(
        self, fitted: Fitted, like: LocalisationResult | None = None
    ) -> LocalisationResult:
        """Return the location of the residual of a fit: declared equations, inputs or outputs.

        Args:
            fitted: a fit to the training records.
            like: an earlier result whose spline basis is reused.
        """
        _, _, (v, S) = self._pass(fitted)
        # A model with only the effects of the fit is small, so that this program compiles fast.
        model = self.model_at(fitted.values).only(fitted.effects)
        problem = Problem.of(model, Free((), self.free.per_record), self.records, self.likelihood)
        places = {LocationKind.EQUATION: self.equations, LocationKind.INPUT: model.inputs}
        places[LocationKind.SENSOR] = model.outputs
        if gusts := gusts_of(model):
            places[LocationKind.AIR] = gusts
        splines = resolution(self.records, fitted.fit.residuals) if like is None else like.splines
        own, padding = len(self.rows), self.padded_width(fitted.columns) - len(fitted.columns)
        free = jnp.concatenate([S[..., :own], S[..., own + np.array(fitted.columns, int)]], axis=-1)
        free = jnp.pad(free, ((0, 0), (0, 0), (0, 0), (0, padding)))  # few widths are compiled
        parameters = Parameters(jnp.zeros(0), fitted.fit.parameters.rows)
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
        problem, parameters, *_ = self._fit_arguments(
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
        complete = self.all_columns_free(values, noise.parameters.rows)
        columns = jnp.concatenate([noise.of(problem, PASSES(*complete)[1]), noise.probes], axis=-1)
        is_free = self.columns.marked(fitted.columns)
        is_free = jnp.pad(is_free, (0, noise.probes.shape[-1]))
        return noise, scores_of(noise.v, columns, self.records.mask, is_free)

    def _white_columns(self, fitted: Fitted):
        """Residuals and sensitivities to all columns, in units of the noise."""
        problem, _, linearised = self._pass(fitted)
        return whitened(problem, *linearised)

    def _pass(self, fitted: Fitted):
        """Problem with all columns free, its parameters at the values of a fit, and residuals and
        sensitivities there.

        The latest result is kept, because several methods use it for the same fit.
        """
        if (
            self.latest_pass is None
            or self.latest_pass[0] is not fitted
            or self.latest_pass[1][0].records is not self.records
        ):
            arguments = self.all_columns_free(fitted.values, fitted.fit.parameters.rows)
            self.latest_pass = (fitted, (*arguments, PASSES(*arguments)))
        return self.latest_pass[1]

    def _fit_arguments(self, effects: Sequence[str], values, rows, reduced: bool = False):
        """Arguments of `fit_problem`.

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
        return (
            problem,
            parameters,
            self.solver,
            self._known_sensitivities(problem, chosen, values, parameters),
        )

    def _known_sensitivities(
        self, problem: Problem, chosen: Sequence[int], values, parameters: Parameters
    ):
        """Sensitivities of the latest pass if a fit starts at its parameters, else NaN."""
        records, width = problem.records, parameters.shared.size
        if self.latest_pass is not None:
            fitted, (at_problem, at, (_, S)) = self.latest_pass
            same = np.array_equal(fitted.values, values) and at.rows is parameters.rows
            if same and at_problem.records is records:
                own, padding = len(self.rows), width - len(chosen)
                columns = np.r_[np.arange(own), own + np.array(chosen, int)]
                return jnp.pad(S[..., columns], ((0, 0), (0, 0), (0, 0), (0, padding)))
        return jnp.full((*records.z.shape, len(self.rows) + width), jnp.nan, float)

    def _signals(self, fitted: Fitted):
        """Signals of the model over all training records, and the valid samples of the measured
        outputs.
        """
        declared = with_values(
            self.model.model, self.free.shared, jnp.asarray(fitted.values[: len(self.free.shared)])
        )
        problem = Problem.of(declared, self.free, self.records, self.likelihood)
        shared = jnp.asarray(fitted.values[: len(self.free.shared)])
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
