"""`check_equations`: refuse a model whose `rhs` or `output` does not fit its channels."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.checks import InputError, require
from .._foundation.traced_errors import plain_errors
from .base import AbstractModel, canonical

STRUCTURES = 256  # chosen: number of structures whose check is cached
# Channels for which each method returns values.
METHOD_CHANNELS = {"rhs": "states", "output": "outputs", "output_given": "outputs"}


def check_equations(model: AbstractModel) -> None:
    """Refuse a model whose equations cannot be traced, or do not fit its channels.

        rhs(t, x, u): shape (state,),    output(t, x, u): shape (output,)

    Where a class overrides `output_given`, which the simulation calls, it is evaluated in place of
    `output`. Abstract evaluation: no number is computed and nothing is compiled. Each structure of
    a model (class, static fields, shapes of the arrays) is evaluated once; later calls look it up.

    Args:
        model: any model; its leaves may be traced.

    Raises:
        InputError: it names the method, its return value or operation, and the remedy.
    """
    check_names(model)
    leaves, structure = jax.tree.flatten(canonical(model))
    described = tuple(_described(leaf) for leaf in leaves)
    try:
        hash((structure, described))
    except TypeError:  # a static field without a hash, which `jit` refuses with its own message
        _check_structure.__wrapped__(structure, described)
    else:
        _check_structure(structure, described)


def check_names(model: AbstractModel) -> None:
    """Refuse channel names that are one text, which would be read letter by letter.

    Raises:
        InputError: with the attribute.
    """
    for kind in ("states", "inputs", "outputs"):
        names = getattr(model, kind)
        require(
            not isinstance(names, str),
            f"`{kind}` of {type(model).__name__} is the text {names!r}, not a tuple. Write "
            f"{kind} = ({names!r},), with a comma.",
        )


def _described(leaf):
    """Return the shape and dtype of an array, and any other leaf unchanged."""
    return jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) if eqx.is_array(leaf) else leaf


@functools.lru_cache(maxsize=STRUCTURES)
def _check_structure(structure, described) -> None:
    """Check a model given as its tree structure and its leaves, arrays as shapes and dtypes."""
    model = jax.tree.unflatten(structure, described)
    number = jax.dtypes.canonicalize_dtype(float)
    t = jax.ShapeDtypeStruct((), number)
    x = dx = jax.ShapeDtypeStruct((len(model.states),), number)
    u = jax.ShapeDtypeStruct((len(model.inputs),), number)
    _check_value(model, "rhs", _shape_of(model, "rhs", t, x, u))
    if type(model).output_given is AbstractModel.output_given:
        _check_value(model, "output", _shape_of(model, "output", t, x, u))
    else:
        _check_value(model, "output_given", _shape_of(model, "output_given", t, x, u, dx))


def _shape_of(model: AbstractModel, method: str, *arguments):
    """Return the value of a method, arrays as shapes and dtypes.

    Raises:
        InputError: when it cannot be traced, or does not accept the shapes of the model's channels.
    """
    title = f"`{method}` of {type(model).__name__}"
    try:
        with plain_errors(title):
            return eqx.filter_eval_shape(
                lambda of, *args: getattr(of, method)(*args), model, *arguments
            )
    except InputError:
        raise
    except KeyError as error:
        known = ", ".join((*model.states, *model.inputs))
        raise InputError(
            f"{title} uses the name {error}, which it does not know. The model's states and inputs "
            f"are {known}: correct the name."
        ) from error
    except (IndexError, TypeError, ValueError) as error:
        words = str(error).strip().rstrip(".").splitlines() or [type(error).__name__]
        raise InputError(
            f"{title} fails for a state of shape ({len(model.states)},) and an input of shape "
            f"({len(model.inputs)},): {words[0]}. The model names the states "
            f"({', '.join(model.states)}) and the inputs ({', '.join(model.inputs)}): "
            "correct the method or the names. A single input or state is `u[0]`, `x[0]`, not `u`."
        ) from error


def _check_value(model: AbstractModel, method: str, value) -> None:
    """Refuse a value that is not one floating-point array with a number for each channel."""
    kind = METHOD_CHANNELS[method]
    names = getattr(model, kind)
    title, wanted = f"`{method}` of {type(model).__name__}", f"({len(names)},)"
    remedy = f"Return one array of shape {wanted}, such as `jnp.stack([...])`."
    array = isinstance(value, jax.ShapeDtypeStruct)
    require(array, f"{title} returns a {type(value).__name__}, not an array. {remedy}")
    if value.shape != (len(names),):
        description = f"shape {value.shape}" if value.shape else "a single number, of shape ()"
        raise InputError(
            f"{title} returns {description}, but the model names {len(names)} {kind}: "
            f"{', '.join(names) or '(none)'}. {remedy} Or correct `{kind}`."
        )
    require(
        jnp.issubdtype(value.dtype, jnp.floating),
        f"{title} returns {value.dtype} numbers, not real floating-point ones. {remedy}",
    )
