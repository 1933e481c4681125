"""The benchmark's flights are those of plain NumPy, singly and in a batch; nothing is timed
here.
"""

import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.simulation")


@pytest.fixture(scope="module")
def flights(benchmark):
    """Three flights at once, long enough for the augmentation to be switched on, and each of them
    by the peers.
    """
    problem, seconds = benchmark.make_problem(), 8.5
    batch = benchmark.fly_many(problem, 3, seconds, repeats=1).flights
    ours = [(np.asarray(batch.solution.x[i]), np.asarray(batch.solution.y[i])) for i in range(3)]
    peers = [
        {name: fly() for name, fly in benchmark.peers(problem, seconds, key).items()}
        for key in benchmark.keys(3)
    ]
    return problem.aircraft, ours, peers


def test_batched_flights_equal_numpy_flights(benchmark, flights):
    _, ours, peers = flights
    for one, peer in zip(ours, peers, strict=True):
        # Equal equations, steps and interpolation: rounding alone is between them.
        assert benchmark.disagreement(one, peer[benchmark.NUMPY]) <= 1e-12
        assert (
            benchmark.disagreement(one, peer[benchmark.SCIPY])
            <= benchmark.TOLERANCES[benchmark.SCIPY]
        )


def test_flights_differ_and_excite_all_compared_signals(flights):
    """Gusts, errors and augmentation are felt: what agrees does not agree for want of motion."""
    aircraft, ours, _ = flights
    x, y = (np.stack([one[k] for one in ours]) for k in (0, 1))
    assert np.all(
        np.ptp(y, axis=0).max(axis=0)[
            [aircraft.outputs.index(name) for name in ("alpha", "beta", "p", "V")]
        ]
        > 0
    )
    assert np.all(np.ptp(x, axis=1)[:, 13:] > 1e-4)  # augmentation and surfaces
    alpha = np.degrees(y[0, :, aircraft.outputs.index("alpha")])
    knots = np.array([10.0, 12.5, 15.0, 16.0, 17.5, 20.0, 22.5])  # of the tables
    assert np.sum((alpha.min() < knots) & (knots < alpha.max())) >= 2


def test_disagreement_detects_one_wrong_sample(benchmark, flights):
    """A thousandth of a degree at one instant shows."""
    _, ours, _ = flights
    wrong = ours[0][1].copy()
    wrong[40, 0] += np.radians(1e-3)
    assert benchmark.disagreement((ours[0][0], wrong), ours[0]) > 1e-5


@pytest.mark.parametrize("beta_deg", [-50.0, -38.0, -12.0, 0.0, 3.3, 33.0, 41.0])
def test_numpy_peer_interpolates_as_scipy(beta_deg):
    """Its written-out cubic against SciPy's along the whole axis, from end to end and beyond."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)
        peer = importlib.import_module("benchmarks.flight_in_numpy")
    from jaxid.aircraft.airframes.shared import DATA
    from jaxid.aircraft.vehicle.aerodynamics_tables import read_coefficients

    grids = read_coefficients(DATA / "f4")
    alpha, beta = np.radians(16.4), np.radians(beta_deg)
    coefficients = peer.Coefficients(grids)(alpha, beta, (0.0,) * 6)
    knots = [np.array(line) for line in grids["CX"].knots]
    held = np.clip(beta, knots[1][0], knots[1][-1])
    rows = [PchipInterpolator(knots[0], grids[name].values)(alpha) for name in peer.BODY]
    expected = [float(PchipInterpolator(knots[1], row)(held)) for row in rows]
    np.testing.assert_allclose(coefficients, expected, rtol=1e-12, atol=1e-15)


def test_json_has_status_and_misfit(user_environment):
    command = [
        sys.executable,
        "-m",
        "benchmarks.simulation",
        "--json",
        "--flights",
        "1",
        "--seconds",
        "3",
    ]
    done = subprocess.run(
        [*command, "--repeats", "1"],
        cwd=ROOT,
        env=user_environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert output["status"] == "agrees"
    assert output["device_kind"]
    assert [row["way"] for row in output["rows"]] == [
        "NumPy, same steps",
        "SciPy, solve_ivp",
        "jaxid",
    ]
    for row in output["rows"]:
        assert row["status"] == "agrees"
        # 496 samples of unit variance: 5 standard deviations
        assert row["misfit"] == pytest.approx(1.0, abs=0.15)
        assert row["seconds"] > 0
        assert row["times_numpy"] > 0
    assert output["rows"][2]["compile_seconds"] > 0
    assert output["rows"][2]["megabytes"] > 0
