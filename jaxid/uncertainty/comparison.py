"""`compare_errors`: the standard errors of an estimate in one table, and which of them to take."""

import enum
from collections.abc import Sequence

import equinox as eqx
import numpy as np

from .._foundation.checks import require
from .._foundation.notebook import Table
from .._foundation.types import Float, Numbers
from ..estimation.result import Estimate
from .bootstrap import Bootstrap
from .fixed_constants import FixedConstants
from .profile import Profile, Shape
from .sandwich import Sandwich

# Chosen: ratios of two errors that make a difference to a user.
COLOURED_RATIO = 1.1
CONSTANTS_RATIO = 1.05
SANDWICH_RATIO = 1.25
BOOTSTRAP_RATIO = 1.25
# Chosen: ratio of the two sides of a profile beyond which a symmetric interval misleads.
ASYMMETRY = 1.25
FEW_DOF = 30  # derived: Student's t quantile is 4 % larger than the normal one


class ErrorKind(enum.Enum):
    """Kinds of standard errors and intervals, each with the call that returns it."""

    CRAMER_RAO = "interval()"
    COLOURED = "interval(coloured=True)"
    CONSTANTS = "consider(...).standard_errors"
    SANDWICH = "sandwich(...).interval()"
    BOOTSTRAP = "bootstrap(...).interval()"
    PROFILE = "profile_likelihood(...).ends"
    NOTHING = "none"


class ErrorAdvice(eqx.Module):
    """The kind of error to take for a parameter, with the reason in one sentence."""

    kind: ErrorKind = eqx.field(static=True)
    reason: str = eqx.field(static=True)


