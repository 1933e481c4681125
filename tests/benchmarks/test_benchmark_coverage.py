"""Tests of the benchmarks of coverage and of the unstable aircraft, on few draws and starts."""

import importlib
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import FilterError, Fixed, free, record, stack
from jaxid.aircraft import Aircraft, f16, f16_engine, level, linearise_euler
from jaxid.aircraft.physics.imperial import FOOT
from jaxid.aircraft.vehicle.controls import MeasuredSurfaces

ROOT = Path(__file__).resolve().parents[2]
WHITE = "output error, white noise"


def load(name):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        return importlib.import_module(name)


def test_band_equals_binomial_quantiles():
    low, high = load("benchmarks.coverage.__main__").band(2000, 1)
    # 95 % -/+ 3.29 sqrt(0.95 0.05 / 2000)
    np.testing.assert_allclose([low, high], [0.934, 0.966], atol=0.002)


def test_row_of_white_noise_lies_inside_its_band():
    row = load("benchmarks.coverage.__main__").measure(WHITE, 50)
    assert row["converged"] == 1.0
    assert row["inside"]
    assert [entry["parameter"] for entry in row["rows"]] == ["Zw", "Mw", "Mq", "Md"]


def test_simulated_gust_has_its_variance_and_memory():
    """The measured angle with the aircraft's motion removed is minus the gust over the speed."""
    benchmark = load("benchmarks.coverage.flights")
    calm, gusty = (benchmark.fly(400, 40, 1, gust=gust).z for gust in (0.0, 1.0))
    first = (gusty - calm)[:, 0, 0] * benchmark.SPEED
    # 400 draws: 3.3 sigma of a variance are 23 %; the noise of both is 2 (0.2 m/s)^2
    np.testing.assert_allclose(np.var(first), 1.0 + 0.08, rtol=0.24)


@pytest.mark.parametrize("time", [0.6, 2.0])
def test_gusts_are_stationary_and_have_their_spectra(time):
    gusts = load("benchmarks.coverage.gusts")
    omega = np.geomspace(0.01, 100.0, 30)
    square = (omega * time) ** 2
    # two-sided, of unit variance: integral over omega / (2 pi)
    spectra = {
        "first_order": 2.0 * time / (1.0 + square),
        "dryden": time * (1.0 + 3.0 * square) / (1.0 + square) ** 2,
    }
    for name, spectrum in spectra.items():
        A, B, C, P = getattr(gusts, name)(time)
        np.testing.assert_allclose(A @ P + P @ A.T + np.outer(B, B), 0.0, atol=1e-14)
        np.testing.assert_allclose(C @ P @ C, 1.0, rtol=1e-14)
        response = [C @ np.linalg.solve(1j * w * np.eye(len(C)) - A, B) for w in omega]
        np.testing.assert_allclose(np.abs(response) ** 2, spectrum, rtol=1e-12)


def test_innovations_in_dryden_gusts_are_white():
    """Flights of the F-16 under the model with the states of the gust, all parameters true."""
    flights, dryden = (load(f"benchmarks.coverage.{name}") for name in ("flights", "dryden"))
    gusts, airplane, size, draws = dryden.dryden, flights.F16, 3.0, 40
    data = flights.fly(draws, 300, 1, gust=size, airplane=airplane, shape=gusts)
    aircraft = airplane.model(airplane.derivatives).with_disturbance_inputs()
    model = dryden.InDrydenGusts(aircraft, jnp.asarray(airplane.gust_time))
    lead = dryden.second_order_truth(airplane, size)["process.lead"]
    spread = size * np.sqrt(np.diag(gusts(airplane.gust_time).P))
    likelihood = FilterError(
        process={"lead": Fixed(lead)},
        noise={name: Fixed(deviation) for name, deviation in flights.NOISE.items()},
        initial={"lead": Fixed(spread[0]), "lag": Fixed(spread[1])},
    )
    channels = {"inputs": ("elevator",), "outputs": ("alpha", "q")}
    records = stack([record(data.t, data.u, z, **channels) for z in data.z])
    stochastic, _ = likelihood.prepared(model, free(model, "Zw"), records)
    begin = jnp.array([*flights.INITIAL, 0.0, 0.0])
    t, u = jnp.asarray(data.t), jnp.asarray(data.u)

    @jax.jit
    @jax.vmap
    def innovations(z):
        one = eqx.tree_at(lambda r: (r.t, r.u, r.z, r.mask), records, (t, u, z, z == z))
        filtered = likelihood.filter(stochastic, one, begin)
        return jnp.linalg.solve(jnp.linalg.cholesky(filtered.B), filtered.v[..., None])[..., 0]

    w = np.asarray(innovations(jnp.asarray(data.z)))[:, 20:]
    # 40 x 280 pairs: 3.3 sigma of a variance are 0.044, of a correlation 0.031
    np.testing.assert_allclose(np.mean(w**2, axis=(0, 1)), 1.0, atol=0.044)
    for lag in (1, 2, 5):
        np.testing.assert_allclose(np.mean(w[:, lag:] * w[:, :-lag], axis=(0, 1)), 0.0, atol=0.032)


