"""Smoothing of records: what is replaced, what is added, what is refused."""

import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.data import Fourier, LocalPolynomial, SmoothingSpline, differentiate, record, smooth, stack

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
        t, u, z, inputs=("stabilator",), outputs=("q", "mach"), units=units, name="one", constants={"mass": 9.0}
    )


def test_only_the_named_channels_are_replaced():
    r = flight()
    found = smooth(r, ("q", "stabilator"), METHOD)
    for name in ("q", "stabilator"):
        np.testing.assert_array_equal(found.channel(name), METHOD(r.t, r.channel(name)).value)
    np.testing.assert_array_equal(found.channel("mach"), r.channel("mach"))
    assert (found.outputs, found.inputs, found.output_units, found.names) == (
        r.outputs,
        r.inputs,
        r.output_units,
        r.names,
    )
    np.testing.assert_array_equal(found.t, r.t)


def test_derivatives_come_after_the_outputs_with_their_units():
    r = flight()
    found = differentiate(r, {"q": "qdot", "stabilator": "stabilator_rate", "mach": "mach_rate"}, METHOD)
    assert found.outputs == ("q", "mach", "qdot", "stabilator_rate", "mach_rate")
    assert found.output_units == ("rad/s", "", "rad/s^2", "rad/s", "")
    np.testing.assert_array_equal(found.channel("qdot"), METHOD(r.t, r.channel("q")).derivative)
    np.testing.assert_array_equal(found.channel("q"), r.channel("q"))
    assert np.asarray(found.mask).all()
    assert float(found.constants["mass"]) == 9.0
    # 0.01 of noise; Fourier leaves about 0.05 of it in the slope, and takes 0.1 of the slope at the ends
    np.testing.assert_allclose(found.channel("qdot")[20:-20], 2 * np.cos(2 * r.t[20:-20]), atol=0.25)


def test_gaps_are_refused_or_bridged_and_stay_missing():
    r = flight(missing=(50, 51, 52))
    with pytest.raises(
        InputError, match=r"'one', channel 'q': 3 samples are missing after row 49.*0\.08 s.*longest_gap"
    ):
        smooth(r, ("q",), METHOD)
    found = smooth(r, ("q",), METHOD, longest_gap=0.08)
    assert np.isnan(found.channel("q")).sum() == 3
    assert not np.asarray(found.mask)[50:53, 0].any()
    whole = smooth(flight(), ("q",), METHOD)
    there = np.asarray(found.mask)[:, 0]
    np.testing.assert_allclose(found.z[there, 0], whole.z[there, 0], atol=0.02)  # two standard deviations of the noise
    rate = differentiate(r, {"q": "qdot"}, METHOD, longest_gap=0.08)
    np.testing.assert_array_equal(rate.mask[:, 2], r.mask[:, 0])
    with pytest.raises(InputError, match="missing at an end"):
        smooth(flight(missing=(0,)), ("q",), METHOD, longest_gap=1.0)


def test_a_stack_is_smoothed_case_by_case():
    cases = [flight(), flight(150)]
    found = differentiate(smooth(stack(cases), ("q",), METHOD), {"mach": "rate"}, METHOD)
    assert found.t.shape == (2, N)
    for one, case in zip(found, cases, strict=True):
        alone = differentiate(smooth(case, ("q",), METHOD), {"mach": "rate"}, METHOD)
        np.testing.assert_array_equal(one.z, alone.z)


def test_uneven_times_are_for_the_spline():
    r = flight(t=np.cumsum(np.random.default_rng(2).uniform(0.01, 0.03, N)))
    for method in (METHOD, LocalPolynomial()):
        with pytest.raises(InputError, match=r"'one', channel 'q': .*evenly spaced.*SmoothingSpline"):
            smooth(r, ("q",), method)
    found = smooth(r, ("q",), SmoothingSpline())
    np.testing.assert_allclose(found.channel("q"), np.sin(2 * r.t), atol=0.02)  # two standard deviations of the noise


def test_names_are_checked():
    r = flight()
    with pytest.raises(InputError, match=r"no channel 'p'.*q, mach"):
        smooth(r, ("p",), METHOD)
    with pytest.raises(InputError, match=r"the string 'q'.*\('q',\)"):
        smooth(r, "q", METHOD)
    with pytest.raises(InputError, match="'mach' occurs twice"):
        differentiate(r, {"q": "mach"}, METHOD)
    with pytest.raises(InputError, match="no channel to smooth"):
        smooth(r, (), METHOD)
