"""How a loop decides: one small checked object."""

import equinox as eqx

from .._foundation.checks import require


class LoopOptions(eqx.Module):
    """Levels and limits of `close_loop`.

    Args:
        level: probability of one false effect in a study in which nothing is missing, spread over all candidates tried.
        material: fall of the check records' error (mean over channels of its logarithm) from which on an effect counts
            while the residual is still predictable, so that its significance is not known well. It must also be more than the
            standard error of that fall (two of them, where the effect has no score that tells its colour).
        harm: rise of the same error that an effect may cause on check records that hardly excite it.
        refits: how many of the best-scored candidates are refitted in each round, and beside them so many at most of those whose
            score does not tell what they bring (a stop, an overflow).
        pairs: how many of the best-scored pairs are refitted where no single candidate helps, and how many effects in the place
            of a round's winner, or of one or two that are in; with 0 none of these is tried.
        max_rounds: how many rounds may add, an effect or a pair each.
        ways: 2 where a search that ends with something left may begin again with another effect; it can take twice as long.
        predictable: share of the residual's power that its own past may explain, up to which it counts as noise.

    Raises:
        InputError: when a number lies outside its range.
    """

    level: float = eqx.field(static=True, default=0.01)
    material: float = eqx.field(static=True, default=0.02)
    harm: float = eqx.field(static=True, default=0.001)
    refits: int = eqx.field(static=True, default=8)
    pairs: int = eqx.field(static=True, default=3)
    max_rounds: int = eqx.field(static=True, default=8)
    ways: int = eqx.field(static=True, default=2)
    predictable: float = eqx.field(static=True, default=0.03)

    def __check_init__(self):
        for name in ("level", "material", "predictable"):
            require(0 < getattr(self, name) < 1, f"{name} is {getattr(self, name)}; it must lie between 0 and 1.")
        for name in ("harm", "pairs"):
            require(getattr(self, name) >= 0, f"{name} is {getattr(self, name)}; it must not be negative.")
        for name in ("refits", "max_rounds"):
            require(getattr(self, name) >= 1, f"{name} is {getattr(self, name)}; it must be at least 1.")
        require(self.ways in (1, 2), f"ways is {self.ways}; it must be 1 or 2.")
