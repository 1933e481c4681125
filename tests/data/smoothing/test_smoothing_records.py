"""Smoothing of records: replaced channels, added derivatives, refused gaps and names."""

import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.data import record, stack
from jaxid.data.smoothing import Fourier, LocalPolynomial, SmoothingSpline, differentiate, smooth

N, STEP = 200, 0.02
METHOD = Fourier(2.0)


def flight(rows=N, missing=(), t=None):
    t = np.arange(rows) * STEP if t is None else t
    rng = np.random.default_rng(1)
    z = np.stack([np.sin(2 * t), 0.1 * np.cos(3 * t)], axis=1) + 0.01 * rng.normal(size=(len(t), 2))
    z[list(missing), 0] = np.nan
    u = 0.1 * np.sin(t) + 0.001 * rng.normal(size=len(t))
    units = {"stabilator": "rad", "q": "rad/s", "mach": ""}
    return record(
        t,
        u,
        z,
        inputs=("stabilator",),
        outputs=("q", "mach"),
        units=units,
        name="one",
        constants={"mass": 9.0},
    )


def test_smooth_replaces_only_named_channels():
    r = flight()
    result = smooth(r, ("q", "stabilator"), METHOD)
    for name in ("q", "stabilator"):
        np.testing.assert_array_equal(result.channel(name), METHOD(r.t, r.channel(name)).value)
    np.testing.assert_array_equal(result.channel("mach"), r.channel("mach"))
    assert (result.outputs, result.inputs, result.output_units, result.names) == (
        r.outputs,
        r.inputs,
        r.output_units,
        r.names,
    )
    np.testing.assert_array_equal(result.t, r.t)


def test_derivatives_follow_outputs_with_their_units():
    r = flight()
    result = differentiate(
        r, {"q": "qdot", "stabilator": "stabilator_rate", "mach": "mach_rate"}, METHOD
    )
    assert result.outputs == ("q", "mach", "qdot", "stabilator_rate", "mach_rate")
    assert result.output_units == ("rad/s", "", "rad/s^2", "rad/s", "")
    np.testing.assert_array_equal(result.channel("qdot"), METHOD(r.t, r.channel("q")).derivative)
    np.testing.assert_array_equal(result.channel("q"), r.channel("q"))
    assert np.asarray(result.mask).all()
    assert float(result.constants["mass"]) == 9.0
    # Noise of 0.01 causes noise of about 0.05 in the derivative; smoothing removes 0.1 of the
    # derivative at the ends.
    np.testing.assert_allclose(
        result.channel("qdot")[20:-20], 2 * np.cos(2 * r.t[20:-20]), atol=0.25
    )


def test_gaps_are_refused_or_filled_and_stay_missing():
    r = flight(missing=(50, 51, 52))
    with pytest.raises(
        InputError,
        match=r"'one', channel 'q': 3 samples are missing after row 49.*0\.08 "
        r"s.*longest_gap",
    ):
        smooth(r, ("q",), METHOD)
    result = smooth(r, ("q",), METHOD, longest_gap=0.08)
    assert np.isnan(result.channel("q")).sum() == 3
    assert not np.asarray(result.mask)[50:53, 0].any()
    complete = smooth(flight(), ("q",), METHOD)
    valid = np.asarray(result.mask)[:, 0]
    # two standard deviations of the noise
    np.testing.assert_allclose(result.z[valid, 0], complete.z[valid, 0], atol=0.02)
    rate = differentiate(r, {"q": "qdot"}, METHOD, longest_gap=0.08)
    np.testing.assert_array_equal(rate.mask[:, 2], r.mask[:, 0])
    with pytest.raises(InputError, match="missing at an end"):
        smooth(flight(missing=(0,)), ("q",), METHOD, longest_gap=1.0)


def test_stack_is_smoothed_case_by_case():
    cases = [flight(), flight(150)]
    result = differentiate(smooth(stack(cases), ("q",), METHOD), {"mach": "rate"}, METHOD)
    assert result.t.shape == (2, N)
    for smoothed, case in zip(result, cases, strict=True):
        alone = differentiate(smooth(case, ("q",), METHOD), {"mach": "rate"}, METHOD)
        np.testing.assert_array_equal(smoothed.z, alone.z)


def test_uneven_times_are_accepted_by_spline_only():
    r = flight(t=np.cumsum(np.random.default_rng(2).uniform(0.01, 0.03, N)))
    for method in (METHOD, LocalPolynomial()):
        with pytest.raises(
            InputError, match=r"'one', channel 'q': .*evenly spaced.*SmoothingSpline"
        ):
            smooth(r, ("q",), method)
    result = smooth(r, ("q",), SmoothingSpline())
    # two standard deviations of the noise
    np.testing.assert_allclose(result.channel("q"), np.sin(2 * r.t), atol=0.02)


def test_unknown_or_repeated_channel_names_are_refused():
    r = flight()
    with pytest.raises(InputError, match=r"no channel 'p'.*q, mach"):
        smooth(r, ("p",), METHOD)
    with pytest.raises(InputError, match=r"the string 'q'.*\('q',\)"):
        smooth(r, "q", METHOD)
    with pytest.raises(InputError, match="'mach' occurs twice"):
        differentiate(r, {"q": "mach"}, METHOD)
    with pytest.raises(InputError, match="no channel to smooth"):
        smooth(r, (), METHOD)
