"""`linearise`: exact on linear models, equal to differences on others, reduced by names."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.flight.longitudinal_flight import true_aircraft
from jaxid.models import LinearModel
from jaxid.simulation import linearise

X, U = jnp.array([180.0, 15.0, 0.05, 0.1]), jnp.array([-0.02])


@pytest.fixture(scope="module")
def aircraft():
    return true_aircraft()


@pytest.fixture(scope="module")
def point(aircraft):
    return jax.jit(linearise)(aircraft, 0.0, X, U)


def test_linearisation_of_linear_model_equals_model(seed):
    random = np.random.default_rng(seed)
    matrices = (
        random.normal(size=(3, 3)),
        random.normal(size=(3, 2)),
        random.normal(size=(1, 3)),
        random.normal(size=(1, 2)),
    )
    model = LinearModel(*matrices, states=("a", "b", "c"), inputs=("d", "e"), outputs=("f",))
    result = linearise(model, 0.0, random.normal(size=3), random.normal(size=2))
    for name, matrix in zip("ABCD", matrices, strict=True):
        np.testing.assert_allclose(getattr(result, name), matrix, rtol=1e-14)
        np.testing.assert_array_equal(getattr(result.as_model(), name), getattr(result, name))


def test_linearisation_of_aircraft_equals_central_differences(aircraft, point):
    """Central differences are right to about 1e-9 of the size of the equations, here ten to a
    hundred.
    """
    t = jnp.zeros(())
    for matrix, function, vary in (
        (point.A, lambda dx: aircraft.rhs(t, X + dx, U), X),
        (point.B, lambda du: aircraft.rhs(t, X, U + du), U),
        (point.C, lambda dx: aircraft.output(t, X + dx, U), X),
        (point.D, lambda du: aircraft.output(t, X, U + du), U),
    ):
        for column in range(vary.size):
            step = 1e-5 * jnp.zeros(vary.size).at[column].set(1.0)
            np.testing.assert_allclose(
                matrix[:, column], (function(step) - function(-step)) / 2e-5, atol=1e-6, rtol=1e-7
            )


def test_reduced_linearisation_has_named_channels(point):
    short = point.reduced(states=("q", "w"), outputs=("az",))
    assert (short.states, short.inputs, short.outputs) == (("q", "w"), ("elevator",), ("az",))
    np.testing.assert_array_equal(
        short.A, [[point.A[2, 2], point.A[2, 1]], [point.A[1, 2], point.A[1, 1]]]
    )
    np.testing.assert_array_equal(short.B, [point.B[2], point.B[1]])
    np.testing.assert_array_equal(short.C, [[point.C[4, 2], point.C[4, 1]]])
    np.testing.assert_array_equal(short.D, [point.D[4]])
    with pytest.raises(InputError, match=r"no state of the linearisation 'theta'.* u, w, q, pitch"):
        point.reduced(states=("theta",))


def test_linearisation_under_vmap_equals_single_points(aircraft, point):
    batch = jax.vmap(lambda V: linearise(aircraft, 0.0, X.at[0].set(V), U))(
        jnp.array([150.0, 180.0])
    )
    assert batch.states == point.states
    np.testing.assert_allclose(
        batch.reduced(states=("w", "q")).A[1], point.reduced(states=("w", "q")).A, rtol=1e-13
    )
    assert str(batch) == "Linearisation at 2 points: u, w, q, pitch"


def test_print_of_linearisation_shows_matrices(point):
    lines = str(point).splitlines()
    assert lines[0].split() == ["A", "u", "w", "q", "pitch"]
    assert lines[1].split() == ["d(u)/dt", *(f"{value:.4g}" for value in point.A[0])]


def test_linearise_refuses_wrong_shapes(aircraft):
    with pytest.raises(
        InputError,
        match=r"x has shape \(3,\), but the model has 4 channels there: "
        r"u, w, q, pitch",
    ):
        linearise(aircraft, 0.0, X[:3], U)
