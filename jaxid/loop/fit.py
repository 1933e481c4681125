"""`fit`: estimate of a hypothesis; `LoopFit` owns its linearisation."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property

import equinox as eqx
import numpy as np

from .._foundation.checks import InputError, require
from .._foundation.compiler import fast_compile_jit
from .._foundation.host import to_device
from .._foundation.results import RESULTS, is_one_of
from .._foundation.types import Array, Float
from ..diagnosis.autoregression import autoregressive_r2
from ..diagnosis.validation import Prediction
from ..effects.augmented import Augmented
from ..estimation.estimate import Fit
from ..estimation.host_iteration import fit_by_steps
from ..estimation.likelihoods import OutputError
from ..estimation.model_programs import PROGRAMS, FlatProblem
from ..estimation.solver import GaussNewton
from ..estimation.spectrum_policy import AbstractPolicy, Damp
from ..models.base import AbstractModel
from ..models.free import with_values
from ..models.noise import AbstractNoise, FixedNoise
from .estimation_problem import Estimation, estimation_of
from .hypothesis import Hypothesis, RandomForces
from .linear import Triangle
from .linear_motion import LinearMotion
from .problem import LoopProblem, regular
from .random_forces import force_innovations, forced_motion, information_of

# Chosen: largest number of continuations of a fit that its iteration limit stopped; more cost time
# where a direction is undetermined.
MAX_CONTINUATIONS = 10
# Chosen: fall of the cost (half of chi-square) below which a fit is not continued: one unit of
# chi-square changes no choice between hypotheses.
MIN_COST_FALL = 0.5
# Second policy (chosen). Shortened steps creep in the curved valley of a gain times a time
# constant, where damped ones need a tenth of the evaluations. Damped steps creep where the declared
# model is far from the records: on the benchmark's F-4 whose lift bends over they do not reach in
# 400 evaluations what shortened ones reach in 18.
SECOND_POLICY = Damp()
# Chosen: share of the fall of all continuations so far below which a fit is not continued. Stops
# fits that creep along an undetermined direction.
MIN_CONTINUATION_SHARE = 0.1


@dataclasses.dataclass(frozen=True, eq=False)
class LoopFit:
    """A fit of a hypothesis, with its linearisation.

    Attributes:
        problem: the problem of the search.
        hypothesis: effects and noise.
        estimation: the estimation problem at the fit.
        solution: result of the solver, with the padding of the estimation problem.
    """

    problem: LoopProblem
    hypothesis: Hypothesis
    estimation: Estimation
    solution: Fit

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in the model."""
        return self.hypothesis.effects

    @property
    def cost(self) -> float:
        """Negative log-likelihood of the training records; infinite if a simulation fails."""
        cost = float(self.solution.cost)
        return cost if np.isfinite(cost) else np.inf

    @property
    def converged(self) -> bool:
        """True if the solver met its tolerance."""
        return bool(is_one_of(self.solution.result, (RESULTS.successful, RESULTS.at_bound)))

    @property
    def count(self) -> int:
        """Number of parameters (`Hypothesis.count`)."""
        return self.hypothesis.count(self.problem)

    @property
    def price(self) -> float:
        """Twice the cost, with a price for each parameter: the logarithm of the number of samples
        (Schwarz, Annals of Statistics 6, 1978).
        """
        return 2.0 * self.cost + self.problem.price * self.count

    @cached_property
    def estimates(self) -> dict[str, tuple[float, float]]:
        """Value and standard error, corrected for colour, of each free shared parameter."""
        deviation = np.sqrt(np.diagonal(np.asarray(self.solution.robust_covariance)))
        shared = np.asarray(self.solution.parameters.shared)
        names = self.estimation.free.shared
        return {n: (float(shared[k]), float(deviation[k])) for k, n in enumerate(names)}

    @cached_property
    def model(self) -> AbstractModel:
        """The declared model with the effects and the values of the fit."""
        problem = self.problem
        own = tuple(problem.columns.names[k] for k in problem.columns.chosen(self.effects))
        effects = tuple(problem.effects[name] for name in self.effects)
        model = Augmented(problem.model, effects) if effects else problem.model
        values = np.array([self.estimates[name][0] for name in own])
        return with_values(model, own, to_device(values))

    @property
    def information(self) -> Float[np.ndarray, "row parameter"]:
        """Factor of the information on the free parameters, without the padding columns."""
        factor = np.asarray(self.solution.information.factor)[:, : len(self.estimation.free.shared)]
        return np.asarray(np.linalg.qr(factor, mode="r"))

    @cached_property
    def values(self) -> Float[np.ndarray, " column"]:
        """Values of all columns; zero gains and initial shapes for absent effects."""
        values = self.problem.initial_values.copy()
        for name, column in self.problem.columns.index.items():
            values[column] = self.estimates.get(name, (values[column], 0.0))[0]
        return values

    @cached_property
    def motion(self) -> LinearMotion:
        """Motion of the fit without its random forces, and its linear model."""
        rows = self.estimation.rows(self.solution.parameters)
        return LinearMotion(self.problem, self.effects, self.values, rows)

    @property
    def rows(self) -> dict[str, Float[np.ndarray, " case"]]:
        """Values of the per-record parameters by name."""
        rows = self.estimation.rows(self.solution.parameters)
        return dict(zip(self.estimation.free.per_record, rows.T, strict=True))

    @cached_property
    def triangle(self) -> Triangle:
        """Triangular factor of the sensitivities to all columns, and of the residual."""
        v, S = self.motion.sensitivities
        return self.white_triangle(*self.whitened(v, S), self.problem.columns.names)

    @cached_property
    def free_triangle(self) -> Triangle:
        """Triangular factor of the sensitivities to the free parameters, and of the residual."""
        names = self.estimation.free.shared
        factor = np.asarray(self.solution.information.factor)
        return self.triangle_of(factor[:, [*range(len(names)), -1]], names)

    def triangle_with(self, columns: Mapping[str, Float[np.ndarray, "case time output"]]):
        """Return the triangular factor of the free parameters and of further columns, by name."""
        chosen = self.problem.columns.chosen(self.effects)
        names = tuple(self.problem.columns.names[k] for k in chosen)
        S = np.stack([*columns.values()], axis=-1)
        S = np.concatenate([self.motion.chosen(chosen), S], axis=-1)
        white = self.whitened(self.motion.sensitivities[0], to_device(S))
        return self.white_triangle(*white, (*names, *columns))

    def white_triangle(self, v, S, names: tuple[str, ...]) -> Triangle:
        """Return the triangular factor of whitened columns, the per-record ones eliminated."""
        factor = triangular_factor(v, S, self.motion.own)
        return self.triangle_of(np.asarray(factor), names)

    def whitened(
        self, v: Float[Array, "case time output"], S: Float[Array, "case time output column"]
    ) -> tuple[Float[Array, "case time output"], Float[Array, "case time output column"]]:
        """Return residuals and columns along the motion in units of the noise, with its memory
        removed.
        """
        motion, noise = self.motion, self.hypothesis.noise
        if isinstance(noise, RandomForces):
            forces = noise.at(self.estimates, self.problem.model.outputs)
            return force_innovations(forced_motion(motion, noise, v, S), forces)
        likelihood = self.estimation.problem.likelihood
        return _white(likelihood.noise, v, S, likelihood.row_mask(self.problem.train.mask))

    def triangle_of(self, factor, names: tuple[str, ...]) -> Triangle:
        """Return the factor of some columns with their names; names unknown to the fit are absent.

        An effect is removed by its gain; its shape then has no column, and counts as zero.
        """
        chosen, columns = set(self.estimation.free.shared), self.problem.columns
        free = np.array([name in chosen for name in names])
        gains = {f"{effect}.gain" for effect in columns.of_effect}
        values = [self.values[columns.index[n]] if n in gains else 0.0 for n in names]
        return Triangle(names, factor, free, np.array(values))

    @cached_property
    def white_residuals(self) -> Float[Array, "case time output"]:
        """Residuals in units of the noise, with its memory removed: innovations under colour."""
        likelihood, mask = self.estimation.problem.likelihood, self.problem.train.mask
        if isinstance(likelihood, OutputError):
            v = self.solution.residuals
            return _white(likelihood.noise, v, to_device(np.zeros((*v.shape, 0))), mask)[0]
        case = FlatProblem.of(self.estimation.problem)
        rows, _ = PROGRAMS.sensitivities(*case.sensitivities_arguments(self.solution.parameters))
        return rows[..., : mask.shape[-1]]

    @cached_property
    def predictable(self) -> dict[str, float]:
        """Share of the power of each whitened residual that its own past explains."""
        share = np.asarray(autoregressive_r2(self.white_residuals, self.problem.train.mask))
        return dict(zip(self.problem.model.outputs, map(float, share), strict=True))

    @property
    def noise_covariance(self) -> Float[Array, "output output"]:
        """Covariance of the sensor noise; of its innovations if it is coloured."""
        if isinstance(self.estimation.problem.likelihood, OutputError):
            return self.solution.noise
        deviations = [self.estimates[f"sensor.{n}"][0] for n in self.problem.model.outputs]
        return to_device(np.diag(np.square(deviations)))

    @cached_property
    def check_prediction(self) -> Prediction:
        """Prediction of the check records."""
        return self.predict(self.problem.check)

    def predict(self, records) -> Prediction:
        """Return the prediction of an anonymous stack that was not fitted, by simulation."""
        problem, known = self.problem, FixedNoise(regular(self.noise_covariance))
        predictor = eqx.tree_at(lambda node: node.likelihood.noise, problem.predictor, known)
        if problem.window is not None:
            predictor = dataclasses.replace(predictor, prior=self.motion.usual(predictor.starts))
        return predictor.predict(problem.model_at(self.values, self.effects), records)


