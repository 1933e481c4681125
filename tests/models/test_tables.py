"""Tables: equal to the interpolation of full axes by independent codes, differentiable everywhere,
with clear errors.
"""

import interpax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator, RegularGridInterpolator

from jaxid._foundation.checks import InputError
from jaxid.models.names import parameter_names
from jaxid.models.tables import Table, range_violations, require_inside

METHODS = ("linear", "cubic", "monotone")
KNOTS = np.array([-0.4, -0.1, 0.0, 0.3, 0.35, 0.8, 1.1])
OTHER = np.array([-1.0, 0.0, 0.5, 2.0])


@jax.jit
def look(table, points):
    """Values along columns of points, one column for each axis."""
    return jax.vmap(lambda point: table(dict(zip(table.axes, point, strict=True))))(points)


def line(values, **options):
    return Table(values, [KNOTS], ["alpha"], **options)


@pytest.fixture
def values(seed):
    return np.random.default_rng(seed).normal(size=KNOTS.size)


@pytest.fixture
def grid(seed):
    return np.random.default_rng(seed).normal(size=(KNOTS.size, OTHER.size, 3, 2))


@pytest.mark.parametrize("method", METHODS)
def test_stencil_interpolation_equals_interpolation_over_full_axis(values, method):
    points = np.sort(np.concatenate([np.linspace(KNOTS[0], KNOTS[-1], 200), KNOTS]))
    result = look(line(values, interpolation=method), jnp.asarray(points)[:, None])
    word = "monotonic" if method == "monotone" else method
    with jax.numpy_rank_promotion("allow"):
        full_axis = interpax.interp1d(
            jnp.asarray(points), jnp.asarray(KNOTS), jnp.asarray(values), word
        )
    np.testing.assert_allclose(
        result, full_axis, rtol=0, atol=1e-14
    )  # values of size one: rounding
    if method == "monotone":
        np.testing.assert_allclose(
            result, PchipInterpolator(KNOTS, values)(points), rtol=0, atol=1e-14
        )


@pytest.mark.parametrize("method", METHODS)
def test_values_at_knots_are_reproduced(grid, method):
    table = Table(
        grid,
        [KNOTS, OTHER, [0.0, 1.0, 3.0]],
        ["a", "b", "c"],
        quantities=["x", "y"],
        interpolation=method,
    )
    mesh = np.stack(np.meshgrid(KNOTS, OTHER, [0.0, 1.0, 3.0], indexing="ij"), -1)
    result = look(table, jnp.asarray(mesh.reshape(-1, 3))).reshape(grid.shape)
    np.testing.assert_allclose(result, grid, rtol=0, atol=1e-15)


