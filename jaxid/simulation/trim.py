"""`balance`: the values of some unknowns at which as many equations vanish, within limits, or the reason why there are none."""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.core import Tracer

from .._foundation.checks import InputError, require, require_float64, require_unique
from .._foundation.results import RESULTS
from .._foundation.types import Array, Bool, Float, Int, Numbers, PyTree
from .bounded import BoundedSearch

NEAR = 1e-3  # of a range: so near its limit an unknown counts as standing at it


class Trim(eqx.Module):
    """The result of `balance`. Under `vmap` every case has its own values and status.

    Attributes:
        names, units: of the unknowns.
        equations, equation_units: of the equations.
        values: the unknowns at the balance, or where the search ended.
        residuals: what is left of each equation [its unit].
        lower, upper: limits of the unknowns; infinite where there is none.
        result: status.
        steps: of the search, from all starts that were tried.
        remedy: what to do when it fails, in the words of who asked.
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
        """What happened and what to do, in a sentence; of one case only."""
        return "balanced" if bool(self.successful) else self.explain()

    @property
    def at_limit(self) -> Bool[Array, "*case unknown"]:
        """Which unknowns stand at a limit, to a thousandth of their range."""
        near = NEAR * (self.upper - self.lower)
        bounded = jnp.isfinite(near)
        return bounded & ((self.values <= self.lower + near) | (self.values >= self.upper - near))

    def value(self, name: str) -> Float[Array, "*case"]:
        """The value of one unknown, by name [its unit]."""
        return self.values[..., self.names.index(name)]

    def residual(self, equation: str) -> Float[Array, "*case"]:
        """What is left of one equation, by name [its unit]."""
        return self.residuals[..., self.equations.index(equation)]

    def explain(self) -> str:
        """Why a balance failed: the equations that are out, the unknowns at their limits, and what to do; one case only."""
        if bool(self.result == RESULTS.nonfinite):
            wrong = [n for n, r in zip(self.equations, self.residuals, strict=True) if not bool(jnp.isfinite(r))]
            return (
                f"{' and '.join(wrong) or 'An equation'} cannot be computed (not a finite number) at "
                f"{self._listed(range(len(self.names)))}. Start elsewhere, or look for what is wrong in the model. {self.remedy}"
            ).rstrip()
        size = np.abs(np.asarray(self.scaled_residuals))
        order = [int(i) for i in np.argsort(-size) if size[i] > 0.02 * size.max()][:3]
        first, *others = [
            f"{self.equations[i]} is out of balance by {float(self.residuals[i]):.3g} {self.equation_units[i]}".rstrip()
            for i in order
        ]
        also = f" ({'; '.join(others)})" if others else ""
        limits = [
            f"{self.names[i]} stands at its {'lower' if self.values[i] < (self.lower[i] + self.upper[i]) / 2 else 'upper'} "
            f"limit, {self._quantity(i)}"
            for i in np.flatnonzero(np.asarray(self.at_limit))
        ]
        where = " and ".join(limits) or "no unknown stands at a limit, so that there is no balance near the start"
        return f"{first}{also}; {where}. {self.remedy}".rstrip()

    def _listed(self, which) -> str:
        return ", ".join(f"{self.names[i]} = {self._quantity(i)}" for i in which)

    def _quantity(self, i) -> str:
        """An unknown with its unit, angles also in degrees."""
        value, unit = float(self.values[i]), self.units[i]
        return f"{value:.4g} {unit}".rstrip() + (f" ({np.degrees(value):.3g} deg)" if unit == "rad" else "")

    def __str__(self) -> str:
        if self.values.ndim > 1:
            good = int(jnp.sum(self.successful))
            return f"Trim of {self.values.shape[0]} cases, {good} balanced: {', '.join(self.names)}"
        width = max(8, *(len(name) for name in self.names + self.equations))
        lines = [f"{'unknown':<{width}} {'value':>13}  unit"]
        for name, value, unit, limit in zip(self.names, self.values, self.units, self.at_limit, strict=True):
            lines.append(
                f"{name:<{width}} {float(value):>13.6g}  {unit}{' (at its limit)' if bool(limit) else ''}".rstrip()
            )
        lines.append(f"{'equation':<{width}} {'residual':>13}  unit")
        for name, value, unit in zip(self.equations, self.residuals, self.equation_units, strict=True):
            lines.append(f"{name:<{width}} {float(value):>13.3g}  {unit}".rstrip())
        return "\n".join([*lines, f"status: {self.status} ({int(self.steps)} steps)"])


def balance(
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
    remedy: str = "Ask for less, widen the limit, or start nearer.",
    throw: bool = True,
) -> Trim:
    """Find the values of unknowns within limits at which all equations vanish.

        residual(x, args) = 0,    lower <= x <= upper

    by `BoundedSearch` on the scaled equations, a Levenberg-Marquardt method that ends as Newton's. Pure, and a failed case of a
    batch fails alone. Derivatives to whatever stands in `args` are those of the implicit function,
    `-(d residual/dx)^-1 d residual/dargs`.

    Args:
        residual: the equations, given the unknowns and `args`; pure. One and the same function compiles once.
        start: where to begin; of several rows the first counts from which a balance is reached.
        args: what the equations need beside the unknowns, such as the model.
        names, units: of the unknowns.
        equations, equation_units: of the equations, as many as unknowns.
        scale: typical sizes of the unknowns, one by default; where there are limits their range takes its place.
        equation_scale: typical sizes of the equations, one by default.
        lower, upper: limits of the unknowns; an unknown has both or none (infinite).
        tolerance: an equation is balanced when it is smaller than this, in its scale.
        max_steps: of the search, from each start.
        remedy: what to do when it fails, for the message.
        throw: raise where it fails, unless inside of `jit` or `vmap`; else the status tells.

    Returns:
        Values, residuals and status.

    Raises:
        InputError: when names, limits and numbers do not fit each other, or JAX is in 32 bit; with `throw`, when the equations
            cannot be balanced: which one is out by how much, and which unknown stands at its limit.
    """
    require_float64()
    names, equations = tuple(names), tuple(equations)
    count = len(names)
    require_unique("unknown", names)
    require_unique("equation", equations)
    require(count == len(equations), f"There are {count} unknowns, but {len(equations)} equations. Match them.")
    start = jnp.atleast_2d(jnp.asarray(start, float))
    require(start.shape[1] == count, f"The start has {start.shape[1]} values for {count} unknowns: {', '.join(names)}.")
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
    values, residuals, result, steps = _solve(residual, start, args, vectors, tolerance, max_steps)
    found = Trim(
        names=names,
        units=tuple(units) if units else ("",) * count,
        equations=equations,
        equation_units=tuple(equation_units) if equation_units else ("",) * count,
        values=values,
        residuals=residuals,
        scaled_residuals=residuals / vectors["equation_scale"],
        lower=vectors["lower"],
        upper=vectors["upper"],
        result=result,
        steps=steps,
        remedy=remedy,
    )
    if throw and not isinstance(found.values, Tracer) and not bool(found.successful):
        raise InputError(found.explain())
    return found


def _check_limits(names, lower, upper):
    """Refuse limits that are empty or one-sided, where they are known."""
    if isinstance(lower, Tracer) or isinstance(upper, Tracer):
        return
    for name, low, high in zip(names, np.asarray(lower), np.asarray(upper), strict=True):
        require(bool(low < high), f"The limits of {name!r} are empty: {low:g} is not below {high:g}.")
        require(
            bool(np.isfinite(low) == np.isfinite(high)),
            f"{name!r} has one limit, {low:g} to {high:g}; give it both, the other far away, or none.",
        )


@eqx.filter_jit
def _solve(residual, start, args, vectors, tolerance: float, max_steps: int):
    """The pure inside of `balance`: values, residuals, status and number of steps."""
    fixed = jax.lax.stop_gradient(vectors)
    half = (fixed["upper"] - fixed["lower"]) / 2.0
    size = jnp.where(jnp.isfinite(half), half, fixed["scale"])
    starts = jax.vmap(lambda x: jnp.clip(x, fixed["lower"], fixed["upper"]) / size)(jax.lax.stop_gradient(start))
    found = optx.root_find(
        lambda y, given: residual(y * size, given) / fixed["equation_scale"],
        BoundedSearch(rtol=tolerance, atol=tolerance, patience=max_steps),
        starts[0],
        args,
        options={"starts": starts, "lower": fixed["lower"] / size, "upper": fixed["upper"] / size},
        max_steps=max_steps * starts.shape[0] + 1,
        throw=False,
    )
    values = found.value * size
    residuals = residual(values, args)
    error = jnp.max(jnp.abs(residuals / fixed["equation_scale"]))
    result = RESULTS.where(error < tolerance, RESULTS.successful, RESULTS.unbalanced)
    finite = jnp.all(jnp.isfinite(residuals))
    result = RESULTS.where(finite, result, RESULTS.nonfinite)  # pyright: ignore[reportArgumentType]  (inherited)
    return values, residuals, result, found.stats["num_steps"]
