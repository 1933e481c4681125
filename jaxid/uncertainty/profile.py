"""`profile_likelihood`: the likelihood over one parameter, all others at their best."""

import enum
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy

from .._foundation.checks import require_known, require_level
from .._foundation.notebook import preformatted
from .._foundation.types import Array, Float
from ..data.record import Record
from ..estimation.estimate import fit_problem
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.result import Estimate
from ..estimation.solver import GaussNewton, solver_or_default
from ..models.free import Parameters
from ..sensitivity.information import OwnBlock
from ..sensitivity.spectrum import spectrum
from .argument_checks import stack_of_estimate

SIDE_STEPS = np.arange(1, 9) / 8.0  # of a profile on each side of the estimate; chosen
# First and largest width of a side in standard errors, and factor by which it is widened until the
# interval ends; chosen.
FIRST_WIDTH, LARGEST_WIDTH, WIDENING = 4.0, 64.0, 4.0
CLOSE_END = 0.25  # share of the width of a side within which an end has too few points; chosen
ROUNDS = 16  # of widening or refining; chosen


class Shape(enum.Enum):
    """Which ends the interval of a profile has; each value is a sentence."""

    BOUNDED = "both ends are determined"
    ONE_SIDED = "only one end is determined; the other is a limit or infinite"
    FLAT = "no end is determined"


class Profile(eqx.Module):
    """The likelihood over one parameter.

    Attributes:
        name: the parameter.
        value: its estimate.
        points, costs: values of the parameter and the costs there, the others at their best.
        threshold: rise of the cost at the ends of the interval.
        ends: of the interval, at this rise; infinite, or the bound of the parameter, where the cost
            does not rise so far.
        shape: which ends are determined.
    """

    name: str = eqx.field(static=True)
    value: float = eqx.field(static=True)
    points: Float[Array, " point"]
    costs: Float[Array, " point"]
    threshold: float = eqx.field(static=True)
    ends: tuple[float, float] = eqx.field(static=True)
    shape: Shape = eqx.field(static=True)

    @property
    def asymmetry(self) -> float:
        """Ratio of the longer to the shorter side of the interval; one for a linear model."""
        low, high = self.value - self.ends[0], self.ends[1] - self.value
        return max(low, high) / min(low, high) if min(low, high) > 0 else np.inf

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def __str__(self) -> str:
        return (
            f"{self.name}: {self.value:.6g}, from {self.ends[0]:.6g} to {self.ends[1]:.6g} "
            f"({self.shape.value})"
        )


def profile_likelihood(
    estimate: Estimate,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood,
    name: str,
    *,
    level: float = 0.95,
    solver: GaussNewton | None = None,
) -> Profile:
    r"""Return the profile of the likelihood over one parameter, and the interval that follows.

        J(theta_k) = min over all others,    J(theta_k) - J_min < N/2 log(1 + q^2 / nu)

    with Student's q of `nu = N - p` degrees of freedom, which for a linear model with one output is
    the interval of `Estimate.interval`; the limit is `q^2 / 2` where R is known. The interval
    follows a likelihood that is not quadratic, ends at bounds, and is infinite where the data set
    no limit within 64 standard errors. A parameter on its bound may move into its bounds; its
    standard error here is the one without the bound.

    Args:
        estimate: from `estimate`, of one case.
        records, likelihood: those of the estimate.
        name: a shared parameter.
        level: probability, such as 0.95.
        solver: options of the iterations, which start at the estimate.

    Raises:
        InputError: for a name that is not free, or a level that is not between 0 and 1.
    """
    records = stack_of_estimate(estimate, records, likelihood)
    require_known("free parameter", [name], estimate.names)
    require_level(level, 0.95)
    problem = Problem.of(estimate.model, estimate.free, records, likelihood)
    index, upper = estimate.names.index(name), 0.5 * (1.0 + level)
    if estimate.noise_known:
        threshold = 0.5 * float(scipy.special.ndtri(upper)) ** 2
    else:
        nu, count = float(estimate.degrees_of_freedom), float(np.sum(np.asarray(estimate.mask)))
        threshold = 0.5 * count * float(np.log1p(scipy.special.stdtrit(nu, upper) ** 2 / nu))
    value, local = float(estimate.values[index]), _local(problem, estimate, index)
    limits = problem.limits
    bounds = float(limits.lower.shared[index]), float(limits.upper.shared[index])
    below = above = FIRST_WIDTH * local.error
    for _ in range(ROUNDS):
        points = np.concatenate(
            [value - below * SIDE_STEPS[::-1], [value], value + above * SIDE_STEPS]
        )
        points = np.clip(points, *bounds)
        costs = np.asarray(
            _costs(problem, estimate, *local[1:], index, jnp.asarray(points), solver)
        )
        rises = costs - float(estimate.cost)
        low = _crossing(points[::-1], rises[::-1], value, threshold)
        high = _crossing(points, rises, value, threshold)
        last = below, above
        largest = LARGEST_WIDTH * local.error
        below = _next_width(below, value - low, largest, at_bound=bool(points[0] == bounds[0]))
        above = _next_width(above, high - value, largest, at_bound=bool(points[-1] == bounds[1]))
        if (below, above) == last:
            break
    determined = int(np.isfinite(low)) + int(np.isfinite(high))
    return Profile(
        name=name,
        value=value,
        points=jnp.asarray(points),
        costs=jnp.asarray(costs),
        threshold=threshold,
        ends=(low if np.isfinite(low) else bounds[0], high if np.isfinite(high) else bounds[1]),
        shape=(Shape.FLAT, Shape.ONE_SIDED, Shape.BOUNDED)[determined],
    )