def test_linear_table_of_three_axes_equals_scipy_inside_and_outside(grid, seed):
    knots = (KNOTS, OTHER, np.array([0.0, 1.0, 3.0]))
    table = Table(grid, knots, ["a", "b", "c"], quantities=["x", "y"], extrapolation="linear")
    points = np.random.default_rng(seed).uniform([-0.6, -2.0, -1.0], [1.4, 3.0, 4.0], (300, 3))
    scipy = RegularGridInterpolator(knots, grid, bounds_error=False, fill_value=None)
    np.testing.assert_allclose(
        look(table, jnp.asarray(points)), scipy(points), rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("method", ["cubic", "monotone"])
def test_table_of_two_axes_equals_successive_interpolation(grid, method):
    values, word = grid[..., 0, 0], "monotonic" if method == "monotone" else method
    table = Table(values, [KNOTS, OTHER], ["a", "b"], interpolation=method)
    points = np.random.default_rng(3).uniform([-0.4, -1.0], [1.1, 2.0], (40, 2))

    def successive(point):
        across = interpax.interp1d(point[0], jnp.asarray(KNOTS), jnp.asarray(values), word)
        return interpax.interp1d(point[1], jnp.asarray(OTHER), across, word)

    with jax.numpy_rank_promotion("allow"):
        expected = jax.jit(jax.vmap(successive))(jnp.asarray(points))
    np.testing.assert_allclose(look(table, jnp.asarray(points)), expected, rtol=0, atol=1e-14)


def test_monotone_table_never_exceeds_data(values):
    points = np.linspace(KNOTS[0], KNOTS[-1], 2000)
    result = np.asarray(look(line(values, interpolation="monotone"), jnp.asarray(points)[:, None]))
    cell = np.clip(np.searchsorted(KNOTS, points, side="right") - 1, 0, KNOTS.size - 2)
    low, high = (
        np.minimum(values[cell], values[cell + 1]),
        np.maximum(values[cell], values[cell + 1]),
    )
    assert np.all(result >= low - 1e-14)
    assert np.all(result <= high + 1e-14)
    cubic = np.asarray(look(line(values, interpolation="cubic"), jnp.asarray(points)[:, None]))
    assert np.any((cubic < low - 1e-3) | (cubic > high + 1e-3))  # so the test can fail


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("extrapolation", ["hold", "linear"])
def test_table_outside_knots_is_constant_or_linear(values, method, extrapolation):
    table = line(values, interpolation=method, extrapolation=extrapolation)
    edges = jnp.array([KNOTS[0], KNOTS[-1]])[:, None]
    # A second derivative of some hundreds changes the slope by 1e-3 over 1e-6.
    inside = jnp.array([1e-6, -1e-6])[:, None]
    slope = (look(table, edges + inside) - look(table, edges)) / inside[:, 0]
    far = look(table, edges - 3e5 * inside)
    expected = values[[0, -1]] + (
        slope * np.array([-0.3, 0.3]) if extrapolation == "linear" else 0.0
    )
    np.testing.assert_allclose(far, expected, rtol=0, atol=1e-3 if extrapolation == "linear" else 0)


@pytest.mark.parametrize("extrapolation", ["hold", "linear", "refuse"])
@pytest.mark.parametrize("method", ["cubic", "monotone"])
def test_derivative_by_signal_equals_finite_differences_across_knots(values, method, extrapolation):
    table = line(values, interpolation=method, extrapolation=extrapolation)
    points = np.concatenate([KNOTS[1:-1], np.linspace(-0.39, 1.09, 50)])
    if extrapolation != "refuse":
        points = np.concatenate([points, [-0.7, 1.5]])
    slope = jax.jit(jax.vmap(jax.grad(lambda a: table({"alpha": a}))))(jnp.asarray(points))
    step = 1e-6
    ahead, back = (look(table, jnp.asarray(points + s)[:, None]) for s in (step, -step))
    # the curvature jumps at a knot
    np.testing.assert_allclose(slope, (ahead - back) / (2 * step), rtol=0, atol=3e-3)
    away = np.abs(points[:, None] - KNOTS).min(1) > 2 * step
    np.testing.assert_allclose(slope[away], ((ahead - back) / (2 * step))[away], rtol=0, atol=2e-8)


@pytest.mark.parametrize("method", METHODS)
def test_derivative_by_values_equals_finite_differences(grid, method):
    table = Table(
        grid[..., 0, 0], [KNOTS, OTHER], ["a", "b"], interpolation=method, extrapolation="linear"
    )
    points = jnp.array([[-0.33, 1.3], [0.2, -0.7], [1.3, 2.2]])

    def value(values):
        return look(
            Table(values, table.knots, table.axes, interpolation=method, extrapolation="linear"),
            points,
        )

    slope = np.asarray(jax.jit(jax.jacfwd(value))(table.values))
    assert np.all(np.isfinite(slope))
    for index in ((0, 2), (3, 0), (6, 3)):
        step = np.zeros(table.values.shape)
        step[index] = 1e-6
        difference = (value(table.values + step) - value(table.values - step)) / 2e-6
        np.testing.assert_allclose(slope[:, *index], difference, rtol=0, atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("extrapolation", ["hold", "linear", "refuse"])
def test_derivatives_are_finite_at_knots_and_for_equal_values(method, extrapolation):
    table = line(
        np.array([0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]),
        interpolation=method,
        extrapolation=extrapolation,
    )
    points = jnp.concatenate([jnp.asarray(KNOTS), jnp.array([-0.2, 0.1, -5.0, 5.0])])
    by_point = jax.jit(jax.vmap(jax.grad(lambda a: table({"alpha": a}))))(points)
    by_value = jax.jit(jax.jacfwd(look))(table, points[:, None]).values
    assert jnp.all(jnp.isfinite(by_point))
    assert jnp.all(jnp.isfinite(by_value))


def test_table_of_two_quantities_equals_separate_tables(grid):
    values = grid[:, :, 0, :]
    both = Table(
        values, [KNOTS, OTHER], ["a", "b"], quantities=["x", "y"], interpolation="monotone"
    )
    points = jnp.array([[0.2, 0.1], [1.0, -0.9]])
    for k in range(2):
        alone = Table(values[..., k], [KNOTS, OTHER], ["a", "b"], interpolation="monotone")
        # A compiler may contract the same sums in another way, which causes a few rounding errors.
        np.testing.assert_allclose(
            look(both, points)[:, k], look(alone, points), rtol=1e-15, atol=1e-15
        )


def test_short_axes_use_interpolation_of_available_knots():
    for method in METHODS:
        two = Table([1.0, 3.0], [[0.0, 2.0]], ["a"], interpolation=method, extrapolation="linear")
        np.testing.assert_allclose(two({"a": jnp.array(3.0)}), 4.0, rtol=1e-15)
    three = Table([1.0, 3.0, 4.0], [[0.0, 1.0, 3.0]], ["a"], interpolation="monotone")
    expected = PchipInterpolator([0.0, 1.0, 3.0], [1.0, 3.0, 4.0])(2.2)
    np.testing.assert_allclose(three({"a": jnp.array(2.2)}), expected, rtol=1e-15)


def test_names_of_angle_axis_have_degrees():
    knots = [np.deg2rad([-10.0, 20.0]), [0.0, 0.5]]
    table = Table(np.zeros((2, 2)), knots, ["alpha", "mach"], units=["rad", ""])
    assert parameter_names(table) == (
        "alpha=-10,mach=0",
        "alpha=-10,mach=0.5",
        "alpha=20,mach=0",
        "alpha=20,mach=0.5",
    )
    two_quantities = Table(
        np.zeros((2, 2)), knots[:1], ["alpha"], units=["rad"], quantities=["Cl", "Cn"]
    )
    assert parameter_names(two_quantities) == (
        "Cl.alpha=-10",
        "Cn.alpha=-10",
        "Cl.alpha=20",
        "Cn.alpha=20",
    )


def test_refused_extrapolation_is_nan_or_error():
    table = Table(
        [0.0, 1.0], [np.deg2rad([-10.0, 20.0])], ["alpha"], units=["rad"], extrapolation="refuse"
    )
    assert jnp.isnan(table({"alpha": jnp.array(0.5)}))
    assert not jnp.isnan(table({"alpha": jnp.array(0.3)}))
    require_inside(table, {"alpha": np.deg2rad([-10.0, 20.0])})
    with pytest.raises(
        InputError,
        match=r"alpha reaches 24.5 deg, the range is -10 to 20 deg. "
        r"Keep inside",
    ):
        require_inside(table, {"alpha": np.deg2rad([0.0, 24.5, 21.0])})


def test_outside_lists_every_signal_beyond_limits():
    limits = {"alpha": (0.0, 1.0), "mach": (0.2, 0.8), "beta": (-1.0, 1.0)}
    signals = {
        "alpha": np.array([0.5, -0.25, np.nan]),
        "mach": np.array(0.9),
        "other": np.array(5.0),
    }
    assert range_violations(limits, signals) == (
        "alpha reaches -0.25, the range is 0 to 1",
        "mach reaches 0.9, the range is 0.2 to 0.8",
    )
    assert range_violations(limits, {"alpha": np.array([0.5, np.nan])}) == ()


def test_missing_signal_of_axis_is_refused():
    with pytest.raises(InputError, match=r"no signal 'alpha'"):
        line(np.zeros(7))({"beta": jnp.zeros(())})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"knots": [[0.0, 1.0, 1.0]]}, "axis 'a' do not increase: 1.0 follows 1.0"),
        ({"knots": [[0.0, 2.0, 1.0]]}, "1.0 follows 2.0. Sort them"),
        ({"knots": [[0.0, np.nan, 1.0]]}, "a knot of axis 'a' is not finite"),
        ({"knots": [[0.0]], "values": [1.0]}, "has 1 knots. Give two or more"),
        ({"values": [0.0, np.nan, 1.0]}, "the value at a=1 is not finite"),
        ({"values": [0.0, 1.0]}, r"values of shape \(2,\), and knots and quantities make \(3,\)"),
        ({"axes": ["a", "b"]}, "1 lines of knots for 2 axes"),
        ({"axes": [], "knots": []}, "it has 0 axes"),
        ({"units": ["rad", "rad"]}, "2 units for 1 axes"),
        ({"quantities": ["x", "x"], "values": np.zeros((3, 2))}, "quantity name 'x' occurs twice"),
    ],
)
def test_invalid_tables_are_refused_with_reason(change, words):
    given = {"values": [0.0, 1.0, 2.0], "knots": [[0.0, 1.0, 2.0]], "axes": ["a"]} | change
    with pytest.raises(InputError, match=words):
        Table(np.asarray(given.pop("values")), given.pop("knots"), given.pop("axes"), **given)
