"""Information adds up: joint estimates from stacked factors, and a thousand separate estimates in
one call.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from reference_estimation import rk4

from jaxid._foundation.linalg import stack_factors
from jaxid._foundation.results import RESULTS
from jaxid._foundation.types import Array
from jaxid.data import Record, record, stack
from jaxid.estimation import OutputError, estimate
from jaxid.models import AbstractModel, FixedNoise, LinearModel, free

A = np.array([[0.0, 1.0], [-2.0, -0.5]])
R = np.array([[0.04, 0.03], [0.03, 0.09]])
KNOWN = OutputError(noise=FixedNoise(R))
ROWS = 90  # all records are padded to it, so that they share one compiled program
NAMES = {"inputs": ("force",), "outputs": ("x", "v")}


def model():
    return LinearModel(A, np.zeros((2, 1)), np.eye(2), np.zeros((2, 1)), states=("x", "v"), **NAMES)


@pytest.fixture
def flights(seed):
    rng = np.random.default_rng(seed)
    made = []
    for i in range(16):
        n = int(rng.integers(40, ROWS))
        t = 0.1 * np.arange(n)
        u = np.sin((0.5 + 0.1 * i) * t + i)
        x = rk4(lambda x, u, b: A @ x + b * u, t, u, rng.normal(size=2), np.array([0.5, 2.0]))
        made.append(
            record(
                t, u, x + rng.multivariate_normal(np.zeros(2), R, n), name=f"flight {i}", **NAMES
            )
        )
    return made


@pytest.mark.parametrize(
    "rows", [(), ("initial_state",)], ids=["shared only", "own initial states"]
)
def test_joint_estimate_equals_solution_of_stacked_factors(flights, rows):
    """Each factor holds `T d = r` about its own estimate; about zero it is `T theta = r + T
    theta_j`.
    """
    chosen = free(model(), "B", per_record=rows)
    joint = estimate(model(), chosen, stack(flights, ROWS), KNOWN)
    factors = []
    for flight in flights:
        alone = estimate(model(), chosen, stack([flight], ROWS), KNOWN)
        T, r = alone.information.triangle, alone.information.rhs
        factors.append(jnp.column_stack([T, r + T @ alone.values]))
    factor = stack_factors(jnp.stack(factors))
    T, r = factor[:2, :2], factor[:2, 2]
    np.testing.assert_allclose(joint.values, jnp.linalg.solve(T, r), rtol=1e-9)
    np.testing.assert_allclose(joint.covariance, jnp.linalg.inv(T.T @ T), rtol=1e-9)
    # The last diagonal element is the norm of the whitened residual, which adds up as well.
    np.testing.assert_allclose(factor[2, 2], joint.information.factor[2, 2], rtol=1e-9)


def test_factors_of_vmapped_call_give_joint_estimate(flights):
    """All sixteen at once: stacked, padded, estimated in parallel, their factors put on top of
    each other.
    """
    chosen, together = free(model(), "B"), stack(flights).anonymous()
    alone = eqx.filter_vmap(lambda one: estimate(model(), chosen, one, KNOWN))(_unnamed(together))
    T, r = alone.information.factor[..., :-1], alone.information.factor[..., -1]
    shifted = jnp.concatenate(
        [T, (r + jnp.einsum("cij,cj->ci", T, alone.values))[..., None]], axis=-1
    )
    factor = stack_factors(shifted)
    joint = estimate(model(), chosen, flights, KNOWN)
    np.testing.assert_allclose(
        jnp.linalg.solve(factor[:2, :2], factor[:2, 2]), joint.values, rtol=1e-9
    )


def _unnamed(records: Record) -> Record:
    """Return a stack whose cases can be mapped over, with one name for all."""
    fields = {name: getattr(records, name) for name in Record.__dataclass_fields__}
    return Record(**{**fields, "names": ("",)})


def test_standard_errors_fall_with_added_information(flights):
    chosen = free(model(), "B", per_record=("initial_state",))

    def errors(records):
        return np.asarray(estimate(model(), chosen, stack(records, ROWS), KNOWN).standard_errors)

    growing = np.array([errors(flights[:k]) for k in (1, 4, 16)])
    assert (np.diff(growing, axis=0) < 0).all()
    np.testing.assert_allclose(errors(flights[:1] * 16), errors(flights[:1]) / 4, rtol=1e-9)


class Hardening(AbstractModel):
    """A lag with a destabilising cubic: it diverges under a large input."""

    p: Array
    b: Array
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return -self.p * x + 0.05 * x**3 + self.b * u

    def output(self, t, x, u):
        return x


def test_diverging_record_among_thousand_fails_alone(seed):
    cases, poisoned = 1000, 417
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(80)
    u = np.sin(np.outer(rng.uniform(0.5, 2.0, cases), t))
    theta = np.stack([rng.uniform(1.0, 2.0, cases), rng.uniform(0.5, 1.5, cases)])

    def rhs(x, u, theta):
        return -theta[0] * x + 0.05 * x**3 + theta[1] * u

    z = rk4(rhs, t, u.T, np.zeros(cases), theta).T + 0.02 * rng.normal(size=(cases, 80))
    u[poisoned] = 1e6
    begin, chosen = Hardening(p=1.0, b=0.7), free(Hardening(p=1.0, b=0.7), "p", "b")
    traces = []

    @eqx.filter_jit
    def all_of_them(u, z):
        traces.append(1)

        def one(u, z):
            valid = jnp.ones(z.shape, bool)
            data = Record(jnp.asarray(t), u, z, valid, {}, ("u",), ("x",), ("",), ("",), ("",))
            return estimate(begin, chosen, data, OutputError())

        return eqx.filter_vmap(one)(u, z)

    result = all_of_them(jnp.asarray(u)[..., None], jnp.asarray(z)[..., None])
    good = np.asarray(result.successful)
    np.testing.assert_array_equal(np.flatnonzero(~good), [poisoned])
    assert bool((result.result == RESULTS.start_diverges)[poisoned])
    assert str(result) == "Estimate of 1000 cases, 999 successful: p, b"
    pulls = np.asarray((result.values - theta.T) / result.standard_errors)[good]
    assert np.abs(pulls).max() < 5.5  # 1,998 normal numbers: 5.5 is beyond 99.99 %
    assert 0.93 < pulls.std() < 1.08
    for case in (0, 416, 418, 999):
        data = record(t, u[case], z[case], inputs=("u",), outputs=("x",))
        alone = estimate(begin, chosen, data, OutputError())
        np.testing.assert_allclose(result.values[case], alone.values, rtol=1e-7)
        np.testing.assert_allclose(result.standard_errors[case], alone.standard_errors, rtol=1e-6)
    all_of_them(jnp.asarray(u[::-1].copy())[..., None], jnp.asarray(z[::-1].copy())[..., None])
    assert len(traces) == 1
