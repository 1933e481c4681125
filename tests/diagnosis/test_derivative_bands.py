"""Derivatives of identified responses along records, and their deviations by hand."""

import numpy as np
import pytest
from polynomial_swing import SIGMA, flown, swing

from jaxid import FixedNoise, OutputError, identify
from jaxid._foundation.checks import InputError
from jaxid.estimation.coloured_errors import colour_ratio
from jaxid.study import IdentifyOptions

TERMS = ("x", "v", "force", "x^3")


@pytest.fixture(scope="module")
def record():
    return flown(0, rows=200)[0]


@pytest.fixture(scope="module")
def result(record):
    """The cubic term keeps the value of the regression."""
    options = IdentifyOptions(
        terms={"stiffness": TERMS}, keep=("stiffness",), share=0.0, fix={"stiffness": ("x^3",)}
    )
    known = FixedNoise([SIGMA["x"] ** 2, SIGMA["v"] ** 2])
    return identify(swing({}), record, options=options, likelihood=OutputError(known))


def test_slope_has_the_variances_of_both_stages(result, record):
    """stiffness = a x + b x^3 + ...: the slope is a + 3 b x^2, with a estimated and b regressed."""
    band = result.derivatives(record, {"stiffness": ("x",)})["dstiffness/dx"]
    polynomial, fit = result.model.stiffness, result.estimate
    value = dict(zip(polynomial.terms, np.asarray(polynomial.coefficients), strict=True))
    x = np.asarray(record.channel("x"))
    np.testing.assert_allclose(
        np.asarray(band.value)[0], value["x"] + 3.0 * value["x^3"] * x**2, rtol=1e-10
    )
    error = float(fit.standard_error("stiffness.x"))
    ratio = colour_ratio(fit.standard_errors, fit.corrected_errors)
    error *= float(ratio[fit.names.index("stiffness.x")])
    regression = result.equations["stiffness"].regression
    kept = regression.standard_errors[regression.names.index("x^3")]
    np.testing.assert_allclose(
        np.asarray(band.deviation)[0], np.hypot(error, 3.0 * kept * x**2), rtol=1e-6
    )


def test_shorter_record_is_padded(record):
    shorter = record.window(0, 150)
    options = IdentifyOptions(terms={"stiffness": TERMS}, keep=("stiffness",), share=0.0)
    result = identify(swing({}), [record, shorter], options=options)
    band = result.derivatives([record, shorter], {"stiffness": ("x", "force")})
    assert list(band) == ["dstiffness/dx", "dstiffness/dforce"]
    x = np.asarray(band["dstiffness/dx"].value)
    np.testing.assert_array_equal(x[1], [*x[0, :150], *np.zeros(50)])


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ({"damping": ("x",)}, "no response with an equation 'damping'"),
        ({"stiffness": ("rudder",)}, "no signal 'rudder'"),
    ],
)
def test_unknown_names_are_refused(result, record, pairs, words):
    with pytest.raises(InputError, match=words):
        result.derivatives(record, pairs)
