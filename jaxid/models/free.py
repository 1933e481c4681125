"""`Free`: selection of free parameters, shared or one per record; `Parameters`: their values."""

from collections.abc import Mapping, Sequence
from typing import Literal, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_known, require_unique
from .._foundation.compiler import fast_compile_jit
from .._foundation.host import on_host
from .._foundation.types import Array, Float, Int, Numbers
from ..data.record import INITIAL_STATE, Record
from .base import AbstractModel, as_float, canonical
from .names import array_leaves, flatten, parameter_names, with_array_leaves

Model = TypeVar("Model", bound=AbstractModel)


class Parameters(eqx.Module):
    """Values of free parameters: one vector for all records, and one row per record.

    Attributes:
        shared: values in the order of `Free.shared`.
        rows: one row per record, in the order of `Free.per_record`.
    """

    shared: Float[Array, " parameter"]
    rows: Float[Array, "case row_parameter"]


class Positions(eqx.Module):
    """Positions of free parameters in the flat vector of a model followed by its initial state.

    Positions are data, not structure: another selection of the same size does not cause another
    compilation, and a position beyond the vector is a column that is switched off. Only the leaves
    of the model to which positions may refer are structure. All other leaves are constants in a
    derivative, so that a table of thousands of numbers adds no cost while none of them is free.

    Attributes:
        shared: positions of parameters with one value for all records.
        rows: positions of parameters with one value per record.
        leaves: indices of the leaves with free parameters; the last leaf is the initial state.
    """

    shared: Int[Array, " parameter"]
    rows: Int[Array, " row_parameter"]
    leaves: tuple[int, ...] = eqx.field(static=True)


class Free(eqx.Module):
    """Selection of the free parameters of a model, built with `free`.

    Attributes:
        shared: names of parameters with one value for all records.
        per_record: names of parameters with one value for each record.
        lower, upper: bounds by name; a missing name has no bounds.
        scale: typical sizes by name; a missing name is scaled by its sensitivity (Eq. 4.25).
        prior: mean and standard deviation of a Gaussian prior by name, for shared parameters.
    """

    shared: tuple[str, ...] = eqx.field(static=True)
    per_record: tuple[str, ...] = eqx.field(static=True, default=())
    lower: dict[str, Float[Array, ""]] = eqx.field(default_factory=dict)
    upper: dict[str, Float[Array, ""]] = eqx.field(default_factory=dict)
    scale: dict[str, Float[Array, ""]] = eqx.field(default_factory=dict)
    prior: dict[str, tuple[Float[Array, ""], Float[Array, ""]]] = eqx.field(default_factory=dict)

    def positions(self, model: AbstractModel) -> Positions:
        """Positions of the free parameters in the model's flat vector followed by the initial
        state.
        """
        available = all_names(model)
        index = {name: position for position, name in enumerate(available)}
        require_known("parameter", self.shared + self.per_record, available)
        shared, rows = ([index[name] for name in names] for names in (self.shared, self.per_record))
        return Positions(
            jnp.asarray(np.array(shared, int), int),
            jnp.asarray(np.array(rows, int), int),
            leaves_at(model, np.array(shared + rows, int)),
        )

    def only(self, names: Sequence[str]) -> "Free":
        """Return the selection without the parameters that are not among these names."""
        parts = {
            option: {name: value for name, value in getattr(self, option).items() if name in names}
            for option in ("lower", "upper", "scale", "prior")
        }
        shared, rows = (
            tuple(name for name in chosen if name in names)
            for chosen in (self.shared, self.per_record)
        )
        return Free(shared, rows, **parts)

    def bounds(
        self, which: Literal["shared", "per_record"]
    ) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
        """Lower and upper bounds as vectors, infinite for parameters without bounds."""
        names = getattr(self, which)
        lower = as_float([self.lower.get(name, -np.inf) for name in names])
        return lower, as_float([self.upper.get(name, np.inf) for name in names])


