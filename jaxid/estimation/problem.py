"""One estimation problem as arrays without names: cost, residuals and sensitivities for the solver.

Per-record parameters (`own`, `rows`) have one value per record, such as the initial state. Shared
parameters have one value for all records.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import scipy

from .._foundation.device import default_device, memory_of
from .._foundation.types import Array, Bool, Float
from ..data.record import Record
from ..models.base import AbstractModel, canonical
from ..models.free import Free, Parameters, Positions, flat_vectors
from ..models.free_model import FreeModel, insert
from ..models.noise import AbstractWhitening
from ..sensitivity.information import Information, gather, record_triangles
from ..simulation.solution import Solution
from .coloured_errors import ScoreSpectrum
from .likelihoods import AbstractLikelihood
from .limits import Limits, within_bounds

# Largest size of the sensitivities of all records that are kept, and of the blocks in which larger
# ones are computed and folded into triangles (chosen; larger blocks are no faster).
KEPT_BYTES, BLOCK_BYTES = 16_000_000, 4_000_000
# On a GPU, where a step of time takes as long for many records as for one, a 64th of its memory:
# the arrays of a linearisation take some ten times the sensitivities (chosen).
PARTS_OF_GPU_MEMORY = 64


def kept_bytes(*, block: bool = False) -> int:
    """Return the largest size of the sensitivities that are kept, or of a block [bytes]."""
    device = default_device()
    if device.platform != "cpu":
        return memory_of(device) // PARTS_OF_GPU_MEMORY
    return BLOCK_BYTES if block else KEPT_BYTES


class Linearised(eqx.Module):
    """A problem linearised at one set of parameters.

    Attributes:
        v: rows of misfit; for output error the residuals, zero where there is no valid sample.
        S: sensitivities of the rows, not whitened. The first columns belong to the per-record
            parameters, the last ones to the shared parameters. None for a stack of records that
            exceeds `kept_bytes`.
        information: square-root information on the parameters.
    """

    v: Float[Array, "case time row"]
    S: Float[Array, "case time sensitive column"] | None
    information: Information


class Problem(eqx.Module):
    """All arguments of the cost except the parameters.

    Attributes:
        model: the model, with the values of the parameters that are not free.
        positions: positions of the free parameters in the flat vector of the model.
        records: a stack.
        likelihood: the likelihood.
        limits: bounds, scales, priors.
    """

    model: AbstractModel
    positions: Positions
    records: Record
    likelihood: AbstractLikelihood
    limits: Limits

    @classmethod
    def of(
        cls, model: AbstractModel, free: Free, records: Record, likelihood: AbstractLikelihood
    ) -> "Problem":
        """Return the problem of estimating the free parameters.

        The problem contains no names, so that problems with arrays of equal shapes share one
        compilation.

        Args:
            model: the model, with the values that are not free.
            free: the free parameters.
            records: a stack.
            likelihood: the likelihood.
        """
        model, free = canonical(model), canonical(free)
        limits = Limits.of(free, records.n_cases)
        return cls(model, free.positions(model), records.anonymous(), canonical(likelihood), limits)

    def outputs(self, parameters: Parameters) -> Float[Array, "case time output"]:
        """Return the model outputs at every sample of every record."""
        return self.solve(parameters).y

    def solve(self, parameters: Parameters) -> Solution:
        """Return states and outputs of every record, as simulated by the likelihood."""
        return jax.vmap(lambda own, case: self.solve_one(own, parameters.shared, case)[0])(
            parameters.rows, self.cases()
        )

    def residuals(self, parameters: Parameters) -> Float[Array, "case time row"]:
        """Return the rows of misfit: for output error `v = z - y`, zero where there is no valid
        sample.
        """

        def rows(family: FreeModel, theta, record: Record):
            model, initial_state = family(theta)
            return self.likelihood.rows(model, record, initial_state)

        def some(arguments):
            return self._by_case(rows, parameters.shared, *arguments)

        batch = self._largest_batch(len(self.model.states) + self.row_mask.shape[-1])
        return self._by_batch(some, (parameters.rows, self.cases()), batch)

    @property
    def row_mask(self) -> Bool[Array, "case time row"]:
        """Valid elements of the rows of misfit."""
        return self.likelihood.row_mask(self.records.mask)

    def cost(self, parameters: Parameters) -> Float[Array, ""]:
        """Return the negative log-likelihood with priors; infinite where the simulation fails."""
        return self.cost_of(self.residuals(parameters), parameters)

    def evaluate(self, parameters: Parameters) -> tuple[Float[Array, ""], "Linearised"]:
        """Return the cost and the linearised problem from one pass."""
        linearised = self.linearise(parameters)
        return self.cost_of(linearised.v, parameters), linearised

    def cost_of(self, v: Float[Array, "case time row"], parameters: Parameters) -> Float[Array, ""]:
        """Return the negative log-likelihood of given residuals, with priors."""
        cost = self.likelihood.noise.cost(v, self.row_mask) + self.prior_cost(parameters)
        return jnp.where(jnp.isfinite(cost), cost, jnp.inf)

    def sensitivities(
        self, parameters: Parameters
    ) -> tuple[Float[Array, "case time row"], Float[Array, "case time sensitive column"]]:
        """Return the rows of misfit `v` and `S = -dv/dtheta`, not whitened.

        The first columns belong to the per-record parameters, the last ones to the shared
        parameters.
        """
        return self._sensitivities(parameters.rows, parameters.shared, self.cases())

    def _sensitivities(self, rows, shared, cases):
        """Return rows and sensitivities of some records."""
        return self._by_case(self.likelihood.sensitivities, shared, rows, cases)

    def _by_case(self, function, shared, rows, cases):
        """Return the results of a function of family, parameters and record for some records."""

        def of_case(own, case):
            flat, record = case
            family = FreeModel(self.model, flat, self.positions)
            return function(family, jnp.concatenate([own, shared]), record)

        if len(rows) == 1:  # arrays without an axis of one record need fewer copies
            result = of_case(*jax.tree.map(lambda leaf: leaf[0], (rows, cases)))
            return jax.tree.map(lambda leaf: leaf[None], result)
        return jax.vmap(of_case)(rows, cases)

    def linearise(self, parameters: Parameters) -> "Linearised":
        """Return residuals, sensitivities and their information.

        A parameter on a bound is held fixed if a descent of the cost would move it out of its
        bounds. If a simulation fails, the information of all records is zero.
        """
        folded = self._by_case(
            self.likelihood.folded, parameters.shared, parameters.rows, self.cases()
        )
        if folded is not None:
            profile = jnp.zeros((self.records.n_cases, 0, folded.triangle.shape[-1] - 1))
            return Linearised(folded.rows, None, self._gather(parameters, folded.triangle, profile))
        if self.batch == self.records.n_cases:
            return self.informed(*self.sensitivities(parameters), parameters)
        v = self.residuals(parameters)
        whiten = self.likelihood.noise.whitening(v, self.row_mask)

        def fold(batch):
            rows, cases, v = batch
            _, S = self._sensitivities(rows, parameters.shared, cases)
            return self._fold(S, v, self.likelihood.row_mask(cases[1].mask), whiten)

        folded = self._by_batch(fold, (parameters.rows, self.cases(), v), self.batch)
        return Linearised(v, None, self._gather(parameters, *folded))

    @eqx.filter_jit
    def informed(
        self,
        v: Float[Array, "case time row"],
        S: Float[Array, "case time sensitive column"],
        parameters: Parameters,
    ) -> "Linearised":
        """Return the linearised problem of given residuals and sensitivities (jitted)."""
        folded = self._fold(S, v, self.row_mask, self.likelihood.noise.whitening(v, self.row_mask))
        return Linearised(v, S, self._gather(parameters, *folded))

    def score_spectrum(
        self,
        parameters: Parameters,
        linearised: "Linearised",
        half: Float[Array, "parameter parameter"],
    ) -> ScoreSpectrum:
        """Return the Fourier transforms of the sensitivities of all records.

        Args:
            parameters: values of the parameters.
            linearised: the problem at these parameters.
            half: square root of the covariance of the shared parameters.
        """
        v, own = linearised.v, linearised.information.own
        mask, count = self.row_mask, self.positions.rows.size
        whiten = self.likelihood.noise.whitening(v, mask)
        prior = half / self.limits.prior_deviation[:, None]
        priors = jnp.sum((half @ prior.T) ** 2, axis=1), prior.T @ prior
        size = 2 * int(scipy.fft.next_fast_len(mask.shape[1], real=True))

        def transforms(S, own, mask):
            white = whiten(S, mask)
            columns = white[..., :count] @ own.inverse[:, None], self._projected(white, own) @ half
            return jnp.fft.rfft(jnp.concatenate(columns, axis=-1), size, axis=1)

        def power(columns):
            return jnp.sum(jnp.abs(columns[..., count:] @ half.T) ** 2, axis=0)

        if linearised.S is not None:
            columns = transforms(linearised.S, own, mask)
            return ScoreSpectrum(power(columns), columns, count, *priors)

        def of_batch(batch):
            rows, cases, own = batch
            _, S = self._sensitivities(rows, parameters.shared, cases)
            return power(transforms(S, own, self.likelihood.row_mask(cases[1].mask)))

        batches = self._split((parameters.rows, self.cases(), own), self.batch)
        of_batch = jax.jit(of_batch)  # so that it is traced once
        shape = jax.eval_shape(of_batch, jax.tree.map(lambda leaf: leaf[0], batches))
        # A sum along the way: the spectra of all batches would be larger than the records.
        total, _ = jax.lax.scan(
            lambda total, batch: (total + of_batch(batch), None),
            jnp.zeros(shape.shape, shape.dtype),
            batches,
        )
        return ScoreSpectrum(total, None, count, *priors)

    @property
    def batch(self) -> int:
        """Number of records whose sensitivities are in memory at once: a divisor of all."""
        columns = self.positions.rows.size + self.positions.shared.size
        rows = self.likelihood.n_sensitive(self.records.z.shape[2])
        return self._largest_batch(rows * columns)

    def _largest_batch(self, values: int) -> int:
        """Return all records if their values are kept, otherwise their largest divisor in a block.

        Args:
            values: number of values at each sample of a record.
        """
        n_cases, samples = self.records.t.shape
        if n_cases * (size := max(8 * samples * values, 1)) <= kept_bytes():
            return n_cases
        largest = max(kept_bytes(block=True) // size, 1)
        return max(n for n in range(1, min(n_cases, largest) + 1) if n_cases % n == 0)

    def _by_batch(self, function, arguments, size: int):
        """Return the results of a function of `size` records at a time, for all records."""
        if size == self.records.n_cases:
            return function(arguments)

        def join(leaf):
            return leaf.reshape(leaf.shape[0] * leaf.shape[1], *leaf.shape[2:])

        return jax.tree.map(join, jax.lax.map(function, self._split(arguments, size)))

    def _split(self, arguments, size: int):
        """Return arguments of all records in batches of `size` records."""
        count = self.records.n_cases // size
        return jax.tree.map(lambda leaf: leaf.reshape(count, size, *leaf.shape[1:]), arguments)

    def _fold(self, S, v, mask, whiten: AbstractWhitening):
        """Return the triangles of some records, and their rows of the noise's curvature."""
        v, mask = v[..., : S.shape[2]], mask[..., : S.shape[2]]
        white_v, white_S = whiten.misfit(v, mask), whiten(S, mask)
        count = self.positions.rows.size
        triangles = record_triangles(white_S[..., :count], white_S[..., count:], white_v)
        return triangles, self.likelihood.noise.profile_rows(white_S, white_v, mask)

    def _gather(self, parameters: Parameters, triangles, profile) -> Information:
        """Return the information of all records and priors, parameters on bounds held fixed."""
        mask = self.row_mask
        finite = jnp.all(jnp.isfinite(triangles))
        triangles = jnp.where(finite, triangles, 0.0)
        weights = jnp.sqrt(self.likelihood.noise.profile_weights(mask))
        profile = jnp.where(finite, profile, 0.0) * weights[None, :, None]
        held = self._held(parameters, triangles)
        count = jnp.min(jnp.sum(mask, axis=(0, 1))) * 1.0
        prior = self.prior_rows(parameters)
        return gather(triangles, prior, held.rows, held.shared, profile, count)

    def whiten(
        self, v: Float[Array, "case time row"], rows: Float[Array, "case time sensitive *column"]
    ):
        """Return `rows` in units of the noise, with its memory removed; `v` are the residuals."""
        return self.likelihood.noise.whitening(v, self.row_mask)(rows, self.row_mask)

    def misfit(self, v: Float[Array, "case time row"]) -> Float[Array, "case time row"]:
        """Return the whitened residuals (`AbstractWhitening.misfit`)."""
        return self.likelihood.noise.whitening(v, self.row_mask).misfit(v, self.row_mask)

    def projected(self, linearised: "Linearised") -> Float[Array, "case time sensitive parameter"]:
        """Return the whitened sensitivities to the shared parameters, orthogonal to the others.

        The projection on the sensitivities to the per-record parameters is subtracted. It carries
        no information on the shared parameters, so that the corrections of standard errors for
        coloured residuals and for noise of the inputs must not include it.

        Args:
            linearised: the problem at one set of parameters, from `informed`.
        """
        v, S = linearised.v, linearised.S
        assert S is not None, "projected needs the sensitivities of all records"
        return self._projected(self.whiten(v, S), linearised.information.own)

    def _projected(self, white, own):
        count = self.positions.rows.size
        return white[..., count:] - jnp.einsum(
            "ctjo,cok,ckp->ctjp", white[..., :count], own.inverse, own.coupling
        )

    def project(
        self, parameters: Parameters, information: Information | None = None, near: float = 0.0
    ) -> Parameters:
        """Return the nearest parameters within the bounds.

        A value within rounding of a bound is set to that bound.

        Args:
            parameters: any values.
            information: information from which the standard errors for `near` are computed; with
                None, only rounding is considered.
            near: distance from a bound within which a value is set to the bound, in standard errors
                that the parameter would have if the other shared parameters were known.
        """
        if information is None:
            inverse_error = jax.tree.map(lambda leaf: jnp.full(leaf.shape, jnp.inf), parameters)
        else:
            columns = information.triangle, information.own.jacobian
            norms = Parameters(*(jnp.linalg.norm(column, axis=-2) for column in columns))
            inverse_error = jax.tree.map(lambda leaf: jnp.where(leaf > 0, leaf, jnp.inf), norms)
        low, high = self.limits.lower, self.limits.upper
        return jax.tree.map(partial(within_bounds, near=near), parameters, low, high, inverse_error)

    def prior_cost(self, parameters: Parameters) -> Float[Array, ""]:
        """Return the contribution of the priors to the negative log-likelihood."""
        return 0.5 * jnp.sum(
            ((parameters.shared - self.limits.prior_mean) / self.limits.prior_deviation) ** 2
        )

    def prior_rows(self, parameters: Parameters) -> Float[Array, "row column"]:
        """Return the priors as rows `[T r]`, to be stacked with the rows of the records."""
        weight = 1.0 / self.limits.prior_deviation
        return jnp.column_stack(
            [jnp.diag(weight), weight * (self.limits.prior_mean - parameters.shared)]
        )

    def model_of(
        self, parameters: Parameters, case: int
    ) -> tuple[AbstractModel, Float[Array, " state"]]:
        """Return the model and the initial state of one record."""
        flat = self.cases()[0][case]
        return insert(self.model, flat, self.positions, parameters.shared, parameters.rows[case])

    def solve_one(self, own, shared, case) -> tuple[Solution, AbstractModel]:
        """Return the solution of one record, and the model with the parameters of this record."""
        flat, record = case
        model, initial_state = insert(self.model, flat, self.positions, shared, own)
        return self.likelihood.solve(model, record, initial_state), model

    def cases(self) -> tuple[Float[Array, "case flat"], Record]:
        """Return the flat vector of parameter values of each record, and the stack of records."""
        return flat_vectors(self.model, self.records), self.records

    def _held(self, parameters: Parameters, triangles) -> Parameters:
        """Return a mask of the parameters on a bound whose descent direction leaves the bounds."""
        count = self.positions.rows.size
        descent = jnp.einsum("cij,ci->cj", triangles[..., :-1], triangles[..., -1])
        prior = self.prior_rows(parameters)
        prior_descent = prior[:, :-1].T @ prior[:, -1]
        shared_descent = jnp.sum(descent[:, count:], axis=0) + prior_descent
        directions = Parameters(shared_descent, descent[:, :count])

        def outward(value, low, high, direction) -> Bool[Array, "..."]:
            return ((value <= low) & (direction <= 0)) | ((value >= high) & (direction >= 0))

        return jax.tree.map(outward, parameters, self.limits.lower, self.limits.upper, directions)
