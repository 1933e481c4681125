"""A printed model shows the values of its parameters, a traced one its shapes."""

import jax
import jax.numpy as jnp
import pytest
from small_spring import Spring

import jaxid
from jaxid.models.base import canonical
from jaxid.models.stochastic import StochasticModel


def test_printed_model_has_its_values_to_six_digits():
    model = canonical(Spring(2.0, 1.0 / 3.0))
    assert str(model) == repr(model) == "Spring(k=2.0, c=0.333333)"
    assert "Spring(k=2.0, c=0.333333)" in str(jaxid.models.saving.Saved(model, None))


def test_matrix_is_printed_and_a_large_array_is_not():
    small = jaxid.LinearModel(
        A=[[0.0, 1.0], [-1.0, -0.1]],
        B=[[0.0], [1.0]],
        C=[[1.0, 0.0]],
        D=[[0.0]],
        states=("x", "v"),
        inputs=("force",),
        outputs=("x",),
    )
    assert "A=[[0.0, 1.0], [-1.0, -0.1]]" in str(small)
    assert "f64[100]" in str(Spring(jnp.ones(100), jnp.ones(())))


def test_traced_model_is_printed_without_values():
    printed = []
    jax.jit(lambda model: printed.append(str(model)) or model.k)(canonical(Spring(2.0, 0.1)))
    assert printed == ["Spring(k=f64[], c=f64[])"]


def test_model_with_noises_has_the_parameters_of_its_model():
    noisy = StochasticModel(Spring(2.0, 0.1), {"v": jnp.ones(())}, {}, {}, {}, ("force",))
    assert (noisy.k, noisy.c) == (2.0, 0.1)
    assert not hasattr(noisy, "mass")


def test_property_of_model_with_noises_that_fails_is_not_taken_from_its_model(monkeypatch):
    noisy = StochasticModel(Spring(2.0, 0.1), {"v": jnp.ones(())}, {}, {}, {}, ("force",))
    monkeypatch.setattr(StochasticModel, "with_memory", property(lambda self: self.absent))
    with pytest.raises(AttributeError):
        _ = noisy.states
