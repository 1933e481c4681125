"""`LinearMotion`: the motion without random forces at given parameters, and its linear model."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.compiler import fast_compile_jit
from .._foundation.host import to_device
from .._foundation.location import Location, LocationKind
from .._foundation.types import Array, Float
from ..data.record import INITIAL_STATE, Record
from ..diagnosis.free_form import Linear, Places, gusts_of, linear_models, responses
from ..effects.sensor import delayed_signal
from ..effects.shape_initialisation import RECORD
from ..estimation.model_programs import PROGRAMS, FlatProblem
from ..estimation.problem import Problem
from ..models.base import AbstractModel
from ..models.free import Free, Parameters, with_values
from ..models.polynomial import monomials
from .estimation_problem import padded_problem
from .problem import LoopProblem

# Share of the largest element within which two matrices of a linear model are equal (chosen).
SAME_MATRIX = 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class LinearMotion:
    """The simulation of the training records at given parameters, and its linear model.

    Attributes:
        problem: the problem of the search.
        effects: names of the effects in the model.
        values: values of all columns.
        rows: per-record parameters.
    """

    problem: LoopProblem
    effects: tuple[str, ...]
    values: Float[np.ndarray, " column"]
    rows: Float[np.ndarray, "case own"]

    @property
    def own(self) -> int:
        """Number of per-record parameters."""
        return self.rows.shape[1]

    @cached_property
    def fixed(self) -> tuple[Problem, Parameters]:
        """The problem at these values, and its parameters."""
        problem = self.problem
        if not problem.uses_reduced_model:
            return self._padded
        model = problem.model_at(self.values, self.effects).only(self.effects)
        free = Free((), problem.per_record(self.effects))
        base = Problem.of(model, free, problem.train, problem.likelihood)
        return base, Parameters(to_device(np.zeros(0)), to_device(self.rows))

    @cached_property
    def _padded(self) -> tuple[Problem, Parameters]:
        """The problem of the model with all candidates at these values, and its parameters."""
        problem = self.problem
        base, shared = padded_problem(problem, problem.likelihood, self.effects, self.values)
        return base, Parameters(shared, problem.padding(self.effects, ()).padded_own(self.rows))

    @cached_property
    def sensitivities(self) -> tuple[Float[Array, "case time output"], Array]:
        """Residuals and sensitivities to the per-record parameters and all columns.

        A column that is not finite is zero (`infinite_columns`).
        """
        return self._columns[:2]

    @cached_property
    def infinite_columns(self) -> tuple[str, ...]:
        """Names of the columns that are not finite."""
        infinite = self._columns[2][self.own :]
        return tuple(np.array(self.problem.columns.names)[infinite])

    @cached_property
    def _columns(self) -> tuple[Float[Array, "case time output"], Array, np.ndarray]:
        """Residuals, sensitivities with zeros in columns that are not finite, and a mask of these
        columns.
        """
        v, S = self.columns_of(self.problem.columns.names)
        S = np.array(S)
        infinite = ~np.all(np.isfinite(S), axis=(0, 1, 2))
        S[..., infinite] = 0.0
        return v, to_device(S), infinite

    def chosen(self, columns: Sequence[int]) -> Float[np.ndarray, "case time output column"]:
        """Return the sensitivities to the per-record parameters and some columns, of all that are
        known.
        """
        at = np.r_[np.arange(self.own), self.own + np.array(columns, int)]
        return np.asarray(self.sensitivities[1])[..., at]

    def columns_of(self, names: Sequence[str]) -> tuple[Float[Array, "case time output"], Array]:
        """Return residuals and sensitivities to the per-record parameters and to the named
        columns.
        """
        blocks = [PROGRAMS.sensitivities(*arguments) for arguments in self.column_arguments(names)]
        width = self._padded[0].positions.rows.size
        S = np.concatenate([np.asarray(S) for _, S in blocks], axis=-1)[..., : width + len(names)]
        return blocks[0][0], to_device(np.delete(S, np.s_[self.own : width], axis=-1))

    def column_arguments(self, names: Sequence[str]) -> Iterator[tuple]:
        """Yield the arguments of the program of the sensitivities for `columns_of`, in blocks as
        wide as a fit; in one block of all columns where steps are linearised, as reverse mode
        costs the same for any number.
        """
        problem, columns = self.problem, self.problem.columns
        base, parameters = self._padded
        case = FlatProblem.of(base)
        model, *others = case.outputs_arguments(parameters)
        chosen = problem.positions[[columns.index[name] for name in names]]
        rows = np.asarray(base.positions.rows)
        own = rows.size
        width = own + problem.positions.size if problem.is_long else case.at.size
        at = np.r_[rows, chosen]
        padded = np.r_[at, np.full(-at.size % width, len(problem.position))]
        owners = [None] * own + [columns.owners.get(name) for name in names]
        for k in range(0, padded.size, width):
            held = {*self.effects, *owners[k : k + width]} - {None}
            block = to_device(padded[k : k + width])
            yield model.with_present(held), *others, block, problem.leaves

    @cached_property
    def places(self) -> dict[LocationKind, tuple[str, ...]]:
        """Names of all places of a disturbance, by kind."""
        model = self.fixed[0].model
        kinds = {
            LocationKind.EQUATION: model.states,
            LocationKind.INPUT: model.inputs,
            LocationKind.SENSOR: model.outputs,
            LocationKind.AIR: gusts_of(model),
        }
        return {kind: names for kind, names in kinds.items() if names}

    @cached_property
    def x(self) -> Float[np.ndarray, "case time state"]:
        """States of all records, those of the effects included."""
        problem, parameters = self.fixed
        arguments = FlatProblem.of(problem).outputs_arguments(parameters)
        return np.asarray(PROGRAMS.outputs(*arguments)[0])

    @cached_property
    def linear(self) -> Linear:
        """Linear models of all records, with a disturbance at each place."""
        return linear_models(*self.linear_arguments)

    @property
    def linear_arguments(self) -> tuple[Problem, Parameters, Places]:
        """Arguments of `linear_models`."""
        return *self.fixed, tuple(self.places.items())

    def linear_at(self, chosen: Mapping[LocationKind, tuple[str, ...]]) -> Linear:
        """Return the linear models with disturbances at some places."""
        places: Places = tuple((kind, names) for kind, names in chosen.items() if names)
        return self.linear.at(tuple(self.places.items()), places)

    @property
    def is_linear(self) -> bool:
        """True if the linear model is one and the same along all records, and therefore exact."""
        rows = self.problem.recorded
        Phi, C = np.asarray(self.linear.Phi)[rows[:, 1:]], np.asarray(self.linear.C)[rows]
        spread = ((np.ptp(matrix, axis=0), np.max(np.abs(matrix))) for matrix in (Phi, C))
        return all(bool(np.all(part <= SAME_MATRIX * size)) for part, size in spread)

    def without_absent_states(self, linear: Linear) -> Linear:
        """Return linear models without the states of absent effects, which act on nothing."""
        states = self.problem.augmented.only(self.effects).states
        return linear.of_states([self.fixed[0].model.states.index(name) for name in states])

    def usual(self, starts: Sequence[str]) -> Float[Array, "2 start"]:
        """Return mean and standard deviation of some initial states along the motion; the latter is
        infinite for a state that rests, and for other parameters.
        """
        known = [f"{INITIAL_STATE}.{name}" for name in self.fixed[0].model.states]
        x = self.x[self.problem.recorded]
        along = [x[:, known.index(name)] if name in known else np.zeros(1) for name in starts]
        deviation = np.array([np.std(values) for values in along])
        mean = np.array([np.mean(values) for values in along])
        return to_device(np.stack([mean, np.where(deviation > 0, deviation, np.inf)]))

    @cached_property
    def signals(self) -> dict[str, np.ndarray]:
        """All signals of the declared model along the motion, by name."""
        problem, declared = self.problem, self.problem.columns.declared
        model = with_values(problem.model, problem.free.shared, to_device(self.values[:declared]))
        x = to_device(self.x[..., : len(model.states)])
        return {n: np.asarray(s) for n, s in signals_of(model, problem.train, x).items()}

    @property
    def variables(self) -> dict[str, np.ndarray]:
        """States, inputs and time along the motion, by name."""
        model, signals = self.problem.model, self.signals
        return {name: signals[name] for name in (*model.states, *model.inputs, "t")}

    def response(self, terms: Sequence[tuple[str, str]]) -> Float[np.ndarray, "case time output"]:
        """Return the response of the outputs to terms in equations, in the linear model.

        Args:
            terms: pairs of a state, in whose equation a term acts, and the term; of an output for a
                static model, whose equations are those of its outputs.
        """
        total = np.zeros(self.problem.train.z.shape)
        for name, term in terms:
            is_state = name in self.problem.model.states
            kind = LocationKind.EQUATION if is_state else LocationKind.SENSOR
            total += self._response_to(_term_values(term, self.signals), Location(kind, name))
        return total

    def response_to_spread(
        self, at: Location, time: float, centre: float
    ) -> Float[np.ndarray, "case time output"]:
        """Return the response of the outputs, in the linear model, if half of a signal arrives
        earlier and half of it later.

            d(t) = (s(t - centre + time) + s(t - centre - time)) / 2 - s(t - centre)

        Args:
            at: the sensor whose output, or the input, that is the signal `s`.
            time: how much earlier and later [s].
            centre: delay of the signal as a whole [s].
        """
        if at.kind is LocationKind.SENSOR:
            signal = self.linear.y[..., self.problem.model.outputs.index(at.name)]
        else:
            signal = self.signals[at.name]
        delays = centre + time * np.array([-1.0, 0.0, 1.0])
        early, middle, late = _delayed(self.problem.train.t, signal, delays)
        return self._response_to((early + late) / 2 - middle, at)

    def _response_to(
        self, disturbance: Float[Array, "case time"], at: Location
    ) -> Float[np.ndarray, "case time output"]:
        """Return the response of the outputs to a disturbance at one place."""
        linear = self.linear_at({at.kind: (at.name,)})
        disturbances = to_device(np.asarray(disturbance)[..., None])
        return np.asarray(responses(linear, disturbances))[..., 0, 0]


@fast_compile_jit
def _delayed(t, signal, delays) -> Float[Array, "delay case time"]:
    """Return a signal with each delay."""
    of_records = jax.vmap(delayed_signal, (0, 0, None))
    return jax.vmap(of_records, (None, None, 0))(t, signal, delays)


@fast_compile_jit
def _term_values(term: str, signals: dict) -> Float[Array, "case time"]:
    """Return the values of a term at every sample."""
    return jax.vmap(jax.vmap(lambda instant: monomials((term,), instant)[0]))(signals)


@fast_compile_jit
def signals_of(
    model: AbstractModel, records: Record, x: Float[Array, "case time state"]
) -> dict[str, Float[Array, "case time"]]:
    """Return every signal of a model at states `x`, with time and record number (jitted)."""
    signals = jax.vmap(jax.vmap(model.signals))(records.t, x, records.u)
    number = jnp.broadcast_to(1.0 * jnp.arange(records.n_cases)[:, None], records.t.shape)
    return {"t": records.t, RECORD: number} | signals
