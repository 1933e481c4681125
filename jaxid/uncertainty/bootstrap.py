"""`bootstrap`: scatter of the estimates from simulated repetitions of the experiment."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy

from .._foundation.checks import require, require_key, require_level
from .._foundation.types import Array, Bool, Float
from ..data.record import Record
from ..estimation.estimate import fit_problem
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem, kept_bytes
from ..estimation.result import Estimate
from ..estimation.solver import GaussNewton, solver_or_default
from ..models.free import Parameters
from ..models.free_model import FreeModel
from ..models.noise import DiagonalNoise, FixedNoise, FullNoise, InnovationNoise
from .argument_checks import stack_of_estimate

WHITE_NORMAL = (FixedNoise, DiagonalNoise, FullNoise, InnovationNoise)
FEWEST_DRAWS = 20  # successful ones for a standard error, which is then right to 16 %; chosen


class Bootstrap(eqx.Module):
    """Estimates of simulated repetitions of the experiment.

    Attributes:
        names: names of the shared parameters.
        values: of the estimate itself.
        draws: estimates of the repetitions.
        successful: True for the repetitions that converged; the others do not count.
        block: length of the blocks of residuals [samples], zero for simulated white noise.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    values: Float[Array, " parameter"]
    draws: Float[Array, "draw parameter"]
    successful: Bool[Array, " draw"]
    block: int = eqx.field(static=True)

    @property
    def standard_errors(self) -> Float[Array, " parameter"]:
        """Standard deviation of the estimates about their mean."""
        return jnp.asarray(np.std(self._used(), axis=0, ddof=1))

    @property
    def bias(self) -> Float[Array, " parameter"]:
        """Mean of the estimates less the value with which they were simulated."""
        return jnp.asarray(np.mean(self._used(), axis=0) - np.asarray(self.values))

    def interval(self, level: float = 0.95) -> Float[Array, "parameter 2"]:
        """Return the bias-corrected percentile interval of each parameter.

        Its ends are the quantiles `Phi(2 z0 -/+ z)` of the draws, `z0 = Phi^-1` of the share of
        draws below the estimate (Efron, Canadian Journal of Statistics 9(2), 1981). The interval
        is not symmetric where the distribution is not. Draws equal to an estimate on its bound
        stand for draws beyond the bound: as many of them count as below as bring the share nearest
        to one half.

        Args:
            level: probability, such as 0.95; a few hundred draws are needed.

        Raises:
            InputError: when the level is not between 0 and 1.
        """
        require_level(level, 0.95)
        used = self._used()
        values = np.asarray(self.values)[None]
        below = np.clip(0.5, np.mean(used < values, axis=0), np.mean(used <= values, axis=0))
        z0 = scipy.special.ndtri(np.clip(below, 0.5 / len(used), 1 - 0.5 / len(used)))
        tails = scipy.special.ndtri([0.5 * (1 - level), 0.5 * (1 + level)])
        shares = scipy.special.ndtr(2 * z0[:, None] + tails[None])
        ends = [np.quantile(column, at) for column, at in zip(used.T, shares, strict=True)]
        return jnp.asarray(np.array(ends).reshape(-1, 2))

    def _used(self) -> np.ndarray:
        used = np.asarray(self.draws)[np.asarray(self.successful)]
        require(
            len(used) >= FEWEST_DRAWS,
            f"Only {len(used)} of {len(self.draws)} repetitions converged; {FEWEST_DRAWS} are "
            "needed. Give the parameters bounds or a prior, or draw more.",
        )
        return used


