"""One estimation problem as arrays: what the solver evaluates, with no names and no words in it."""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.types import Array, Bool, Float
from ..data.record import Record
from ..models.base import AbstractModel, canonical
from ..models.free import Free, Parameters, Positions, flat_vectors, insert
from ..models.noise import whiten
from ..sensitivity.information import Information, gather, record_triangles
from ..sensitivity.jacobian import value_and_jacobian
from ..simulation.solution import Solution
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


class Linearised(eqx.Module):
    """A problem at one set of parameters.

    Attributes:
        v: residuals, zero where there is no valid sample.
        S: sensitivities of the outputs, each record's own unknowns first, then the shared ones; not whitened.
        information: what they say of the parameters.
    """

    v: Float[Array, "case time output"]
    S: Float[Array, "case time output column"]
    information: Information


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

    @classmethod
    def of(cls, model: AbstractModel, free: Free, records: Record, likelihood: AbstractLikelihood) -> "Problem":
        """The problem of estimating what is free, without a name in it, so that every one of its shape is compiled once.

        Args:
            model: with the values that are not free.
            free: what is free.
            records: a stack.
            likelihood: how the misfit is measured.
        """
        model, free = canonical(model), canonical(free)
        limits = Limits.of(free, records.n_cases)
        return cls(model, free.positions(model), records.anonymous(), canonical(likelihood), limits)

    def outputs(self, parameters: Parameters) -> Float[Array, "case time output"]:
        """Model outputs at every sample of every record."""
        return self.solve(parameters).y

    def solve(self, parameters: Parameters) -> Solution:
        """States and outputs of every record, as the likelihood simulates them."""
        return jax.vmap(lambda own, case: self.solve_one(own, parameters.shared, case)[0])(
            parameters.rows, self.cases()
        )

    def residuals(self, parameters: Parameters) -> Float[Array, "case time output"]:
        """`v = z - y`, zero where there is no valid sample."""
        return self._residuals(self.outputs(parameters))

    def cost(self, parameters: Parameters) -> Float[Array, ""]:
        """Negative log-likelihood, priors included; infinite where the simulation fails."""
        return self.cost_of(self.residuals(parameters), parameters)

    def evaluate(self, parameters: Parameters) -> tuple[Float[Array, ""], "Linearised"]:
        """Cost and linearised problem from one pass."""
        linearised = self.linearise(parameters)
        return self.cost_of(linearised.v, parameters), linearised

    def cost_of(self, v: Float[Array, "case time output"], parameters: Parameters) -> Float[Array, ""]:
        """Negative log-likelihood of given residuals, priors included."""
        cost = self.likelihood.noise.cost(v, self.records.mask) + self.prior_cost(parameters)
        return jnp.where(jnp.isfinite(cost), cost, jnp.inf)

    def sensitivities(
        self, parameters: Parameters
    ) -> tuple[Float[Array, "case time output"], Float[Array, "case time output column"]]:
        """Residuals and `S = dy/dtheta`, the record's own unknowns first, then the shared ones; not whitened."""
        count = self.positions.rows.size

        def one(own, case):
            def outputs(theta):
                return self.solve_one(theta[:count], theta[count:], case)[0].y

            return value_and_jacobian(outputs, jnp.concatenate([own, parameters.shared]))

        y, S = jax.vmap(one)(parameters.rows, self.cases())
        return self._residuals(y), S

    def linearise(self, parameters: Parameters) -> "Linearised":
        """Residuals, sensitivities and their information."""
        return self.informed(*self.sensitivities(parameters), parameters)

    def informed(
        self,
        v: Float[Array, "case time output"],
        S: Float[Array, "case time output column"],
        parameters: Parameters,
    ) -> "Linearised":
        """What given residuals and sensitivities say of the parameters, those that press on a bound held.

        Where the simulation failed the information is zero.
        """
        white_v, white_S = self.whiten(v, v), self.whiten(v, S)
        count = self.positions.rows.size
        triangles = record_triangles(white_S[..., :count], white_S[..., count:], white_v)
        triangles = jnp.where(jnp.all(jnp.isfinite(triangles)), triangles, 0.0)
        held = self._held(parameters, triangles)
        return Linearised(v, S, gather(triangles, self.prior_rows(parameters), held.rows, held.shared))

    def whiten(self, v: Float[Array, "case time output"], rows: Float[Array, "case time output *column"]):
        """Rows in units of the noise that belongs to these residuals."""
        mask = self.records.mask
        return whiten(self.likelihood.noise.cholesky(v, mask), rows, mask)

    def projected(self, linearised: "Linearised") -> Float[Array, "case time output parameter"]:
        """Whitened sensitivities to the shared parameters, less what each record's own unknowns can imitate.

        What those imitate says nothing of the shared parameters: it counts neither for the colour of the residuals nor for the
        noise of the inputs.

        Args:
            linearised: the problem at one set of parameters.
        """
        white = self.whiten(linearised.v, linearised.S)
        count, own = self.positions.rows.size, linearised.information.own
        return white[..., count:] - jnp.einsum("ctjo,cok,ckp->ctjp", white[..., :count], own.inverse, own.coupling)

    def project(self, parameters: Parameters) -> Parameters:
        """The nearest parameters within the bounds."""
        return jax.tree.map(jnp.clip, parameters, self.limits.lower, self.limits.upper)

    def prior_cost(self, parameters: Parameters) -> Float[Array, ""]:
        """The priors' part of the negative log-likelihood."""
        return 0.5 * jnp.sum(((parameters.shared - self.limits.prior_mean) / self.limits.prior_deviation) ** 2)

    def prior_rows(self, parameters: Parameters) -> Float[Array, "row column"]:
        """The priors as rows `[T r]` beside those of the records."""
        weight = 1.0 / self.limits.prior_deviation
        return jnp.column_stack([jnp.diag(weight), weight * (self.limits.prior_mean - parameters.shared)])

    def solve_one(self, own, shared, case) -> tuple[Solution, AbstractModel]:
        """One of the `cases` from its own and the shared parameters, and the model that these make."""
        flat, record = case
        model, initial_state = insert(self.model, flat, self.positions, shared, own)
        return self.likelihood.solve(model, record, initial_state), model

    def cases(self) -> tuple[Float[Array, "case flat"], Record]:
        """What the records differ in: their values of everything that is not free, and what was measured."""
        return flat_vectors(self.model, self.records), self.records

    def _residuals(self, y):
        # A masked sample must not let a NaN of the model through either: it would poison the sums.
        return jnp.where(self.records.mask, self.records.z - y, 0.0)

    def _held(self, parameters: Parameters, triangles) -> Parameters:
        """True for each parameter that stands on a bound and whose descent direction points outward."""
        count = self.positions.rows.size
        descent = jnp.einsum("cij,ci->cj", triangles[..., :-1], triangles[..., -1])
        prior = self.prior_rows(parameters)
        pull = prior[:, :-1].T @ prior[:, -1]
        toward = Parameters(jnp.sum(descent[:, count:], axis=0) + pull, descent[:, :count])

        def outward(value, low, high, direction) -> Bool[Array, "..."]:
            return ((value <= low) & (direction <= 0)) | ((value >= high) & (direction >= 0))

        return jax.tree.map(outward, parameters, self.limits.lower, self.limits.upper, toward)
