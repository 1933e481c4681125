"""`LoopProblem`: declared model, library of candidate effects and records of a search."""

import dataclasses
import itertools
from collections.abc import Collection
from functools import cached_property

import jax
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.host import to_device
from .._foundation.types import Array, Bool, Float
from ..data.record import Record
from ..diagnosis.validation import Predictor, check_window
from ..effects.augmented import Augmented, starts_of
from ..effects.base import Effect
from ..effects.card import EffectCard
from ..effects.channel_checks import check_absent
from ..effects.library import uncertain_equations
from ..estimation.autoregressive_noise import AutoregressiveNoise
from ..estimation.estimate import as_stack, check_channels, check_samples, check_sampling
from ..estimation.likelihoods import AbstractLikelihood, OutputError
from ..estimation.solver import GaussNewton
from ..models.base import AbstractModel, canonical, equations_of
from ..models.free import INITIAL_STATE, Free, all_names, leaves_at, with_values_at
from ..models.names import flat_vector
from ..simulation.steppers import rate
from .columns import COLUMN_BLOCK, ROW_BLOCK, Columns, Padding, padded_number

# The tolerance is in standard errors; a decision needs no smaller one. Most fits converge in some
# twenty steps, and one that has not in forty continues with another policy (`fit`).
SEARCH_SOLVER = GaussNewton(tolerance=1e-2, least_fall=1e-3, max_steps=40, chord=True)
# Chosen: longest memory of a noise, in durations of a record. A slower one renews itself less than
# five times in a record, and is as well a constant or a drift.
LONGEST_MEMORY = 0.1
# Measured: cost of compiling a fit, in operations that the 24 passes of a refit do per sample:
# 3 s and 10 ms per operation of its model, at 0.3 us per operation and sample (0.15 to 0.6), on
# two cores, for models of 6 to 1,435 operations.
COMPILE_COST, COMPILE_COST_PER_OPERATION = 400_000, 1400
# Measured: samples of the training records from which fits of reduced models, and the columns of
# all candidates, are faster with linearised steps. On 43,375 samples of the Silverbox a refit's ten
# passes take 1.9 s less and its compilation 0.4 s more; all 76 columns 10 and 8 s.
LINEARISED_FROM = 10_000


