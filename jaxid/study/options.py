"""`LoopOptions`: levels and limits of `close_loop`."""

import equinox as eqx

from .._foundation.checks import require


class LoopOptions(eqx.Module):
    """Levels and limits of `close_loop`.

    Args:
        level: probability of one false effect in a study in which nothing is missing, spread over
            all candidates tried.
        min_check_gain: least fall of the check records' error (mean over channels of its logarithm)
            for an effect to be added while the residual is still predictable, because its
            significance is then inaccurate. The fall must also exceed its standard error; two
            standard errors if the effect has no score, because its significance then cannot be
            corrected for the colour of the residual.
        max_check_loss: largest rise of the same error that an effect may cause on check records
            that hardly excite it.
        refits: number of best-scored candidates that are refitted in each round; at most as many
            again are refitted of the candidates whose score does not predict their fall of the cost
            (a stop, an overflow).
        swap_limit: number of best-scored pairs that are refitted if no single candidate helps, and
            number of effects that are tried in place of a round's winner, or of one or two effects
            of the model; with 0 none of these is tried.
        max_rounds: largest number of rounds; each adds an effect or a pair.
        beam_width: 2 if a search that leaves more than noise may start again with another effect,
            which can take twice as long; else 1.
        max_predictable_share: largest share of the residual's power that its past may explain for
            the residual to count as noise.

    Raises:
        InputError: if a number lies outside its range.
    """

    level: float = eqx.field(static=True, default=0.01)
    min_check_gain: float = eqx.field(static=True, default=0.02)
    max_check_loss: float = eqx.field(static=True, default=0.001)
    refits: int = eqx.field(static=True, default=8)
    swap_limit: int = eqx.field(static=True, default=3)
    max_rounds: int = eqx.field(static=True, default=8)
    beam_width: int = eqx.field(static=True, default=2)
    max_predictable_share: float = eqx.field(static=True, default=0.03)

    def __check_init__(self):
        for name in ("level", "min_check_gain", "max_predictable_share"):
            require(
                0 < getattr(self, name) < 1,
                f"{name} is {getattr(self, name)}; it must lie between 0 and 1.",
            )
        for name in ("max_check_loss", "swap_limit"):
            require(
                getattr(self, name) >= 0,
                f"{name} is {getattr(self, name)}; it must not be negative.",
            )
        for name in ("refits", "max_rounds"):
            require(
                getattr(self, name) >= 1, f"{name} is {getattr(self, name)}; it must be at least 1."
            )
        require(self.beam_width in (1, 2), f"beam_width is {self.beam_width}; it must be 1 or 2.")
