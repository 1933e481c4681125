"""The next shapes of what was found: where one of them does nearly as well, the records do not
settle the form.
"""

import numpy as np

from .._foundation.compiler import fast_compile_jit
from .._foundation.host import to_device
from .._foundation.types import Array, Bool, Float
from ..diagnosis.scores import exchange_falls, sensitivities, whitened
from ..effects.augmented import Augmented, split_effects
from ..estimation.problem import Problem
from ..models.free import Free, Parameters, initial_parameters
from .fit import Fitted
from .workbench import Workbench


def near_kin(bench: Workbench, found: Fitted, margin: float) -> tuple[str, ...]:
    """Names of the kin that fit worse by less than a margin of chi-square.

    Args:
        bench, found: as `misfits_of_kin` takes them.
        margin: of chi-square.
    """
    return tuple(name for name, worse in misfits_of_kin(bench, found).items() if worse < margin)


def misfits_of_kin(bench: Workbench, found: Fitted) -> dict[str, float]:
    """By how much worse the training records are fitted with each of the kin in the place of its
    effect, in chi-square.

        v + S_out phi = S_free d + s_kin g + rest,    misfit = |rest|^2 - |v|^2

    with whitened residuals v and sensitivities S at the fit, the effect of gain phi taken out, and
    d and g by least squares. This linear model holds where it counts: a shape that does nearly as
    well leads to nearly the same motion.

    Args:
        bench: with its library, which is asked about elsewhere and left out here.
        found: the fit with the effects.

    Returns:
        Misfits by name; infinite where the free parameters imitate what is asked about.
    """
    model, free = bench.model_and_free(found)
    known = {*bench.effects, *(one.name for one in split_effects(model)[1])}
    kin = [
        (name, one)
        for name in found.effects
        for one in bench.effects[name].neighbouring_shapes()
        if one.name not in known
    ]
    by_name = {one.name: one for _, one in kin}
    if not kin:
        return {}
    assert isinstance(model, Augmented)  # as effects are in
    columns = (*free.shared, *(f"{name}.gain" for name in by_name))
    model = Augmented(model.model, (*model.effects_in, *by_name.values()))
    problem = Problem.of(model, Free(columns, free.per_record), bench.records, bench.likelihood)
    shared = initial_parameters(problem.model, problem.positions, problem.records).shared
    is_free = to_device(np.arange(len(columns)) < len(free.shared))
    out = np.array([[column == f"{name}.gain" for column in columns] for name, _ in kin])
    falls = _falls(problem, Parameters(shared, found.fit.parameters.rows), is_free, to_device(out))
    into = [columns.index(f"{one.name}.gain") for _, one in kin]
    misfits = -np.asarray(falls)[np.arange(len(kin)), into]
    return {one.name: float(worse) for (_, one), worse in zip(kin, misfits, strict=True)}


@fast_compile_jit
def _falls(
    problem: Problem,
    parameters: Parameters,
    is_free: Bool[Array, " column"],
    out: Bool[Array, "set column"],
) -> Float[Array, "set column"]:
    """By how much chi-square falls with each column in the place of each set."""
    v, S = whitened(problem, *sensitivities(problem, parameters))
    return exchange_falls(v, S, is_free, out, parameters.shared)
