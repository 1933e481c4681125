"""`Judge`: what the training and the check records say of a fit, and whether a candidate may be
kept.
"""

import dataclasses

import equinox as eqx
import numpy as np

from .._foundation.types import Array, Float
from ..data.record import Record
from ..diagnosis.autoregression import autoregressive_r2, chance_level
from ..diagnosis.scores import critical
from ..diagnosis.validation import Prediction, root_mean_square
from ..loop.heldout_error import difference_error, mean_log
from ..models.noise import AbstractNoise
from .fit import Fitted
from .options import LoopOptions
from .rounds import Candidate, Decision
from .shortlist import has_no_shape
from .workbench import Workbench

# standard errors that a gain, or a fall of the check's error, must stand off zero to be told at all
DETERMINED = 2.0


class Judge:
    """Says what the records say of fits.

    Args:
        bench: fits and scores.
        check: the records that decide; not used for fitting.
        tests: records whose errors are noted in passing, and decide nothing.
        window: samples at the start of check and test records in which the initial state is fitted.
        options: levels and limits.
    """

    def __init__(
        self,
        bench: Workbench,
        check: Record,
        tests: dict[str, Record],
        window: int | None,
        options: LoopOptions,
    ):
        self.bench, self.check, self.tests = bench, check, tests
        self.window, self.options = window, options
        self.samples = int(np.sum(np.asarray(bench.records.mask)))

    # Of a candidate ----------------------------------------------------------------------

    def told(
        self,
        fitted: Fitted,
        refit: Fitted,
        candidate: Candidate,
        before: Prediction,
        threshold: float,
    ) -> Candidate:
        """A refitted candidate, with whether it may be kept, and why not if not.

        The training records must bear it out, as far as their colour is known. Of a residual that
        is still predictable that is not known well: there the check must gain materially as well,
        by more than its scatter. (The check alone does not do: where it is the rest of the training
        records, what drifts in these goes on drifting in it, and in no other record.) Of what has
        no score, such as an effect that refines another, no colour is known: its gain must be twice
        the scatter. What the records show by themselves need only be borne out, and not refuted by
        the check.

        Args:
            fitted, refit: without the candidate and with it.
            candidate: what was refitted.
            before: the check records as predicted without it.
            threshold: chi-square from which on it counts as significant.
        """
        fall = 2.0 * (fitted.cost - refit.cost)
        after = self.check_prediction(refit)
        check_fall, scatter = mean_log(before) - mean_log(after), difference_error(before, after)
        shown = any(
            self.bench.effects[part].evident_in_data(self.bench.measured)
            for part in candidate.parts
        )
        known = np.isfinite(candidate.variance_inflation)
        borne_out = fall > threshold * (candidate.variance_inflation if known else 1.0)
        material = check_fall > max(
            self.options.min_check_gain, scatter if known else DETERMINED * scatter
        )
        harm = max(self.options.max_check_loss, scatter) if shown else self.options.max_check_loss
        if np.isnan(check_fall) or check_fall < -harm:
            decision = Decision.CHECK_WORSE
        elif not self.determined(refit, candidate):
            decision = Decision.UNDETERMINED
        elif self.bench.is_degenerate(refit, candidate.parts):
            decision = Decision.DEGENERATE
        elif not (
            borne_out
            and (shown or material or (known and self.looks_like_noise(self.predictable(refit))))
        ):
            decision = Decision.NOT_SIGNIFICANT
        else:
            decision = Decision.ACCEPTABLE
        return dataclasses.replace(
            candidate, cost_fall=fall, check_fall=float(check_fall), decision=decision
        )

    def determined(self, refit: Fitted, candidate: Candidate) -> bool:
        """Whether each gain stands two standard errors off zero, the colour of what is left
        accounted for.

        Where an effect has a shape beside its gain, the two can be told together only (a faint lag
        is gain times time), and the gain by itself says nothing.
        """
        errors = self.bench.standard_errors(refit)
        alone = (name for name in candidate.parts if has_no_shape(self.bench.effects[name]))
        return all(
            abs(value) > DETERMINED * error
            for value, error in (errors[f"{name}.gain"] for name in alone)
        )

    def threshold(self, candidates: tuple[Candidate, ...]) -> float:
        """The chi-square that counts as significant, with as many candidates tried (Bonferroni)."""
        return critical(self.options.level / max(len(candidates), 1))

    # Of a fit ----------------------------------------------------------------------

    def evidence(self, fitted: Fitted) -> float:
        """Twice the log-likelihood of training and check records, which are one body of evidence.

        A check record by itself is short: where a model drifts, its error is a matter of luck.
        """
        predicted = self.check_prediction(fitted)
        check_cost = float(_cost(self.bench.likelihood.noise, predicted))
        return -2.0 * (fitted.cost + check_cost)

    def worth(self, fitted: Fitted) -> float:
        """The evidence, less a price for each parameter."""
        return self.evidence(fitted) - self.price(fitted)

    def price(self, fitted: Fitted) -> float:
        """What its parameters cost: the logarithm of the number of samples each (Schwarz, Ann.
        Statist. 6, 1978).
        """
        return float(np.log(self.samples)) * len(fitted.columns)

    def check_prediction(self, fitted: Fitted) -> Prediction:
        """The check records as a fit predicts them."""
        return self.bench.predict(fitted, self.check, self.window)

    def check_error(self, fitted: Fitted) -> float:
        """Mean over the channels of the logarithm of the error on the check records."""
        return mean_log(self.check_prediction(fitted))

    def errors(self, fitted: Fitted) -> dict[str, dict[str, float]]:
        """Root mean square error by part and channel."""
        names = self.bench.records.outputs
        parts = {
            "train": root_mean_square(fitted.fit.residuals, self.bench.records.mask),
            "check": self.bench.predict(fitted, self.check, self.window).rms,
        }
        for name, test in self.tests.items():
            parts[f"test {name}"] = self.bench.predict(fitted, test, self.window).rms
        return {part: dict(zip(names, map(float, rms), strict=True)) for part, rms in parts.items()}

    def looks_like_noise(self, predictable: dict[str, float]) -> bool:
        """Whether no channel's past predicts more of it than is allowed, the scatter of short
        records included.
        """
        return all(share <= self.predictable_by_chance() for share in predictable.values())

    def predictable_by_chance(self) -> float:
        """The share of a channel's residual that its past may predict, and it still counts as
        noise.
        """
        fewest = int(np.min(np.sum(np.asarray(self.bench.records.mask), axis=(0, 1))))
        return self.options.max_predictable_share + chance_level(fewest)

    def predictable(self, fitted: Fitted) -> dict[str, float]:
        """Share of the training residual that its own past predicts, per channel."""
        share = autoregressive_r2(fitted.fit.residuals, self.bench.records.mask)
        return dict(zip(self.bench.records.outputs, map(float, share), strict=True))


@eqx.filter_jit
def _cost(noise: AbstractNoise, prediction: Prediction) -> Float[Array, ""]:
    """Negative log-likelihood of the errors of a prediction (jitted)."""
    return noise.cost(prediction.residuals, prediction.scored)
