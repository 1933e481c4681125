"""`LoopProblem`: the estimation problems of a closed loop, for any set of effects.

All problems are made from one augmented model, which holds every candidate effect.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from .._foundation.host import to_device
from .._foundation.types import Array, Float
from ..data.record import Record
from ..effects.augmented import Augmented
from ..effects.base import Effect
from ..effects.library import uncertain_equations
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.solver import GaussNewton
from ..loop.columns import Columns
from ..loop.compilation import use_reduced_model
from ..loop.problem import starting_states
from ..loop.thresholds import COLUMN_BLOCK
from ..models.base import AbstractModel, canonical, equations_of
from ..models.free import (
    Free,
    Positions,
    all_names,
    leaves_at,
    with_values,
    with_values_at,
)
from ..models.names import flat_vector
from .fit import Fitted


class LoopProblem:
    """The estimation problems of a closed loop: a model with all candidates, and its records.

    Args:
        model: the declared model.
        free: its free parameters.
        effects: the library of candidates.
        likelihood: measure of the misfit.
        records: the training records, a stack.
        solver: the Gauss-Newton solver.

    Attributes:
        model: the declared model with all candidates.
        effects: the candidates by name.
        columns: the columns of all parameters that can be estimated.
        equations: states whose equations are uncertain; none if the equations are the outputs.
        starts: states whose initial value is fitted for a prediction.
        uses_reduced_model: True if each set of effects is fitted by a program of its own.
        declared_start: values of the declared parameters at which their first fit starts.
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
        self.rows = to_device(np.array([position[name] for name in free.per_record], int))
        self.starts = starting_states(free, model, self.model)
        uncertain = uncertain_equations(
            canonical(model), np.asarray(self.free.positions(canonical(model)).shared)
        )
        # The equations of a static model are its outputs, which are locations anyway.
        has_states = equations_of(model) == model.states
        self.equations = uncertain if has_states else ()
        self.leaves = leaves_at(self.model, np.r_[self.at, np.asarray(self.rows)])
        self.uses_reduced_model = use_reduced_model(self.model, self.records.t.shape[1])
        self.declared_start = self.initial_values()[: self.columns.declared]

    def initial_values(self) -> Float[np.ndarray, " column"]:
        """Return the values of all columns in the model."""
        return np.array(flat_vector(self.model))[self.at]

    def model_at(self, values) -> Augmented:
        """Return the model with values of all columns."""
        return with_values_at(self.model, self.at, np.asarray(values))

    def padded_width(self, chosen: Sequence[int]) -> int:
        """Return the number of columns of a fit of the chosen columns, with the padding."""
        declared = self.columns.declared
        return declared + COLUMN_BLOCK * max(1, -(-(len(chosen) - declared) // COLUMN_BLOCK))

    def padded_problem(
        self, chosen: Sequence[int], width: int, values
    ) -> tuple[Problem, Float[Array, " column"]]:
        """Return the problem with the chosen columns free, padded to a width, and their starting
        values.
        """
        padding = width - len(chosen)
        chosen = [*chosen]
        model = self.model_at(values)
        shared = to_device(np.r_[self.at[chosen], np.full(padding, len(self.names))])
        positions = Positions(shared, self.rows, self.leaves)
        limits = self.columns.limits(chosen, padding, self.records.n_cases)
        shared = to_device(np.r_[values[chosen], np.zeros(padding)])
        return Problem(model, positions, self.records, self.likelihood, limits), shared

    def reduced_problem(
        self, effects: Sequence[str], chosen: Sequence[int], values
    ) -> tuple[Problem, Float[Array, " column"]]:
        """Return the problem with the chosen columns free in a model with only these effects, and
        their starting values.
        """
        model = self.model_at(values).only(effects)
        names = tuple(self.columns.names[column] for column in chosen)
        positions = Free(names, self.free.per_record).positions(model)
        limits = self.columns.limits(chosen, 0, self.records.n_cases)
        problem = Problem(model, positions, self.records, self.likelihood, limits)
        return problem, to_device(values[chosen])

    def model_and_free(self, fitted: Fitted) -> tuple[AbstractModel, Free]:
        """Return the declared model with the effects and the values of a fit, and its free
        parameters.
        """
        effects = tuple(self.effects[name] for name in fitted.effects)
        names = tuple(self.columns.names[column] for column in fitted.columns)
        declared = self.model.model
        model = with_values(
            Augmented(declared, effects) if effects else declared,
            names,
            jnp.asarray(fitted.values[[*fitted.columns]]),
        )
        lower, upper = (
            {
                self.columns.names[k]: jnp.asarray(bounds[k])
                for k in fitted.columns
                if np.isfinite(bounds[k])
            }
            for bounds in (self.columns.lower, self.columns.upper)
        )
        free = self.free
        return model, Free(
            names, free.per_record, free.lower | lower, free.upper | upper, free.scale, free.prior
        )

    def standard_errors(self, fitted: Fitted) -> dict[str, tuple[float, float]]:
        """Return value and colour-corrected standard error of every free parameter, by name."""
        deviation = np.sqrt(np.diagonal(np.asarray(fitted.fit.robust_covariance)))
        return {
            self.columns.names[column]: (float(fitted.values[column]), float(deviation[index]))
            for index, column in enumerate(fitted.columns)
        }

    def is_degenerate(self, fitted: Fitted, names: Sequence[str]) -> bool:
        """Return True if one of these effects is on a bound at which it has no effect, or has an
        undetermined parameter that is not on a bound.
        """
        columns = self.columns
        undetermined = np.isinf(np.diagonal(fitted.fit.covariance)) & ~np.asarray(
            fitted.fit.shared_on_bound
        )
        degenerate = {name: self.effects[name].card.degenerate_at_bounds for name in names}
        at = [columns.index[f"{name}.{field}"] for name in names for field in degenerate[name]]
        bounds = np.stack([columns.lower[at], columns.upper[at]])
        on_bound = np.isclose(fitted.values[at][None], bounds, rtol=1e-9, atol=0.0)
        of_names = np.isin(fitted.columns, columns.of(names))
        return bool(np.any(on_bound) or np.any(undetermined[: len(fitted.columns)] & of_names))
