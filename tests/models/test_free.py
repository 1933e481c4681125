"""Free parameters: names, groups, bounds, and positions in the flat vector."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.data import record, segment, stack
from jaxid.estimation import OutputError, estimate
from jaxid.estimation.shooting import cut
from jaxid.models import AbstractModel, LinearModel, Polynomial, free, with_values
from jaxid.models.free import (
    Positions,
    first_state,
    flat_vectors,
    initial_parameters,
    leaves_at,
)
from jaxid.models.free_model import insert
from jaxid.models.names import flatten


class Aero(eqx.Module):
    Cm: Polynomial
    Cmx: object


class Plane(AbstractModel):
    aero: Aero
    mass: object
    table: object
    states, inputs, outputs = ("alpha", "q"), ("elevator",), ("q",)

    def rhs(self, t, x, u):
        signals = dict(zip(("alpha", "q", "elevator"), jnp.concatenate([x, u]), strict=True))
        return jnp.stack([x[1], self.aero.Cm(signals) / self.mass + self.aero.Cmx * u[0]])

    def output(self, t, x, u):
        return x[1:] + self.table[0, 1]

    def initial_state(self, record):
        return jnp.stack([self.mass / 10.0, record.z[0, 0]])


def plane(mass=2.0):
    return Plane(
        Aero(Polynomial({"alpha": -1.0, "alpha^2": 0.5, "q": -0.2}), 3.0),
        mass,
        jnp.array([[7.0, 8.0]]),
    )


ALL = (
    "aero.Cm.alpha",
    "aero.Cm.alpha^2",
    "aero.Cm.q",
    "aero.Cmx",
    "mass",
    "table[0,0]",
    "table[0,1]",
    "initial_state.alpha",
    "initial_state.q",
)


def flight(name, n, q0, **constants):
    t = 0.1 * np.arange(n)
    z = q0 + np.zeros((n, 1))
    return record(
        t, np.ones((n, 1)), z, inputs=("elevator",), outputs=("q",), name=name, constants=constants
    )


def test_groups_are_expanded_in_given_order():
    selection = free(plane(), "table", "mass", "aero.Cm", per_record=("initial_state",))
    assert selection.shared == (*ALL[5:7], "mass", *ALL[:3])
    assert selection.per_record == ALL[7:]
    assert free(plane(), "aero").shared == ALL[:4]
    assert free(plane(), "table[0,1]", "initial_state.q").shared == (
        "table[0,1]",
        "initial_state.q",
    )


def test_unknown_name_is_refused_with_known_and_nearest_names():
    with pytest.raises(InputError) as caught:
        free(plane(), "mass", "aero.Cm.alfa")
    message = str(caught.value)
    assert "There is no parameter 'aero.Cm.alfa'. Did you mean 'aero.Cm.alpha'" in message
    assert f"The names are: {', '.join(ALL)}." in message
    with pytest.raises(InputError, match=r"There is no parameter 'zzz'\. The names are"):
        free(plane(), per_record=("zzz",))


@pytest.mark.parametrize(
    ("names", "rows", "twice"),
    [
        (("mass", "mass"), (), "mass"),
        (("aero.Cm", "aero.Cm.q"), (), "aero.Cm.q"),
        (("mass", "table"), ("table[0,0]",), "table[0,0]"),
    ],
)
def test_repeated_name_is_refused(names, rows, twice):
    with pytest.raises(InputError) as caught:
        free(plane(), *names, per_record=rows)
    assert f"free parameter name {twice!r} occurs twice" in str(caught.value)


def test_selection_without_parameters_is_refused():
    with pytest.raises(InputError, match="No parameter is free"):
        free(plane())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"bounds": {"mass": (2.5, None)}},
            "The starting value of 'mass', 2, lies outside its bounds (2.5, inf)",
        ),
        (
            {"bounds": {"mass": (None, 1.5)}},
            "The starting value of 'mass', 2, lies outside its bounds (-inf, 1.5)",
        ),
        ({"bounds": {"mass": (3.0, 3.0)}}, "The bounds of 'mass' are empty: 3.0 is not below 3.0"),
        (
            {"bounds": {"aero.Cmx": (0.0, 9.0)}},
            "There is no free parameter (in `bounds`) 'aero.Cmx'",
        ),
        ({"scale": {"mass": 0.0}}, "The scale of 'mass' is 0.0; it must be positive and finite."),
        ({"scale": {"mass": float("nan")}}, "The scale of 'mass' is nan"),
        (
            {"prior": {"mass": (2.0, -1.0)}},
            "The prior of 'mass' is -1.0; it must be positive and finite.",
        ),
        (
            {"prior": {"initial_state.q": (0.0, 1.0)}},
            "There is no free parameter (in `prior`) 'initial_state.q'",
        ),
    ],
)
def test_invalid_options_are_refused(options, message):
    with pytest.raises(InputError) as caught:
        free(plane(), "mass", per_record=("initial_state.q",), **options)
    assert message in str(caught.value)


def test_bounds_have_order_of_names():
    chosen = free(
        plane(),
        "aero.Cm.q",
        "mass",
        per_record=("initial_state",),
        bounds={"mass": (1.0, None), "initial_state.q": (-3.0, 4.0)},
    )
    np.testing.assert_array_equal(chosen.bounds("shared"), [[-np.inf, 1.0], [np.inf, np.inf]])
    np.testing.assert_array_equal(chosen.bounds("per_record"), [[-np.inf, -3.0], [np.inf, 4.0]])
    free(plane(), "mass", bounds={"mass": (2.0, 5.0)})  # a start on the bound is inside


def test_numbers_in_options_become_arrays():
    chosen = free(
        plane(),
        "mass",
        scale={"mass": 2.0},
        prior={"mass": (1.0, 3.0)},
        bounds={"mass": (0.0, 9.0)},
    )
    for leaf in jax.tree.leaves(chosen):
        assert leaf.dtype == jnp.float64
        assert not leaf.weak_type


@pytest.mark.parametrize("mass", [2, 2.0, np.float32(2), jnp.float32(2), jnp.array(2.0)])
def test_with_values_replaces_leaf_of_any_type(mass):
    changed = with_values(plane(mass), ("mass", "table[0,0]"), jnp.array([5.0, -1.0]))
    assert changed.mass.dtype == jnp.float64
    np.testing.assert_array_equal(flatten(changed)[0], [-1.0, 0.5, -0.2, 3.0, 5.0, -1.0, 8.0])


def test_values_for_unknown_name_are_refused():
    with pytest.raises(InputError, match=r"There is no parameter 'masss'\. Did you mean 'mass'"):
        with_values(plane(), ("masss",), jnp.zeros(1))


def test_positions_select_initial_parameters():
    records = stack([flight("a", 5, 0.1), flight("b", 3, -0.4)])
    model = with_values(plane(), (), jnp.zeros(0))
    chosen = free(model, "mass", "aero.Cm.q", per_record=("initial_state",))
    positions = chosen.positions(model)
    np.testing.assert_array_equal(positions.shared, [ALL.index("mass"), ALL.index("aero.Cm.q")])
    np.testing.assert_array_equal(positions.rows, [7, 8])
    values = initial_parameters(model, positions, records)
    np.testing.assert_array_equal(values.shared, [2.0, -0.2])
    np.testing.assert_allclose(values.rows, [[0.2, 0.1], [0.2, -0.4]], rtol=1e-15)


def test_constants_of_record_replace_parameters():
    records = stack([flight("light", 5, 0.1, mass=1.5), flight("heavy", 5, 0.1, mass=4.0)])
    flat = flat_vectors(with_values(plane(), (), jnp.zeros(0)), records)
    local = np.array([-1.0, 0.5, -0.2, 3.0, np.nan, 7.0, 8.0, np.nan, 0.1])
    want = np.stack(
        [np.where(np.isnan(local), [0, 0, 0, 0, m, 0, 0, m / 10.0, 0], local) for m in (1.5, 4.0)]
    )
    # the initial state uses the mass of the record
    np.testing.assert_allclose(flat, want, rtol=1e-15)


def test_insert_sets_values_and_drops_columns_switched_off():
    model = with_values(plane(), (), jnp.zeros(0))
    flat = jnp.arange(9.0)
    positions = Positions(
        jnp.array([4, 9, 12345]), jnp.array([8]), leaves_at(model, np.array([4, 8]))
    )
    changed, state = insert(model, flat, positions, jnp.array([-4.0, 1e6, 1e6]), jnp.array([-8.0]))
    np.testing.assert_array_equal(flatten(changed)[0], [0.0, 1.0, 2.0, 3.0, -4.0, 5.0, 6.0])
    np.testing.assert_array_equal(state, [7.0, -8.0])
    np.testing.assert_array_equal(changed.mass, -4.0)

    def all_numbers(values):
        model_at, state_at = insert(model, flat, positions, values[:3], values[3:])
        return jnp.concatenate([flatten(model_at)[0], state_at])

    jacobian = jax.jacfwd(all_numbers)(jnp.zeros(4))
    want = np.zeros((9, 4))
    want[4, 0] = want[8, 3] = 1.0
    np.testing.assert_array_equal(jacobian, want)


def test_matrices_inconsistent_with_names_are_refused():
    with pytest.raises(
        InputError,
        match=r"B has shape \(1, 2\), but the channel names need "
        r"\(1, 1\)",
    ):
        LinearModel(
            [[1.0]], [[1.0, 2.0]], [[1.0]], [[0.0]], states=("x",), inputs=("u",), outputs=("x",)
        )


# Known initial states -----------------------------------------------------------------------------


def fall(**constants):
    """Record of `q' = 1` from q = -0.1, measured with an error that grows from 0.05."""
    t = 0.1 * np.arange(30)
    z = (-0.05 + t + 0.02 * t**2)[:, None]
    return record(t, np.ones((30, 1)), z, inputs=("elevator",), outputs=("q",), constants=constants)


def test_constants_of_a_record_are_its_known_initial_states():
    model = with_values(plane(), (), jnp.zeros(0))
    given = stack([fall(**{"initial_state.q": q}) for q in (-0.1, 0.7)])
    starts = flat_vectors(model, given)[:, 7:]
    # alpha stays the model's, a tenth of the mass; q is not the first measurement, -0.05
    np.testing.assert_array_equal(starts, [[0.2, -0.1], [0.2, 0.7]])
    both = fall(**{"initial_state.alpha": 0.3, "initial_state.q": -0.1})
    np.testing.assert_array_equal(first_state(model, both), [0.3, -0.1])


def test_initial_state_is_the_first_valid_sample_of_each_output():
    t, z = 0.1 * np.arange(30), np.arange(60.0).reshape(30, 2)
    z[:3, 1] = np.nan
    names = {"inputs": ("elevator",), "outputs": ("alpha", "q")}
    given = record(t, np.ones((30, 1)), z, **names)
    A, B = np.eye(2), np.ones((2, 1))
    model = LinearModel(A, B, A, 0 * B, states=names["outputs"], **names)
    np.testing.assert_array_equal(model.initial_state(given), [0.0, 7.0])


def test_known_initial_state_is_not_estimated_and_starts_the_simulation():
    """`q = q(0) + gain t`: the line through the known q(0), and the free line."""
    zero, one = np.zeros((1, 1)), np.ones((1, 1))
    channels = {"states": ("q",), "inputs": ("elevator",), "outputs": ("q",)}
    model = LinearModel(zero, one, one, zero, **channels)
    given = fall(**{"initial_state.q": -0.1})
    fit = estimate(model, free(model, "B[0,0]"), given, OutputError())
    t, z = np.asarray(given.t), np.asarray(given.z)[:, 0]
    np.testing.assert_allclose(fit.values, [t @ (z + 0.1) / (t @ t)], rtol=1e-8)
    both = free(model, "B[0,0]", per_record=("initial_state",))
    fit = estimate(model, both, given, OutputError())
    np.testing.assert_allclose([*fit.values, *fit.own[0]], np.polyfit(t, z, 1), rtol=1e-6)


def test_initial_state_of_an_unknown_state_is_refused():
    with pytest.raises(InputError, match=r"no state .of a record's constant.*'beta'.*alpha, q"):
        flat_vectors(plane(), stack([fall(**{"initial_state.beta": 0.1})]))


def test_parts_of_a_record_that_start_later_have_no_known_initial_state():
    given = fall(**{"initial_state.q": -0.1, "mass": 3.0})
    assert set(given.window(0, 9).constants) == {"initial_state.q", "mass"}
    assert set(given.window(9).constants) == {"mass"}
    assert all(set(piece.constants) == {"mass"} for piece in segment(given, 1.0))
    assert set(cut(stack([given]), 10).constants) == {"mass"}
