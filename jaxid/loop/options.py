"""`LoopOptions`: levels and limits of a search for missing effects."""

import equinox as eqx

from .._foundation.checks import require
from .hypothesis import NoiseHypothesis


class LoopOptions(eqx.Module):
    """Levels and limits of `close_loop`.

    Args:
        level: probability of one false effect in a study in which nothing is missing, spread over
            all candidates.
        min_check_gain: least fall of the check records' error (mean over channels of its logarithm)
            for an effect to be added while the residual is still predictable, because its
            significance is then inaccurate.
        max_check_loss: largest rise of the same error that an effect may cause on check records
            that hardly excite it.
        refits: number of best-scored candidates that are refitted from each hypothesis, in addition
            to the best candidate of each place; half as many of those with a shape, whose score
            holds at a guess of the shape; and as many of those whose score does not predict their
            fall of the cost (a stop, an overflow).
        swap_limit: number of swaps, of pairs, and of pairs with the best refused addition, that are
            refitted from each hypothesis; with 0 there is none.
        max_rounds: largest number of rounds, which are all changes but removals.
        beam_width: number of hypotheses that are kept in each round.
        max_predictable_share: largest share of the residual's power that its past may explain for
            the residual to count as noise.
        draws: number of draws of the second opinion on each round; with 0 there is none. They
            resolve a level of `1 / (draws + 1)` and more.
        seed: seed of these draws.
        noises: noise hypotheses of your own, which are compared with the others.

    Raises:
        InputError: if a number lies outside its range.
    """

    level: float = eqx.field(static=True, default=0.01)
    min_check_gain: float = eqx.field(static=True, default=0.02)
    max_check_loss: float = eqx.field(static=True, default=0.001)
    refits: int = eqx.field(static=True, default=6)
    swap_limit: int = eqx.field(static=True, default=3)
    max_rounds: int = eqx.field(static=True, default=8)
    beam_width: int = eqx.field(static=True, default=1)
    max_predictable_share: float = eqx.field(static=True, default=0.03)
    draws: int = eqx.field(static=True, default=999)
    seed: int = eqx.field(static=True, default=0)
    noises: tuple[NoiseHypothesis, ...] = ()

    def __check_init__(self):
        for name in ("level", "min_check_gain", "max_predictable_share"):
            value = getattr(self, name)
            require(0 < value < 1, f"{name} is {value}; it must lie between 0 and 1.")
        for name in ("max_check_loss", "swap_limit", "draws", "seed"):
            value = getattr(self, name)
            require(value >= 0, f"{name} is {value}; it must not be negative.")
        for name in ("refits", "max_rounds", "beam_width"):
            value = getattr(self, name)
            require(value >= 1, f"{name} is {value}; it must be at least 1.")
