"""Tests of the benchmark of ten-second pieces: two estimates, and a piece without motion."""

import dataclasses
import importlib
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
CASE = "longitudinal 1"


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.report_pieces")


@pytest.fixture(scope="module")
def outcomes(benchmark):
    return list(benchmark.pieces((CASE,), (0.0, 10.0)))


def test_pieces_end_in_finite_estimates(outcomes):
    assert [one.start for one in outcomes] == [0.0, 10.0]
    for one in outcomes:
        assert one.passes
        assert one.finite
        assert {*one.kept} | {*one.left_out} == {"CX", "CZ", "Cm"}


def test_first_piece_is_the_flight_of_the_report(benchmark, outcomes):
    """The same motion and instruments; the noise of the longer flight has other draws."""
    flown = benchmark.fly_case(CASE, 0)
    alpha = np.degrees(np.asarray(flown.record.channel("alpha")))
    np.testing.assert_allclose(outcomes[0].alpha, [alpha.min(), alpha.max()], atol=1.0)


def test_piece_without_motion_is_refused_with_the_reason_of_each_equation(benchmark, seed):
    setting = benchmark.SETTINGS[CASE]
    flown = benchmark.fly_case(CASE, 0)
    record = benchmark.record_of(flown, setting)
    noise = np.random.default_rng(seed).normal(size=record.z.shape)
    still = eqx.tree_at(
        lambda one: (one.u, one.z),
        record,
        (
            jnp.broadcast_to(record.u[:1], record.u.shape) + 1e-6 * noise[:, : record.u.shape[1]],
            record.z[:1] + 1e-3 * noise,
        ),
    )
    result = benchmark.outcome(CASE, 0.0, benchmark.model_of(flown, setting), still)
    assert result.status == "refused"
    assert result.passes
    assert all(f"{name} left out: overall F" in result.message for name in ("CX", "CZ", "Cm"))


def test_other_refusals_and_infinite_errors_do_not_pass(outcomes):
    other = dataclasses.replace(outcomes[0], finite=False, message="The model cannot be simulated")
    assert not other.passes
    assert not dataclasses.replace(outcomes[0], finite=False).passes