@dataclasses.dataclass(frozen=True, eq=False)
class LoopProblem:
    """Everything that a search for missing effects is given; build it by `LoopProblem.of`.

    Attributes:
        model: the declared model.
        library: candidate effects, all absent.
        free: free parameters of the declared model.
        likelihood: measure of the misfit for white noise.
        train: stack of records to fit.
        check: stack of records that decide.
        window: samples at the start of a check record in which its initial state is fitted.
        excluded: names of candidates that are not used.
        solver: the Gauss-Newton solver; `fit` uses a second policy next to its own.
    """

    model: AbstractModel
    library: tuple[Effect, ...]
    free: Free
    likelihood: AbstractLikelihood
    train: Record
    check: Record
    window: int | None = None
    excluded: frozenset[str] = frozenset()
    solver: GaussNewton = SEARCH_SOLVER

    @classmethod
    def of(
        cls, model, library, free, likelihood, train, check, *, window=None, solver=SEARCH_SOLVER
    ) -> "LoopProblem":
        """Return the problem of a model and its records; the arguments are attributes.

        Raises:
            InputError: if the likelihood is not output error with white noise, channels differ,
                records are too short for the window or sampled in a way that the model, the
                likelihood or a candidate cannot use, the check records have no valid sample after
                the window, or a candidate occurs twice or is already present.
        """
        require(
            isinstance(likelihood, OutputError)
            and not isinstance(likelihood.noise, AutoregressiveNoise),
            "A study fits by output error with white noise, and tries random forces and coloured "
            "noise by itself. Use OutputError().",
        )
        train, check = as_stack(train), as_stack(check)
        check_channels(model, train)
        check_sampling(model, train, likelihood)
        check_samples(train)
        likelihood.check(model, train)
        check_absent(library, model)
        augmented = canonical(Augmented(model, tuple(library)))
        problem = cls(
            augmented.model,
            augmented.effects_in,
            canonical(free),
            canonical(likelihood.compact()),
            train.anonymous(),
            check.anonymous(),
            window,
            solver=solver,
        )
        if problem.is_long:
            likelihood = canonical(likelihood.compact(linearised=True))
            problem = dataclasses.replace(problem, likelihood=likelihood)
        for effect in problem.library:
            effect.check(np.asarray(train.t))
        problem.check_predicted(check, "check records")
        return problem

    def check_predicted(self, records: Record, which: str) -> None:
        """Refuse a stack of records that the model, its effects, or the window cannot predict.

        Args:
            records: the stack.
            which: its name in the message.
        """
        check_channels(self.model, records)
        check_sampling(self.model, records, self.likelihood)
        for effect in self.library:
            effect.check(np.asarray(records.t))
        if self.window is not None:
            check_window(records, self.window, len(self.declared_starts))
        require(
            bool(np.any(np.asarray(records.mask)[:, self.window or 0 :])),
            f"No output of the {which} has a valid sample after the window. Give other records.",
        )

    def on(self, records) -> "LoopProblem":
        """Return the same problem with other training records."""
        return dataclasses.replace(self, train=as_stack(records).anonymous())

    def without(self, *names: str) -> "LoopProblem":
        """Return the problem without some candidates, given by name or by family.

        The compiled programs of the complete library still serve it.
        """
        cards = [effect.card for effect in self.library]
        known = {card.name for card in cards} | {card.family for card in cards}
        require_known("effect of the library", names, sorted(known))
        barred = {card.name for card in cards if {card.name, card.family} & set(names)}
        return dataclasses.replace(self, excluded=self.excluded | barred)

    @cached_property
    def augmented(self) -> Augmented:
        """The declared model with all candidates."""
        return canonical(Augmented(self.model, self.library).with_present(()))

    @cached_property
    def cards(self) -> dict[str, EffectCard]:
        """Cards of the candidates that are used, by name."""
        return {name: effect.card for name, effect in self.effects.items()}

    @cached_property
    def effects(self) -> dict[str, Effect]:
        """The candidates that are used, by name."""
        return {e.name: e for e in self.library if e.name not in self.excluded}

    @cached_property
    def columns(self) -> Columns:
        """The columns of all shared parameters: the declared ones, then those of each effect."""
        return Columns(self.free, self.library)

    @cached_property
    def positions(self) -> np.ndarray:
        """Positions of the columns in the flat vector of the augmented model."""
        return np.array([self.position[name] for name in self.columns.names], int)

    def per_record(self, effects: Collection[str]) -> tuple[str, ...]:
        """Return the names of the per-record parameters of a hypothesis.

        Where a record's initial state is free, so is the memory of the effects at its first sample
        (`Effect.starts`): a record that begins in motion does not show it.
        """
        declared = self.free.per_record
        if not any(name.startswith(f"{INITIAL_STATE}.") for name in declared):
            return declared
        inside = (starts for name, starts in self.starts_of_effects.items() if name in effects)
        return (*declared, *itertools.chain(*inside))

    def padding(self, effects: Collection[str], free: Collection[str] | None = None) -> Padding:
        """Return the padding of a program with some effects in the model.

        Args:
            effects: names of the effects in the model.
            free: names of those effects whose parameters are free; by default all of them.
        """
        chosen = self.columns.chosen(effects if free is None else free)
        own, shared = len(self.per_record(effects)), len(chosen)
        declared, rows = self.columns.declared, len(self.free.per_record)
        any_row = len(self.per_record(self.names)) > rows
        return Padding(
            own,
            rows + padded_number(own - rows, ROW_BLOCK, least=int(any_row)),
            shared,
            declared + padded_number(shared - declared, COLUMN_BLOCK),
        )

    @cached_property
    def starts_of_effects(self) -> dict[str, tuple[str, ...]]:
        """Memory of each candidate at the first sample (`Effect.starts`), by its name."""
        return {effect.name: effect.starts for effect in self.library}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all candidates."""
        return tuple(self.starts_of_effects)

    @cached_property
    def leaves(self) -> tuple[int, ...]:
        """Leaves of the augmented model that hold the columns."""
        rows = [self.position[name] for name in self.per_record(self.names)]
        return leaves_at(self.augmented, np.r_[self.positions, np.array(rows, int)])

    @cached_property
    def position(self) -> dict[str, int]:
        """Position of each parameter in the flat vector of the augmented model."""
        return {name: k for k, name in enumerate(all_names(self.augmented))}

    @cached_property
    def initial_values(self) -> Float[np.ndarray, " column"]:
        """Values of all columns in the declared model with absent effects."""
        return np.array(flat_vector(self.augmented))[self.positions]

    @cached_property
    def uses_reduced_model(self) -> bool:
        """True if each set of effects is fitted by a program without the absent effects."""
        return use_reduced_model(self.augmented, self.train.t.shape[1])

    @cached_property
    def is_long(self) -> bool:
        """True if the records are so long that fits linearise their steps."""
        return self.uses_reduced_model and self.train.t.size > LINEARISED_FROM

    @cached_property
    def equations(self) -> tuple[str, ...]:
        """States whose equations are uncertain; none for a static model."""
        if equations_of(self.model) != self.model.states:
            return ()
        return uncertain_equations(self.model, np.asarray(self.free.positions(self.model).shared))

    @property
    def declared_starts(self) -> tuple[str, ...]:
        """Initial states of the declared model that are fitted for a prediction: those that are
        free, or all if none is.
        """
        names, free = starts_of(self.model), self.free.per_record
        return tuple(name for name in names if name in free) or names

    @property
    def starts(self) -> tuple[str, ...]:
        """Parameters that are fitted for a prediction, those of effects included."""
        return (*self.declared_starts, *itertools.chain(*self.starts_of_effects.values()))

    @property
    def predictor(self) -> Predictor:
        """Prediction of records that were not fitted."""
        return Predictor(self.likelihood, self.window, self.starts, self.train.n_cases)

    @cached_property
    def samples(self) -> int:
        """Number of valid measured values of the training records."""
        return int(np.sum(np.asarray(self.train.mask)))

    @cached_property
    def recorded(self) -> Bool[np.ndarray, "case time"]:
        """True at the rows of the training records, False at their padding."""
        rows = np.arange(self.train.t.shape[1])
        return rows < np.asarray(self.train.samples)[:, None]

    @cached_property
    def longest_memory(self) -> float:
        """Correlation time from which on a noise is as well a constant or a drift [s]."""
        t = np.asarray(self.train.t)
        return LONGEST_MEMORY * float(np.max(t[:, -1] - t[:, 0]))

    @property
    def price(self) -> float:
        """Chi-square by which a parameter must be worth adding: the logarithm of the samples."""
        return float(np.log(self.samples))

    @cached_property
    def measured_by_record(self) -> dict[str, tuple[np.ndarray, ...]]:
        """Valid samples of each measured output in each record."""
        z, mask = np.asarray(self.train.z), np.asarray(self.train.mask)
        return {
            name: tuple(own[valid] for own, valid in zip(z[..., i], mask[..., i], strict=True))
            for i, name in enumerate(self.train.outputs)
        }

    @cached_property
    def measured(self) -> dict[str, np.ndarray]:
        """Valid samples of each measured output."""
        return {name: np.concatenate(own) for name, own in self.measured_by_record.items()}

    def model_at(self, values: Float[np.ndarray, " column"], effects: Collection[str]) -> Augmented:
        """Return the model with values of all columns, in which only the named effects are
        evaluated.
        """
        changed = np.asarray(values) != self.initial_values
        model = with_values_at(self.augmented, self.positions[changed], values[changed])
        return model.with_present(effects)

    def absent(self, effects: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of the candidates that may be added to some effects.

        At most one member of a family is in a model unless it is repeatable; a refinement needs the
        effect that it refines, and replaces it.
        """
        inside = [self.cards[name] for name in effects]
        families, refined = {card.family for card in inside}, {card.refines for card in inside}

        def allowed(card: EffectCard) -> bool:
            taken = refined if card.repeatable else families | refined
            return card.family not in taken and (not card.refines or card.refines in families)

        return tuple(n for n, card in self.cards.items() if n not in effects and allowed(card))

    def has_shape(self, name: str) -> bool:
        """Return True if an effect has estimated parameters besides its gain."""
        return len(self.columns.of_effect[name]) > 1

    def is_evident(self, name: str) -> bool:
        """Return True if the records show an effect without a model."""
        return self.effects[name].evident_in_data(self.measured_by_record)


