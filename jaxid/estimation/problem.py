"""One estimation problem as arrays: what the solver evaluates, with no names and no words in it."""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.types import Array, Bool, Float
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.free import Free, Parameters, Positions, flat_vectors, insert
from ..models.noise import whiten
from ..sensitivity.information import Information, gather, record_triangles
from ..sensitivity.jacobian import value_and_jacobian
from .likelihoods import AbstractLikelihood


class Limits(eqx.Module):
    """Bounds, typical sizes and Gaussian priors as vectors: infinite and NaN where there are none."""

    lower: Parameters
    upper: Parameters
    scale: Float[Array, " parameter"]
    prior_mean: Float[Array, " parameter"]
    prior_deviation: Float[Array, " parameter"]

    @classmethod
    def of(cls, free: Free, n_cases: int) -> "Limits":
        """The vectors of a selection of free parameters."""

        def rows(vector):
            return jnp.broadcast_to(vector, (n_cases, vector.size))

        shared, own = free.bounds("shared"), free.bounds("per_record")
        nan, inf = jnp.asarray(jnp.nan), jnp.asarray(jnp.inf)
        return cls(
            Parameters(shared[0], rows(own[0])),
            Parameters(shared[1], rows(own[1])),
            jnp.array([free.scale.get(name, nan) for name in free.shared], float),
            jnp.array([free.prior.get(name, (0.0, inf))[0] for name in free.shared], float),
            jnp.array([free.prior.get(name, (0.0, inf))[1] for name in free.shared], float),
        )


class Problem(eqx.Module):
    """Everything that the cost is a function of, but the parameters.

    Attributes:
        model: the model; its own parameter values stand where nothing is free.
        positions: where the free parameters stand in its flat vector.
        records: a stack.
        likelihood: how the misfit is measured.
        limits: bounds, scales, priors.
    """

    model: AbstractModel
    positions: Positions
    records: Record
    likelihood: AbstractLikelihood
    limits: Limits

    def outputs(self, parameters: Parameters) -> Float[Array, "case time output"]:
        """Model outputs at every sample of every record."""
        predict = self._predictor()
        return jax.vmap(lambda own, case: predict(own, parameters.shared, case))(parameters.rows, self._cases())

    def residuals(self, parameters: Parameters) -> Float[Array, "case time output"]:
        """`v = z - y`, zero where there is no valid sample."""
        return self._residuals(self.outputs(parameters))

    def cost(self, parameters: Parameters) -> Float[Array, ""]:
        """Negative log-likelihood, priors included; infinite where the simulation fails."""
        v = self.residuals(parameters)
        cost = self.likelihood.noise.cost(v, self.records.mask) + self._prior_cost(parameters)
        return jnp.where(jnp.isfinite(cost), cost, jnp.inf)

    def sensitivities(
        self, parameters: Parameters
    ) -> tuple[Float[Array, "case time output"], Float[Array, "case time output column"]]:
        """Residuals and `S = dy/dtheta`, the record's own unknowns first, then the shared ones; not whitened."""
        count = self.positions.rows.size
        predict = self._predictor()

        def one(own, case):
            theta = jnp.concatenate([own, parameters.shared])
            return value_and_jacobian(lambda theta: predict(theta[:count], theta[count:], case), theta)

        y, S = jax.vmap(one)(parameters.rows, self._cases())
        return self._residuals(y), S

    def information(self, parameters: Parameters) -> Information:
        """Square-root information at the parameters, with those that press on a bound held; zero where the simulation fails."""
        v, S = self.sensitivities(parameters)
        white_v, white_S = self.whiten(v, v), self.whiten(v, S)
        count = self.positions.rows.size
        triangles = record_triangles(white_S[..., :count], white_S[..., count:], white_v)
        triangles = jnp.where(jnp.all(jnp.isfinite(triangles)), triangles, 0.0)
        held = self._held(parameters, triangles)
        return gather(triangles, self._prior_rows(parameters), held.rows, held.shared)

    def whiten(self, v: Float[Array, "case time output"], rows: Float[Array, "case time output *column"]):
        """Rows in units of the noise that belongs to these residuals."""
        mask = self.records.mask
        return whiten(self.likelihood.noise.cholesky(v, mask), rows, mask)

    def project(self, parameters: Parameters) -> Parameters:
        """The nearest parameters within the bounds."""
        return jax.tree.map(jnp.clip, parameters, self.limits.lower, self.limits.upper)

    def _predictor(self):
        """The prediction of one case from its own and the shared parameters."""

        def predict(own, shared, case):
            flat, record = case
            flat = flat.at[self.positions.rows].set(own, mode="drop")
            return self.likelihood.predict(*self._placed(flat, shared, record))

        return predict

    def _placed(self, flat, shared, record):
        model, initial_state = insert(self.model, flat, self.positions.shared, shared)
        return model, record, initial_state

    def _cases(self):
        return flat_vectors(self.model, self.records), self.records

    def _residuals(self, y):
        # A masked sample must not let a NaN of the model through either: it would poison the sums.
        return jnp.where(self.records.mask, self.records.z - y, 0.0)

    def _prior_cost(self, parameters):
        return 0.5 * jnp.sum(((parameters.shared - self.limits.prior_mean) / self.limits.prior_deviation) ** 2)

    def _prior_rows(self, parameters) -> Float[Array, "row column"]:
        weight = 1.0 / self.limits.prior_deviation
        return jnp.column_stack([jnp.diag(weight), weight * (self.limits.prior_mean - parameters.shared)])

    def _held(self, parameters: Parameters, triangles) -> Parameters:
        """True for each parameter that stands on a bound and whose descent direction points outward."""
        count = self.positions.rows.size
        descent = jnp.einsum("cij,ci->cj", triangles[..., :-1], triangles[..., -1])
        toward = Parameters(jnp.sum(descent[:, count:], axis=0), descent[:, :count])

        def outward(value, low, high, direction) -> Bool[Array, "..."]:
            return ((value <= low) & (direction <= 0)) | ((value >= high) & (direction >= 0))

        return jax.tree.map(outward, parameters, self.limits.lower, self.limits.upper, toward)
