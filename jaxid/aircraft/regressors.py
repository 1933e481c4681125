"""Which terms each coefficient admits in a regression (report Table 6.1)."""

from collections.abc import Mapping, Sequence

from .._foundation.checks import require_known
from .aerodynamics import COEFFICIENTS

STATIC = (
    *("alpha", "beta", "alpha^2", "beta^2", "alpha beta", "alpha^3", "beta^3", "alpha^2 beta", "alpha beta^2"),
    *("alpha^4", "beta^4", "alpha^2 beta^2", "alpha^5", "beta^5", "alpha^6", "alpha^7", "alpha^8", "alpha^9"),
)
LONGITUDINAL = ("stabilator", "alpha stabilator", "qhat", "alpha qhat")
PITCHING = ("stabilator", "alpha^2 stabilator", "qhat", "alpha qhat")
LATERAL = ("rudder", "alpha rudder", "aileron", "alpha aileron", "phat", "alpha phat", "rhat", "alpha rhat")

TABLE_6_1: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("CX", "CZ"), (*LONGITUDINAL, *STATIC)),
    "Cm": (*PITCHING, *STATIC),
    **dict.fromkeys(("CY", "Cl", "Cn"), (*LATERAL, *STATIC)),
}
"""The report's regressors by coefficient, the constant left to the regression; alpha and beta are centred on their means.

The regressands u, v, w, p, q, r of the table determine CX, CY, CZ, Cl, Cm, Cn; its p, q, r are the reduced rates phat, qhat,
rhat that the coefficients are written in (E.1 to E.8). Two things are not as in the scan:

- The rows of rudder, aileron, p and r carry a cross in the column of q, and those of stabilator and q carry none. The tables of
  results have it the other way: Cm with stabilator, q, alpha q and alpha^2 stabilator (Tables 6.3, 6.4), Table 3.1 too. So they
  are taken here.
- `alpha stabilator` has no cross at q, and `alpha^2 stabilator` has one. Cm is given the latter in place of the former:
  each longitudinal equation then has 22 terms and each lateral one 26, as Table 6.2 counts them.
"""

SMALL_MOTION: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("CX", "CZ", "Cm"), ("alpha", "qhat", "stabilator", "alpha^2")),
    **dict.fromkeys(("CY", "Cl", "Cn"), ("beta", "phat", "rhat", "aileron", "rudder")),
}
"""The derivatives of a motion about one flight condition, and the parabola of the polar: what a manoeuvre of a few degrees tells.

High powers of an angle of attack that moves by 2 deg are nearly one another, and a long record has noise enough to choose among
them.
"""


def extended(*more: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
    """The regressors of Table 6.1 and more behind them.

    Args:
        more: further terms by coefficient, such as `{"Cm": ("alpha stabilator", "|alpha| qhat")}`; one that is there already
            stays once.

    Returns:
        Terms by coefficient.

    Raises:
        InputError: when a coefficient is not one of the six.
    """
    terms = dict(TABLE_6_1)
    for given in more:
        require_known("aerodynamic coefficient", given, COEFFICIENTS)
        terms |= {name: tuple(dict.fromkeys((*terms[name], *added))) for name, added in given.items()}
    return terms
