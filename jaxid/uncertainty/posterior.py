r"""`posterior`: draws from the posterior of the parameters, by Hamiltonian Monte Carlo.

    p(theta | z)  ~  exp(-J(theta)) prior(theta)    within the bounds

with the cost J of the estimate. For an unknown diagonal R the profiled cost `N/2 log det R(theta)`
is the one in which R is integrated out with the density 1/s of each deviation s (Jeffreys). The
cost of other unknown noises is profiled too: they are at their largest likelihood.

The chains move in coordinates `xi` in which the posterior of a linear model is standard normal,
by the information of the estimate with the parameters of each record eliminated,

    theta = theta_0 + M^(-1/2) xi,    own = own_0 + T_own^-1 (xi_own - coupling (theta - theta_0))
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_key, require_level
from .._foundation.notebook import Table
from .._foundation.types import Array, Bool, Float
from ..data.record import Record
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.result import Estimate
from ..models.free import Parameters
from ..sensitivity.information import OwnBlock
from ..sensitivity.spectrum import spectrum
from .argument_checks import stack_of_estimate

# Chosen: largest ratio of the scatter of all draws to the one within the chains (A. Gelman,
# D. B. Rubin, Statistical Science 7, 1992), and least effective number of draws.
LARGEST_RATIO, LEAST_EFFECTIVE = 1.01, 400.0
# Chosen: distance from a bound at which chains start, in standard deviations that the parameter
# has if the others are known.
INSIDE = 1e-3


class Posterior(eqx.Module):
    """Draws from the posterior.

    Attributes:
        names, own_names: names of the shared parameters and of the parameters of each record.
        draws: of the shared parameters.
        own: of the parameters of each record.
        divergent: True where the simulated path left the posterior or its bounds.
        ratio: scatter of all draws over the one within the chains, one if they agree.
        effective: effective number of independent draws of each shared parameter.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    own_names: tuple[str, ...] = eqx.field(static=True)
    draws: Float[Array, "chain draw parameter"]
    own: Float[Array, "chain draw case own"]
    divergent: Bool[Array, "chain draw"]
    ratio: Float[Array, " parameter"]
    effective: Float[Array, " parameter"]

    @property
    def agree(self) -> bool:
        """True if the chains agree and are long enough for an interval."""
        return bool(jnp.all(self.ratio < LARGEST_RATIO) & jnp.all(self.effective > LEAST_EFFECTIVE))

    def interval(self, level: float = 0.95) -> Float[Array, "parameter 2"]:
        """Return the quantiles that hold each parameter with a probability, equal tails outside.

        Raises:
            InputError: when the level is not between 0 and 1.
        """
        require_level(level, 0.95)
        shares = jnp.array([0.5 * (1.0 - level), 0.5 * (1.0 + level)])
        return jnp.quantile(self.draws.reshape(-1, len(self.names)), shares, axis=0).T

    def to_arviz(self) -> Any:
        """Return the draws as ArviZ data: an xarray `DataTree` with the groups `posterior` and
        `sample_stats`, dimensions `chain` and `draw`, and `record` for parameters of each record.
        """
        import xarray as xr  # slow to import

        shape: tuple[str, ...] = ("chain", "draw")
        variables: dict[str, Any] = {
            name: (shape, np.asarray(self.draws[..., k])) for k, name in enumerate(self.names)
        }
        for k, name in enumerate(self.own_names):
            variables[name] = ((*shape, "record"), np.asarray(self.own[..., k]))
        chains, draws = self.divergent.shape
        axes = {"chain": np.arange(chains), "draw": np.arange(draws)}
        stats = {"diverging": (shape, np.asarray(self.divergent))}
        return xr.DataTree.from_dict(
            {"posterior": xr.Dataset(variables, axes), "sample_stats": xr.Dataset(stats, axes)}
        )

    def _repr_html_(self) -> str:
        return self._table().html(below=self._chains())

    def __str__(self) -> str:
        return "\n".join([*self._table().lines(), *self._chains()])

    def _table(self) -> Table:
        """Return the distribution of each shared parameter in words."""
        heads = ("parameter", "mean", "deviation", "2.5 %", "97.5 %", "effective", "ratio", "")
        flat = np.asarray(self.draws).reshape(-1, len(self.names))
        moments = np.column_stack([flat.mean(axis=0), flat.std(axis=0), self.interval()])
        columns = (self.names, moments, self.effective, self.ratio)
        rows = (
            (name, *(f"{cell:.5g}" for cell in cells), f"{effective:.0f}", f"{ratio:.4f}", "")
            for name, cells, effective, ratio in zip(*columns, strict=True)
        )
        return Table(heads, (9, *(11 for _ in heads[1:-1])), tuple(rows))

    def _chains(self) -> list[str]:
        """Return number, divergences and agreement of the chains, in words."""
        chains, draws = self.divergent.shape
        lines = [f"{chains} chains of {draws} draws, {int(self.divergent.sum())} divergent"]
        if not self.agree:
            lines.append("The chains do not agree yet, or are too short: give more `draws`.")
        return lines


class _Coordinates(NamedTuple):
    """The linear map from standard coordinates to the parameters."""

    centre: Parameters
    half: Float[Array, "parameter parameter"]
    own: OwnBlock

    def __call__(self, xi: Parameters) -> Parameters:
        step = self.half @ xi.shared
        own = xi.rows - jnp.einsum("cop,p->co", self.own.coupling, step)
        rows = self.centre.rows + jnp.einsum("coq,cq->co", self.own.inverse, own)
        return Parameters(self.centre.shared + step, rows)