class ErrorComparison(eqx.Module):
    """Standard errors of an estimate side by side.

    Attributes:
        names: names of the shared parameters.
        kinds: of the errors in the table.
        table: standard errors of each kind, in the order of `names`. Those with fixed constants
            contain the colour of the residuals.
        advice: for each parameter.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    kinds: tuple[ErrorKind, ...] = eqx.field(static=True)
    table: Float[Numbers, "kind parameter"]
    advice: tuple[ErrorAdvice, ...]

    def errors(self, kind: ErrorKind) -> Float[Numbers, " parameter"]:
        """Return the standard errors of one kind."""
        return self.table[self.kinds.index(kind)]

    def _repr_html_(self) -> str:
        return self._table().html(below=self._reasons())

    def __str__(self) -> str:
        return "\n".join([*self._table().lines(), *self._reasons()])

    def _table(self) -> Table:
        """Return the errors of each parameter, and the kind to take, in words."""
        titles = {
            ErrorKind.CRAMER_RAO: "Cramer-Rao",
            ErrorKind.COLOURED: "coloured",
            ErrorKind.CONSTANTS: "constants",
            ErrorKind.SANDWICH: "sandwich",
            ErrorKind.BOOTSTRAP: "bootstrap",
        }
        heads = ("parameter", *(titles[kind] for kind in self.kinds), "take")
        rows = (
            (name, *(f"{error:.3g}" for error in errors), advice.kind.value)
            for name, errors, advice in zip(
                self.names, np.asarray(self.table).T, self.advice, strict=True
            )
        )
        return Table(heads, (9, *(11 for _ in self.kinds)), tuple(rows))

    def _reasons(self) -> list[str]:
        """Return the reason for the kind to take, once for all parameters that share it."""
        reasons: dict[str, list[str]] = {}
        for name, advice in zip(self.names, self.advice, strict=True):
            reasons.setdefault(advice.reason, []).append(name)
        return [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()]


def _require_same_parameters(
    estimate: Estimate,
    considered: FixedConstants | None,
    bootstrap: Bootstrap | None,
    sandwich: Sandwich | None,
) -> None:
    """Refuse results of another estimate."""
    for name, other in (
        ("considered", considered and considered.parameters),
        ("bootstrap", bootstrap and bootstrap.names),
        ("sandwich", sandwich and sandwich.names),
    ):
        require(
            other is None or tuple(other) == estimate.names,
            f"`{name}` has the parameters of another estimate.",
        )


def compare_errors(
    estimate: Estimate,
    *,
    considered: FixedConstants | None = None,
    bootstrap: Bootstrap | None = None,
    sandwich: Sandwich | None = None,
    profiles: Sequence[Profile] = (),
) -> ErrorComparison:
    """Return all standard errors of an estimate, and which one to take for each parameter and why.

    The first reason that applies decides: not determined; on or near a bound; a profile that is
    not symmetric; a bootstrap that disagrees; fixed constants; scores of records or blocks that
    scatter more than the likelihood states; coloured residuals; few samples.

    Args:
        estimate: from `estimate`, of one case.
        considered: from `consider`.
        bootstrap: from `bootstrap`.
        sandwich: from `sandwich`.
        profiles: from `profile_likelihood`, of some parameters.

    Raises:
        InputError: for results of another estimate.
    """
    _require_same_parameters(estimate, considered, bootstrap, sandwich)
    coloured = np.asarray(estimate.corrected_errors)
    errors = {
        ErrorKind.CRAMER_RAO: np.asarray(estimate.standard_errors),
        ErrorKind.COLOURED: coloured,
    }
    if considered is not None:
        added = np.sum(np.asarray(considered.contributions) ** 2, axis=1)
        errors[ErrorKind.CONSTANTS] = np.sqrt(coloured**2 + added)
    if sandwich is not None:
        errors[ErrorKind.SANDWICH] = np.asarray(sandwich.standard_errors)
    if bootstrap is not None:
        errors[ErrorKind.BOOTSTRAP] = np.asarray(bootstrap.standard_errors)
    by_name = {profile.name: profile for profile in profiles}
    advice = []
    for index, name in enumerate(estimate.names):
        own = {kind: float(values[index]) for kind, values in errors.items()}
        advice.append(
            _of_likelihood(estimate, index, by_name.get(name))
            or _of_bootstrap(own, bootstrap)
            or _of_errors(estimate, own)
        )
    table = np.stack(list(errors.values()))
    return ErrorComparison(estimate.names, tuple(errors), table, tuple(advice))


def _of_likelihood(estimate: Estimate, index: int, profile: Profile | None) -> ErrorAdvice | None:
    """Return the advice for a parameter without a usable curvature of the likelihood."""
    if bool(estimate.on_bound[index]):
        return ErrorAdvice(ErrorKind.PROFILE, "on a bound, where the curvature is no error.")
    if not np.isfinite(float(estimate.standard_errors[index])):
        return ErrorAdvice(
            ErrorKind.NOTHING, "not determined by the data; see the weak directions."
        )
    if bool(estimate.near_bound[index]):
        return ErrorAdvice(
            ErrorKind.PROFILE, "near a bound, which a symmetric interval would cross."
        )
    if profile is not None and profile.shape is not Shape.BOUNDED:
        return ErrorAdvice(
            ErrorKind.PROFILE, f"the likelihood is not closed: {profile.shape.value}."
        )
    if profile is not None and profile.asymmetry > ASYMMETRY:
        return ErrorAdvice(
            ErrorKind.PROFILE,
            f"one side of the likelihood is {profile.asymmetry:.2g} times as wide as the other.",
        )
    return None


def _of_bootstrap(own: dict[ErrorKind, float], bootstrap: Bootstrap | None) -> ErrorAdvice | None:
    """Return the advice where the bootstrap disagrees with the errors of the same noise."""
    if bootstrap is None:
        return None
    kind = ErrorKind.COLOURED if bootstrap.block else ErrorKind.CRAMER_RAO
    ratio = own[ErrorKind.BOOTSTRAP] / own[kind]
    if max(ratio, 1.0 / ratio) < BOOTSTRAP_RATIO:
        return None
    return ErrorAdvice(
        ErrorKind.BOOTSTRAP,
        f"repetitions scatter {ratio:.2g} times as much as the curvature predicts: the model is "
        "not linear within its errors.",
    )


def _of_errors(estimate: Estimate, own: dict[ErrorKind, float]) -> ErrorAdvice:
    """Return the advice of the standard errors alone."""
    plain, coloured = own[ErrorKind.CRAMER_RAO], own[ErrorKind.COLOURED]
    with_constants = own.get(ErrorKind.CONSTANTS, coloured)
    if with_constants > CONSTANTS_RATIO * coloured:
        return ErrorAdvice(
            ErrorKind.CONSTANTS,
            f"the fixed constants widen the error {with_constants / coloured:.2g} times.",
        )
    scattered = own.get(ErrorKind.SANDWICH, coloured)
    if scattered > SANDWICH_RATIO * coloured:
        return ErrorAdvice(
            ErrorKind.SANDWICH,
            f"records or blocks disagree {scattered / coloured:.2g} times more than their noise "
            "explains.",
        )
    if coloured > COLOURED_RATIO * plain:
        return ErrorAdvice(
            ErrorKind.COLOURED,
            f"the residuals are coloured, and the Cramer-Rao bound is {coloured / plain:.2g} times "
            "too small.",
        )
    few = float(estimate.degrees_of_freedom) < FEW_DOF
    reason = "the residuals are white, R is estimated from few samples: Student's t."
    return ErrorAdvice(
        ErrorKind.CRAMER_RAO, reason if few else "the residuals are white and the model is regular."
    )
