"""`compare`: whether one hypothesis is better than another, with the numbers of the decision."""

import dataclasses
import enum
from collections.abc import Sequence

import equinox as eqx
import numpy as np
import scipy

from .._foundation.grid import typical_step
from .._foundation.types import Array, Float
from ..diagnosis.autoregression import chance_level
from ..diagnosis.heldout_error import difference_error, mean_log, uncertainty
from ..diagnosis.validation import Prediction
from ..estimation.autoregressive_noise import AutoregressiveNoise
from ..models.noise import AbstractNoise
from .fit import LoopFit
from .hypothesis import White
from .options import LoopOptions

# Chosen: chi-square by which two fits differ at least to be distinguished; a likelihood ratio of
# 20. Less names an arbitrary one of two, more reports alternatives that the records do distinguish.
INSEPARABLE = 6.0
# Derived: chi-square of five standard errors, the convention for a discovery. An effect is
# called the cause only if the nearest alternative fits worse by at least this.
SETTLED = 25.0
# Chosen: factor by which a fall, or the gain on the check records, may exceed the expected one.
OPTIMISM = 10.0
# Chosen: standard errors by which a gain must differ from zero to be determined.
DETERMINED = 2.0


class Decision(enum.Enum):
    """Outcome of a comparison; the value is the decision in words.

    Attributes:
        BETTER: the new hypothesis replaces the old one.
        CHECK_WORSE: it predicts the check records worse.
        UNDETERMINED: the gain of an added effect is within two standard errors of zero.
        DEGENERATE: an added effect is on a bound where it has no effect, or has a parameter that
            the records do not determine.
        NOT_SIGNIFICANT: the decrease of the cost may be due to chance.
        DRIFT: a noise has so long a memory that it is as well a constant or a drift.
        FOLLOWS: a noise depends on a candidate or a signal.
    """

    BETTER = "better"
    CHECK_WORSE = "predicts the check records worse"
    UNDETERMINED = "its gain is not determined"
    DEGENERATE = "on a bound where it has no effect"
    NOT_SIGNIFICANT = "not significant"
    DRIFT = "a noise as slow as a drift"
    FOLLOWS = "a noise that depends on a signal"


@dataclasses.dataclass(frozen=True)
class Comparison:
    """A decision and its numbers.

    Attributes:
        decision: the decision.
        fall: decrease of twice the cost of the training records (chi-square).
        required: least fall for the change, for its number of parameters, the number of candidates
            and the colour of the residual.
        check_fall: decrease of the mean logarithm of the check records' error; NaN between
            different noises.
    """

    decision: Decision
    fall: float
    required: float
    check_fall: float

    @property
    def accepted(self) -> bool:
        """True if the new hypothesis replaces the old one."""
        return self.decision is Decision.BETTER


def compare(old: LoopFit, new: LoopFit, options: LoopOptions, count: int) -> Comparison:
    """Compare a hypothesis with the one from which it was made.

    Added parameters must lower twice the cost by more than chance would with as many candidates
    (chi-square, Bonferroni), multiplied by the variance inflation of the new residual. A removal
    must raise it by less. A swap must pay the price of its parameters, multiplied by the same
    inflation if it has more, or lower twice the cost by `INSEPARABLE` times the inflation if it has
    as many. Another noise must pay the price of its parameters and `INSEPARABLE`. Where the
    residual is still predictable, train and check records decide together, by the probability of
    both improvements (`improvement_chance`), and the check records must gain materially. A noise
    must not be as slow as a drift.

    Args:
        count: number of candidates among which the change was selected.
    """
    fall = 2.0 * (old.cost - new.cost)
    if type(old.hypothesis.noise) is not type(new.hypothesis.noise):
        required = new.problem.price * (new.count - old.count) + INSEPARABLE
        decision = Decision.BETTER if fall > required else Decision.NOT_SIGNIFICANT
        if decision is Decision.BETTER and is_drift(new, memory(new)):
            decision = Decision.DRIFT
        return Comparison(decision, fall, required, float("nan"))
    level = options.level / max(count, 1)
    required = _required(old, new, level)
    check_fall = mean_log(old.check_prediction) - mean_log(new.check_prediction)
    numbers = Comparison(Decision.BETTER, fall, required, check_fall)
    return dataclasses.replace(numbers, decision=_decide(old, new, numbers, options, level))