def test_derivatives_of_the_f16_are_those_of_its_linearisation():
    airplane = load("benchmarks.coverage.flights").F16
    aircraft = Aircraft(f16(xcg=0.30), engines=(f16_engine(),), controls=MeasuredSurfaces())
    trimmed = level(aircraft, airplane.speed, 1000.0 * FOOT)
    still = jnp.zeros(len(aircraft.inputs))
    linear = eqx.filter_jit(linearise_euler)(trimmed.aircraft, 0.0, trimmed.state, still)
    part = linear.reduced(states=("w", "q"), inputs=("stabilator",))
    true = dict(airplane.derivatives | airplane.known)
    A = [[true["Zw"], airplane.speed + true["Zq"]], [true["Mw"], true["Mq"]]]
    np.testing.assert_allclose(part.A, A, rtol=1e-3)
    np.testing.assert_allclose(part.B[:, 0], [true["Zd"], true["Md"]], rtol=1e-3)
    np.testing.assert_allclose(airplane.gust_time, 1000.0 * FOOT / airplane.speed)


def test_simulated_noise_has_its_colour_and_gaps():
    """Two records that differ by their noise alone: correlation of neighbours, share of gaps."""
    benchmark = load("benchmarks.coverage.flights")
    flights = benchmark.fly(2, 20_000, 1, colour=0.8, missing=0.3)
    noise = flights.z[0] - flights.z[1]
    both = np.all(flights.valid, axis=0)
    pairs = both[1:, 0] & both[:-1, 0]
    correlation = np.corrcoef(noise[1:, 0][pairs], noise[:-1, 0][pairs])[0, 1]
    np.testing.assert_allclose(correlation, 0.8, atol=0.03)
    np.testing.assert_allclose(np.mean(flights.valid), 0.7, atol=0.01)


def test_true_derivatives_differ_from_flight_to_flight():
    """Without noise of the sensors the pitch acceleration by the elevator is each flight's own."""
    benchmark = load("benchmarks.coverage.flights")
    flights = benchmark.fly(400, 10, 1, spread={"Md": 2.0})
    Md = flights.derivatives[:, 3]
    np.testing.assert_allclose(np.std(Md), 2.0, rtol=0.13)  # 3.3 sigma of 400 draws: 12 %
    pitch = flights.z[:, -1, 1] - flights.z[:, 0, 1]
    assert np.corrcoef(pitch, Md)[0, 1] > 0.95


def test_expected_share_of_profiles_equals_simulation():
    """Normal errors Z of an estimate with a lower bound: the interval by the rise of the cost."""
    expected = load("benchmarks.coverage.cases").expected_at_bound
    Z, q = np.random.default_rng(3).normal(size=400_000), 1.959963984540054
    for distance in (0.0, 0.5, 1.0, 1.9, 3.0):
        best = np.maximum(Z, -distance)  # error of the estimate, held at the bound
        rise = Z**2 - (Z - best) ** 2  # twice the cost at the truth over that at the estimate
        share = np.mean(rise < q**2)
        # 400,000 draws: 3.3 sigma of a share are 0.0011
        np.testing.assert_allclose(expected(distance), share, atol=0.0012)


def test_filter_error_alone_finds_unstable_aircraft_from_bad_starts():
    benchmark = load("benchmarks.unstable")
    corners = [(0.5, 1.5, 1.5, 0.5), (1.5, 0.5, 0.5, 1.5)]
    flight = benchmark.fly(400)
    fits = benchmark.attempts(flight, "filter error", corners)
    assert all(benchmark.is_found(fit) for fit in fits)
    distance = (fits[0].values - fits[1].values) / fits[0].standard_errors
    np.testing.assert_allclose(distance, 0.0, atol=1e-3)


def test_flights_with_an_effect_of_gain_zero_are_those_of_the_exact_transition():
    """Means of 400 flights by the simulation and by matrix exponentials: noise of 0.004 / 20."""
    flights, selection = (load(f"benchmarks.coverage.{name}") for name in ("flights", "selection"))
    declared = flights.ShortPeriod(*map(jnp.asarray, flights.DERIVATIVES.values()))
    nothing = eqx.tree_at(lambda effect: effect.gain, selection.missing_effect(), jnp.zeros(()))
    simulated = flights.fly_with(nothing, 400, 100, 1, declared).z.mean(axis=0)
    exact = flights.fly(400, 100, 2).z.mean(axis=0)
    # 5 standard errors of a difference of two means, of 200 values
    np.testing.assert_allclose(simulated, exact, atol=5.0 * np.sqrt(2.0) * 0.004 / 20)
    missing = selection.fly_missing(400, 100, 1).z.mean(axis=0)
    assert np.max(np.abs(missing - simulated)) > 0.01
