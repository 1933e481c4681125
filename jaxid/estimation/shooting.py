"""Multiple shooting: initial parameters of output error from short pieces of the records.

The simulation of a long or unstable record is far from the measurements at any parameters but the
best, and Gauss-Newton does not find these. Each record is therefore cut into pieces, each with a
free initial state of its own, near its measurements. The initial states are eliminated with the
per-record parameters of the pieces. From stage to stage pieces are joined, and the joined piece
starts at the initial state of its first part, until a piece is a whole record: in this limit the
motion is continuous, and the likelihood is the one of the whole records.

Source: H. G. Bock, Numerical treatment of inverse problems in chemical reaction kinetics, in
Modelling of Chemical Reaction Systems, Springer, 1981, for the pieces and their elimination.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require
from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Float
from ..data.record import Record, without_initial_state
from ..models.base import AbstractModel
from ..models.free import INITIAL_STATE, Free, Parameters, initial_parameters
from .likelihoods import OutputError
from .problem import Problem
from .solver import NEAR, GaussNewton, minimise

JOINED = 4  # chosen: pieces joined from stage to stage
LEAST_SAMPLES = 2  # of a piece


def shot(
    model: AbstractModel,
    free: Free,
    records: Record,
    likelihood: OutputError,
    solver: GaussNewton,
) -> Parameters:
    """Return initial parameters from fits of ever longer pieces of the records.

    Args:
        model: the model, with the start of the parameters.
        free: the free parameters.
        records: a stack.
        likelihood: output error with `shooting`, the number of pieces of each record.
        solver: options of the iteration, whose tolerance is replaced by a coarse one.

    Raises:
        InputError: for more pieces than the records have pairs of samples, or an initial state that
            all records share.
    """
    assert likelihood.shooting is not None
    _check(free, records, likelihood.shooting)
    samples, of_piece = records.t.shape[-1], _free_of_piece(model, free)
    coarse = dataclasses.replace(solver, tolerance=NEAR)
    length, parameters = -(-samples // likelihood.shooting), None
    while length < samples:
        pieces = cut(records, length)
        problem = Problem.of(model, of_piece, pieces, likelihood)
        begin = initial_parameters(model, problem.positions, problem.records)
        if parameters is not None:
            begin = Parameters(parameters.shared, _starts(parameters.rows, records.n_cases))
        parameters, length = _minimised(problem, begin, coarse), length * JOINED
    problem = Problem.of(model, free, records, likelihood)
    begin = initial_parameters(model, problem.positions, problem.records)
    if parameters is None:
        return begin
    first = parameters.rows.reshape(records.n_cases, -1, parameters.rows.shape[-1])[:, 0]
    own = np.array([of_piece.per_record.index(name) for name in free.per_record], int)
    return Parameters(parameters.shared, first[:, own])


def cut(records: Record, length: int) -> Record:
    """Return the pieces of all records as a stack, the pieces of the first record first.

    The last piece of a record is padded.

    Args:
        records: a stack.
        length: number of samples of a piece.
    """
    cases, samples = records.t.shape
    count = -(-samples // length)
    rows = np.arange(count * length).reshape(count, length)
    inside = jnp.asarray(rows < samples)
    rows = np.minimum(rows, samples - 1)

    def pieces(leaf):
        return leaf[:, rows].reshape(cases * count, length, *leaf.shape[2:])

    return dataclasses.replace(
        records,
        t=pieces(records.t),
        u=pieces(records.u),
        z=pieces(records.z),
        mask=pieces(records.mask) & jnp.tile(inside, (cases, 1))[..., None],
        constants={
            name: jnp.repeat(c, count)
            for name, c in without_initial_state(records.constants).items()
        },
        names=("",) * (cases * count),
    )


def _starts(rows: Float[Array, "piece own"], cases: int) -> Float[Array, "joined own"]:
    """Return the parameters of the pieces with which joined pieces start."""
    first = rows.reshape(cases, -1, rows.shape[-1])[:, ::JOINED]
    return first.reshape(-1, rows.shape[-1])


def _free_of_piece(model: AbstractModel, free: Free) -> Free:
    """Return the free parameters with all initial states among the parameters of each record.

    Bounds and typical sizes of an initial state are of the start of the record, not of its pieces.
    """
    states = tuple(f"{INITIAL_STATE}.{name}" for name in model.states)
    others = tuple(name for name in free.per_record if name not in states)

    def of_all_pieces(option):
        return {name: value for name, value in option.items() if name not in states}

    return dataclasses.replace(
        free,
        per_record=(*states, *others),
        lower=of_all_pieces(free.lower),
        upper=of_all_pieces(free.upper),
        scale=of_all_pieces(free.scale),
    )


@fast_compile_jit
def _minimised(problem: Problem, begin: Parameters, solver: GaussNewton) -> Parameters:
    return minimise(problem, begin, solver)[0]


def _check(free: Free, records: Record, count: int) -> None:
    samples = records.t.shape[-1]
    require(
        count * LEAST_SAMPLES <= samples,
        f"The records have {samples} samples, too few for {count} pieces of {LEAST_SAMPLES}. Give "
        f"`shooting` at most {samples // LEAST_SAMPLES}.",
    )
    shared = [name for name in free.shared if name.startswith(f"{INITIAL_STATE}.")]
    require(
        not shared,
        f"With `shooting` every piece of a record has its own initial state, and "
        f"{', '.join(shared)} is one value for all records. Name it in `per_record`.",
    )