def bootstrap(
    estimate: Estimate,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood,
    *,
    key: Array,
    draws: int = 200,
    block: int = 0,
    solver: GaussNewton | None = None,
) -> Bootstrap:
    """Return the estimates of simulated repetitions of the experiment, many at once.

        z* = y(theta) + e*

    The parametric bootstrap draws `e*` from white noise of the estimated covariance R, and for
    filter error the process noise and the initial states as well: it shows the effects of a model
    that is not linear. The block bootstrap joins blocks of consecutive
    residuals, all channels together, drawn at random with replacement from the same record: it
    keeps the correlation of the residuals within a block (Kuensch, Annals of Statistics 17(3),
    1989), less the share `lag / block` of each lag. The residuals, and the draws of a noise whose R
    is estimated, are scaled by `sqrt(N / (N - parameters))`. A prior counts as a measurement of its
    parameter, whose mean is drawn as well.

    Args:
        estimate: from `estimate`, of one case.
        records, likelihood: those of the estimate.
        key: random key.
        draws: number of repetitions; 200 give a standard error to 5 %.
        block: length of the blocks [samples], several times the correlation time of the residuals;
            zero for the parametric bootstrap.
        solver: options of the iteration, which starts at the estimate.

    Raises:
        InputError: when there are less than 20 draws; for blocks that are longer than a record, of
            records in which samples are missing, or of innovations; for a parametric bootstrap of
            noise with memory or outliers.
    """
    require_key(key)
    records = stack_of_estimate(estimate, records, likelihood)
    require(draws >= FEWEST_DRAWS, f"{draws} draws give no standard error; take 200.")
    _check_noise(likelihood, block)
    samples = np.atleast_1d(np.asarray(records.samples))
    if block:
        complete = np.arange(records.t.shape[1])[None] < samples[:, None]
        require(
            bool(np.all(np.asarray(records.mask) == complete[..., None])),
            "Samples are missing in these records, so that blocks of residuals have gaps. Take the "
            "parametric bootstrap, or `interval(coloured=True)`.",
        )
        require(
            0 < block <= int(samples.min()),
            f"A block has {block} samples and the shortest record {int(samples.min())}. Take "
            "shorter blocks.",
        )
    problem = Problem.of(estimate.model, estimate.free, records, likelihood)
    count = float(np.sum(np.asarray(records.mask)))
    # Residuals have less power than their noise, whether R is known or not.
    scaled = dataclasses.replace(estimate, noise_known=estimate.noise_known and not block)
    dof = float(np.asarray(scaled.degrees_of_freedom))
    ratio = np.sqrt(count / dof) if np.isfinite(dof) and dof > 0 else 1.0
    size = estimate.values.size + estimate.own.shape[-1]
    batch = int(np.clip(kept_bytes() // max(8 * records.z.size * size, 1), 1, draws))
    values, successful = _repeated(
        problem,
        estimate,
        jax.random.split(key, draws),
        jnp.asarray(ratio),
        jnp.asarray(samples),
        block,
        batch,
        solver_or_default(solver),
    )
    return Bootstrap(estimate.names, estimate.values, values, successful, block)


def drawn_records(
    problem: Problem, parameters: Parameters, root: Float[Array, "output output"], key: Array
) -> Float[Array, "case time output"]:
    """Return measurements of every record, drawn from the model with its noise.

    Args:
        problem: the estimation problem.
        parameters: values of the parameters.
        root: Cholesky factor of R, of noise without memory.
        key: random key.
    """

    def of_case(own, case, key):
        flat, record = case
        family = FreeModel(problem.model, flat, problem.positions)
        model, initial_state = family(jnp.concatenate([own, parameters.shared]))
        return problem.likelihood.drawn(model, record, initial_state, root, key)

    keys = jax.random.split(key, problem.records.n_cases)
    return jax.vmap(of_case)(parameters.rows, problem.cases(), keys)


def _check_noise(likelihood: AbstractLikelihood, block: int) -> None:
    """Refuse a kind of bootstrap that does not repeat the experiment of a likelihood."""
    if block:
        require(
            likelihood.simulates,
            f"The residuals of {type(likelihood).__name__} are innovations, and no blocks of them "
            "make a record. Take the parametric bootstrap (`block=0`).",
        )
        return
    name = type(likelihood.noise).__name__
    require(
        isinstance(likelihood.noise, WHITE_NORMAL),
        f"The parametric bootstrap draws white normal noise, and the noise is {name}. Take blocks "
        "of the residuals: `block=1` for noise without memory, otherwise several times its memory.",
    )


@eqx.filter_jit
def _repeated(problem: Problem, estimate: Estimate, keys, ratio, samples, block, batch, solver):
    """Return the estimates of all repetitions and their success (jitted)."""
    parameters: Parameters = estimate.parameters
    mask, v = problem.records.mask, ratio * estimate.residuals
    y = problem.outputs(parameters) if block else None
    root = ratio * jnp.linalg.cholesky(estimate.noise)

    def measured(key):
        if y is None:
            return drawn_records(problem, parameters, root, key)
        return y + jax.vmap(lambda key, v, count: _blocks(key, v, count, block))(
            jax.random.split(key, y.shape[0]), v, samples
        )

    def repeated(key):
        z = jnp.where(mask, measured(key), 0.0)
        mean = _drawn_means(problem, parameters, jax.random.fold_in(key, 1))
        again = eqx.tree_at(
            lambda node: (node.records.z, node.limits.prior_mean), problem, (z, mean)
        )
        fit = fit_problem(again, parameters, solver)
        return fit.parameters.shared, fit.result

    values, result = jax.lax.map(repeated, keys, batch_size=batch)
    probe = eqx.tree_at(lambda node: node.result, estimate, result)
    return values, probe.successful


def _drawn_means(problem: Problem, parameters: Parameters, key) -> Float[Array, " parameter"]:
    """Return the means of the priors in another experiment: measurements of the parameters."""
    deviation = problem.limits.prior_deviation
    drawn = parameters.shared + deviation * jax.random.normal(key, deviation.shape)
    return jnp.where(jnp.isfinite(deviation), drawn, problem.limits.prior_mean)


def _blocks(key, v, count, block: int):
    """Return residuals of a record joined from blocks at random places of it."""
    length = v.shape[0]
    number = -(-length // block)
    starts = jax.random.randint(key, (number,), 0, count - block + 1)
    rows = (starts[:, None] + jnp.arange(block)[None]).reshape(-1)[:length]
    centred = v - jnp.sum(v, axis=0, keepdims=True) / count
    return centred[rows]
