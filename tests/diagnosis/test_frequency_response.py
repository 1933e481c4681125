"""Frequency response and coherence: exact gains, SciPy, the closed form, noise, refusals."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal
from small_spring import Spring

import jaxid
from jaxid.diagnosis import FrequencyResponse, frequency_response

DT, SAMPLES = 0.05, 4096
T = DT * np.arange(SAMPLES)


def made(u, z, t=T):
    u, z = np.reshape(u, (len(t), -1)), np.reshape(z, (len(t), -1))
    inputs = tuple(f"u{k}" for k in range(u.shape[1]))
    outputs = tuple(f"z{k}" for k in range(z.shape[1]))
    return jaxid.record(t, u, z, inputs=inputs, outputs=outputs)


@pytest.fixture
def noise(seed):
    return np.random.default_rng(seed).normal(size=(3, SAMPLES))


def test_gains_of_two_inputs_are_exact(noise):
    u = noise[:2].T
    response = frequency_response(made(u, 2 * u[:, 0] - 3 * u[:, 1]))
    np.testing.assert_allclose(response.measured[:, 0], [[2, -3]] * len(response.w), atol=1e-9)
    np.testing.assert_allclose(response.coherence, 1, atol=1e-9)
    assert response.errors.max() < 1e-4


def test_inputs_of_different_units_are_both_identified(noise):
    """An elevator [rad] and a thrust [N], whose powers differ by a factor of 6e12."""
    u = noise[:2].T * [0.02, 5e4]
    response = frequency_response(made(u, 3 * u[:, 0] + 5 * u[:, 1]))
    np.testing.assert_allclose(response.measured[:, 0, 1], 5, rtol=1e-9)
    response = frequency_response(made(u, np.column_stack([3 * u[:, 0], 5e-6 * u[:, 1]])))
    np.testing.assert_allclose(response.measured[:, 0, 0], 3, rtol=1e-6)


def test_error_of_a_gain_is_the_one_of_its_input(seed):
    """Of two inputs, whose gains differ by a factor of 100, in 40 simulations."""
    rng = np.random.default_rng(seed)
    gains = np.array([3.0, 0.03])
    responses = []
    for _ in range(40):
        u = rng.normal(size=(SAMPLES, 2))
        z = u @ gains + 0.3 * rng.normal(size=SAMPLES)
        responses.append(frequency_response(made(u, z), seconds=12.8))
    scatter = np.std([np.abs(one.measured[:, 0, 0]) for one in responses], axis=0)
    stated = np.mean([one.errors[:, 0, 0] for one in responses], axis=0)
    # Segments that overlap by half are not independent: the formula is low by some percent.
    assert np.median(scatter / 3.0 / stated) == pytest.approx(1.1, abs=0.15)
    difference = [one.measured[:, 0, 1].real - 0.03 for one in responses]
    stated = np.mean([one.errors[:, 0, 1] * np.abs(one.measured[:, 0, 1]) for one in responses], 0)
    assert np.median(np.std(difference, axis=0) / stated) == pytest.approx(1.1, abs=0.15)


def test_one_input_equals_scipy(noise):
    z = scipy.signal.lfilter([0.5, 0.2], [1, -0.7], noise[0]) + 0.1 * noise[1]
    response = frequency_response(made(noise[0], z), seconds=12.8)
    options = {"fs": 1 / DT, "nperseg": 256, "noverlap": 128, "detrend": "constant"}
    f, cross = scipy.signal.csd(noise[0], z, **options)
    _, power = scipy.signal.welch(noise[0], **options)
    _, coherence = scipy.signal.coherence(noise[0], z, **options)
    np.testing.assert_allclose(response.w, 2 * np.pi * f[1:])
    np.testing.assert_allclose(response.measured[:, 0, 0], (cross / power)[1:], rtol=1e-9)
    np.testing.assert_allclose(response.coherence[:, 0], coherence[1:], rtol=1e-9)
    one_input = np.sqrt((1 - coherence[1:]) / (2 * 31 * coherence[1:]))
    np.testing.assert_allclose(response.errors[:, 0, 0], one_input, rtol=1e-9)
    assert response.segments == 31


def test_coherence_is_the_share_of_the_power_without_noise(noise):
    """Signal and noise have equal power at all frequencies: 1/2, with a scatter of 1/sqrt(n)."""
    response = frequency_response(made(noise[0], noise[0] + noise[1]), seconds=3.2)
    assert np.mean(response.coherence) == pytest.approx(0.5, abs=0.03)
    inside = np.abs(np.abs(response.measured[:, 0, 0]) - 1) < 2 * response.errors[:, 0, 0]
    assert 0.85 < inside.mean() <= 1


def test_model_equals_the_closed_form_and_its_record(noise):
    """At frequencies up to 3 rad/s. Transients of 2 s in segments of 51 s leave some percent."""
    spring = Spring(jnp.array(4.0), jnp.array(1.0))
    u = scipy.signal.lfilter([0.2], [1, -0.8], noise[0])
    y = np.asarray(jaxid.simulate(spring, T, u[:, None], np.zeros(2)).y)
    record = jaxid.record(T, u, y, inputs=("force",), outputs=("x",))
    response = frequency_response(record, spring, seconds=51.2)
    low = response.w < 3
    exact = 1 / (4.0 - response.w[low] ** 2 + 1j * response.w[low])
    deviation = np.abs(response.measured[low, 0, 0] / exact - 1)
    assert deviation.max() < 0.1
    assert np.median(deviation) < 0.05
    np.testing.assert_allclose(response.model, response.measured, rtol=1e-9)


def test_records_are_averaged(noise):
    records = [made(part, 2 * part + z) for part, z in zip(noise, noise[::-1], strict=True)]
    one, all_of_them = frequency_response(records[0]), frequency_response(records)
    stacked = frequency_response(jaxid.stack(records))
    assert all_of_them.segments == 3 * one.segments
    np.testing.assert_array_equal(stacked.measured, all_of_them.measured)


def test_response_is_table_dataset_and_figure(noise):
    spring = Spring(jnp.array(4.0), jnp.array(1.0))
    t = T[:400]
    record = jaxid.record(
        t, noise[0, :400], noise[1, :400], inputs=("force",), outputs=("x",), units={"x": "m"}
    )
    response = frequency_response(record, spring)
    assert "x from force, 8 segments" in str(response)
    assert "coherence" in response._repr_html_()
    dataset = response.to_xarray()
    gain = dataset["model_gain"].sel(output="x", input="force")
    np.testing.assert_allclose(gain, np.abs(response.model[:, 0, 0]))
    assert dataset["measured_phase"].dims == ("w", "output", "input")
    gain, phase, coherence = response.plot("x", "force").axes
    np.testing.assert_allclose(gain.lines[2].get_ydata(), np.abs(response.model[:, 0, 0]))
    assert (gain.get_ylabel(), phase.get_ylabel()) == ("gain [m per 1]", "phase [deg]")
    np.testing.assert_array_equal(coherence.lines[0].get_ydata(), response.coherence[:, 0])
    with pytest.raises(jaxid.InputError, match="There is no output 'y'"):
        response.plot("y")


def test_phases_of_records_and_model_that_agree_are_equal():
    w = np.geomspace(0.1, 10, 100)
    H = (np.exp(-0.8j * w) / (1 + 1j * w) ** 3)[:, None, None]
    # Certain above 2.5 rad/s, where the phase is below -180 degrees, except for a hole, in which it
    # falls by more than 180 degrees.
    errors = np.where((w > 2.5) & ((w < 3) | (w > 9)), 0.1, 1.0)[:, None, None]
    response = FrequencyResponse(
        w, H, np.ones((100, 1)), errors, H, 8, ("u",), ("y",), ("",), ("",)
    )
    records, model = (line.get_ydata() for line in response.plot().axes[1].lines)
    certain = errors[:, 0, 0] < 1
    np.testing.assert_array_equal(np.isfinite(records), certain)
    np.testing.assert_allclose(records[certain], model[certain], atol=1e-9)
    exact = -0.8 * w - 3 * np.arctan(w)
    np.testing.assert_allclose(model, np.degrees(exact), atol=1e-9)
    shifted = H * np.exp(-1j * np.linspace(0, 0.5, 100))[:, None, None]
    dataset = eqx.tree_at(lambda r: r.measured, response, shifted).to_xarray()
    np.testing.assert_allclose(dataset["model_phase"][:, 0, 0], exact, atol=1e-9)
    np.testing.assert_allclose(
        dataset["measured_phase"][:, 0, 0], exact - np.linspace(0, 0.5, 100), atol=1e-9
    )


def test_records_without_a_response_are_refused(noise):
    u, z = noise[:2]
    gap = z.copy()
    gap[7] = np.nan
    other = made(u, z, 2 * T)
    options = {"inputs": ("u0",), "outputs": ("z0",)}
    renamed = jaxid.record(T, u, z, **options | {"inputs": ("v",)})
    in_degrees = jaxid.record(T, u, z, units={"u0": "deg"}, **options)
    cases = {
        "no input": (jaxid.record(T, None, z, inputs=(), outputs=("z",)), {}),
        "1 samples are missing": (made(u, gap), {}),
        "steps of time differ": (made(u, z, T + 0.01 * np.sin(np.arange(SAMPLES))), {}),
        "step 0.1 s, and the first record 0.05 s": ([made(u, z), other], {}),
        "Give other `seconds`": (made(u, z), {"seconds": 1e4}),
        "Record 1 .*its inputs differ in 'u0', 'v'": ([made(u, z), renamed], {}),
        "Record 1 .*channel 'u0' is in .rad.": ([made(u, z), in_degrees], {}),
        "no record": ([], {}),
        "1 segments for 1 inputs": (made(u, z), {"seconds": DT * SAMPLES}),
        "other channels": (made(u, z), {"model": Spring(jnp.array(1.0), jnp.array(1.0))}),
    }
    for words, (records, options) in cases.items():
        with pytest.raises(jaxid.InputError, match=words):
            frequency_response(records, **options)
