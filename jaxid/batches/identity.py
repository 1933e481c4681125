"""Version, settings, data and code of a batch as short texts, by which a store is recognised."""

import functools
import hashlib
import importlib.metadata
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.solver import GaussNewton
from ..models.base import AbstractModel, canonical
from ..models.free import Free
from .cases import Case
from .user_code import code_of


def identity_of(
    model: AbstractModel,
    free: Free,
    likelihood: AbstractLikelihood,
    solver: GaussNewton,
    cases: Sequence[Case],
) -> dict[str, str]:
    """Return the attributes of a dataset of results: version, settings, and digests of the data and
    of the user's code.

    Args:
        model: the model; its class and static fields count, as the values stand in the cases.
        free: the free parameters, with their bounds and priors.
        likelihood: the likelihood.
        solver: options of the iteration.
        cases: records and models.
    """
    models = {case.structure: case.arrays.model for case in cases if not case.refusal}
    return {
        "version": version(),
        "model": f"{type(model).__name__} {_digest([eqx.tree_pformat(canonical(model))])}",
        "free": _described(free),
        "likelihood": _described(likelihood),
        "solver": _described(solver),
        "data": _digest(part for case in cases for part in _parts(case)),
        "code": digest_of_code([*models.values(), free, likelihood, solver]),
    }


def digest_of(tree: Any) -> str:
    """Return a digest of the structure and the values of a tree of modules, arrays and texts."""
    tree = canonical(tree)
    return _digest([eqx.tree_pformat(tree, width=10_000), *_leaf_parts(tree)])


def digest_of_code(tree: Any) -> str:
    """Return a digest of the code outside of this package that a tree of modules runs."""
    return _digest(code_of(tree))


def _described(module: eqx.Module) -> str:
    """Return the text of a module with a digest of its arrays, whose values the text leaves out."""
    module = canonical(module)
    return f"{eqx.tree_pformat(module, width=10_000)} {_digest(_leaf_parts(module))}"


def _parts(case: Case) -> Iterator[str | bytes]:
    """Yield all values of a case."""
    yield f"{case.index} {case.name} {case.refusal}"
    yield from _leaf_parts([*case.parameters, *case.records])


def _leaf_parts(tree) -> Iterator[str | bytes]:
    """Yield the shape, the type and the values of each array of a tree."""
    for leaf in filter(eqx.is_array, jax.tree.leaves(tree)):
        yield _heading(leaf.shape, leaf.dtype)
        yield np.asarray(leaf).tobytes()


@functools.cache
def _heading(shape: tuple[int, ...], dtype: np.dtype) -> str:
    return str((shape, dtype))


def _digest(parts: Iterable[str | bytes]) -> str:
    """Return the first 16 digits of the SHA-256 of some parts."""
    total = hashlib.sha256()
    for part in parts:
        total.update(part.encode() if isinstance(part, str) else part)
    return total.hexdigest()[:16]


def version() -> str:
    """Return the version of jaxid, or "unknown" where it is not installed."""
    try:
        return importlib.metadata.version("jaxid")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"