def _decide(
    old: LoopFit, new: LoopFit, numbers: Comparison, options: LoopOptions, level: float
) -> Decision:
    """Return the decision between two fits of one noise."""
    check_fall = numbers.check_fall
    added = [name for name in new.effects if name not in old.effects]
    if not check_fall >= -_tolerated_loss(old, new, options):  # also if it is not a number
        return Decision.CHECK_WORSE
    if not all(_is_determined(new, name) for name in added):
        return Decision.UNDETERMINED
    if is_degenerate(new, added):
        return Decision.DEGENERATE
    if _is_accurate(old, new, options):
        better = numbers.fall > numbers.required
    else:
        gain = check_fall > options.min_check_gain
        better = gain and improvement_chance(old, new, numbers.fall, check_fall) < level
    return Decision.BETTER if better else Decision.NOT_SIGNIFICANT


def _is_accurate(old: LoopFit, new: LoopFit, options: LoopOptions) -> bool:
    """Return True if the fall of the cost alone decides: of an addition only if the residual is no
    longer predictable, or the records show the effect without a model.
    """
    added = set(new.effects) - set(old.effects)
    if not added or _is_swap(old, new) or any(map(new.problem.is_evident, added)):
        return True
    return is_noise_like(new, options)


def improvement_chance(old: LoopFit, new: LoopFit, fall: float, check_fall: float) -> float:
    """Return the probability that chance alone improves train and check records as much.

    The fall of chi-square of the training records, divided by the inflation, and the fall of the
    check records' error, divided by its standard error, are independent. Their probabilities are
    combined by Fisher's method (Statistical Methods for Research Workers, 1932, section 21.1).
    """
    added = set(new.effects) - set(old.effects)
    of_train = scipy.stats.chi2.logsf(max(fall, 0.0) / inflation(new, added), new.count - old.count)
    scatter = difference_error(old.check_prediction, new.check_prediction)
    if scatter > 0:
        of_check = scipy.stats.norm.logsf(check_fall / scatter)
    else:  # no difference, or one of the simulations fails
        of_check = -np.inf if check_fall > 0 else 0.0
    return float(scipy.stats.chi2.sf(-2.0 * (of_train + of_check), 4))


def _tolerated_loss(old: LoopFit, new: LoopFit, options: LoopOptions) -> float:
    """Return the largest rise of the check records' error, in its logarithm.

    An effect that the records show without a model, a swap, and a removal may raise it by its
    scatter.
    """
    if _is_swap(old, new):
        return uncertainty(new.check_prediction)
    evident = any(map(new.problem.is_evident, set(new.effects) - set(old.effects)))
    if not (evident or set(new.effects) < set(old.effects)):
        return options.max_check_loss
    scatter = difference_error(old.check_prediction, new.check_prediction)
    return max(options.max_check_loss, scatter)


def _is_swap(old: LoopFit, new: LoopFit) -> bool:
    """Return True if effects were both removed and added."""
    before, after = set(old.effects), set(new.effects)
    return not before <= after and not after <= before


def _required(old: LoopFit, new: LoopFit, level: float) -> float:
    """Return the least fall of chi-square by which the new hypothesis is better."""
    more, before, after = new.count - old.count, set(old.effects), set(new.effects)
    if after < before:
        return -float(scipy.stats.chi2.isf(level, -more))
    colour, price = inflation(new, after - before), new.problem.price
    if more > 0 and before <= after:
        return float(scipy.stats.chi2.isf(level, more)) * colour
    return price * more if more < 0 else colour * (price * more or INSEPARABLE)


def inflation(fit: LoopFit, effects) -> float:
    """Return the largest factor by which colour inflates the variance of an effect's parameters.

    Autocorrelation of the residual, after the effect was fitted, makes falls of the cost by chance
    larger by this factor.
    """
    columns = fit.problem.columns
    at = [fit.estimation.free.shared.index(name) for e in effects for name in columns.of_effect[e]]
    robust, plain = (
        np.diagonal(np.asarray(matrix))[at]
        for matrix in (fit.solution.robust_covariance, fit.solution.covariance)
    )
    known = np.isfinite(plain) & (plain > 0)
    return float(np.max(robust[known] / plain[known], initial=1.0))


def best_of_families(fits: Sequence[LoopFit]) -> list[LoopFit]:
    """Return the fits without those that are clearly worse than another one of the same families of
    effects, under the same noise.

    The members of a family are one effect from different initial shapes. One that ends in a higher
    local minimum is not its maximum likelihood estimate, even where it predicts the check records
    better.
    """
    pairs = [(_families(fit), fit) for fit in fits]
    lowest = {key: min(fit.cost for other, fit in pairs if other == key) for key, _ in pairs}
    near = INSEPARABLE / 2  # of the cost, half of chi-square
    return [fit for key, fit in pairs if fit.cost <= lowest[key] + near]