def fit(
    problem: LoopProblem,
    hypothesis: Hypothesis,
    parent: LoopFit | None = None,
    start: Mapping[str, float] | None = None,
    target: float = np.inf,
) -> LoopFit:
    """Estimate all parameters of a hypothesis together.

    A fit stopped by its iteration limit is continued by the other policy (`SECOND_POLICY`), unless
    its target is out of reach: comparing unconverged fits can select the wrong candidate.

    Args:
        problem: the problem of the search.
        hypothesis: effects and noise.
        parent: fit from whose values it starts; by default from the declared values.
        start: starting values of some parameters, by name.
        target: cost from which on the fit is of interest.
    """
    values, known = _start(problem, hypothesis, parent, start or {})
    rows = {} if parent is None else rows_at_start(problem, parent)
    S, costs = None, [np.inf]
    policies = problem.solver.policy, SECOND_POLICY
    while True:
        estimation = estimation_of(problem, hypothesis, values, known, rows)
        if len(costs) == 1:  # a continuation starts elsewhere
            S = _known_sensitivities(parent, estimation, hypothesis, values)
            costs = costs if parent is None or S is None else [parent.cost]
        solver = _solver(estimation, problem.solver, policies[(len(costs) - 1) % len(policies)])
        solution = fit_by_steps(estimation.problem, estimation.parameters, solver, S)
        costs, S = [*costs, float(solution.cost)], None
        fitted = LoopFit(problem, hypothesis, estimation, solution)
        stopped = bool(is_one_of(solution.result, (RESULTS.steps_exhausted,)))
        if not stopped or not worth_continuing(costs, target):
            return fitted
        rows = fitted.rows
        shared = np.asarray(solution.parameters.shared)
        known = {name: float(shared[k]) for k, name in enumerate(estimation.free.shared)}
        chosen = problem.columns.chosen(hypothesis.effects)
        values[chosen] = shared[: len(chosen)]


