"""Figures of an identification: the lines and bands are the estimates and two deviations."""

import numpy as np
import pytest
from polynomial_swing import flown, identified

from jaxid._foundation.checks import InputError


@pytest.fixture(scope="module")
def flight():
    return flown(0, rows=100)


@pytest.fixture(scope="module")
def result(flight):
    return identified(flight[0])


def half_width(ax):
    """Half of the height of the band at each sample."""
    vertices = ax.collections[0].get_paths()[0].vertices
    x = np.unique(vertices[:, 0])
    return np.array([np.ptp(vertices[vertices[:, 0] == at, 1]) / 2.0 for at in x])


def test_outputs_are_drawn_with_the_band_of_a_repeated_measurement(result, flight):
    axes = result.plot().axes
    assert [ax.get_ylabel() for ax in axes] == ["x", "v"]
    bands = result.prediction_bands().measured
    for ax, name in zip(axes, ("x", "v"), strict=True):
        measured, fitted = (one.get_ydata() for one in ax.lines)
        np.testing.assert_allclose(measured, flight[0].channel(name))
        np.testing.assert_allclose(fitted, bands[name].value[0])
        np.testing.assert_allclose(half_width(ax), 2.0 * np.asarray(bands[name].deviation)[0])
    with pytest.raises(InputError, match="There is no record 1 among 1"):
        result.plot(case=1)


def test_coefficients_are_drawn_with_combined_bands_and_truth(result, flight):
    record, true = flight
    deviations = {"scale": 0.01}
    truth = {"stiffness": true}
    (ax,) = result.plot(0, record, deviations=deviations, truth=truth).axes
    band = result.combined_bands(record, deviations)["stiffness"]
    measured, estimated, drawn = (one.get_ydata() for one in ax.lines)
    np.testing.assert_allclose(measured, record.channel("vdot"))
    np.testing.assert_allclose(estimated, band.value[0])
    np.testing.assert_array_equal(drawn, true)
    np.testing.assert_allclose(half_width(ax), 2.0 * np.asarray(band.deviation)[0])


def test_derivatives_are_drawn_in_place_of_coefficients(result, flight):
    record, _ = flight
    pairs = {"stiffness": ("force", "v")}
    axes = result.plot(0, record, derivatives=pairs).axes
    bands = result.derivatives(record, pairs)
    assert [ax.get_ylabel() for ax in axes] == list(bands)
    for ax, band in zip(axes, bands.values(), strict=True):
        np.testing.assert_allclose(ax.lines[0].get_ydata(), band.value[0])


@pytest.mark.parametrize(
    ("truth", "words"),
    [
        ({"Cm": np.zeros(100)}, "no history .* 'Cm'"),
        ({"stiffness": np.zeros(99)}, r"has shape \(99,\), and the record has 100 samples"),
    ],
)
def test_truth_of_another_response_or_length_is_refused(result, flight, truth, words):
    with pytest.raises(InputError, match=words):
        result.plot(0, flight[0], truth=truth)