def free(
    model: AbstractModel,
    *names: str,
    per_record: Sequence[str] = (),
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    scale: Mapping[str, float] | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
) -> Free:
    """Return the selection of the named parameters; all others keep the model's values.

    An initial state that is not named is not estimated: it is the record's constant
    `initial_state.<state>`, or without one `model.initial_state(record)`.

    Args:
        model: the model with these parameters.
        names: dotted names of shared parameters; the name of a group (`A`, `aero.Cm`) selects all
            its elements.
        per_record: names with one value per record; `"initial_state"` is the state at each record's
            first sample.
        bounds: (lowest, highest) by name; None means no bound.
        scale: typical size by name, in place of the scaling by sensitivity (Eq. 4.25).
        prior: (mean, standard deviation) by name, of an independent Gaussian prior on a shared
            parameter.

    Returns:
        The selection, with groups replaced by the names of their elements.

    Raises:
        InputError: for a name that does not exist (the message lists the existing names) or is
            given twice, a starting value or prior mean that is not finite, bounds that are empty or
            exclude the model's value, a scale or standard deviation that is not positive.
    """
    require(
        isinstance(model, AbstractModel),
        f"`free` needs a model, and this is {model!r}. Give the class with starting values, such "
        "as Spring(k=1.0, c=0.1).",
    )
    available = all_names(model)
    shared = _expand(names, available)
    rows = _expand(per_record, available)
    require_unique("free parameter", shared + rows)
    require(
        bool(shared or rows),
        "No parameter is free, so there is nothing to estimate. Name at least one.",
    )
    lower, upper = _checked_bounds(model, bounds or {}, shared + rows)
    scale, prior = dict(scale or {}), dict(prior or {})
    _require_positive("scale", scale, shared + rows)
    _require_positive("prior", {name: deviation for name, (_, deviation) in prior.items()}, shared)
    for name, (mean, _) in prior.items():
        require(bool(np.isfinite(mean)), f"The prior mean of {name!r} is {mean}; give a number.")
    return Free(shared, rows, lower, upper, canonical(scale), canonical(prior))


def all_names(model: AbstractModel) -> tuple[str, ...]:
    """Names of all parameters that can be free: the model's parameters, then its initial state,
    `initial_state.<state>`.
    """
    return parameter_names(model) + tuple(f"{INITIAL_STATE}.{state}" for state in model.states)


def initial_parameters(model: AbstractModel, positions: Positions, records: Record) -> Parameters:
    """Starting values: the values of the model, and initial states from `model.initial_state` of
    each record.
    """
    return Parameters(*_selected(flat_vectors(model, records), positions.shared, positions.rows))


@on_host
def _selected(xp, flat, shared, rows):
    """Return the values at the positions `shared` of the first vector and `rows` of all."""
    return xp.take(flat[0], shared, mode="clip"), xp.take(flat, rows, axis=1, mode="clip")


def flat_vectors(model: AbstractModel, records: Record) -> Float[Array, "case flat"]:
    """Flat vector of the model's parameters and the initial state, for each record.

    A constant of the record with the name of a parameter or of an initial state
    (`initial_state.<state>`) replaces its value. Other constants are available to
    `model.initial_state`.

    Raises:
        InputError: for the initial state of a state that the model does not have.
    """
    prefix = f"{INITIAL_STATE}."
    given = [name.removeprefix(prefix) for name in records.constants if name.startswith(prefix)]
    # A state whose equation is left out is an input, and its history is measured.
    require_known(
        "state (of a record's constant `initial_state.<state>`)",
        [name for name in given if name not in model.inputs],
        model.states,
    )
    return _flat_vectors(model, records.anonymous())


@fast_compile_jit
def _flat_vectors(model: AbstractModel, records: Record) -> Float[Array, "case flat"]:
    """Flat vectors (jitted): without jit, the initial state of an aircraft would compile a hundred
    small programs, one per operation.
    """
    vector, unflatten = flatten(model)
    names = parameter_names(model)
    known = [name for name in records.constants if name in names]
    at = np.array([names.index(name) for name in known], int)

    def flat_vector(record: Record):
        values = jnp.stack([record.constants[name] for name in known]) if known else jnp.zeros(0)
        parameters = vector.at[at].set(values)
        return jnp.concatenate([parameters, first_state(unflatten(parameters), record)])

    return jax.vmap(flat_vector)(records)


