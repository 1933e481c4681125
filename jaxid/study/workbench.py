"""The workbench of a loop: one augmented model, in which any set of effects can be fitted and scored."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.grid import typical_step
from .._foundation.results import RESULTS
from .._foundation.types import Array, Float
from ..data.record import Record
from ..diagnosis.free_form import Kind, Places, gusts_of
from ..diagnosis.process_noise import ProcessNoise, process_noise
from ..diagnosis.reading import Reading, read
from ..diagnosis.scores import Scores, exchange_falls, scores_of, whitened
from ..diagnosis.validation import Prediction
from ..diagnosis.where import Where, located, resolution
from ..estimation.estimate import Fit
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.solver import GaussNewton
from ..models.augmented import Augmented
from ..models.base import AbstractModel, canonical, equations_of
from ..models.effects import Effect
from ..models.free import (
    INITIAL_STATE,
    Free,
    Parameters,
    Positions,
    all_names,
    leaves_at,
    start,
    with_values,
)
from ..models.library import started, uncertain_equations
from ..models.names import flatten
from ..models.noise import FixedNoise
from ..models.starts import RESIDUAL, SHOWN
from .columns import Columns
from .programs import FITS, KEPT_FITS, PASSES, PREDICTIONS, compile_together, pays_to_compile, placed, signals_of

GO_ON = 10  # times at most that a fit goes on behind its iteration limit
LITTLE = 0.5  # fall of the cost (one of chi-square) that makes it worth while
CREEPING = 0.1  # of all that going on has brought: a time that brings less changes no choice
WIDTH = 8  # effects' parameters are fitted in columns of this many, so that few widths are ever compiled


class Fitted(eqx.Module):
    """A fit of the declared parameters and of some effects.

    Attributes:
        effects: names of the effects that are in.
        values: of all columns; zero gains and starting shapes where an effect is out.
        fit: what the solver left behind, in the order of `columns`, padded.
        columns: which columns were free.
    """

    effects: tuple[str, ...] = eqx.field(static=True)
    values: Float[np.ndarray, " column"]
    fit: Fit
    columns: tuple[int, ...] = eqx.field(static=True)

    @property
    def cost(self) -> float:
        """Negative log-likelihood."""
        return float(self.fit.cost)


class Workbench:
    """Fits and scores any set of effects.

    One compiled pass scores all. Fits take one program as well, or, where that pays (`by_itself`), one for each set of effects.

    Args:
        model: the declared model.
        free: its free parameters.
        effects: the library of candidates.
        likelihood: how the misfit is measured.
        records: the training records, a stack.
        solver: how to iterate.
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
        self.model = canonical(Augmented(model, tuple(effects)))
        self.free, self.solver = canonical(free), solver
        self.likelihood, self.records = canonical(likelihood.compact()), records.anonymous()
        self.effects = {effect.name: effect for effect in self.model.effects_in}
        self.columns = Columns(self.free, tuple(self.effects.values()))
        self.names = all_names(self.model)
        position = {name: index for index, name in enumerate(self.names)}
        self.at = np.array([position[name] for name in self.columns.names], int)
        self.rows = jnp.array([position[name] for name in free.per_record], int)
        self.starts = starting_states(free, model, self.model)
        uncertain = uncertain_equations(canonical(model), np.asarray(self.free.positions(canonical(model)).shared))
        moves = equations_of(model) == model.states  # else they are the outputs, which are places anyway
        self.equations = uncertain if moves else ()
        self.leaves = leaves_at(self.model, np.r_[self.at, np.asarray(self.rows)])
        self.by_itself = pays_to_compile(self.model, self.records.t.shape[1])
        self.begin = self._values()[: self.columns.declared]  # where the declared model's own fit starts
        self.measured: dict[str, np.ndarray] = {}
        self.variables: dict[str, Array] = {}
        self.passed: tuple | None = None

    def compile(self, tests: Sequence[Record], window: int | None) -> None:
        """Compile the programs that every study needs, side by side, before any of them runs.

        Args:
            tests: records that will be predicted.
            window: as `predict` takes it.
        """
        values = self._values()
        declared = self._to_fit((), values, None)
        noise = jnp.eye(len(self.records.outputs))
        by_shape = {(records.z.shape, records.u.shape): records for records in tests}
        programs = [
            (FITS, declared),
            (PASSES, self._of_all(values, declared[1].rows)),
            *((PREDICTIONS, self._to_predict(values, noise, records, window)) for records in by_shape.values()),
        ]
        compile_together(programs)

    def base(self) -> Fitted:
        """The declared model by itself."""
        return self.fit((), self._values())

    def set_shapes(self, fitted: Fitted) -> Fitted:
        """Set the effects' shapes from the signals of the declared model's fit; the fit itself is not touched."""
        signals, self.measured = self._signals(fitted)
        step = float(typical_step(self.records.t))
        effects = started(tuple(self.effects.values()), signals, self.measured, step)
        self.model = eqx.tree_at(lambda model: model.effects_in, self.model, canonical(effects))
        self.effects = {effect.name: effect for effect in effects}
        self.columns.bound(effects)
        values = self._values()
        values[: len(self.free.shared)] = fitted.values[: len(self.free.shared)]
        return eqx.tree_at(lambda one: one.values, fitted, values)

    def fit(
        self,
        effects: Sequence[str],
        values: Float[np.ndarray, " column"],
        rows: Float[Array, "case own"] | None = None,
        creeping: float = CREEPING,
    ) -> Fitted:
        """Estimate the declared parameters and those of some effects together.

        A fit that its iteration limit ends is gone on with, as a search that compares what is under way takes the wrong one.

        Args:
            effects: names of the effects that are in.
            values: of all columns, where to start.
            rows: the records' own parameters, where to start; what the model reads from the records by default.
            creeping: share of all that going on has brought; a time that brings less is the last.
        """
        chosen, values = self.columns.chosen(effects), np.array(values)
        found, costs = None, []
        while found is None or (found.result == RESULTS.steps_exhausted and worth_going_on(costs, creeping)):
            found = FITS(*self._to_fit(effects, values, rows))
            values[chosen] = np.asarray(found.parameters.shared)[: len(chosen)]
            rows, costs = found.parameters.rows, [*costs, float(found.cost)]
        return Fitted(tuple(effects), values, found, tuple(chosen))

    def finish(self, fitted: Fitted) -> Fitted:
        """A fit gone on with to its very end, as a figure that is reported must be."""
        if fitted.fit.result != RESULTS.steps_exhausted:
            return fitted
        return self.fit(fitted.effects, fitted.values, fitted.fit.parameters.rows, creeping=0.0)

    def prepare(self, fitted: Fitted, sets: Sequence[tuple[str, ...]]) -> None:
        """Compile the fits of some sets of effects side by side, where each has a program of its own.

        Args:
            fitted: from which they will start.
            sets: names of effects.
        """
        if self.by_itself:
            rows = fitted.fit.parameters.rows
            FITS.make_room(len(sets), KEPT_FITS)
            compile_together([(FITS, self._to_fit(names, fitted.values, rows)) for names in sets])

    def score(self, fitted: Fitted) -> Scores:
        """Score all columns that are not in a fit."""
        return scores_of(*self._white_columns(fitted), self.columns.marked(fitted.columns))

    def exchange_falls(self, fitted: Fitted, sets: Sequence[tuple[str, ...]]) -> Float[Array, "set column"]:
        """By how much chi-square falls with each column in the place of each set of effects that are in."""
        out = jnp.stack([self.columns.marked(self.columns.of(names)) for names in sets])
        is_gain = self.columns.marked(tuple(self.columns.gains.values()))
        white = self._white_columns(fitted)
        values = jnp.where(is_gain, jnp.asarray(fitted.values), 0.0)
        return exchange_falls(*white, self.columns.marked(fitted.columns), out, values)

    def predict(self, fitted: Fitted, records: Record, window: int | None) -> Prediction:
        """Predict records that were not used."""
        return PREDICTIONS(*self._to_predict(fitted.values, fitted.fit.noise, records, window))

    def where(self, fitted: Fitted, like: Where | None = None) -> Where:
        """Where the residual of a fit sits, among the declared equations, the inputs and the outputs.

        Args:
            fitted: a fit to the training records.
            like: an earlier answer, of which the hats are taken.
        """
        _, _, (v, S) = self._pass(fitted)
        # The model with what is in and nothing else: small, so that this one more program compiles fast.
        model = self._with(fitted.values).only(fitted.effects)
        problem = Problem.of(model, Free((), self.free.per_record), self.records, self.likelihood)
        places: dict[Kind, tuple[str, ...]] = {
            "equation": self.equations,
            "input": model.inputs,
            "output": model.outputs,
        }
        if gusts := gusts_of(model):
            places["air"] = gusts
        hats = resolution(self.records, fitted.fit.residuals) if like is None else like.hats
        own, padding = len(self.rows), self._width(fitted.columns) - len(fitted.columns)
        free = jnp.concatenate([S[..., :own], S[..., own + np.array(fitted.columns, int)]], axis=-1)
        free = jnp.pad(free, ((0, 0), (0, 0), (0, 0), (0, padding)))  # few widths are ever compiled
        parameters = Parameters(jnp.zeros(0), fitted.fit.parameters.rows)
        return located(problem, parameters, (v, free), _regular(fitted.fit.noise), hats, places)

    def read(self, fitted: Fitted) -> Reading:
        """The residual of a fit to the training records, tested against the states, inputs and time of the declared model."""
        return read(fitted.fit.residuals, self.records.mask, self.variables, self.records.outputs)

    def filtered(
        self, fitted: Fitted, force: Float[Array, " place"], places: Places, known: bool, anew: bool = False
    ) -> tuple[ProcessNoise, Scores]:
        """The residual of a fit as the work of what nothing predicts, and the scores of what is absent among innovations.

        Args:
            fitted: a fit to the training records.
            force, places, known: as `process_noise` takes them.
            anew: whether it begins anew, at the fit's or the declared values.
        """
        problem, parameters, *_ = self._to_fit(fitted.effects, fitted.values, fitted.fit.parameters.rows, alone=True)
        values, chosen = np.array(fitted.values), [*fitted.columns]
        values[: self.begin.size] = self.begin
        begin = (parameters, self._to_fit(fitted.effects, values, None, alone=True)[1]) if anew else ()
        noise = process_noise(problem, parameters, force, places, known, begin)
        values[chosen] = noise.parameters.shared[: len(chosen)]
        everything = self._of_all(values, noise.parameters.rows)
        columns = jnp.concatenate([noise.of(problem, PASSES(*everything)[1]), noise.probes], axis=-1)
        is_free = self.columns.marked(fitted.columns)
        return noise, scores_of(noise.v, columns, jnp.pad(is_free, (0, noise.probes.shape[-1])))

    def _white_columns(self, fitted: Fitted):
        """Residuals and sensitivities to all columns, in units of the noise."""
        problem, _, seen = self._pass(fitted)
        return whitened(problem, *seen)

    def _pass(self, fitted: Fitted):
        """The problem with all columns, a fit's values in it, and residuals and sensitivities there; the last is kept, as
        several questions are asked of each fit."""
        if self.passed is None or self.passed[0] is not fitted or self.passed[1][0].records is not self.records:
            asked = self._of_all(fitted.values, fitted.fit.parameters.rows)
            self.passed = (fitted, (*asked, PASSES(*asked)))
        return self.passed[1]

    def _of_all(self, values, rows) -> tuple[Problem, Parameters]:
        """The problem with all columns free, and its parameters."""
        problem, shared = self._problem(range(len(self.at)), len(self.at), values)
        return problem, Parameters(shared, rows)

    def _values(self) -> Float[np.ndarray, " column"]:
        """Of all columns, as the model has them."""
        return np.array(flatten(self.model)[0])[self.at]

    def _to_fit(self, effects: Sequence[str], values, rows, alone: bool = False):
        """What `fit_problem` takes; where it is to be alone, or better is, without the effects that are not in."""
        chosen = self.columns.chosen(effects)
        if alone or self.by_itself:
            problem, shared = self._problem_by_itself(effects, chosen, values)
        else:
            problem, shared = self._problem(chosen, self._width(chosen), values)
        if rows is None:
            rows = start(problem.model, problem.positions, problem.records).rows
        parameters = Parameters(shared, rows)
        return problem, parameters, self.solver, self._known_sensitivities(problem, chosen, values, parameters)

    def _known_sensitivities(self, problem: Problem, chosen: Sequence[int], values, parameters: Parameters):
        """Those of the latest pass, where a fit starts from there; else NaN."""
        records, width = problem.records, parameters.shared.size
        if self.passed is not None:
            fitted, (passed, at, (_, S)) = self.passed
            same = np.array_equal(fitted.values, values) and at.rows is parameters.rows
            if same and passed.records is records:
                own, padding = len(self.rows), width - len(chosen)
                columns = np.r_[np.arange(own), own + np.array(chosen, int)]
                return jnp.pad(S[..., columns], ((0, 0), (0, 0), (0, 0), (0, padding)))
        return jnp.full((*records.z.shape, len(self.rows) + width), jnp.nan, float)

    def _to_predict(self, values, noise, records: Record, window: int | None):
        """What `predict_stack` takes."""
        known = eqx.tree_at(lambda likelihood: likelihood.noise, self.likelihood, FixedNoise(_regular(noise)))
        return self._with(values), records.anonymous(), known, window, self.starts

    def model_and_free(self, fitted: Fitted) -> tuple[AbstractModel, Free]:
        """The declared model with the effects of a fit and its values, and what is free in it."""
        effects = tuple(self.effects[name] for name in fitted.effects)
        names = tuple(self.columns.names[column] for column in fitted.columns)
        declared = self.model.model
        model = with_values(
            Augmented(declared, effects) if effects else declared, names, jnp.asarray(fitted.values[[*fitted.columns]])
        )
        one, own = self.free, self.columns
        lower = {own.names[k]: jnp.asarray(own.lower[k]) for k in fitted.columns if np.isfinite(own.lower[k])}
        upper = {own.names[k]: jnp.asarray(own.upper[k]) for k in fitted.columns if np.isfinite(own.upper[k])}
        return model, Free(names, one.per_record, one.lower | lower, one.upper | upper, one.scale, one.prior)

    def standard_errors(self, fitted: Fitted) -> dict[str, tuple[float, float]]:
        """Value and colour-corrected standard error of every free parameter, by name."""
        deviation = np.sqrt(np.diagonal(np.asarray(fitted.fit.coloured)))
        return {
            self.columns.names[column]: (float(fitted.values[column]), float(deviation[index]))
            for index, column in enumerate(fitted.columns)
        }

    def is_void(self, fitted: Fitted, names: Sequence[str]) -> bool:
        """Whether one of these effects stands on a bound on which it is none, or, off bounds, where nothing determines it."""
        own = self.columns.of(names)
        lost = np.isinf(np.diagonal(fitted.fit.covariance)) & ~np.asarray(fitted.fit.shared_on_bound)
        asked = [self.columns.index[f"{name}.{field}"] for name in names for field in self.effects[name].void_on_bounds]
        bounds = np.stack([self.columns.lower[asked], self.columns.upper[asked]])
        void = np.isclose(fitted.values[asked][None], bounds, rtol=1e-9, atol=0.0)
        return bool(np.any(void) or np.any(lost[: len(fitted.columns)] & np.isin(fitted.columns, own)))

    def _width(self, chosen: Sequence[int]) -> int:
        """In how many columns so many parameters are fitted."""
        declared = self.columns.declared
        return declared + WIDTH * max(1, -(-(len(chosen) - declared) // WIDTH))

    def _problem(self, chosen, width, values):
        """The problem with the chosen columns free, padded to a width, and their starting values."""
        padding = width - len(chosen)
        chosen = [*chosen]
        model = self._with(values)
        shared = jnp.asarray(np.r_[self.at[chosen], np.full(padding, len(self.names))], int)
        positions = Positions(shared, self.rows, self.leaves)
        limits = self.columns.limits(chosen, padding, self.records.n_cases)
        shared = jnp.asarray(np.r_[values[chosen], np.zeros(padding)])
        return Problem(model, positions, self.records, self.likelihood, limits), shared

    def _problem_by_itself(self, effects, chosen, values):
        """The problem with the chosen columns free, in a model with these effects and no other, and their starting values."""
        model = self._with(values).only(effects)
        names = tuple(self.columns.names[column] for column in chosen)
        positions = Free(names, self.free.per_record).positions(model)
        limits = self.columns.limits(chosen, 0, self.records.n_cases)
        return Problem(model, positions, self.records, self.likelihood, limits), jnp.asarray(values[chosen])

    def _with(self, values) -> Augmented:
        return placed(self.model, jnp.asarray(self.at), jnp.asarray(values))

    def _signals(self, fitted: Fitted):
        """Signals of the model over all training records, and the measured outputs, valid samples only."""
        declared = with_values(self.model.model, self.free.shared, jnp.asarray(fitted.values[: len(self.free.shared)]))
        problem = Problem.of(declared, self.free, self.records, self.likelihood)
        shared = jnp.asarray(fitted.values[: len(self.free.shared)])
        signals, real = signals_of(problem, Parameters(shared, fitted.fit.parameters.rows))
        self.variables = {name: signals[name] for name in (*self.model.model.states, *self.model.inputs, "t")}
        real = np.asarray(real)
        mask, z = np.asarray(self.records.mask), np.asarray(self.records.z)
        measured = {name: z[..., i][mask[..., i]] for i, name in enumerate(self.records.outputs)}
        left = np.where(mask, np.asarray(fitted.fit.residuals), 0.0)
        for i, name in enumerate(self.records.outputs):
            signals |= {
                RESIDUAL + name: left[..., i],
                SHOWN + name: np.where(mask[..., i], z[..., i] - left[..., i], 0.0),
            }
        return {name: np.asarray(signal)[real] for name, signal in signals.items()}, measured


def starting_states(free: Free, declared: AbstractModel, augmented: AbstractModel) -> tuple[str, ...]:
    """States whose initial value is fitted where a record is predicted: those that effects brought, and of the declared ones
    those that are free, or all where none is."""
    chosen = tuple(state for state in declared.states if f"{INITIAL_STATE}.{state}" in free.per_record)
    return (chosen or declared.states) + augmented.states[len(declared.states) :]


def _regular(R: Float[Array, "output output"]) -> Float[Array, "output output"]:
    """R with a floor on its diagonal, for a channel that is fitted without any error."""
    floor = jnp.finfo(float).eps * jnp.max(jnp.diagonal(R))
    return R + floor * jnp.eye(R.shape[0])


def worth_going_on(costs: list[float], creeping: float) -> bool:
    """Whether a fit that its iteration limit ended, at these costs so far, is to be gone on with."""
    few = len(costs) < 2  # of which no fall is known
    return len(costs) <= GO_ON and (few or costs[-2] - costs[-1] > max(LITTLE, creeping * (costs[0] - costs[-1])))
