"""`solve_equilibrium`: roots of equations within limits, or the reason for the failure."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.core import Tracer

from .._foundation.checks import InputError, require, require_float64, require_unique
from .._foundation.results import RESULTS
from .._foundation.types import Array, Bool, Float, Int, Numbers, PyTree
from .bounded_root import BoundedSearch

# Share of its range within which an unknown counts as being at its limit (chosen).
AT_LIMIT = 1e-3


class Trim(eqx.Module):
    """The result of `solve_equilibrium`. Under `vmap` every case has its own values and status.

    Attributes:
        names, units: names and units of the unknowns.
        equations, equation_units: names and units of the equations.
        values: values of the unknowns at the root, or at the end of the search [their units].
        residuals: residual of each equation [its unit].
        scaled_residuals: the residuals in the scale of each equation.
        lower, upper: limits of the unknowns; infinite if there is no limit.
        result: status.
        steps: number of steps of the search, from all starts.
        remedy: advice for a failure, from the caller.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    equations: tuple[str, ...] = eqx.field(static=True)
    equation_units: tuple[str, ...] = eqx.field(static=True)
    values: Float[Array, "*case unknown"]
    residuals: Float[Array, "*case equation"]
    scaled_residuals: Float[Array, "*case equation"]
    lower: Float[Array, "*case unknown"]
    upper: Float[Array, "*case unknown"]
    result: RESULTS
    steps: Int[Array, "*case"]
    remedy: str = eqx.field(static=True)

    @property
    def successful(self) -> Bool[Array, "*case"]:
        """True where all equations are balanced."""
        return jnp.asarray(self.result == RESULTS.successful)

    @property
    def status(self) -> str:
        """Outcome and remedy in one sentence; for one case only."""
        return "balanced" if bool(self.successful) else self.explain()

    @property
    def at_limit(self) -> Bool[Array, "*case unknown"]:
        """Mask of the unknowns at a limit, to a thousandth of their range."""
        near = AT_LIMIT * (self.upper - self.lower)
        bounded = jnp.isfinite(near)
        return bounded & ((self.values <= self.lower + near) | (self.values >= self.upper - near))

    def value(self, name: str) -> Float[Array, "*case"]:
        """Return the value of one unknown, by name [its unit]."""
        return self.values[..., self.names.index(name)]

    def residual(self, equation: str) -> Float[Array, "*case"]:
        """Return the residual of one equation, by name [its unit]."""
        return self.residuals[..., self.equations.index(equation)]

    def explain(self) -> str:
        """Return the reason for a failure, for one case only.

        It contains the equations out of balance, the unknowns at their limits, and the remedy.
        """
        if bool(self.result == RESULTS.nonfinite):
            return f"{self._nonfinite()} {self.remedy}".rstrip()
        size = np.abs(np.asarray(self.scaled_residuals))
        order = [int(i) for i in np.argsort(-size) if size[i] > 0.02 * size.max()][:3]
        first, *others = [
            f"{self.equations[i]} is out of balance by {float(self.residuals[i]):.3g} "
            f"{self.equation_units[i]}".rstrip()
            for i in order
        ]
        also = f" ({'; '.join(others)})" if others else ""
        limits = [self._limit(i) for i in np.flatnonzero(np.asarray(self.at_limit))]
        where = (
            " and ".join(limits)
            or "no unknown stands at a limit, so that there is no balance near the start"
        )
        return f"{first}{also}; {where}. {self.remedy}".rstrip()

    def _nonfinite(self) -> str:
        """Return the equations that cannot be computed and the unknowns' values, in words."""
        wrong = [
            n
            for n, r in zip(self.equations, self.residuals, strict=True)
            if not bool(jnp.isfinite(r))
        ]
        return (
            f"{' and '.join(wrong) or 'An equation'} cannot be computed (not a finite number) at "
            f"{self._listed(range(len(self.names)))}. Start elsewhere, or look for an error "
            "in the model."
        )

    def _limit(self, i) -> str:
        """Return an unknown at a limit, in words."""
        end = "lower" if self.values[i] < (self.lower[i] + self.upper[i]) / 2 else "upper"
        return f"{self.names[i]} stands at its {end} limit, {self._quantity(i)}"

    def _listed(self, which) -> str:
        return ", ".join(f"{self.names[i]} = {self._quantity(i)}" for i in which)

    def _quantity(self, i) -> str:
        """Return an unknown with its unit, angles also in degrees, in words."""
        value, unit = float(self.values[i]), self.units[i]
        return f"{value:.4g} {unit}".rstrip() + (
            f" ({np.degrees(value):.3g} deg)" if unit == "rad" else ""
        )

    def __str__(self) -> str:
        if self.values.ndim > 1:
            good = int(jnp.sum(self.successful))
            return f"Trim of {self.values.shape[0]} cases, {good} balanced: {', '.join(self.names)}"
        width = max(8, *(len(name) for name in self.names + self.equations))
        lines = [f"{'unknown':<{width}} {'value':>13}  unit"]
        for name, value, unit, limit in zip(
            self.names, self.values, self.units, self.at_limit, strict=True
        ):
            lines.append(
                f"{name:<{width}} {float(value):>13.6g}  "
                f"{unit}{' (at its limit)' if bool(limit) else ''}".rstrip()
            )
        lines.append(f"{'equation':<{width}} {'residual':>13}  unit")
        for name, value, unit in zip(
            self.equations, self.residuals, self.equation_units, strict=True
        ):
            lines.append(f"{name:<{width}} {float(value):>13.3g}  {unit}".rstrip())
        return "\n".join([*lines, f"status: {self.status} ({int(self.steps)} steps)"])