def _families(fit: LoopFit) -> tuple:
    """Return the families of the effects of a fit, and its kind of noise."""
    families = sorted(fit.problem.cards[name].family for name in fit.effects)
    return (*families, type(fit.hypothesis.noise))


def is_degenerate(fit: LoopFit, effects) -> bool:
    """Return True if an effect is on a bound at which it has no effect, or has an undetermined
    parameter that is not on a bound.
    """
    problem, names = fit.problem, fit.estimation.free.shared
    at_bound = np.asarray(fit.solution.shared_on_bound)
    variance = np.diagonal(np.asarray(fit.solution.covariance))
    for effect in effects:
        own = [names.index(name) for name in problem.columns.of_effect[effect]]
        if np.any(np.isinf(variance[own]) & ~at_bound[own]):
            return True
        fields = problem.effects[effect].card.degenerate_at_bounds
        if any(at_bound[names.index(f"{effect}.{field}")] for field in fields):
            return True
    return False


def is_noise_like(fit: LoopFit, options: LoopOptions) -> bool:
    """Return True if the past of no whitened residual predicts more of it than is allowed."""
    return all(share <= allowed for share, allowed, _ in _predictable(fit, options))


def _predictable(fit: LoopFit, options: LoopOptions) -> list[tuple[float, float, int]]:
    """Return for each output the predictable share of its residual, the share that is allowed, and
    the number of its samples.
    """
    counts = np.sum(np.asarray(fit.problem.train.mask), axis=(0, 1)).tolist()
    return [
        (share, options.max_predictable_share + chance_level(count), count)
        for share, count in zip(fit.predictable.values(), counts, strict=True)
    ]


def least_expected_fall(fit: LoopFit, options: LoopOptions) -> float:
    """Return the fall of chi-square below which an addition to a fit cannot be accepted.

    While the residual is predictable, an addition is accepted if it ends that, or if the error on
    the check records falls by `min_check_gain`. With `n` samples of each output, a fall `d` of the
    training records' mean logarithmic error is one of `2 n d` of chi-square for each output. To end
    a share `s` that the past predicts takes `-n log(1 - s)`. A fall may exceed the expected one by
    the factor `OPTIMISM`.
    """
    known = _predictable(fit, options)
    excess = max(-n * np.log1p(min(allowed - share, 0.0)) for share, allowed, n in known)
    gain = 2.0 * options.min_check_gain * sum(n for *_, n in known)
    return float(min(excess, gain)) / OPTIMISM


def memory(fitted: LoopFit) -> float:
    """Return the longest correlation time of the noise of a fit [s]; zero for white noise.

    Autoregressive noise with coefficients of characteristic roots `z` decays as `max |z|^i`.
    """
    noise = fitted.estimation.problem.likelihood.noise
    times = [v for n, (v, _) in fitted.estimates.items() if n.startswith("correlation_time.")]
    if isinstance(noise, AutoregressiveNoise):
        mask = fitted.problem.train.mask
        step = float(typical_step(fitted.problem.train.t))
        for coefficients in np.asarray(noise.coefficients(fitted.solution.residuals, mask)):
            largest = float(np.max(np.abs(np.roots(np.r_[1.0, -coefficients])), initial=0.0))
            times.append(step / max(-np.log(max(largest, 1e-300)), 1e-300))
    return max(times, default=0.0)


def is_drift(fitted: LoopFit, memory: float) -> bool:
    """Return True if a noise of some memory [s] is so slow in the records of a fit that it is as
    well a constant or a drift.
    """
    return bool(memory >= fitted.problem.longest_memory)


def worth(fit: LoopFit) -> float:
    """Return the evidence of a fit: twice the log-likelihood less a price for each parameter.

    For white noise the check records count as well: a short check record alone is a matter of
    chance. It is minus infinity where the prediction of one diverges.
    """
    if not isinstance(fit.hypothesis.noise, White):
        return -fit.price
    noise = fit.estimation.problem.likelihood.noise
    value = -fit.price - 2.0 * float(_cost(noise, fit.check_prediction))
    return value if np.isfinite(value) else -np.inf


def _is_determined(fit: LoopFit, effect: str) -> bool:
    """Return True if the gain of an effect without a shape differs from zero significantly.

    The gain of an effect with a shape is determined together with the shape only.
    """
    if fit.problem.has_shape(effect):
        return True
    value, error = fit.estimates[f"{effect}.gain"]
    return abs(value) > DETERMINED * error


@eqx.filter_jit
def _cost(noise: AbstractNoise, prediction: Prediction) -> Float[Array, ""]:
    """Return the negative log-likelihood of the errors of a prediction (jitted)."""
    return noise.cost(prediction.residuals, prediction.scored)
