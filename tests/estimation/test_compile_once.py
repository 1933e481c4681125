"""A second call of `estimate` with other numbers of the same shapes compiles nothing, whatever type
they came in.

Compilations are counted by the events that JAX itself records at each: once for every program,
cached on disk or not.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_estimation import Lag, Pendulum, as_records, lag_rhs, pendulum_records, rk4

from jaxid._foundation.checks import InputError
from jaxid.data import record, stack
from jaxid.estimation import Clip, GaussNewton, OutputError, estimate
from jaxid.models import DiagonalNoise, FixedNoise, FullNoise, free


def lag_record(seed, name=""):
    t = 0.05 * np.arange(120)
    rng = np.random.default_rng(seed)
    u = np.sign(np.sin(rng.uniform(0.5, 2.0) * t))
    z = rk4(lag_rhs, t, u, np.zeros(1), rng.uniform(0.8, 1.6, 2)) + 0.02 * rng.normal(size=(120, 1))
    return record(t, u, z, inputs=("u",), outputs=("x",), name=name)


def test_compilations_of_new_shape_are_counted(compilations, seed):
    jax.jit(lambda x: x * 1.2345 + seed)(jnp.zeros(17)).block_until_ready()
    assert len(compilations) >= 1
    count = len(compilations)
    np.testing.assert_allclose(np.zeros(3), 0.0)
    assert len(compilations) == count


LEAVES = {
    "a float": lambda: Lag(p=0.9, b=1.1),
    "an int": lambda: Lag(p=1, b=1),
    "float32": lambda: Lag(p=jnp.float32(0.9), b=np.float32(1.1)),
    "a weak type": lambda: Lag(p=jnp.asarray(0.9) * 1.0, b=jax.lax.full_like(0.0, 1.0)),
    "numpy": lambda: Lag(p=np.float64(0.9), b=np.asarray(1.1)),
    "float64": lambda: Lag(p=jnp.array(0.9), b=jnp.array(1.1)),
}


@pytest.mark.parametrize("leaf", LEAVES)
def test_estimate_with_other_numbers_does_not_compile(compilations, leaf):
    model = Lag(p=jnp.array(1.0), b=jnp.array(1.0))
    estimate(
        model,
        free(model, "p", "b", per_record=("initial_state",)),
        lag_record(1, "one"),
        OutputError(),
    )
    other, data = LEAVES[leaf](), lag_record(2, "two")
    compilations.clear()
    result = estimate(
        other, free(other, "p", "b", per_record=("initial_state",)), data, OutputError()
    )
    assert compilations == []
    assert bool(result.successful)
    assert result.values.dtype == jnp.float64


def test_estimate_with_other_options_of_same_kind_does_not_compile(compilations):
    """Bounds, scales, priors, R and other names of as many parameters are data, not structure."""
    model = Lag(p=1.0, b=1.0)
    data = lag_record(1)

    def options(low, size, deviation, variance):
        chosen = free(
            model,
            "p",
            "b",
            bounds={"p": (low, None)},
            scale={"b": size},
            prior={"p": (1.0, deviation)},
        )
        return estimate(model, chosen, data, OutputError(noise=FixedNoise([variance])))

    options(0.1, 1.0, 0.5, 4e-4)
    compilations.clear()
    options(0.2, 2.0, 0.7, 5e-4)
    assert compilations == []


def test_estimate_of_records_with_gaps_and_given_solver_does_not_compile(compilations, seed):
    model = Pendulum(stiffness=3.5, damping=0.2, torque=1.2)
    chosen = free(model, "stiffness", "damping", per_record=("initial_state",))

    def fit(seed):
        records = as_records(pendulum_records(np.random.default_rng(seed), gaps=True), model)
        return estimate(
            model,
            chosen,
            records,
            OutputError(noise=DiagonalNoise()),
            solver=GaussNewton(policy=Clip()),
        )

    fit(seed)
    compilations.clear()
    result = fit(seed + 1)
    assert compilations == []
    assert bool(result.successful)


def test_estimate_under_jit_of_readings_equals_estimate():
    """The stack's times, inputs and mask are concrete, its readings are traced."""
    records = stack([lag_record(1), lag_record(2)])
    model = Lag(p=jnp.array(0.9), b=jnp.array(1.1))
    chosen = free(model, "p", "b")

    def values(z, mask):
        given = dataclasses.replace(records, z=z, mask=mask)
        return estimate(model, chosen, given, OutputError()).values

    expected = values(records.z, records.mask)
    result = jax.jit(lambda z: values(z, records.mask))(records.z)
    np.testing.assert_allclose(result, expected, rtol=1e-10)
    np.testing.assert_allclose(jax.jit(values)(records.z, records.mask), expected, rtol=1e-10)


def test_concrete_mask_is_checked_under_jit_of_readings():
    records = stack([lag_record(1), lag_record(2)])
    model = Lag(p=jnp.array(0.9), b=jnp.array(1.1))
    chosen = free(model, "p")
    lost = dataclasses.replace(records, mask=jnp.zeros_like(records.mask))

    def values(z):
        given = dataclasses.replace(lost, z=z)
        return estimate(model, chosen, given, OutputError(FullNoise())).values

    with pytest.raises(InputError, match="no valid sample"):
        jax.jit(values)(records.z)
