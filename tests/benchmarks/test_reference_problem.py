"""Tests of the reference problem: its programs agree, and its hand-derived equations are right.

Times are not tested.
"""

import importlib
import json
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = 76
PACKAGE = "benchmarks.reference_problem"


def load(name: str):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        return importlib.import_module(f"{PACKAGE}.{name}")


@pytest.fixture(scope="module")
def contenders():
    return load("contenders")


@pytest.fixture(scope="module")
def given():
    return load("problem").make_problem(SAMPLES)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("compiled")


@pytest.fixture(scope="module")
def reference(contenders, given, folder):
    return contenders.REFERENCE.make(given, folder)


def make(contenders, key, given, folder):
    missing = contenders.CONTENDERS[key].missing()
    if missing is not None:
        pytest.skip(missing)
    return contenders.CONTENDERS[key].make(given, folder)


# Exact programs take the same steps. With steps of 0.2 s Tsit5 and the classical method differ by
# 2e-3. Forward differences err by curvature times the step.
@pytest.mark.parametrize(
    ("key", "bound"),
    [
        ("c", 1e-9),
        ("user", 1e-9),
        ("package", 1e-9),
        ("jvp", 1e-9),
        ("casadi", 1e-9),
        ("diffrax", 1e-2),
        ("numpy", 1e-4),
    ],
)
def test_sensitivities_of_program_agree_with_hand_derived(
    contenders, given, folder, reference, key, bound
):
    program = make(contenders, key, given, folder)
    y, S = program.sensitivities(given.start)
    expected_y, expected_S = reference.sensitivities(given.start)
    assert S.shape == (SAMPLES, 10, 30)
    # every parameter acts, so that each column is compared
    assert np.all(np.max(np.abs(expected_S), axis=(0, 1)) > 0)
    assert load("measure").sensitivity_difference(S, expected_S) <= bound
    np.testing.assert_allclose(y, expected_y, rtol=0, atol=bound * np.max(np.abs(expected_y)))


@pytest.mark.parametrize("key", ["c", "user"])
def test_estimates_of_program_agree_with_hand_derived(contenders, given, folder, reference, key):
    fitted, expected = make(contenders, key, given, folder).fit(), reference.fit()
    assert fitted.converged
    # two fits that each end within 1e-6 standard errors of the minimum
    assert load("measure").estimate_difference(fitted, expected) <= 1e-5
    np.testing.assert_allclose(fitted.errors, expected.errors, rtol=1e-6)
    np.testing.assert_allclose(fitted.cost, expected.cost, rtol=1e-10)


def test_pass_of_c_equals_normal_equations_of_its_sensitivities(contenders, given, folder):
    program = make(contenders, "c", given, folder)
    result = program.evaluate(given.start)
    y, S = program.sensitivities(given.start)
    expected = load("gauss_newton").normal_pass(y, S, given.z)
    np.testing.assert_allclose(result.cost, expected.cost, rtol=1e-12)
    np.testing.assert_allclose(result.matrix, expected.matrix, rtol=1e-9)
    np.testing.assert_allclose(result.gradient, expected.gradient, rtol=1e-8)


def test_hand_derived_partials_equal_forward_mode_at_random_states(given, seed):
    equations, partials = load("equations"), load("partials")
    rng = np.random.default_rng(seed)
    c, theta = given.constants, jnp.asarray(given.start)
    for _ in range(5):
        x = jnp.asarray(given.x0 + rng.normal(0.0, [10, 10, 10, 0.3, 0.3, 0.3, 0.5, 0.5, 0.5]))
        d = jnp.asarray(rng.normal(0.0, 0.2, 3))
        for function, by_hand in (
            (equations.rates, partials.rate_partials),
            (equations.outputs, partials.output_partials),
        ):

            def values(x, theta, function=function, d=d):
                return jnp.stack([jnp.asarray(row) for row in function(jnp, c, theta, x, d)])

            expected = jax.jacfwd(values, argnums=(0, 1))(x, theta)
            for ours, exact in zip(by_hand(c, theta, x, d), expected, strict=True):
                scale = float(jnp.max(jnp.abs(exact)))
                np.testing.assert_allclose(ours, exact, rtol=1e-12, atol=1e-14 * scale)


def test_hand_derived_sensitivities_agree_with_central_differences(given, reference):
    equations = load("equations")
    S = reference.sensitivities(given.start)[1]
    for column in (2, 8, 13, 20, 25):  # of quadratic, cubic and damping terms
        step = 1e-4 * abs(given.start[column])
        shift = step * np.eye(30)[column]
        ends = [
            equations.simulate(given.constants, given.t, given.u, given.x0, given.start + side)[1]
            for side in (shift, -shift)
        ]
        difference = (ends[0] - ends[1]) / (2 * step)
        # curvature over the step: the relative error is about its square
        atol = 1e-5 * np.max(np.abs(S[..., column]))
        np.testing.assert_allclose(S[..., column], difference, rtol=0, atol=atol)


def test_one_wrong_entry_shows_in_sensitivity_difference(given, reference):
    S = reference.sensitivities(given.start)[1]
    wrong = S.copy()
    wrong[40, 3, 4] += 1e-4 * np.max(np.abs(S[..., 4]))
    assert load("measure").sensitivity_difference(wrong, S) == pytest.approx(1e-4)


def test_exponent_of_power_law():
    assert load("growth").exponent([1, 10, 100], [2.0, 20.0, 200.0]) == pytest.approx(1.0)


def test_sizes_of_growth(given):
    growth = load("growth")
    for count in (15, 30, 60, 120):
        assert growth.with_parameters(given, count).positions.shared.size == count
    assert growth.with_records(3).records.n_cases == 3


def test_json_has_status_misfit_commit_and_missing_programs(user_environment):
    command = [sys.executable, "-m", PACKAGE, "--json", "--quick", "--repeats", "1"]
    command += ["--samples", str(SAMPLES), "--only", "c", "hand"]
    done = subprocess.run(
        command,
        cwd=ROOT,
        # a compiler that does not exist
        env=user_environment | {"CC": "no-such-compiler"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert output["status"] == "agrees"
    assert {"commit", "date", "cores", "samples"} <= set(output)
    without, hand = output["rows"]
    assert without == {"key": "c", "way": "C, hand-derived", "status": "no C compiler"}
    assert hand["status"] == "agrees"
    # 760 samples of unit variance: 4 standard deviations
    assert hand["misfit"] == pytest.approx(1.0, abs=0.1)
    assert hand["pass_ms"] > 0
    assert hand["pass_times_c"] is None
