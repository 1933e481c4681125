"""`Hypothesis`: an explanation of the records, as a set of effects and a model of the noise."""
# Pyright counts equinox's abstract fields as arguments of the constructor.
# pyright: reportCallIssue=false

import abc
import dataclasses
from collections.abc import Hashable, Mapping
from typing import ClassVar, NamedTuple

import equinox as eqx
import numpy as np

from .._foundation.checks import require
from .._foundation.host import to_device
from .._foundation.location import LocationKind
from .._foundation.types import Array, Float
from ..estimation.autoregressive_noise import AutoregressiveNoise
from ..estimation.filter.filter_error import FilterError
from ..estimation.filter.noise_options import FirstOrder
from ..estimation.likelihoods import AbstractLikelihood, OutputError
from ..simulation.steppers import RK4
from .outcome import Outcome
from .problem import LoopProblem, regular


class ForceNoise(NamedTuple):
    """Parameters of random forces and white sensor noise.

    Attributes:
        deviation: standard deviation of the force at each place [unit of the state per second; of
            the disturbance input for a gust].
        time: correlation time of the force at each place [s].
        sensors: standard deviation of the noise of each sensor [unit of the output].
    """

    deviation: Float[Array, " place"]
    time: Float[Array, " place"]
    sensors: Float[Array, " output"]


class NoiseHypothesis(eqx.Module):
    """A model of the noise, which a search compares with missing effects.

    A noise of your own is a subclass with these methods, given as `LoopOptions(noises=...)`. Its
    parameters, if `likelihood` has any, are estimated with all others and get standard errors.

    Attributes:
        outcome: outcome of a search in which this noise explains the residual without any effect.
    """

    outcome: eqx.AbstractClassVar[Outcome]

    @property
    def words(self) -> str:
        """The noise in the words of a verdict; by default the name of the class."""
        return type(self).__name__

    @property
    def key(self) -> Hashable:
        """Identity of the noise in a search: by default its class with all values."""
        return type(self), eqx.tree_pformat(self, short_arrays=False)

    @abc.abstractmethod
    def likelihood(self, declared: AbstractLikelihood) -> AbstractLikelihood:
        """Return the likelihood under this noise.

        Args:
            declared: the likelihood of the problem, whose noise is white.
        """

    @abc.abstractmethod
    def count(self, outputs: int) -> int:
        """Return the number of parameters beyond those of white noise.

        Args:
            outputs: number of outputs of the model.
        """


class White(NoiseHypothesis):
    """White noise of the sensors: the declared likelihood."""

    outcome: ClassVar[Outcome] = Outcome.NOTHING_MISSING

    @property
    def words(self):
        return "white noise"

    def likelihood(self, declared):
        return declared

    def count(self, outputs):
        return 0


class Coloured(NoiseHypothesis):
    """Autoregressive noise of each sensor, estimated with the parameters.

    Args:
        order: number of past samples that the noise depends on.
    """

    order: int = eqx.field(static=True, default=1)
    outcome: ClassVar[Outcome] = Outcome.COLOURED_NOISE

    @property
    def words(self):
        return f"coloured sensor noise of order {self.order}"

    def likelihood(self, declared):
        require(
            isinstance(declared, OutputError),
            f"Coloured noise is defined for OutputError, not {type(declared).__name__}.",
        )
        return eqx.tree_at(lambda node: node.noise, declared, AutoregressiveNoise(self.order))

    def count(self, outputs):
        return self.order * outputs


