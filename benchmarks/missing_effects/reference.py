"""Attainable error: the true model fitted to the records of a study.

This fit also shows whether the records determine the planted effect.
"""

from typing import NamedTuple

import numpy as np

from benchmarks.missing_effects.scenarios import Flown, Scenario
from jaxid import LoopOptions, OutputError
from jaxid.diagnosis.scores import critical
from jaxid.effects.base import Effect
from jaxid.estimation.estimate import as_stack
from jaxid.loop.columns import own_parameters
from jaxid.study.close_loop import SOLVER
from jaxid.study.fit import Fitted
from jaxid.study.workbench import Workbench


class Reference(NamedTuple):
    """The true model on the records of a study.

    Attributes:
        bench, declared: the workbench, and the declared model's fit.
        chi_square: twice the reduction of the training cost by all planted effects.
        gains: chi-square of each planted gain, for coloured residuals.
        identifiable: whether each is significant at the study's threshold.
        error: mean over the channels of the logarithm of the error on the test records.
    """

    workbench: Workbench
    declared: Fitted
    chi_square: float
    gains: tuple[float, ...]
    identifiable: tuple[bool, ...]
    error: float


def reference(
    scenario: Scenario, flown: Flown, library: tuple[Effect, ...], window: int
) -> Reference:
    """Fit the declared model and the true model, the latter from the true parameter values.

    Args:
        scenario: scenario with its planted effects.
        flown: its records.
        library: candidates of the study, so that the reference needs no further compilation.
        window: samples in which initial states are fitted.
    """
    workbench = Workbench(
        flown.model, flown.free, library, OutputError(), as_stack(list(flown.train)), SOLVER
    )
    declared = workbench.set_shapes(workbench.base())
    names, values = [], np.array(declared.values)
    for name in flown.free.shared if scenario.planted else ():
        values[workbench.columns.index[name]] = flown.true.get(
            name, values[workbench.columns.index[name]]
        )
    for one in scenario.planted:
        name = next(
            (effect.name for effect in library if effect.card.family == one.effect.card.family),
            None,
        )
        if name is None:
            raise ValueError(f"the library of candidates has no {one.effect.card.family}")
        names.append(name)
        for dotted in own_parameters(workbench.effects[name]):
            values[workbench.columns.index[dotted]] = float(
                getattr(one.effect, dotted.rpartition(".")[2])
            )
    fitted = workbench.fit(names, values, declared.fit.parameters.rows) if names else declared
    errors = workbench.standard_errors(fitted)
    gains = tuple(_chi_square(*errors[f"{name}.gain"]) for name in names)
    threshold = critical(LoopOptions().level / len(library))
    rms = workbench.predict(fitted, as_stack(list(flown.test)), window).rms
    fall = 2.0 * (declared.cost - fitted.cost)
    return Reference(
        workbench, declared, fall, gains, tuple(one > threshold for one in gains), mean_log(rms)
    )


def mean_log(rms) -> float:
    """Return the mean over the channels of the logarithm of their errors."""
    return float(np.mean(np.log(np.asarray(list(rms.values()) if isinstance(rms, dict) else rms))))


def _chi_square(value: float, error: float) -> float:
    return float((value / error) ** 2) if error > 0 and np.isfinite(error) else 0.0
