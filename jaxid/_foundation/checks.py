"""Checks of user input, made before any computation.

Each message names the finding, its place and the remedy.
"""

import difflib
import enum
from collections.abc import Iterable
from typing import TypeVar

import jax
import jax.numpy as jnp

E = TypeVar("E", bound=enum.Enum)
MOST_NAMES = 40  # that a message lists; chosen
NEAREST = 6  # names of a longer list in a message; chosen


class InputError(ValueError):
    """Bad input from a user: a channel, a parameter, a file, an option."""


def require(condition: bool, message: str) -> None:
    """Raise `InputError(message)` unless the condition holds."""
    if not condition:
        raise InputError(message)


def require_level(level: float, example: float) -> None:
    """Refuse a level that is no probability; the message has an example.

    Raises:
        InputError: when the level is not between 0 and 1.
    """
    require(
        0 < level < 1,
        f"The level is {level}; a probability lies between 0 and 1, such as {example:g}.",
    )


def require_float64() -> None:
    """Refuse to work in single precision, in which information matrices lose their weak directions.

    Raises:
        InputError: when JAX does not run in 64 bit.
    """
    require(
        bool(jax.config.jax_enable_x64),  # pyright: ignore[reportAttributeAccessIssue]
        "jaxid computes in float64, and JAX is set to float32. Call `jaxid.configure()` before the "
        "first array is made; to change only the precision, "
        '`jax.config.update("jax_enable_x64", True)` or the environment variable JAX_ENABLE_X64=1.',
    )


def require_key(key) -> None:
    """Refuse anything but a random key.

    Raises:
        InputError: when it is no key of JAX, new or old.
    """
    dtype, shape = getattr(key, "dtype", None), getattr(key, "shape", None)
    require(
        dtype is not None
        and (jnp.issubdtype(dtype, jax.dtypes.prng_key) or (dtype == jnp.uint32 and shape == (2,))),
        f"The random key is {key!r}. Give one such as `key=jax.random.key(0)`.",
    )


def require_known(
    kind: str, names: Iterable[str], available: Iterable[str], remedy: str = ""
) -> None:
    """Refuse names that do not exist; the message has the nearest names, all if they are few, and a
    remedy.

    Raises:
        InputError: when a name is not among the available ones.
    """
    available = list(available)
    for name in names:
        if name not in available:
            raise InputError(
                f"There is no {kind} {name!r}.{_nearest(name, available)}{remedy and ' '}{remedy}"
            )


def _nearest(name: str, available: list[str]) -> str:
    """Return the names nearest to an unknown one, and all of them if they are few, in words."""
    few = len(available) <= MOST_NAMES
    near = difflib.get_close_matches(name, available, n=3 if few else NEAREST, cutoff=0.5)
    hint = f" Did you mean {' or '.join(map(repr, near))}?" if near else ""
    if few:
        return f"{hint} The names are: {', '.join(available) or '(none)'}."
    return hint or f" There are {len(available)} names, such as {', '.join(available[:NEAREST])}."


def member(kind: str, option: enum.Enum | str, options: type[E]) -> E:
    """Return the member of an enumeration for an option that is a member or the value of one.

    Raises:
        InputError: when the option is neither; the message lists the values.
    """
    if not isinstance(option, options):
        require_known(kind, [str(option)], [choice.value for choice in options])
    return options(option)


def require_unique(kind: str, names: Iterable[str]) -> None:
    """Refuse a name that occurs twice.

    Raises:
        InputError: when a name is repeated; it is named.
    """
    previous: set[str] = set()
    for name in names:
        require(
            name not in previous, f"The {kind} name {name!r} occurs twice. Rename one of the two."
        )
        previous.add(name)
