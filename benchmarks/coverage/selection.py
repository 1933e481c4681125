"""Intervals of the declared parameters after a search for missing effects by `close_loop`."""

import sys

import jax.numpy as jnp
import numpy as np

from benchmarks.coverage.flights import DERIVATIVES, Flights, ShortPeriod, fly_with
from benchmarks.coverage.intervals import Answer, records_of, started
from jaxid import OutputError, Study, close_loop
from jaxid.effects import Term

WINDOW = 20  # samples that fit the initial state of a check or test record
# Of the magnitude of a quarter of Mw w at the largest w of the manoeuvre (our choice).
MISSING_GAIN = -0.002


def missing_effect() -> Term:
    """Return the effect of the flights that the declared model lacks."""
    return Term("q", "w^3", gain=jnp.array(MISSING_GAIN))


def fly_missing(draws: int, samples: int, seed: int) -> Flights:
    """Return flights of the short period with the missing effect."""
    declared = ShortPeriod(*map(jnp.asarray, DERIVATIVES.values()))
    return fly_with(missing_effect(), draws, samples, seed, declared)


def after_selection(flights: Flights) -> Answer:
    """Return the intervals of the derivatives after a study of each flight with the whole library.

    The check record of a study is the next flight, its test record the one after that. A study
    counts as successful if the true effect is the only one added.
    """
    model, chosen = started()
    records = list(records_of(flights))
    studies = []
    for draw, train in enumerate(records):
        check, test = (records[(draw + further) % len(records)] for further in (1, 2))
        sides = {"train": train, "check": check, "test": test}
        studies.append(close_loop(model, chosen, OutputError(), **sides, window=WINDOW))
        print(f"study {draw + 1} of {len(records)}: {studies[-1].effects}", file=sys.stderr)
    return _answer(studies)


def _answer(studies: list[Study]) -> Answer:
    fits = [study.after.estimate for study in studies]
    keep = [[fit.names.index(name) for name in DERIVATIVES] for fit in fits]
    chosen = list(zip(fits, keep, strict=True))
    return Answer(
        tuple(DERIVATIVES),
        np.array([np.asarray(fit.values)[at] for fit, at in chosen]),
        np.array([np.asarray(fit.standard_errors)[at] for fit, at in chosen]),
        np.array([np.asarray(fit.interval())[at] for fit, at in chosen]),
        np.array([study.effects == (missing_effect().name,) for study in studies]),
    )
