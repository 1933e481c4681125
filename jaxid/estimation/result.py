"""`Estimate`: parameter estimates with standard errors and diagnostics."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy

from .._foundation.checks import require_known
from .._foundation.host import on_host
from .._foundation.notebook import preformatted
from .._foundation.results import CONVERGED, RESULTS, is_one_of, with_undetermined
from .._foundation.types import Array, Bool, Float, Int
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.errors import EstimateErrors
from ..models.free import Free, Parameters, flat_vectors
from ..models.free_model import insert
from ..sensitivity.information import Information
from ..sensitivity.spectrum import Spectrum, spectrum, weak_directions
from .intervals import interval_ends, student_factor, upper_probability
from .listing import (
    NEAR_BOUND,
    estimate_errors,
    estimate_to_dict,
    estimate_to_xarray,
    notes,
    parameter_table,
)

OF_RECORDS = "Values of single records stand in `own`, in the order of `free.per_record`."


class Estimate(eqx.Module):
    """The result of `estimate`.

    Attributes:
        model: the model with the estimated values that all records share.
        free: the free parameters.
        names: names of the shared parameters.
        start: values of the shared parameters at which the iteration started.
        values, standard_errors: of the shared parameters; the standard error is the Cramer-Rao
            bound, infinite for a parameter that the data do not determine, NaN for one that stands
            on a bound. They are asymptotic: an estimated R divides by the number of samples.
            `interval` corrects this for short records.
        corrected_errors: standard errors corrected for the colour of the residuals; never smaller.
            One autoregression by samples serves all records, which should have one step.
        corrected_dof: degrees of freedom of the corrected variances, which are estimated from the
            residuals themselves.
        covariance: Cramer-Rao bound of the shared parameters.
        on_bound: true for each shared parameter that stands on one of its bounds.
        near_bound: true for those inside their bounds, within `NEAR_BOUND` standard errors of one.
        own, own_errors: values and standard errors of the parameters of each single record.
        corrected_own: corrected covariances of these with themselves, then with the shared ones.
        noise: R, as fixed or as estimated.
        cost: negative log-likelihood without its constant.
        information: square-root information, which can be stacked with other flights' information.
        spectrum: singular values and directions of the scaled information.
        residuals: `v = z - y`, zero at missing samples.
        fit: share of each output that the model explains, `100 (1 - |v| / |z - mean z|)` [percent],
            pooled over the records; below zero a constant would explain more, NaN for a constant
            output.
        result: status, one for each case.
        iterations, costs, decrements: the history: accepted steps, cost and length of the remaining
            step at each. Of `FilterError(frozen_gain=True)` the part with exact derivatives alone.
        threshold: eigenvalues below this share of the largest are weak.
        noise_known: True if R was given; with `FilterError`, if all noises were.
    """

    model: AbstractModel
    free: Free
    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    start: Float[Array, "*batch parameter"]
    values: Float[Array, "*batch parameter"]
    standard_errors: Float[Array, "*batch parameter"]
    corrected_errors: Float[Array, "*batch parameter"]
    corrected_dof: Float[Array, "*batch parameter"]
    covariance: Float[Array, "*batch parameter parameter"]
    on_bound: Bool[Array, "*batch parameter"]
    near_bound: Bool[Array, "*batch parameter"]
    own: Float[Array, "*batch case own"]
    own_errors: Float[Array, "*batch case own"]
    corrected_own: Float[Array, "*batch case own unknown"]
    noise: Float[Array, "*batch output output"]
    cost: Float[Array, "*batch"]
    information: Information
    spectrum: Spectrum
    residuals: Float[Array, "*batch case time output"]
    mask: Bool[Array, "*batch case time output"]
    fit: Float[Array, "*batch output"]
    result: RESULTS
    iterations: Int[Array, "*batch"]
    costs: Float[Array, "*batch step"]
    decrements: Float[Array, "*batch step"]
    threshold: float = eqx.field(static=True)
    noise_known: bool = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        fit,
        model: AbstractModel,
        free: Free,
        records: Record,
        threshold: float,
        noise_known: bool,
    ) -> "Estimate":
        """Return the estimate of a fit, with names."""
        positions = free.positions(model)
        flat = flat_vectors(model, records)
        units = model.units()
        on_bound = fit.shared_on_bound
        deviation = _deviations(fit.covariance, on_bound)
        lower, upper = free.bounds("shared")
        own = _first(fit.parameters.rows)
        return cls(
            model=insert(model, _first(flat), positions, fit.parameters.shared, own)[0],
            free=free,
            names=free.shared,
            units=tuple(units.get(name, "") for name in free.shared),
            start=_elements(_first(flat), positions.shared),
            values=fit.parameters.shared,
            standard_errors=deviation,
            corrected_errors=_deviations(fit.robust_covariance, on_bound),
            corrected_dof=fit.robust_dof,
            covariance=fit.covariance,
            on_bound=on_bound,
            near_bound=_near_bound(fit.parameters.shared, lower, upper, deviation, on_bound),
            own=fit.parameters.rows,
            own_errors=_deviations(fit.own_covariance, fit.own_on_bound),
            corrected_own=fit.robust_own,
            noise=fit.noise,
            cost=fit.cost,
            information=fit.information,
            spectrum=fit.spectrum,
            residuals=fit.residuals,
            mask=records.mask,
            fit=_fit(fit.residuals, records.z, records.mask),
            result=with_undetermined(fit.result, deviation),
            iterations=fit.iterations,
            costs=fit.costs,
            decrements=fit.decrements,
            threshold=threshold,
            noise_known=noise_known,
        )

    @property
    def successful(self) -> Bool[Array, "*batch"]:
        """True where the iteration converged, on a bound or not, all parameters determined or
        not.
        """
        return is_one_of(self.result, (*CONVERGED, RESULTS.undetermined))

    @property
    def status(self) -> str:
        """Outcome and remedy in one sentence."""
        return RESULTS[self.result] or "converged"  # the sentence of success is empty

    @property
    def corrected_own_errors(self) -> Float[Array, "*batch case own"]:
        """Standard errors of the parameters of each record, corrected as `corrected_errors`."""
        return _corrected_own(self.corrected_own, self.own_errors)

    @property
    def F(self) -> Float[Array, "*batch parameter"]:
        """F-values `(value / standard error)^2` (Eq. 6.7)."""
        return _squared_ratio(self.values, self.standard_errors)

    @property
    def correlation(self) -> Float[Array, "*batch parameter parameter"]:
        """Correlations between the shared parameters."""
        return _correlation(self.covariance)

    @property
    def weak_directions(self) -> tuple[str, ...]:
        """Combinations of parameters that the data do not determine, in words; for one case only.

        Parameters on their bounds are held and excluded.
        """
        return describe_weak_directions(
            self.names,
            np.asarray(self.values),
            np.asarray(self.on_bound),
            np.asarray(self.information.factor),
            np.asarray(self.spectrum.scale),
            self.threshold,
        )

    @property
    def degrees_of_freedom(self) -> Float[Array, "*batch"]:
        """Number of valid measurements less that of the parameters not on a bound.

        It is infinite where R is known.
        """
        return _degrees_of_freedom(
            self.mask, self.on_bound, self.own_errors, noise_known=self.noise_known
        )

    def interval(
        self, level: float = 0.95, *, coloured: bool = False
    ) -> Float[Array, "*batch parameter 2"]:
        r"""Return the ends of the confidence interval of each shared parameter.

            value -/+ q sqrt(N / nu) standard error,    nu = N - p

        Where R is estimated, `q` is the quantile of Student's t with `nu = degrees_of_freedom`, N
        is the number of valid measurements and p that of the parameters not on a bound; the root
        changes the division of the variance by N to one by nu. Where R is known, `q` is the normal
        quantile and the root is one. This is exact for a linear model with one output and white
        noise. For several outputs it is an approximation: each has a variance of its own. For a
        non-linear model it is asymptotic. A prior adds no degrees of freedom. Positive scales
        (`AbstractModel.scales`: deviations and correlation times of noise) have the interval of
        their logarithm, whose estimate is less skewed.

        Args:
            level: probability, such as 0.95.
            coloured: use the errors corrected for the colour of the residuals, with Student's t of
                `corrected_dof` and without the root.

        Returns:
            Ends along the last axis [units of the parameter]; infinite for a parameter that the
            data do not determine, NaN for a parameter on its bound, and NaN for all parameters if
            there are not more measurements than parameters.

        Raises:
            InputError: when the level is not between 0 and 1.
        """
        upper = upper_probability(level)
        errors = self.corrected_errors if coloured else self.standard_errors
        if coloured:
            factor = scipy.special.stdtrit(np.asarray(self.corrected_dof), upper)
        elif self.noise_known:
            factor = scipy.special.ndtri(upper)
        else:
            nu = np.asarray(self.degrees_of_freedom)[..., None]
            samples = np.sum(np.asarray(self.mask), axis=(-3, -2, -1))[..., None]
            factor = student_factor(upper, samples, nu)
        is_scale = np.isin(self.names, self.model.scales())
        return interval_ends(self.values, errors, np.asarray(factor), is_scale)

    def value(self, name: str) -> float:
        """Return the value of one shared parameter, by name."""
        return float(np.asarray(self.values)[self._index(name)])

    def standard_error(self, name: str) -> float:
        """Return the standard error of one shared parameter, by name."""
        return float(np.asarray(self.standard_errors)[self._index(name)])

    def _index(self, name: str) -> int:
        """Return the position of a shared parameter; an unknown name is refused."""
        require_known("shared free parameter", [name], self.names, OF_RECORDS)
        return self.names.index(name)

    @property
    def parameters(self) -> Parameters:
        """Values in the form of the solver."""
        return Parameters(self.values, self.own)

    @property
    def errors(self) -> EstimateErrors:
        """Values and errors as plain numbers, which `save` writes; for one case only."""
        return estimate_errors(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the estimate as plain numbers and words, for one case only."""
        return estimate_to_dict(self)

    def to_xarray(self) -> Any:
        """Return the estimate as an `xarray.Dataset` with labelled axes."""
        return estimate_to_xarray(self)

    def plot(self, case: int = 0) -> Any:
        """Return a figure of the residual, by matplotlib (`jaxid[report]`).

        Args:
            case: which record of the fit is drawn over time.
        """
        from ..report.figures_signals import fit_residuals

        return fit_residuals(self, case)

    def _repr_html_(self) -> str:
        if self.values.ndim > 1:
            return preformatted(str(self))
        return parameter_table(self).html(below=notes(self))

    def __str__(self) -> str:
        if self.values.ndim > 1:
            good = int(np.sum(np.asarray(self.successful)))
            names = ", ".join(self.names)
            return f"Estimate of {self.values.shape[0]} cases, {good} successful: {names}"
        return "\n".join([*parameter_table(self).lines(), *notes(self)])