class RandomForces(NoiseHypothesis):
    """First-order random forces in equations of motion, or gusts of the air, by `FilterError`.

    The deviation and the correlation time of each force are parameters with standard errors.

    Args:
        forces: starting value of the standard deviation by state in whose equation the force acts
            [unit of the state per second].
        gusts: the same by disturbance input of the model, such as a component of the wind.
        time: starting value of the correlation time [s].
    """

    forces: tuple[tuple[str, float], ...] = eqx.field(static=True)
    gusts: tuple[tuple[str, float], ...] = eqx.field(static=True)
    time: float = eqx.field(static=True)
    outcome: ClassVar[Outcome] = Outcome.PROCESS_NOISE

    def __init__(self, forces: Mapping[str, float], gusts: Mapping[str, float], time: float):
        self.forces, self.gusts = tuple(sorted(forces.items())), tuple(sorted(gusts.items()))
        self.time = float(time)

    @property
    def words(self):
        places = [f"the equation of {name}" for name in self.equations] + [*self.air]
        return f"random forces in {' and '.join(places)}"

    @property
    def key(self):  # the starting values do not count
        return type(self), self.equations, self.air

    @property
    def equations(self) -> tuple[str, ...]:
        """States in whose equations the forces act."""
        return tuple(state for state, _ in self.forces)

    @property
    def air(self) -> tuple[str, ...]:
        """Disturbance inputs that are gusts."""
        return tuple(name for name, _ in self.gusts)

    @property
    def places(self) -> dict[LocationKind, tuple[str, ...]]:
        """Names of the places of the forces, by kind."""
        kinds = {LocationKind.EQUATION: self.equations, LocationKind.AIR: self.air}
        return {kind: names for kind, names in kinds.items() if names}

    @property
    def sizes(self) -> dict[str, float]:
        """Starting values of the standard deviations, by state or disturbance input."""
        return dict((*self.forces, *self.gusts))

    def initial(self, covariance: Float[Array, "output output"]) -> ForceNoise:
        """Return the starting values, from the covariance of the sensor noise."""
        floor = np.diagonal(np.asarray(regular(covariance)))
        sizes = np.array([*self.sizes.values()])
        parts = sizes, np.full(sizes.size, self.time), np.sqrt(floor)
        return ForceNoise(*map(to_device, parts))

    def parameters(self, outputs: tuple[str, ...]) -> tuple[list[str], list[str], list[str]]:
        """Return the names of the parameters: deviations, times and sensors."""
        return (
            [f"process.{name}" for name in self.sizes],
            [f"correlation_time.{name}" for name in self.sizes],
            [f"sensor.{name}" for name in outputs],
        )

    def named(self, noise: ForceNoise, outputs: tuple[str, ...]) -> dict[str, float]:
        """Return the values of the parameters by name."""
        groups = zip(self.parameters(outputs), noise, strict=True)
        return {n: float(v) for names, part in groups for n, v in zip(names, part, strict=True)}

    def at(
        self, estimates: Mapping[str, tuple[float, float]], outputs: tuple[str, ...]
    ) -> ForceNoise:
        """Return the parameters at estimates by name, each a value and its standard error."""
        groups = self.parameters(outputs)
        values = (np.array([estimates[name][0] for name in group]) for group in groups)
        return ForceNoise(*map(to_device, values))

    def likelihood(self, declared):
        assert isinstance(declared, OutputError), "proposed for output error alone"
        process = {name: FirstOrder(size, self.time) for name, size in self.sizes.items()}
        # `FilterError` steps by Runge-Kutta alone.
        stepper = declared.stepper if isinstance(declared.stepper, RK4) else RK4()
        return FilterError(process, hold=declared.hold, stepper=stepper)

    def count(self, outputs):
        return 2 * (len(self.forces) + len(self.gusts))


@dataclasses.dataclass(frozen=True)
class Hypothesis:
    """A set of effects and a model of the noise.

    Attributes:
        effects: names of the effects, in the order in which they were added.
        noise: the noise.
    """

    effects: tuple[str, ...] = ()
    noise: NoiseHypothesis = dataclasses.field(default_factory=White)

    def changed(self, out: tuple[str, ...] = (), into: tuple[str, ...] = ()) -> "Hypothesis":
        """Return the hypothesis with effects removed and others added."""
        kept = tuple(name for name in self.effects if name not in out)
        return Hypothesis((*kept, *into), self.noise)

    def count(self, problem: LoopProblem) -> int:
        """Return the number of parameters that the hypothesis determines: the shared ones, those
        beyond white noise, and the memory of its effects (`Effect.starts`) in each record. Another
        noise than white also determines the variances of the sensors, where white noise has given
        ones.
        """
        outputs = len(problem.model.outputs)
        given = problem.likelihood.noise.is_known and not isinstance(self.noise, White)
        own = self.noise.count(outputs) + outputs * given
        starts = len(problem.per_record(self.effects)) - len(problem.free.per_record)
        return len(problem.columns.chosen(self.effects)) + own + starts * problem.train.n_cases

    def __str__(self) -> str:
        noise = () if isinstance(self.noise, White) else (self.noise.words,)
        return " + ".join((*self.effects, *noise)) or "no effect"

    @property
    def key(self) -> tuple:
        """Identity of the hypothesis; starting values of random forces do not count."""
        return frozenset(self.effects), self.noise.key