def solve_equilibrium(
    residual: Callable[[Float[Array, " unknown"], PyTree], Float[Array, " equation"]],
    start: Float[Numbers, " unknown"] | Float[Numbers, "start unknown"],
    args: PyTree = None,
    *,
    names: Sequence[str],
    equations: Sequence[str],
    units: Sequence[str] | None = None,
    equation_units: Sequence[str] | None = None,
    scale: Float[Numbers, " unknown"] | None = None,
    equation_scale: Float[Numbers, " equation"] | None = None,
    lower: Float[Numbers, " unknown"] | None = None,
    upper: Float[Numbers, " unknown"] | None = None,
    tolerance: float = 1e-8,
    max_steps: int = 100,
    remedy: str = "Reduce the demand, widen the limit, or start nearer.",
    throw: bool = True,
) -> Trim:
    """Return the values of unknowns within limits at which all equations vanish.

        residual(x, args) = 0,    lower <= x <= upper

    by `BoundedSearch` on the scaled equations, a Levenberg-Marquardt method that becomes Newton's
    near a root. Pure; a failed case of a batch does not affect the others. Derivatives by `args`
    are those of the implicit function, `-(d residual/dx)^-1 d residual/dargs`.

    Args:
        residual: the equations as a pure function of the unknowns and `args`. The same function
            object is compiled once.
        start: initial values, shape (unknown,), or rows of them, shape (start, unknown). Rows are
            tried in order until one leads to a root.
        args: additional arguments of the equations, such as the model.
        names, units: names and units of the unknowns.
        equations, equation_units: names and units of the equations, one for each unknown.
        scale: typical sizes of the unknowns, one by default; replaced by their range if they have
            limits.
        equation_scale: typical sizes of the equations, one by default.
        lower, upper: limits of the unknowns; an unknown has both or none (infinite).
        tolerance: largest residual of a balanced equation, in its scale.
        max_steps: largest number of steps from each start.
        remedy: advice for the message of a failure.
        throw: raise on failure, unless inside of `jit` or `vmap`; otherwise see the status.

    Returns:
        Values, residuals and status.

    Raises:
        InputError: when names, limits and numbers do not fit each other, or JAX is in 32 bit; with
            `throw`, when the equations cannot be balanced, with their residuals and the unknowns at
            their limits.
    """
    require_float64()
    names, equations = tuple(names), tuple(equations)
    count = len(names)
    require_unique("unknown", names)
    require_unique("equation", equations)
    require(
        count == len(equations),
        f"There are {count} unknowns, but {len(equations)} equations. Match them.",
    )
    start = jnp.atleast_2d(jnp.asarray(start, float))
    require(
        start.shape[1] == count,
        f"The start has {start.shape[1]} values for {count} unknowns: {', '.join(names)}.",
    )
    numbers = {"scale": (scale, 1.0), "equation_scale": (equation_scale, 1.0)}
    numbers |= {"lower": (lower, -jnp.inf), "upper": (upper, jnp.inf)}
    vectors = {}
    for name, (given, default) in numbers.items():
        vectors[name] = jnp.full(count, default) if given is None else jnp.asarray(given, float)
        require(
            vectors[name].shape == (count,),
            f"`{name}` has shape {vectors[name].shape}, but {count} values belong there.",
        )
    _check_limits(names, vectors["lower"], vectors["upper"])
    root = _solve(residual, start, args, vectors, tolerance, max_steps)
    trim = Trim(
        names=names,
        units=tuple(units) if units else ("",) * count,
        equations=equations,
        equation_units=tuple(equation_units) if equation_units else ("",) * count,
        values=root.values,
        residuals=root.residuals,
        scaled_residuals=root.residuals / vectors["equation_scale"],
        lower=vectors["lower"],
        upper=vectors["upper"],
        result=root.result,
        steps=root.steps,
        remedy=remedy,
    )
    if throw and not isinstance(trim.values, Tracer) and not bool(trim.successful):
        raise InputError(trim.explain())
    return trim