def _solver(estimation: Estimation, solver: GaussNewton, policy: AbstractPolicy) -> GaussNewton:
    """Return the solver with a policy, for a filter without the chord method, as its rows are no
    residuals.
    """
    simple = isinstance(estimation.problem.likelihood, OutputError)
    return dataclasses.replace(solver, policy=policy, chord=solver.chord and simple)


def _start(problem: LoopProblem, hypothesis: Hypothesis, parent: LoopFit | None, start):
    """Return starting values of all columns, and starting values by name."""
    values = (problem.initial_values if parent is None else parent.values).copy()
    estimates = {} if parent is None else parent.estimates
    known = {name: value for name, (value, _) in estimates.items()} | dict(start)
    index, absent = problem.columns.index, set(problem.columns.of_effect) - set(hypothesis.effects)
    for name in set(known) & set(index):
        values[index[name]] = known[name]
    values[[index[f"{name}.gain"] for name in absent]] = 0.0
    return values, known


def rows_at_start(problem: LoopProblem, parent: LoopFit) -> dict[str, Float[np.ndarray, " case"]]:
    """Return the per-record values of a parent from which a fit starts: without its initial states
    where its records begin at another time.
    """
    begin, known = problem.train.t[:, 0], parent.problem.train.t[:, 0]
    left = () if np.array_equal(begin, known) else problem.starts
    return {name: values for name, values in parent.rows.items() if name not in left}


