"""Optimal spectra of inputs to linear models, in steady state (C.2.1 of the report).

A sinusoid of mean square one at the frequency omega adds, in each second, the information

    M(omega) = Re( H_theta^* R^-1 H_theta ) / sample time,    H_theta = dH/dtheta

with `H = C (j omega I - A)^-1 B + D`. The information is a sum over frequencies, so that the best
distribution of the power follows from the exchange algorithm, and its certificate from the
equivalence theorem.

Source: R. K. Mehra, Optimal input signals for parameter estimation in dynamic systems: survey and
new results, IEEE Trans. Automatic Control 19(6), 1974.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require_float64, require_known
from ..._foundation.types import Array, Float, Numbers
from ...estimation.likelihoods import AbstractLikelihood
from ...models.base import AbstractModel, canonical
from ...models.free import Free, all_names
from ...models.names import flatten
from ..exchange import allocate
from ..information import require_known_noise
from ..measures import AbstractMeasure
from ..signals import InputSignal, combine, multisine_inputs

SMALLEST_LINE = 1e-3  # of the power; a line with less is left out of a realised signal (chosen)


class OptimalSpectrum(eqx.Module):
    """Distribution of the power of one input over frequencies.

    Attributes:
        frequencies: candidate frequencies [Hz].
        shares: share of the power at each; their sum is one.
        certificate: of the equivalence theorem, 1 at the optimum.
        value: cost of the measure after one second of unit power.
        axis: name of the input.
        inputs: names of all inputs of the model.
    """

    frequencies: Float[np.ndarray, " frequency"]
    shares: Float[np.ndarray, " frequency"]
    certificate: float = eqx.field(static=True)
    value: float = eqx.field(static=True)
    axis: str = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)

    @property
    def lines(self) -> tuple[Float[np.ndarray, " line"], Float[np.ndarray, " line"]]:
        """Frequencies with power [Hz], and their shares; neighbours on the grid are joined."""
        support = np.flatnonzero(self.shares > SMALLEST_LINE)
        groups = np.split(support, np.flatnonzero(np.diff(support) > 1) + 1)
        shares = np.array([np.sum(self.shares[group]) for group in groups])
        mean = [np.average(self.frequencies[group], weights=self.shares[group]) for group in groups]
        return np.array(mean), shares

    def realise(self, t: Float[Array, " time"], power: float) -> InputSignal:
        """Return a multisine whose harmonics have the power of the nearest frequencies.

        Args:
            t: sample times of one period, as for `multisine_inputs` [s].
            power: mean square of the input [unit^2].
        """
        period = float(t[-1] - t[0])
        frequencies, shares = self.lines
        harmonic = np.maximum(np.round(frequencies * period).astype(int), 1)
        first, last = int(harmonic.min()), int(harmonic.max())
        powers = np.zeros(last - first + 1)
        np.add.at(powers, harmonic - first, shares)
        signal = multisine_inputs(
            t, first / period, last / period, (self.axis,), powers=powers, name="optimal spectrum"
        )
        moved = {self.axis: np.sqrt(power) * signal.u[:, 0]}
        return combine(t, moved, self.inputs, name="optimal spectrum")

    def __str__(self) -> str:
        frequencies, shares = self.lines
        lines = [f"{'frequency, Hz':>14}{'share, %':>10}"]
        rows = zip(frequencies, shares, strict=True)
        lines += [f"{frequency:>14.4g}{100 * share:>10.1f}" for frequency, share in rows]
        return "\n".join([*lines, f"certificate {self.certificate:.4f} (1 at the optimum)"])


def optimal_spectrum(
    model: AbstractModel,
    free: Free,
    frequencies: Float[Numbers, " frequency"],
    measure: AbstractMeasure,
    likelihood: AbstractLikelihood,
    *,
    sample_time: float,
    axis: str | None = None,
    state: Float[Numbers, " state"] | None = None,
    trim_input: Float[Numbers, " input"] | None = None,
    tolerance: float = 1e-4,
) -> OptimalSpectrum:
    """Return the spectrum of one input that minimises a measure, for a given power.

    A nonlinear model is linearised at the given state and input.

    Args:
        model: the model with declared values.
        free: the parameters of the later estimate; those of the record, and priors, do not count in
            a long record in steady state.
        frequencies: increasing candidate frequencies [Hz].
        measure: the measure to be minimised.
        likelihood: the likelihood with known noise.
        sample_time: of the record [s].
        axis: the input that moves; the first by default.
        state, trim_input: the point at which the model is linear; zero by default.
        tolerance: of the certificate.

    Raises:
        InputError: when the frequencies together do not determine the parameters, or the noise is
            unknown.
    """
    require_float64()
    require_known_noise(likelihood)
    axis = model.inputs[0] if axis is None else axis
    require_known("input", [axis], model.inputs)
    require_known("parameter", free.shared, all_names(model))
    x = np.zeros(len(model.states)) if state is None else state
    u = np.zeros(len(model.inputs)) if trim_input is None else trim_input
    f = np.asarray(frequencies, float)
    model = canonical(model)
    noise = likelihood.noise.cholesky(
        jnp.zeros((1, 1, len(model.outputs))), jnp.ones((1, 1, len(model.outputs)), bool)
    )
    rows = _rows(
        model,
        free.positions(model).shared,
        (jnp.asarray(x, float), jnp.asarray(u, float)),
        jnp.asarray(2.0 * np.pi * f),
        model.inputs.index(axis),
        noise,
    )
    result = allocate(np.asarray(rows) / np.sqrt(sample_time), measure, tolerance=tolerance)
    return OptimalSpectrum(f, result.weights, result.certificate, result.cost, axis, model.inputs)


@eqx.filter_jit
def _rows(model, positions, point, omega, column: int, noise):
    """Return real and imaginary parts of the whitened `dH/dtheta`, one column per parameter.

    An input of mean square one has a response of mean square `|H|^2`, so that each part is a row of
    information per sample.
    """
    vector, unflatten = flatten(model)

    def response(theta):
        changed = unflatten(vector.at[positions].set(theta))

        def equations(x, u):
            t = jnp.zeros(())
            return changed.rhs(t, x, u), changed.output(t, x, u)

        (A, B), (C, D) = jax.jacfwd(equations, argnums=(0, 1))(*point)
        B, D = B[:, column], D[:, column]
        whitener = jnp.linalg.inv(noise)

        def at(omega):
            # (j omega I - A) (p + j q) = B in real numbers
            eye = omega * jnp.eye(A.shape[0])
            matrix = jnp.block([[-A, -eye], [eye, -A]])
            solution = jnp.linalg.solve(matrix, jnp.concatenate([B, jnp.zeros_like(B)]))
            real, imaginary = jnp.split(solution, 2)
            return jnp.concatenate([whitener @ (C @ real + D), whitener @ (C @ imaginary)])

        return jax.vmap(at)(omega)

    return jax.jacfwd(response)(vector[positions])