def posterior(
    estimate: Estimate,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood,
    *,
    key: Array,
    draws: int = 1000,
    warmup: int = 500,
    chains: int = 4,
) -> Posterior:
    """Return draws from the posterior of all free parameters, by the no-U-turn sampler of blackjax
    (extra `posterior`).

    Bounds cut the posterior; priors are given by `free(..., prior=...)`, and without one a
    parameter has a flat prior.

    Args:
        estimate: from `estimate`, of one case; the chains start within its errors.
        records, likelihood: as in the estimate.
        key: random key.
        draws: number of draws of each chain.
        warmup: number of draws before, in which the step is adapted.
        chains: number of chains, which run together.

    Raises:
        InputError: without blackjax, for less than two chains or too few draws, for an estimate
            whose cost is not finite, and when the data and priors do not determine the parameters,
            so that the posterior is not finite.
    """
    blackjax = _blackjax()
    require(chains >= 2, f"{chains} chain cannot be compared with another. Give at least 2.")
    require(min(draws, warmup) >= 100, "Give at least 100 draws, and 100 for `warmup`.")
    require_key(key)
    records = stack_of_estimate(estimate, records, likelihood)
    problem = Problem.of(estimate.model, estimate.free, records, likelihood)
    centre = _coordinates(problem, estimate)
    xi, divergent = _chains(blackjax, problem, centre, key, draws, warmup, chains)
    values, ratio, effective = _diagnosed(blackjax, centre, xi)
    return Posterior(
        estimate.names,
        estimate.free.per_record,
        values.shared,
        values.rows,
        divergent,
        ratio,
        effective,
    )


def _blackjax() -> Any:
    try:
        import blackjax  # pyright: ignore[reportMissingImports]  (an extra)
    except ImportError as error:
        raise InputError(
            'The posterior is drawn by blackjax. Install it: pip install "jaxid[posterior]".'
        ) from error
    return blackjax


def _coordinates(problem: Problem, estimate: Estimate) -> _Coordinates:
    """Return the map from standard coordinates, about the estimate.

    Raises:
        InputError: if a direction is not determined, or the cost of the estimate is not finite.
    """
    limits, parameters = problem.limits, estimate.parameters
    ends = jax.tree.map(lambda low: jnp.full(low.shape, jnp.inf), limits.lower)
    # without bounds, which would hold a parameter on one of them
    unbounded = eqx.tree_at(
        lambda node: (node.limits.lower, node.limits.upper),
        problem,
        (jax.tree.map(jnp.negative, ends), ends),
    )
    cost, linearised = eqx.filter_jit(Problem.evaluate)(unbounded, parameters)
    require(
        bool(jnp.isfinite(cost)),
        f"The cost of the estimate is not finite, so that no chain can start: {estimate.status}",
    )
    information = linearised.information
    svd = spectrum(information.triangle, information.rhs, limits.scale)
    weak = jnp.any(svd.weak(estimate.threshold)) | jnp.any(information.own.undetermined)
    require(
        not bool(weak),
        "The data do not determine all parameters (see `weak_directions`), so that the posterior "
        "is not finite. Give a prior, or fix a parameter.",
    )
    columns = information.triangle, information.own.jacobian
    norms = Parameters(*(jnp.linalg.norm(column, axis=-2) for column in columns))

    def inside(value, low, high, norm):
        shift = jnp.minimum(INSIDE / norm, 0.25 * (high - low))
        return jnp.clip(value, low + shift, high - shift)

    centre = jax.tree.map(inside, parameters, limits.lower, limits.upper, norms)
    return _Coordinates(centre, svd.square_root(estimate.threshold), information.own)


@eqx.filter_jit
def _chains(blackjax, problem: Problem, centre: _Coordinates, key, draws, warmup, chains):
    """Return the draws in standard coordinates, and which are divergent (jitted)."""
    limits = problem.limits

    def log_density(xi: Parameters):
        parameters = centre(xi)
        within = jax.tree.map(
            lambda x, low, high: jnp.all((x >= low) & (x <= high)),
            parameters,
            limits.lower,
            limits.upper,
        )
        kept = within.shared & within.rows
        return jnp.where(kept, -problem.cost(problem.project(parameters)), -jnp.inf)

    def chain(key):
        first, second, adapt, run = jax.random.split(key, 4)
        shared, rows = centre.centre.shared.shape, centre.centre.rows.shape
        start = Parameters(jax.random.normal(first, shared), jax.random.normal(second, rows))
        warm = blackjax.window_adaptation(blackjax.nuts, log_density)
        (state, tuned), _ = warm.run(adapt, _within(log_density, start), num_steps=warmup)
        kernel = blackjax.nuts(log_density, **tuned).step

        def step(state, key):
            state, info = kernel(key, state)
            return state, (state.position, info.is_divergent)

        return jax.lax.scan(step, state, jax.random.split(run, draws))[1]

    return jax.vmap(chain)(jax.random.split(key, chains))


@eqx.filter_jit
def _diagnosed(blackjax, centre: _Coordinates, xi: Parameters):
    """Return the drawn parameters, and the ratio of scatters and the effective number of draws of
    the shared ones (jitted).
    """
    values, diagnostics = jax.vmap(jax.vmap(centre))(xi), blackjax.diagnostics
    ratio = diagnostics.potential_scale_reduction(values.shared)
    effective = diagnostics.effective_sample_size(values.shared)
    return values, jnp.atleast_1d(ratio), jnp.atleast_1d(effective)


def _within(log_density, xi: Parameters) -> Parameters:
    """Return the first of a start, half of it, a quarter, ... with a finite density."""

    def halved(xi):
        return jax.tree.map(lambda leaf: 0.5 * leaf, xi)

    return jax.lax.while_loop(lambda xi: ~jnp.isfinite(log_density(xi)), halved, xi)
