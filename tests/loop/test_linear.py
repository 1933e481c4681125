"""The linear value of a change: additions, pairs, swaps and removals by one formula."""

import itertools

import numpy as np
import pytest

from jaxid.loop.linear import Triangle, falls, gains, joint_fall, largest_falls, reduce

NAMES = ("a", "b", "c", "d", "e", "f")
FREE = np.array([True, True, True, False, False, False])


@pytest.fixture(scope="module")
def regression():
    """A linear model `v = S p + noise`, of which the first three parameters were fitted."""
    rng = np.random.default_rng(3)
    S = rng.normal(size=(60, 6))
    S[:, 4] += 0.8 * S[:, 5]
    z = S @ np.array([1.0, -2.0, 0.7, 0.4, 0.3, -0.3]) + rng.normal(size=60)
    values = np.zeros(6)
    values[FREE] = np.linalg.lstsq(S[:, FREE], z, rcond=None)[0]
    v = z - S @ values
    factor = np.linalg.qr(np.column_stack([S, v]), mode="r")
    return S, z, v, Triangle(NAMES, factor, FREE, values)


def fall(triangle, out, into):
    reduced = reduce(triangle, out)
    return falls(reduced, np.array([into]))[0] if into else reduced.base


def chi_square(S, z, columns):
    p = np.linalg.lstsq(S[:, columns], z, rcond=None)[0]
    return np.sum((z - S[:, columns] @ p) ** 2)


@pytest.mark.parametrize(
    ("out", "into"),
    [("", "d"), ("", "de"), ("", "def"), ("c", "d"), ("bc", "e"), ("c", ""), ("bc", "")],
)
def test_fall_equals_refit_of_linear_model(regression, out, into):
    S, z, v, triangle = regression
    columns = [k for k, n in enumerate(NAMES) if (FREE[k] and n not in out) or n in into]
    refitted = v @ v - chi_square(S, z, columns)
    expected = fall(triangle, triangle.at(out), triangle.at(into))
    assert expected == pytest.approx(refitted, rel=1e-9)


def test_joint_fall_of_overlapping_columns_equals_fall_of_their_span(regression):
    """A column given twice adds no direction."""
    *_, triangle = regression
    names = triangle.names
    double = triangle._replace(
        names=(*names, "e again"),
        factor=np.insert(triangle.factor, -1, 2.0 * triangle.factor[:, names.index("e")], axis=1),
        free=np.append(triangle.free, False),
        values=np.append(triangle.values, 0.0),
    )
    expected = fall(triangle, [], triangle.at("de"))
    found, dof = joint_fall(reduce(double), double.at([*"de", "e again"]))
    assert found == pytest.approx(expected, rel=1e-9)
    assert dof == 2


def test_gains_equal_refit_of_linear_model(regression):
    S, z, _, triangle = regression
    refit = np.linalg.lstsq(S[:, [0, 1, 2, 3, 4]], z, rcond=None)[0]
    expected = gains(reduce(triangle), triangle.at("de"))
    assert expected == pytest.approx(refit[3:], rel=1e-9)


def test_addition_of_one_equals_score_test(regression):
    """Rao's score `(s' v)^2 / (s' s)`, with the part of the column orthogonal to the free ones."""
    S, _, v, triangle = regression
    single = falls(reduce(triangle), np.array([[3], [4], [5]]))
    s = S[:, 3:] - S[:, FREE] @ np.linalg.lstsq(S[:, FREE], S[:, 3:], rcond=None)[0]
    assert single == pytest.approx((s.T @ v) ** 2 / np.sum(s**2, axis=0), rel=1e-9)


def test_column_that_the_free_ones_reproduce_has_no_value():
    rng = np.random.default_rng(4)
    S = rng.normal(size=(30, 3))
    S = np.column_stack([S, S[:, 0] - S[:, 1], S[:, 2]])
    factor = np.linalg.qr(np.column_stack([S, rng.normal(size=30)]), mode="r")
    free = np.array([True, True, False, False, False])
    triangle = Triangle(NAMES[:5], factor, free, np.zeros(5))
    assert fall(triangle, (), (3,)) == -np.inf
    assert fall(triangle, (), (2, 4)) == -np.inf
    assert np.isfinite(fall(triangle, (), (2,)))


@pytest.mark.parametrize("members", [1, 2])
def test_largest_fall_of_many_sides_equals_fall_of_each(regression, members):
    S, _, _, triangle = regression
    rng = np.random.default_rng(5)
    into = np.array([*itertools.combinations((3, 4, 5), members)])
    reduced = reduce(triangle)
    sides = rng.normal(size=(7, S.shape[1]))
    each = [np.max(falls(reduced._replace(product=side), into)) for side in sides]
    np.testing.assert_allclose(largest_falls(reduced.correlation, sides, into), each, rtol=1e-12)
    zero = np.zeros_like(reduced.correlation)
    assert np.all(largest_falls(zero, sides, into) == 0.0)


@pytest.mark.parametrize(("share", "counts"), [(1e-3, False), (1e-2, True)])
def test_candidate_that_free_parameters_nearly_reproduce_has_no_fall(share, counts):
    """Its gain would rest on the exact shapes of their columns, which are not known so well."""
    rng = np.random.default_rng(4)
    S = np.linalg.qr(rng.normal(size=(50, 4)))[0]
    S[:, 3] = S[:, 0] - S[:, 1] + share * S[:, 3]
    factor = np.linalg.qr(np.column_stack([S, rng.normal(size=50)]), mode="r")
    triangle = Triangle(NAMES[:4], factor, np.array([True, True, True, False]), np.zeros(4))
    assert np.isfinite(fall(triangle, [], triangle.at("d"))) == counts
