"""Bands with misfit and instruments: coverage of a function that is no polynomial, and parts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from polynomial_swing import SIGMA, flown, identified, swing

import jaxid
from jaxid._foundation.checks import InputError


def test_band_with_misfit_holds_a_function_that_is_no_polynomial():
    """Six records: parameters alone hold little; a band of two deviations about 95 %."""
    shares = []
    for seed in range(6):
        record, true = flown(seed)
        band = identified(record).combined_bands(record)["stiffness"]
        apart = np.abs(np.asarray(band.value)[0] - true)
        shares.append(
            [np.mean(apart <= 2 * np.asarray(d)[0]) for d in (band.parameters, band.deviation)]
        )
    parameters, combined = np.mean(shares, axis=0)
    assert parameters < 0.7
    assert 0.9 < combined < 0.99


def test_misfit_of_the_true_structure_is_small():
    """Without a misfit the difference is white noise, which is subtracted."""
    record, _ = flown(0)
    linear = swing({"1": 0.0, "x": -2.0, "v": -0.4, "force": 1.0})
    t, force = np.asarray(record.t), np.asarray(record.u)
    solution = jaxid.simulate(linear, t, force, np.array([0.1, 0.0]))
    clean = np.asarray(jax.vmap(linear.rhs)(solution.t, solution.x, jnp.asarray(force)))[:, 1]
    rng = np.random.default_rng(1)
    z = np.column_stack([np.asarray(solution.x), clean])
    z = z + rng.normal(size=z.shape) * np.array([*SIGMA.values()])
    other = jaxid.record(t, force, z, inputs=("force",), outputs=tuple(SIGMA))
    band = identified(other).combined_bands(other)["stiffness"]
    assert float(band.misfit) < 0.5 * SIGMA["vdot"]


def test_errors_of_instruments_are_the_changes_of_pseudo_measurements():
    """Two constants that scale the response by 1 and by 2 %, added as independent errors."""
    record, _ = flown(3)
    result = identified(record)
    plain = result.combined_bands(record)["stiffness"]
    band = result.combined_bands(record, {"scale": 0.01, "gain": 0.02})["stiffness"]
    assert float(np.max(plain.instruments)) == 0.0
    size = np.abs(np.asarray(record.channel("vdot")))
    expected = size * np.hypot(1 / 1.01 - 1, 0.02)
    np.testing.assert_allclose(np.asarray(band.instruments)[0], expected, rtol=1e-9)
    np.testing.assert_allclose(band.misfit, plain.misfit, rtol=1e-12)
    parts = (band.parameters, band.misfit, band.instruments)
    total = np.sqrt(sum(np.asarray(part) ** 2 for part in parts))
    np.testing.assert_allclose(band.deviation, total, rtol=1e-12)


@pytest.mark.parametrize(
    ("deviations", "words"),
    [
        ({"scales": 0.01}, "no constant 'scales'"),
        ({"stiffness.x": 0.01}, r"'stiffness\.x' is estimated"),
        ({"scale": 0.0}, "must be positive"),
    ],
)
def test_wrong_constants_are_refused(deviations, words):
    record, _ = flown(3)
    with pytest.raises(InputError, match=words):
        identified(record).combined_bands(record, deviations)