def regular(R: Float[Array, "output output"]) -> Float[Array, "output output"]:
    """Return R with a floor on its diagonal, for a channel that is fitted without any error."""
    known = np.asarray(R)
    floor = np.finfo(float).eps * np.max(np.diagonal(known))
    return to_device(known + floor * np.eye(known.shape[0]))


def use_reduced_model(model: Augmented, samples: int) -> bool:
    """True if each set of effects is fitted faster by a program of its own than by the program of
    the complete library.

    The program of the complete library is compiled once, and skips absent effects by a branch for
    each group of them. Separate programs are faster if

        samples * (operations with all effects absent - operations of the declared model)
            > COMPILE_COST + COMPILE_COST_PER_OPERATION * (operations of the declared model)

    in operations of the right-hand side; the right side of the inequality is the cost of compiling
    a separate program. This holds for a small model on long records, and not for an aircraft, whose
    declared equations are most of the work.
    """
    declared = operations(model.model)
    return (
        samples * (operations(model) - declared)
        > COMPILE_COST + COMPILE_COST_PER_OPERATION * declared
    )


def operations(model: AbstractModel) -> int:
    """Return the number of elementary operations in a model's right-hand side, where a branch
    counts as one.

    Every later program reuses the trace made here.
    """
    t, x, u = np.zeros(()), np.zeros(len(model.states)), np.zeros(len(model.inputs))
    return _count(jax.make_jaxpr(lambda *instant: rate(model, *instant))(t, x, u).jaxpr)


def _count(program) -> int:
    inner = [
        [getattr(value, "jaxpr", value) for value in equation.params.values()]
        for equation in program.eqns
    ]
    called = [[part for part in parts if hasattr(part, "eqns")] for parts in inner]
    return sum(sum(map(_count, parts)) if parts else 1 for parts in called)