def _check_limits(names, lower, upper):
    """Check that known limits are neither empty nor one-sided."""
    if isinstance(lower, Tracer) or isinstance(upper, Tracer):
        return
    for name, low, high in zip(names, np.asarray(lower), np.asarray(upper), strict=True):
        require(
            bool(low < high), f"The limits of {name!r} are empty: {low:g} is not below {high:g}."
        )
        require(
            bool(np.isfinite(low) == np.isfinite(high)),
            f"{name!r} has one limit, {low:g} to {high:g}; give it both, the other far away, or "
            "none.",
        )


class _Root(NamedTuple):
    """Root of the equilibrium equations.

    Attributes:
        values: values of the unknowns.
        residuals: residuals of the equations.
        result: status of the search.
        steps: number of steps.
    """

    values: Float[Array, " unknown"]
    residuals: Float[Array, " equation"]
    result: RESULTS
    steps: Int[Array, ""]


@eqx.filter_jit
def _solve(residual, start, args, vectors, tolerance: float, max_steps: int) -> _Root:
    """Return the root: the jitted core of `solve_equilibrium`."""
    fixed = jax.lax.stop_gradient(vectors)
    half = (fixed["upper"] - fixed["lower"]) / 2.0
    size = jnp.where(jnp.isfinite(half), half, fixed["scale"])
    starts = jax.vmap(lambda x: jnp.clip(x, fixed["lower"], fixed["upper"]) / size)(
        jax.lax.stop_gradient(start)
    )
    solution = optx.root_find(
        lambda y, given: residual(y * size, given) / fixed["equation_scale"],
        BoundedSearch(rtol=tolerance, atol=tolerance, patience=max_steps),
        starts[0],
        args,
        options={"starts": starts, "lower": fixed["lower"] / size, "upper": fixed["upper"] / size},
        max_steps=max_steps * starts.shape[0] + 1,
        throw=False,
    )
    values = solution.value * size
    residuals = residual(values, args)
    error = jnp.max(jnp.abs(residuals / fixed["equation_scale"]))
    result = RESULTS.where(error < tolerance, RESULTS.successful, RESULTS.unbalanced)
    finite = jnp.all(jnp.isfinite(residuals))
    result = RESULTS.where(finite, result, RESULTS.nonfinite)  # pyright: ignore[reportArgumentType]
    return _Root(values, residuals, result, solution.stats["num_steps"])
