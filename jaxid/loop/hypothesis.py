"""`Hypothesis`: an explanation of the records, as a set of effects and a model of the noise."""
# Pyright counts equinox's abstract fields as arguments of the constructor.
# pyright: reportCallIssue=false

import abc
import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require
from ..estimation.autoregressive_noise import AutoregressiveNoise
from ..estimation.filter.filter_error import FilterError
from ..estimation.filter.noise_options import FirstOrder
from ..estimation.likelihoods import AbstractLikelihood, OutputError
from ..models.base import AbstractModel


class NoiseHypothesis(eqx.Module):
    """A model of the noise, which a search compares with missing effects.

    A noise of your own is a subclass with these three methods. Its parameters, if `likelihood` has
    any, are estimated with all others and get standard errors.
    """

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

    def model(self, model: AbstractModel) -> AbstractModel:
        """Return the model with the disturbances of this noise; by default it has none."""
        return model


class White(NoiseHypothesis):
    """White noise of the sensors: the declared likelihood."""

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

    def likelihood(self, declared):
        require(
            isinstance(declared, OutputError),
            f"Coloured noise is defined for OutputError, not {type(declared).__name__}.",
        )
        return eqx.tree_at(lambda node: node.noise, declared, AutoregressiveNoise(self.order))

    def count(self, outputs):
        return self.order * outputs


class RandomForces(NoiseHypothesis):
    """First-order random forces in equations of motion, by `FilterError`.

    The deviation and the correlation time of each force are parameters with standard errors.

    Args:
        deviations: starting value of the standard deviation by state in whose equation the force
            acts [unit of the state per second].
        time: starting value of the correlation time [s].
    """

    deviations: tuple[tuple[str, float], ...] = eqx.field(static=True)
    time: float = eqx.field(static=True)

    def __init__(self, deviations: Mapping[str, float], time: float):
        self.deviations, self.time = tuple(sorted(deviations.items())), float(time)

    @property
    def equations(self) -> tuple[str, ...]:
        """States in whose equations the forces act."""
        return tuple(state for state, _ in self.deviations)

    def likelihood(self, declared):
        assert isinstance(declared, OutputError)
        process = {force_in(state): FirstOrder(size, self.time) for state, size in self.deviations}
        return FilterError(process, hold=declared.hold)

    def count(self, outputs):
        return 2 * len(self.deviations)

    def model(self, model):
        return ForcedModel(model, self.equations)


class ForcedModel(AbstractModel):
    """A model with forces in some equations, which are its disturbance inputs.

    Args:
        model: the model without forces.
        forced: states in whose equations the forces act.
        acting: True for the model that has the forces as inputs.
    """

    model: AbstractModel
    forced: tuple[str, ...] = eqx.field(static=True)
    acting: bool = eqx.field(static=True, default=False)
    transparent: ClassVar[tuple[str, ...]] = ("model",)

    @property
    def states(self):
        return self.model.states

    @property
    def inputs(self):
        forces = tuple(map(force_in, self.forced)) if self.acting else ()
        return (*self.model.inputs, *forces)

    @property
    def outputs(self):
        return self.model.outputs

    def with_disturbance_inputs(self):
        return ForcedModel(self.model, self.forced, acting=True)

    def rhs(self, t, x, u):
        recorded, forces = self._split(u)
        at = np.array([self.states.index(name) for name in self.forced], int)
        return self.model.rhs(t, x, recorded).at[at].add(forces)

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        return self.model.output_given(t, x, self._split(u)[0], dx)

    def initial_state(self, record):
        return self.model.initial_state(record)

    def input_signal(self, path):
        return self.model.input_signal(path)

    def observe(self, t, y):
        return self.model.observe(t, y)

    def units(self):
        units = self.model.units()
        return units | {force_in(name): f"{units.get(name, '')}/s" for name in self.forced}

    def _split(self, u):
        """Return the recorded inputs and the forces."""
        if not self.acting:
            return u, jnp.zeros(len(self.forced))
        return jnp.split(u, [len(self.model.inputs)])


def force_in(state: str) -> str:
    """Return the name of the force in the equation of a state, as a disturbance input."""
    return f"force_{state}"


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

    @property
    def key(self) -> tuple:
        """Identity of the hypothesis; starting values of a noise do not count."""
        equations = self.noise.equations if isinstance(self.noise, RandomForces) else ()
        order = self.noise.order if isinstance(self.noise, Coloured) else 0
        return frozenset(self.effects), type(self.noise), equations, order
