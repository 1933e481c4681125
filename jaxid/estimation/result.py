"""`Estimate`: values, and all that judges them."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.results import RESULTS
from .._foundation.types import Array, Bool, Float, Int
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.free import Free, Parameters, flat_vectors, insert
from ..sensitivity.information import Information
from ..sensitivity.spectrum import Spectrum, weak_directions


class Estimate(eqx.Module):
    """The result of `estimate`.

    Attributes:
        model: the model with the estimated values in it (those shared by all records).
        free: what was free.
        names: names of the shared parameters.
        values, standard_errors: of the shared parameters; the standard error is the Cramer-Rao bound, infinite for a
            parameter that the data do not determine, NaN for one that stands on a bound.
        coloured_errors: the same, corrected for the colour that the residuals show; never smaller.
        covariance: Cramer-Rao bound of the shared parameters.
        own, own_errors: values and standard errors of the parameters that each record has to itself.
        noise: R, as fixed or as estimated.
        cost: negative log-likelihood without its constant.
        information: square-root information, to be stacked with that of other flights.
        spectrum: singular values and directions of the scaled information.
        residuals: `v = z - y`, zero where there is no valid sample.
        result: status, one for each case.
        iterations, costs, decrements: the history: accepted steps, cost and length of the remaining step at each.
    """

    model: AbstractModel
    free: Free
    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    values: Float[Array, "*batch parameter"]
    standard_errors: Float[Array, "*batch parameter"]
    coloured_errors: Float[Array, "*batch parameter"]
    covariance: Float[Array, "*batch parameter parameter"]
    own: Float[Array, "*batch case own"]
    own_errors: Float[Array, "*batch case own"]
    noise: Float[Array, "*batch output output"]
    cost: Float[Array, "*batch"]
    information: Information
    spectrum: Spectrum
    residuals: Float[Array, "*batch case time output"]
    mask: Bool[Array, "*batch case time output"]
    result: RESULTS
    iterations: Int[Array, "*batch"]
    costs: Float[Array, "*batch step"]
    decrements: Float[Array, "*batch step"]
    threshold: float = eqx.field(static=True)

    @classmethod
    def of(cls, fit, model: AbstractModel, free: Free, records: Record, threshold: float) -> "Estimate":
        """Put names to a fit."""
        positions = free.positions(model)
        flat = flat_vectors(model, records)[0]
        units = model.units()
        deviation = jnp.sqrt(jnp.diagonal(fit.covariance))
        deviation = jnp.where(fit.shared_on_bound, jnp.nan, deviation)
        own_deviation = jnp.sqrt(jnp.diagonal(fit.own_covariance, axis1=-2, axis2=-1))
        return cls(
            model=insert(model, flat, positions, fit.parameters.shared, fit.parameters.rows[0])[0],
            free=free,
            names=free.shared,
            units=tuple(units.get(name, "") for name in free.shared),
            values=fit.parameters.shared,
            standard_errors=deviation,
            coloured_errors=jnp.where(fit.shared_on_bound, jnp.nan, jnp.sqrt(jnp.diagonal(fit.coloured))),
            covariance=fit.covariance,
            own=fit.parameters.rows,
            own_errors=jnp.where(fit.own_on_bound, jnp.nan, own_deviation),
            noise=fit.noise,
            cost=fit.cost,
            information=fit.information,
            spectrum=fit.spectrum,
            residuals=fit.residuals,
            mask=records.mask,
            result=fit.result,
            iterations=fit.iterations,
            costs=fit.costs,
            decrements=fit.decrements,
            threshold=threshold,
        )

    @property
    def successful(self) -> Bool[Array, "*batch"]:
        """True where the iteration converged, on a bound or not."""
        return (self.result == RESULTS.successful) | (self.result == RESULTS.at_bound)

    @property
    def status(self) -> str:
        """What happened and what to do, in a sentence."""
        return "converged" if bool(self.result == RESULTS.successful) else RESULTS[self.result]

    @property
    def F(self) -> Float[Array, "*batch parameter"]:
        """F-values `(value / standard error)^2` (Eq. 6.7)."""
        return (self.values / self.standard_errors) ** 2

    @property
    def correlation(self) -> Float[Array, "*batch parameter parameter"]:
        """Correlations between the shared parameters."""
        deviation = jnp.sqrt(jnp.diagonal(self.covariance, axis1=-2, axis2=-1))
        return self.covariance / (deviation[..., :, None] * deviation[..., None, :])

    @property
    def weak_directions(self) -> tuple[str, ...]:
        """Combinations of parameters that the data do not determine, in words; of one case only."""
        return weak_directions(self.names, np.asarray(self.values), self.spectrum, self.threshold)

    def value(self, name: str) -> float:
        """The value of one shared parameter, by name."""
        return float(self.values[self.names.index(name)])

    def standard_error(self, name: str) -> float:
        """The standard error of one shared parameter, by name."""
        return float(self.standard_errors[self.names.index(name)])

    @property
    def parameters(self) -> Parameters:
        """The values as the solver holds them."""
        return Parameters(self.values, self.own)

    def __str__(self) -> str:
        if self.values.ndim > 1:
            good = int(jnp.sum(self.successful))
            return f"Estimate of {self.values.shape[0]} cases, {good} successful: {', '.join(self.names)}"
        width = max([len(name) for name in self.names] + [9])
        lines = [f"{'parameter':<{width}} {'value':>13} {'std. error':>11} {'coloured':>11} {'F':>10}  unit"]
        rows = zip(self.names, self.values, self.standard_errors, self.coloured_errors, self.F, self.units, strict=True)
        for name, value, error, coloured, F, unit in rows:
            lines.append(f"{name:<{width}} {value:>13.6g} {error:>11.3g} {coloured:>11.3g} {F:>10.4g}  {unit}")
        lines += [f"weak: {sentence}" for sentence in self.weak_directions]
        lines.append(f"status: {self.status} ({int(self.iterations)} iterations, cost {float(self.cost):.6g})")
        return "\n".join(lines)
