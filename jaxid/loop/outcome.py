"""`Outcome`: the result of a search for missing effects, as one of six states."""

import enum


class Outcome(enum.Enum):
    """Result of `close_loop`; the value is the word that JSON files and reports print.

    Attributes:
        NOTHING_MISSING: the residual is consistent with noise, and no candidate explains any of it.
        EXPLAINED: with the effects added, the residual is consistent with noise.
        PROXIES: effects are missing; those added predict better, but are not shown to be the cause.
        UNEXPLAINED: effects are missing, and no candidate of the library explains the residual.
        PROCESS_NOISE: random forces explain the residual; no effect is added.
        COLOURED_NOISE: time-correlated sensor noise explains the residual; no effect is added.
    """

    NOTHING_MISSING = "nothing missing"
    EXPLAINED = "explained"
    PROXIES = "proxies"
    UNEXPLAINED = "unexplained"
    PROCESS_NOISE = "process noise"
    COLOURED_NOISE = "coloured noise"

    @property
    def leaves_more_than_noise(self) -> bool:
        """True if the residual of the last fit is no estimate of the sensor noise."""
        return self in (Outcome.PROXIES, Outcome.UNEXPLAINED, Outcome.PROCESS_NOISE)