def _known_sensitivities(
    parent: LoopFit | None, estimation: Estimation, hypothesis: Hypothesis, values
) -> Array | None:
    """Return the sensitivities at the start of a fit, known if it starts at its parent's values."""
    if parent is None or not isinstance(estimation.problem.likelihood, OutputError):
        return None
    problem = parent.problem
    same = problem.train is estimation.problem.records and np.array_equal(values, parent.values)
    if not same:
        return None
    chosen, known = problem.columns.chosen(hypothesis.effects), parent.estimation.free.per_record
    S = parent.motion.chosen(chosen)
    own = np.zeros((*S.shape[:-1], estimation.padding.own))  # an effect at zero gain has none
    for k, name in enumerate(estimation.free.per_record):
        if name in known:
            own[..., k] = S[..., known.index(name)]
    columns = np.concatenate([own, S[..., len(known) :]], axis=-1)
    return estimation.padding.padded_columns(columns)


def worth_continuing(costs: list[float], target: float = np.inf) -> bool:
    """Return True if a fit that its iteration limit stopped should be continued.

    Args:
        costs: its cost at the start, infinite if unknown, and after each run so far.
        target: cost that it should reach, with as much fall in each further run.

    Two policies take turns, so that the larger one of the last two falls counts.
    """
    runs, fall = len(costs) - 1, -float(np.min(np.diff(costs[-3:])))
    left = MAX_CONTINUATIONS + 1 - runs
    if left < 1 or not within_reach(costs[-1], fall, target, left):
        return False
    if runs < 3:  # the fall of the continuations by each policy is not known yet
        return True
    return fall > max(MIN_COST_FALL, MIN_CONTINUATION_SHARE * (costs[1] - costs[-1]))


def within_reach(cost: float, fall: float, target: float, runs: int = MAX_CONTINUATIONS) -> bool:
    """Return True if a cost that falls as much in each of some runs becomes lower than a target."""
    return cost - runs * fall < target


def check_finite(declared: LoopFit) -> None:
    """Refuse candidates that spoil the columns of others, and name them.

    Forward derivatives carry every tangent through every effect: an infinite slope times the zero
    of a tangent that does not concern it is not a number, and spoils all columns that are computed
    together with it.

    Raises:
        InputError: if a candidate spoils the column of another parameter than its own, or the
            derivative by a declared parameter is not finite without any candidate.
    """
    problem, columns = declared.problem, declared.motion.infinite_columns
    infinite = {problem.columns.owners.get(column) for column in columns}
    if len(infinite - problem.excluded) < 2 and None not in infinite:  # None: a declared parameter
        return
    own = _infinite_with(declared, ())
    require(
        not own,
        f"On the training records the derivative of the declared model by {', '.join(own)} is not "
        "finite, so that no candidate can be scored. Keep it finite (a root of zero needs a "
        "floor), or leave the parameter out.",
    )
    suspects = tuple(name for name in problem.names if name in infinite) or problem.names
    names = " and of ".join(map(repr, _spoiling(declared, suspects)))
    raise InputError(
        f"On the training records the derivative at zero gain of {names} is not finite, so that "
        "no other candidate can be scored. "
        "Keep it finite (a root of zero needs a floor), or leave the candidate out."
    )


def _spoiling(declared: LoopFit, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the candidates among `names` whose derivative is not finite."""
    if not _infinite_with(declared, names):
        return ()
    half = len(names) // 2
    return _spoiling(declared, names[:half]) + _spoiling(declared, names[half:]) if half else names


def _infinite_with(declared: LoopFit, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the columns that are not finite in a library of the candidates among `names`."""
    library = tuple(effect for effect in declared.problem.library if effect.name in names)
    alone = dataclasses.replace(declared.problem, library=library, excluded=frozenset())
    return dataclasses.replace(declared, problem=alone).motion.infinite_columns


@fast_compile_jit
def _white(noise: AbstractNoise, rows, S, row_mask):
    """Return whitened rows of misfit and sensitivities, those of the outputs."""
    whiten = noise.whitening(rows, row_mask)
    v, mask = rows[..., : S.shape[2]], row_mask[..., : S.shape[2]]
    return whiten.misfit(v, mask), whiten(S, mask)


@fast_compile_jit
def triangular_factor(v, S, own: int):
    """Return the triangle `[T r]` of whitened columns, the per-record ones eliminated."""
    return information_of(v, S, own).factor
