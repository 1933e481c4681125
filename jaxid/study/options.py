"""How a loop decides: one small checked object."""

import equinox as eqx

from .._foundation.checks import require


class LoopOptions(eqx.Module):
    """Levels and limits of `close_loop`.

    Args:
        level: probability of one false effect in a study in which nothing is missing, spread over all candidates tried.
        material: fall of the check records' error (mean over channels of its logarithm) from which on an effect counts
            while the residual is still predictable, so that no significance is known. It must also stand out of the check's
            scatter: by one standard error where the training records bear the effect out, else by two.
        harm: rise of the same error that an effect may cause on check records that hardly excite it.
        refits: how many of the best-scored candidates are refitted in each round, and beside them so many at most of those whose
            score does not tell what they bring (a stop, an overflow).
        pairs: how many of the best-scored pairs are refitted where no single candidate helps.
        max_rounds: how many effects may be added.
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
    predictable: float = eqx.field(static=True, default=0.03)

    def __check_init__(self):
        for name in ("level", "material", "predictable"):
            require(0 < getattr(self, name) < 1, f"{name} is {getattr(self, name)}; it must lie between 0 and 1.")
        for name in ("harm", "pairs"):
            require(getattr(self, name) >= 0, f"{name} is {getattr(self, name)}; it must not be negative.")
        for name in ("refits", "max_rounds"):
            require(getattr(self, name) >= 1, f"{name} is {getattr(self, name)}; it must be at least 1.")
