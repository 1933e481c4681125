r"""`sandwich`: standard errors that hold when the likelihood is not the true one.

    V = C ( sum_g s_g s_g' + T ) C,    s_g = sum_(i in g) S_i' R^-1 v_i,    C = M^-1

with the scores `s_g` of groups of samples that are independent of each other: the records, or
blocks of consecutive samples; and the information T of the priors, a part of M. Within a group the
errors may have any covariance (P. J. Huber, Proc. Fifth Berkeley Symposium 1, 1967; K.-Y. Liang,
S. L. Zeger, Biometrika 73, 1986).
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy

from .._foundation.checks import require, require_level
from .._foundation.notebook import Table
from .._foundation.types import Array, Float
from ..data.record import Record
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.result import Estimate
from ..models.free import Parameters
from .argument_checks import stack_of_estimate

FEWEST_GROUPS = 10  # beyond the number of parameters, for a covariance of their scores; chosen


class Sandwich(eqx.Module):
    """Covariance of the shared parameters from the scatter of the scores of groups of samples.

    Attributes:
        names: names of the shared parameters.
        values: of the estimate.
        covariance: their covariance.
        groups: number of groups.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    values: Float[Array, " parameter"]
    covariance: Float[Array, "parameter parameter"]
    groups: int = eqx.field(static=True)

    @property
    def standard_errors(self) -> Float[Array, " parameter"]:
        """Standard errors; zero for a parameter on its bound, which is taken as known, and infinite
        for a parameter that the data do not determine.
        """
        return jnp.sqrt(jnp.diagonal(self.covariance))

    def interval(self, level: float = 0.95) -> Float[Array, "parameter 2"]:
        """Return the interval of each parameter, by Student's t with `groups - 1` degrees of
        freedom.

        Args:
            level: probability, such as 0.95.

        Raises:
            InputError: when the level is not between 0 and 1.
        """
        require_level(level, 0.95)
        quantile = float(scipy.special.stdtrit(self.groups - 1.0, 0.5 * (1.0 + level)))
        width = quantile * self.standard_errors
        return jnp.stack([self.values - width, self.values + width], axis=-1)

    def _repr_html_(self) -> str:
        return self._table().html(below=[self._source()])

    def __str__(self) -> str:
        return "\n".join([*self._table().lines(), self._source()])

    def _table(self) -> Table:
        """Return the parameters in words."""
        rows = zip(self.names, self.values, self.standard_errors, strict=True)
        cells = tuple((name, f"{value:.6g}", f"{error:.3g}", "") for name, value, error in rows)
        return Table(("parameter", "value", "std. error", ""), (9, 13, 11), cells)

    def _source(self) -> str:
        return f"sandwich from {self.groups} groups of samples"


def sandwich(
    estimate: Estimate,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood,
    *,
    block: int = 0,
) -> Sandwich:
    """Return the sandwich covariance of an estimate, whatever its likelihood.

    It is multiplied by `G/(G-1) (N-1)/(N-p)` for G groups, N rows of misfit and p parameters.

    Args:
        estimate: from `estimate`, of one case.
        records, likelihood: as in the estimate.
        block: length of the blocks [samples], several correlation times of the residuals; zero for
            whole records.

    Raises:
        InputError: when there are too few groups for the number of parameters.
    """
    records = stack_of_estimate(estimate, records, likelihood)
    samples = records.t.shape[1]
    require(block >= 0, f"A block has {block} samples; give a positive number, or 0 for records.")
    length = min(block or samples, samples)
    problem = Problem.of(estimate.model, estimate.free, records, likelihood)
    scores, valid = _scores(problem, estimate.parameters)
    starts = np.arange(0, samples, length)
    by_group = np.add.reduceat(np.asarray(scores), starts, axis=1).reshape(-1, scores.shape[-1])
    count = np.add.reduceat(np.asarray(valid), starts, axis=1).reshape(-1)
    groups, size = int(np.sum(count > 0)), len(estimate.names)
    require(
        groups >= size + FEWEST_GROUPS,
        f"{groups} groups of samples do not give a covariance of {size} scores; "
        f"{size + FEWEST_GROUPS} are needed. Give a shorter `block`, or more records.",
    )
    half = np.asarray(estimate.spectrum.square_root(estimate.threshold))
    inverse, rows = half @ half.T, float(np.sum(count))
    factor = groups / (groups - 1.0) * (rows - 1.0) / (rows - size)
    moved = by_group @ inverse
    prior = inverse / np.asarray(problem.limits.prior_deviation)
    undetermined = np.where(np.isinf(np.asarray(estimate.standard_errors)), np.inf, 0.0)
    covariance = factor * moved.T @ moved + prior @ prior.T + np.diag(undetermined)
    return Sandwich(estimate.names, estimate.values, jnp.asarray(covariance), groups)


@eqx.filter_jit
def _scores(
    problem: Problem, parameters: Parameters
) -> tuple[Float[Array, "case time parameter"], Float[Array, "case time"]]:
    """Return the score of each sample, the parameters of its record eliminated, and the number of
    its rows of misfit (jitted).
    """
    linearised = problem.informed(*problem.sensitivities(parameters), parameters)
    projected = problem.projected(linearised)
    count = projected.shape[2]
    white, mask = problem.misfit(linearised.v)[..., :count], problem.row_mask[..., :count]
    scores = jnp.einsum("ctjp,ctj->ctp", projected, jnp.where(mask, white, 0.0))
    return scores, jnp.sum(mask, axis=-1) * 1.0
