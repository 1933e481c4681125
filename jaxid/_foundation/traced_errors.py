"""`plain_errors`: JAX's errors on traced numbers in plain words."""

from collections.abc import Iterator
from contextlib import contextmanager

import jax

from .checks import InputError


@contextmanager
def plain_errors(title: str) -> Iterator[None]:
    """Context that turns JAX's errors in a function of the user into an `InputError`.

    Args:
        title: the function, at the start of the message.

    Raises:
        InputError: when the function gives a traced number to NumPy, to a Python branch, or turns
            it into a Python number.
    """
    try:
        yield
    except jax.errors.TracerArrayConversionError as error:
        raise InputError(
            f"{title} gives a traced number to NumPy. Compute with `jax.numpy` (`jnp.sin` for "
            "`np.sin`, `jnp.stack` for `np.array`), which can be compiled and differentiated."
        ) from error
    except jax.errors.TracerBoolConversionError as error:
        raise InputError(
            f"{title} takes a Python branch (`if`, `while`, `and`, `or`, `min`, `max`) on a number "
            "that is only known at run time. Use `jnp.where(condition, a, b)`, `jnp.minimum` or "
            "`jnp.maximum`."
        ) from error
    except (jax.errors.ConcretizationTypeError, jax.errors.TracerIntegerConversionError) as error:
        raise InputError(
            f"{title} turns a traced number into a Python number (`float`, `int`, `range`, an "
            "index, `math.sin`). Compute with `jax.numpy`: `jnp.sin` for `math.sin`, `jnp.take` "
            "for an index, `jnp.where` for a choice."
        ) from error
