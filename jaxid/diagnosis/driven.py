"""A problem with forces on its model as further inputs: the trajectory under a force that was found
is the place to look from.
"""
# Pyright counts the arguments of functions that equinox and jaxtyping wrap in its own way; the
# tests execute them.
# pyright: reportCallIssue=false

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.location import LocationKind
from .._foundation.types import Array, Float
from ..estimation.likelihoods import OutputError
from ..estimation.problem import Problem
from ..models.base import AbstractModel
from ..simulation.mixed_hold import MixedHold
from ..simulation.steppers import rate
from .free_form import FORCES, Places


class Driven(AbstractModel):
    """A model with what moves in the air around it, and forces in some of its equations, as further
    inputs.

    Attributes:
        model: what is driven.
        forced: the states in whose equations a force acts.
    """

    model: AbstractModel
    forced: tuple[str, ...] = eqx.field(static=True)
    # a record's constants go by the parameters' names
    transparent: ClassVar[tuple[str, ...]] = ("model",)

    @property
    def states(self):
        return self.model.states

    @property
    def inputs(self):
        return (*self.model.with_disturbance_inputs().inputs, *map(force_in, self.forced))

    @property
    def outputs(self):
        return self.model.outputs

    def rhs(self, t, x, u):
        u, force = self._apart(u)
        at = np.array([self.states.index(name) for name in self.forced], int)
        return rate(self.model.with_disturbance_inputs(), t, x, u).at[at].add(force)

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        return self.model.with_disturbance_inputs().output_given(t, x, self._apart(u)[0], dx)

    def input_signal(self, path):
        return self.model.input_signal(path)

    def observe(self, t, y):
        return self.model.observe(t, y)

    def initial_state(self, record):
        own = record.u[..., : len(self.model.inputs)]
        return self.model.initial_state(eqx.tree_at(lambda one: one.u, record, own))

    def _apart(self, u):
        """The inputs of the model in moving air, and the forces."""
        return jnp.split(u, [u.shape[-1] - len(self.forced)])


def force_in(state: str) -> str:
    """What the force in the equation of a state is called as an input."""
    return f"force in {state}"


def driven(problem: Problem, places: Places) -> tuple[Problem, Places]:
    """A problem whose model has forces at these places for further inputs, all of them zero, and
    the places as inputs of it.

    The forces run in straight lines between the samples, whatever the inputs do.

    Args:
        problem: with output error for likelihood.
        places: equations by their states, and the air.
    """
    forced, air = (dict(places).get(kind, ()) for kind in FORCES)
    model, likelihood, u = Driven(problem.model, forced), problem.likelihood, problem.records.u
    assert isinstance(likelihood, OutputError)
    hold = MixedHold(likelihood.hold, u.shape[-1])
    still = jnp.zeros((*u.shape[:-1], len(model.inputs) - u.shape[-1]))
    parts = lambda one: (one.model, one.records.u, one.likelihood.hold)  # noqa: E731
    changed = eqx.tree_at(parts, problem, (model, jnp.concatenate([u, still], axis=-1), hold))
    return changed, ((LocationKind.INPUT, (*map(force_in, forced), *air)),)


def under(problem: Problem, places: Places, force: Float[Array, "case time place"]) -> Problem:
    """A driven problem under given forces.

    Args:
        problem, places: as `driven` gives them.
        force: at the samples.
    """
    ((_, names),) = places
    at = np.array([problem.model.inputs.index(name) for name in names], int)
    return eqx.tree_at(lambda one: one.records.u, problem, problem.records.u.at[..., at].set(force))