def describe_weak_directions(
    names: tuple[str, ...],
    values: Float[np.ndarray, " parameter"],
    on_bound: Bool[np.ndarray, " parameter"],
    factor: Float[np.ndarray, "row column"],
    scale: Float[np.ndarray, " parameter"],
    threshold: float,
) -> tuple[str, ...]:
    """Return the combinations of parameters that the data do not determine, in words.

    Args:
        names, values: of the shared parameters.
        on_bound: true for parameters on a bound, which are held and excluded.
        factor: triangle `[T r]` of their information.
        scale: scales of the columns of T (`Spectrum.scale`).
        threshold: eigenvalues below this share of the largest are weak.
    """
    inside = np.flatnonzero(~on_bound)
    if not inside.size:
        return ()
    svd = spectrum(factor[:, inside], factor[:, -1], 1.0 / scale[inside])
    within = tuple(names[index] for index in inside)
    return weak_directions(within, values[inside], svd, threshold)


@on_host
def _first(xp, rows):
    """Return the first row."""
    return rows[0]


@on_host
def _elements(xp, vector, at):
    """Return the elements at these positions."""
    return xp.take(vector, at, mode="clip")


@on_host
def _deviations(xp, covariance, on_bound):
    """Return the standard deviations of a covariance, NaN for parameters on a bound."""
    deviation = xp.sqrt(xp.diagonal(covariance, axis1=-2, axis2=-1))
    return xp.where(on_bound, xp.nan, deviation)