class _Local(NamedTuple):
    """The likelihood about the estimate, with the parameter of the profile free of its bounds.

    Attributes:
        error: standard error of the parameter; with all others known where these do not determine
            it, and one where the data do not depend on it.
        half: square root of the covariance of the shared parameters.
        own: information on the parameters of each record.
    """

    error: float
    half: Float[Array, "parameter parameter"]
    own: OwnBlock


def _local(problem: Problem, estimate: Estimate, index: int) -> _Local:
    """Return the likelihood about the estimate, for the profile over one parameter."""
    information, svd = estimate.information, estimate.spectrum
    if bool(estimate.on_bound[index]):  # which holds it, so that its column there is zero
        released = _with_bounds(problem, index, -jnp.inf, jnp.inf)
        linearised = eqx.filter_jit(Problem.linearise)(released, estimate.parameters)
        information = linearised.information
        svd = spectrum(information.triangle, information.rhs, problem.limits.scale)
    error = float(jnp.sqrt(svd.covariance(estimate.threshold)[index, index]))
    if not np.isfinite(error):
        length = float(jnp.linalg.norm(information.triangle[:, index]))
        error = 1.0 / length if length > 0 else 1.0
    return _Local(error, svd.square_root(estimate.threshold), information.own)


def _with_bounds(problem: Problem, index: int, low, high) -> Problem:
    """Return a problem with other bounds of one shared parameter."""
    limits = problem.limits
    return eqx.tree_at(
        lambda node: (node.limits.lower.shared, node.limits.upper.shared),
        problem,
        (limits.lower.shared.at[index].set(low), limits.upper.shared.at[index].set(high)),
    )


def _next_width(width: float, distance: float, largest: float, *, at_bound: bool) -> float:
    """Return the width of one side of the next profile; the same one where it is right.

    An end that is close to the estimate needs more points: next to a bound the cost rises as a
    straight line, and its root does not.

    Args:
        width: of the side now.
        distance: of the end from the estimate, not finite where the cost does not rise so far.
        largest: width of a side.
        at_bound: True if the side ends at the bound of the parameter.
    """
    if not np.isfinite(distance):
        return width if at_bound or width >= largest else WIDENING * width
    return 2.0 * distance if distance < CLOSE_END * width else width


def _crossing(points: np.ndarray, rises: np.ndarray, value: float, threshold: float) -> float:
    """Return where the rise of the cost passes the threshold on the way outwards, or infinity.

    The root of the rise is nearly a straight line in the parameter, and is interpolated by one.

    Args:
        points: from the far side inwards and outwards again; those before the value do not count.
        rises: of the cost at the points, infinite where the simulation fails.
        value: of the parameter at the least cost.
        threshold: rise at the end of the interval.
    """
    sign = np.sign(points[-1] - points[0])
    outside = sign * (points - value) > 0
    x = np.concatenate([[value], points[outside]])
    root = np.sqrt(np.maximum(np.concatenate([[0.0], rises[outside]]), 0.0))
    limit = np.sqrt(threshold)
    beyond = np.flatnonzero(root > limit)
    if not beyond.size:
        return np.inf
    at = beyond[0]
    if not np.isfinite(root[at]):
        return float(x[at])
    share = (limit - root[at - 1]) / (root[at] - root[at - 1])
    return float(x[at - 1] + share * (x[at] - x[at - 1]))


@eqx.filter_jit
def _costs(problem: Problem, estimate: Estimate, half, own: OwnBlock, index: int, points, solver):
    """Return the least costs with one parameter held at each of several values (jitted).

    The parameter is held by bounds that are equal. The others start where a linear model has them.
    """
    covariance = half @ half.T
    variance = covariance[index, index]
    slope = covariance[:, index] / jnp.where(variance > 0, variance, 1.0)
    reaction = -jnp.einsum("coi,cip->cop", own.inverse, own.coupling)

    def cost(point):
        step = (
            (slope * (point - estimate.values[index])).at[index].set(point - estimate.values[index])
        )
        shared = (estimate.values + step).at[index].set(point)
        begin = Parameters(shared, estimate.own + reaction @ step)
        held = _with_bounds(problem, index, point, point)
        return fit_problem(held, begin, solver_or_default(solver)).cost

    return jax.vmap(cost)(points)
