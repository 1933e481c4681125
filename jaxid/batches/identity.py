"""Version, settings and data of a batch as short texts, by which a store is recognised."""

import hashlib
import importlib.metadata
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.solver import GaussNewton
from ..models.base import AbstractModel, canonical
from ..models.free import Free
from .cases import Case


def identity_of(
    model: AbstractModel,
    free: Free,
    likelihood: AbstractLikelihood,
    solver: GaussNewton,
    cases: Sequence[Case],
) -> dict[str, str]:
    """Return the attributes of a dataset of results: version, settings, and a digest of the data.

    Args:
        model: the model; its class and static fields count, as the values stand in the cases.
        free: the free parameters, with their bounds and priors.
        likelihood: the likelihood.
        solver: options of the iteration.
        cases: records and models.
    """
    return {
        "version": version(),
        "model": f"{type(model).__name__} {_digest([eqx.tree_pformat(canonical(model))])}",
        "free": _described(free),
        "likelihood": _described(likelihood),
        "solver": _described(solver),
        "data": _digest([_bytes(case) for case in cases]),
    }


def digest_of(tree: Any) -> str:
    """Return a digest of the structure and the values of a tree of modules, arrays and texts."""
    tree = canonical(tree)
    return _digest([eqx.tree_pformat(tree, width=10_000), _leaf_bytes(tree)])


def _described(module: eqx.Module) -> str:
    """Return the text of a module with a digest of its arrays, whose values the text leaves out."""
    module = canonical(module)
    return f"{eqx.tree_pformat(module, width=10_000)} {_digest([_leaf_bytes(module)])}"


def _bytes(case: Case) -> bytes:
    """Return all values of a case."""
    head = f"{case.index} {case.name} {case.refusal}"
    return head.encode() + _leaf_bytes(case.arrays)


def _leaf_bytes(tree) -> bytes:
    """Return shapes and values of the arrays of a tree."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(tree) if eqx.is_array(leaf)]
    return b"".join(str((leaf.shape, leaf.dtype)).encode() + leaf.tobytes() for leaf in leaves)


def _digest(parts: Sequence[str | bytes]) -> str:
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