def first_state(model: AbstractModel, record: Record) -> Float[Array, " state"]:
    """State at the first sample: the record's constants `initial_state.<state>`, and for other
    states `model.initial_state(record)`.

    Args:
        model: the model.
        record: a single record.
    """
    state = jnp.asarray(model.initial_state(record), float)
    names = [f"{INITIAL_STATE}.{name}" for name in model.states]
    known = [k for k, name in enumerate(names) if name in record.constants]
    if not known:
        return state
    values = jnp.stack([jnp.asarray(record.constants[names[k]], float) for k in known])
    return state.at[np.array(known)].set(values)


def leaves_at(model: AbstractModel, positions: Int[np.ndarray, " p"]) -> tuple[int, ...]:
    """Indices of the model's array leaves at these positions of its flat vector; the initial state
    counts as the last leaf.
    """
    sizes = [leaf.size for leaf in array_leaves(canonical(model))] + [len(model.states)]
    return tuple(
        int(leaf) for leaf in np.unique(np.repeat(np.arange(len(sizes)), sizes)[positions])
    )


def with_values(
    model: AbstractModel, names: Sequence[str], values: Float[Array, " p"]
) -> AbstractModel:
    """The model with new values of the named parameters."""
    model = canonical(model)
    available = parameter_names(model)
    require_known("parameter", names, available)
    at = np.array([available.index(name) for name in names], int)
    return with_values_at(model, at, values)


def with_values_at(model: Model, at: Int[np.ndarray, " p"], values: Float[Numbers, " p"]) -> Model:
    """The model with new values at positions of its flat vector."""
    leaves = array_leaves(model)
    ends = np.cumsum([leaf.size for leaf in leaves])
    leaf_of = np.searchsorted(ends, at, side="right")
    for k in np.unique(leaf_of):
        chosen = leaf_of == k
        own = np.asarray(at)[chosen] - (ends[k] - leaves[k].size)
        leaves[k] = _replaced(leaves[k], values, own=own, chosen=chosen)
    return with_array_leaves(model, leaves)


@on_host
def _replaced(xp, leaf, values, *, own, chosen):
    """Return a leaf with the chosen values at positions of its flat vector."""
    vector, values = xp.ravel(leaf), values[chosen]
    if xp is np:
        vector = vector.copy()
        vector[own] = values
    else:
        vector = vector.at[own].set(values)
    return vector.reshape(leaf.shape)


def _expand(names: Sequence[str], available: tuple[str, ...]) -> tuple[str, ...]:
    """Replace the names of groups by the names of their elements."""
    expanded: list[str] = []
    for name in names:
        below = [
            full for full in available if full == name or full.startswith((f"{name}.", f"{name}["))
        ]
        if not below:
            require_known("parameter", [name], available)
        expanded.extend(below)
    return tuple(expanded)


def _require_positive(option: str, values: Mapping[str, float], names: tuple[str, ...]) -> None:
    """Refuse numbers of an option that are not positive, or of parameters that are not free."""
    require_known(f"free parameter (in `{option}`)", values, names)
    for name, value in values.items():
        require(
            bool(np.isfinite(value) and value > 0),
            f"The {option} of {name!r} is {value}; it must be positive and finite.",
        )


def _checked_bounds(model: AbstractModel, bounds: Mapping, names: tuple[str, ...]):
    """Bounds as two dictionaries; values that are not finite, empty bounds and bounds without the
    model's value are refused.
    """
    require_known("free parameter (in `bounds`)", bounds, names)
    values = [np.ravel(leaf) for leaf in array_leaves(canonical(model))]
    current = dict(zip(parameter_names(model), np.concatenate([*values, np.zeros(0)]), strict=True))
    for name in names:
        require(
            bool(np.isfinite(current.get(name, 0.0))),
            f"The model's value of {name!r} is {current.get(name)}, and the estimate starts from "
            "it. Give a number.",
        )
    lower: dict[str, Array] = {}
    upper: dict[str, Array] = {}
    for name, (low, high) in bounds.items():
        low, high = -np.inf if low is None else low, np.inf if high is None else high
        require(low < high, f"The bounds of {name!r} are empty: {low} is not below {high}.")
        value = current.get(name)
        if value is not None and not low <= float(value) <= high:
            raise InputError(
                f"The starting value of {name!r}, {float(value):g}, lies outside its bounds "
                f"({low:g}, {high:g}). Start inside."
            )
        lower[name], upper[name] = as_float(low), as_float(high)
    return lower, upper