@on_host
def _corrected_own(xp, covariance, own_errors):
    """Return the corrected deviations, infinite or NaN where the others are."""
    deviation = xp.sqrt(xp.diagonal(covariance, axis1=-2, axis2=-1))
    return xp.where(xp.isfinite(own_errors), deviation, own_errors)


@on_host
def _near_bound(xp, values, lower, upper, deviation, on_bound):
    """True for parameters inside their bounds within `NEAR_BOUND` standard errors of one."""
    distance = xp.minimum(values - lower, upper - values)
    return ~on_bound & (distance < NEAR_BOUND * deviation)


@on_host
def _fit(xp, v, z, mask):
    """Return the share of each output that a model explains [percent]."""
    count = xp.maximum(xp.sum(mask, axis=(0, 1)), 1)
    mean = xp.sum(xp.where(mask, z, 0.0), axis=(0, 1)) / count
    power = xp.sum(xp.where(mask, z - mean[None, None], 0.0) ** 2, axis=(0, 1))
    unexplained = xp.sum(xp.where(mask, v, 0.0) ** 2, axis=(0, 1))
    share = xp.sqrt(unexplained / xp.where(power > 0, power, 1.0))
    return xp.where(power > 0, 100.0 * (1.0 - share), xp.nan)


@on_host
def _squared_ratio(xp, values, errors):
    return xp.square(values / errors)


@on_host
def _correlation(xp, covariance):
    """Return the correlations of a covariance."""
    deviation = xp.sqrt(xp.diagonal(covariance, axis1=-2, axis2=-1))
    return covariance / (deviation[..., :, None] * deviation[..., None, :])


@on_host
def _degrees_of_freedom(xp, mask, on_bound, own_errors, noise_known: bool):
    """Return the number of valid measurements less that of the free parameters, or infinity."""
    samples = xp.sum(mask, axis=(-3, -2, -1))
    shared = xp.sum(~on_bound, axis=-1)
    own = xp.sum(~xp.isnan(own_errors), axis=(-2, -1))
    return xp.where(noise_known, xp.inf, (samples - shared - own) * 1.0)
