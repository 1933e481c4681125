"""Candidate terms of each coefficient in a regression (report Table 6.1)."""

from collections.abc import Mapping, Sequence

from ..._foundation.checks import require, require_known
from ..vehicle.aerodynamics import COEFFICIENTS
from ..vehicle.force_axes import ForceAxes

STATIC_TERMS = (
    *(
        "alpha",
        "beta",
        "alpha^2",
        "beta^2",
        "alpha beta",
        "alpha^3",
        "beta^3",
        "alpha^2 beta",
        "alpha beta^2",
    ),
    *(
        "alpha^4",
        "beta^4",
        "alpha^2 beta^2",
        "alpha^5",
        "beta^5",
        "alpha^6",
        "alpha^7",
        "alpha^8",
        "alpha^9",
    ),
)
FORCE_TERMS = ("stabilator", "alpha stabilator", "qhat", "alpha qhat")
PITCHING_TERMS = ("stabilator", "alpha^2 stabilator", "qhat", "alpha qhat")
LATERAL_TERMS = (
    "rudder",
    "alpha rudder",
    "aileron",
    "alpha aileron",
    "phat",
    "alpha phat",
    "rhat",
    "alpha rhat",
)

TABLE_6_1: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("CX", "CZ"), (*FORCE_TERMS, *STATIC_TERMS)),
    "Cm": (*PITCHING_TERMS, *STATIC_TERMS),
    **dict.fromkeys(("CY", "Cl", "Cn"), (*LATERAL_TERMS, *STATIC_TERMS)),
}
"""Regressors of the report by coefficient, without the constant, which the regression adds.

Alpha and beta are centred on their means. The regressands u, v, w, p, q, r of the table determine
CX, CY, CZ, Cl, Cm, Cn; its p, q, r are the reduced rates phat, qhat, rhat of the coefficients (E.1
to E.8). The scan is corrected in two places:

- The rows of rudder, aileron, p and r have a cross in the column of q, and the rows of stabilator
  and q have none. The tables of results contradict this: Cm has stabilator, q, alpha q and alpha^2
  stabilator (Tables 6.3, 6.4, also Table 3.1). The tables of results are followed here.
- `alpha stabilator` has no cross at q, and `alpha^2 stabilator` has one. Cm therefore has the
  latter instead of the former: each longitudinal equation then has 22 terms and each lateral
  equation 26, the numbers of Table 6.2.
"""

SMALL_MOTION: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("CX", "CZ", "Cm"), ("alpha", "qhat", "stabilator", "alpha^2")),
    **dict.fromkeys(("CY", "Cl", "Cn"), ("beta", "phat", "rhat", "aileron", "rudder")),
}
"""Derivatives about one flight condition and the parabola of the drag polar.

A manoeuvre of a few degrees determines no more terms: for a change of the angle of attack of 2 deg
its high powers are nearly collinear, and a regression on a long record may choose among them by
noise.
"""


USUAL_RANGES: dict[str, tuple[float, float]] = {
    **{"CZ.qhat": (-60.0, 10.0), "CL.qhat": (-10.0, 60.0), "Cm.qhat": (-80.0, 15.0)},
    **{"Cl.phat": (-1.5, 1.0), "Cl.rhat": (-1.0, 1.0)},
    **{"Cn.phat": (-1.0, 1.0), "Cn.rhat": (-2.0, 0.5)},
}
"""Ranges of damping derivatives (chosen).

They include the tables of the F-16 (NASA TP-1538) up to 45 deg of alpha, where CZ.qhat reaches -38,
Cm.qhat -13, Cl.phat -0.9 to 0.6 and Cn.rhat -1.0, and the larger dampings of propeller aircraft and
transports.
"""


def extended(*more: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
    """Return the regressors of Table 6.1 followed by further terms.

    Args:
        more: further terms by coefficient, such as `{"Cm": ("alpha stabilator", "|alpha| qhat")}`;
            repeated terms are kept once.

    Returns:
        Terms by coefficient.

    Raises:
        InputError: for an unknown coefficient.
    """
    terms = dict(TABLE_6_1)
    for given in more:
        require_known("aerodynamic coefficient", given, COEFFICIENTS)
        terms |= {
            name: tuple(dict.fromkeys((*terms[name], *added))) for name, added in given.items()
        }
    return terms


def in_axes(candidates: Mapping[str, Sequence[str]], force: ForceAxes) -> dict[str, Sequence[str]]:
    """Return candidates by the coefficients of a model; terms of CX, CY, CZ serve the coefficients
    that take their place.

    Args:
        candidates: terms by coefficient, of the model or in body axes.
        force: axes of the force coefficients of the model.

    Raises:
        InputError: for an unknown coefficient, or terms of one in both axes.
    """
    place = dict(zip(COEFFICIENTS, force.coefficients, strict=True))
    names = dict.fromkeys((*force.coefficients, *COEFFICIENTS))
    require_known("aerodynamic coefficient (in `candidates`)", candidates, names)
    for name, own in place.items():
        require(
            name == own or not {name, own} <= {*candidates},
            f"There are candidates of {name} and of {own}, which takes its place. Give one.",
        )
    return {place.get(name, name): terms for name, terms in candidates.items()}
