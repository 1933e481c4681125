"""Tests of the missing-effects benchmark: NumPy truth, shares and tables, and one small study."""

import contextlib
import importlib
import io
import json
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import RK4, simulate
from jaxid.effects import Augmented, InputDelay, SensorBias, Term

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def of():
    """A module of the benchmark by name; benchmarks are not part of the installed package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)
        yield lambda name: importlib.import_module(f"benchmarks.missing_effects.{name}")


@pytest.fixture(scope="module")
def studies(of):
    """One scenario and one control on the spring, with few candidates, so that they compile in
    seconds.
    """
    system = of("spring").system()
    library = (*(Term("v", product) for product in ("x^2", "x^3", "v^3")), SensorBias("a"))
    return [
        of("measure").measure(system, system.scenario(name), 0, library=library)
        for name in ("cubic spring", "plain")
    ]


def test_study_adds_planted_effect_and_no_effect_in_control(studies):
    planted, control = studies
    assert (planted["failed"], control["failed"]) == (None, None)
    assert (planted["effects"], planted["outcome"], planted["first_right"]) == (
        ["x^3 in v"],
        "explained",
        True,
    )
    assert (planted["identifiable"], planted["top_three"], planted["in"]) == (
        [True],
        [True],
        [True],
    )
    assert planted["place_right"]
    # The loop ends with the very model that the reference fits, but for where its search stops.
    assert planted["ratio"] == pytest.approx(1.0, abs=1e-4)
    assert planted["attainable"] < planted["error_before"]
    assert (control["effects"], control["outcome"]) == ([], "nothing missing")
    assert control["ratio"] == pytest.approx(1.0, abs=1e-9)


def test_aircraft_in_gusts_keeps_effects_in_inputs_and_sensors(of):
    longitudinal = of("longitudinal")
    aircraft = longitudinal.true_aircraft()
    effects = InputDelay("elevator", jnp.array(0.1)), SensorBias("q", jnp.array(0.01))
    truth, t = Augmented(aircraft, effects), 0.04 * np.arange(20)
    u, start = 0.02 * np.sin(3.0 * t)[:, None], np.array([100.0, 5.0, 0.0, 0.05])
    still = np.column_stack([u, np.zeros(t.size)])
    plain, planted, gusty = (
        np.asarray(simulate(model, t, inputs, start, stepper=RK4()).y)
        for model, inputs in ((aircraft, u), (truth, u), (longitudinal.Gusty(truth), still))
    )
    np.testing.assert_allclose(gusty, planted, rtol=1e-12)
    q = aircraft.outputs.index("q")
    assert np.max(np.abs(planted - plain)[:, q]) > 0.01


def test_names_of_planted_effects_and_of_equivalent_ones(of):
    library = (Term("v", "x^3"), SensorBias("a"), Term("v", "x^2"))
    planted = of("scenarios").planted(Term, "v", "x^3", gain=1.0, places=(), also=("bias of a",))
    assert of("measure").names_of_planted(library, (planted,)) == ["x^3 in v", "bias of a"]


def test_failed_study_reports_its_error(of):
    system = of("spring").system()
    summary = of("measure").measure(
        system, system.scenario("dry friction"), 0, library=(SensorBias("a"), SensorBias("a"))
    )
    assert "occurs twice" in summary["failed"]


def pool_of_threads(count, context):
    """Return a pool of threads in place of one of processes, whose functions must be importable."""
    pool = ThreadPoolExecutor(count)
    submit = pool.submit
    pool.submit = lambda function, *key: submit(pickle.loads(pickle.dumps(function)), *key)
    return pool


@pytest.mark.parametrize("workers", [1, 2])
def test_interrupted_run_resumes_from_log(of, tmp_path, monkeypatch, workers):
    """With a stand-in for the studies, and threads for processes: the log is read, each study runs
    once, all are printed.
    """
    requested, log = [], tmp_path / "log.jsonl"

    def stand_in(system, scenario, seed, *, removed=False):
        requested.append((scenario.name, seed, removed))
        effects = ["a"] if scenario.kind == "single" else []
        return result(
            scenario=scenario.name, kind=scenario.kind, seed=seed, removed=removed, effects=effects
        )

    monkeypatch.setattr(of("measure"), "measure", stand_in)
    monkeypatch.setattr(of("__main__"), "ProcessPoolExecutor", pool_of_threads)
    main = [
        "--json",
        "--workers",
        str(workers),
        "--systems",
        "spring",
        "--scenarios",
        "cubic spring",
        "plain",
        "--log",
        str(log),
    ]
    for seeds, controls in ((1, 1), (2, 4)):
        words = io.StringIO()
        with contextlib.redirect_stdout(words), contextlib.redirect_stderr(io.StringIO()):
            assert (
                of("__main__").main([*main, "--seeds", str(seeds), "--controls", str(controls)])
                == 0
            )
    output = json.loads(words.getvalue())
    cubic = [("cubic spring", seed, removed) for seed in (0, 1) for removed in (False, True)]
    assert sorted(requested) == sorted([*cubic, *(("plain", seed, False) for seed in range(4))])
    assert len(output["studies"]) == len(requested) == len(log.read_text().splitlines())
    assert [row["scenario"] for row in output["scenarios"]] == ["cubic spring", "plain"]
    assert {one["name"] for one in output["goals"]} > {
        "right effect first",
        "false effect where nothing is missing",
    }


def test_text_has_all_rows_and_goals(of):
    results = [
        result(),
        result(seed=1, removed=True),
        result(scenario="control", kind="control", effects=[]),
    ]
    words = of("table").text(results)
    assert all(one.name in words for one in of("judge").goals(results))
    assert "made up" in words
    assert "control" in words
    assert "made up, not in the library, seed 1: explained: a" in words


@pytest.mark.parametrize(
    "name", ["dry friction", "actuator's dead zone", "hysteresis of the spring", "load that swings"]
)
def test_numpy_truth_equals_library_effect(of, name):
    spring, truth = of("spring"), of("truth")
    (one,) = (one for one in spring.system().scenarios if one.name == name)
    t, u = spring.STEP * np.arange(spring.SAMPLES), spring.forced(one.generator(0), 1)
    start = {"x": np.zeros(1), "v": np.zeros(1)}
    y = truth.fly(spring.plant(0.0, 0.0), one.effects, t, {"force": u}, start)[0]
    without = truth.fly(spring.plant(0.0, 0.0), (), t, {"force": u}, start)[0]
    model = spring.Spring(*map(jnp.array, (spring.K, spring.C, 0.0, 0.0, 0.0)))
    with_it = Augmented(model, one.effects)
    same = simulate(
        with_it, t, u.T, jnp.zeros(len(with_it.states)), stepper=RK4(8, unrolled=False)
    ).y
    noise = np.array(list(spring.NOISE.values()))
    # Bends inside of steps cost the fixed step its order: a twentieth of the noise, where the
    # effect is many times as large.
    assert np.max(np.abs(y - np.asarray(same)) / noise) < 0.05
    assert np.max(np.abs(y - without) / noise) > 5.0


def test_scenarios_have_unique_names_and_all_kinds(of):
    for name in ("spring", "ship"):
        scenarios = of(name).system().scenarios
        assert len({one.name for one in scenarios}) == len(scenarios)
        assert {one.kind for one in scenarios} == set(of("scenarios").KINDS)
        assert all(
            len(one.planted) == {"single": 1, "double": 2}.get(one.kind, 0) for one in scenarios
        )


def result(**changes):
    """A study of a single effect that went well."""
    return {
        **{
            "system": "spring",
            "scenario": "made up",
            "kind": "single",
            "seed": 0,
            "removed": False,
            "failed": None,
        },
        **{
            "outcome": "explained",
            "effects": ["a"],
            "first_right": True,
            "top_three": [True],
            "in": [True],
        },
        **{
            "wrong": 0,
            "where": ["equation v"],
            "place_right": True,
            "error_before": 1.0,
            "error_after": 0.0,
        },
        **{
            "attainable": 0.0,
            "ratio": 1.0,
            "identifiable": [True],
            "chi_square": 100.0,
            "fall": 70.0,
            "seconds": 2.0,
        },
        **{"naive": {"first": "b", "right": False, "terms": 3}},
        "alternatives": [[["a"], "White", 90.0]],
    } | changes


def test_shares_count_identifiable_studies_and_failures_as_misses(of):
    judge = of("judge")
    results = [
        result(),
        result(seed=1, first_right=False, ratio=1.2),
        result(seed=2, first_right=False, identifiable=[False]),
        result(seed=3, failed="broken"),
        result(removed=True, outcome="proxies"),
        result(seed=1, removed=True, outcome="explained", place_right=False),
        result(seed=2, removed=True, outcome="explained", fall=80.0),
        result(seed=4, effects=[], outcome="nothing missing", identifiable=[False]),
        result(seed=4, removed=True, effects=[], outcome="nothing missing", place_right=False),
        result(kind="control", effects=[], outcome="nothing missing"),
        result(kind="control", seed=1, effects=["a"], outcome="proxies"),
        result(kind="double", **{"in": [True, False]}),
        result(kind="process", outcome="process noise"),
    ]
    goals = {one.name: one for one in judge.goals(results)}
    assert goals["right effect first"].share == (1, 3)
    assert goals["error on test records within 5 % of the true model's"].share == (2, 4)
    assert goals["both effects of a double found"].share == (0, 1)
    # Without a significant effect no place is scored, and a named cause counts as wrong, while the
    # outcome without a cause does not.
    assert goals["effect not in the library: place right"].share == (1, 2)
    assert goals["effect not in the library: no cause named"].share == (2, 4)
    assert goals["the same, or one that fits no worse than the truth"].share == (3, 4)
    assert goals["gusts told as such"].share == (1, 1)
    assert goals["false effect where nothing is missing"].share == (1, 2)
    assert not goals["right effect first"].met
    # One of two could have a probability of one hundredth or less: the interval begins at 1.3 %.
    assert not goals["false effect where nothing is missing"].met
    assert goals["studies that failed"].share == (1, 13)


@pytest.mark.parametrize(
    "outcome", ["process noise", "coloured noise", "nothing missing", "explained"]
)
def test_denial_of_removed_effect_counts_as_false_cause(of, outcome):
    assert not of("judge").names_no_cause(result(removed=True, outcome=outcome))
    assert of("judge").names_no_cause(result(removed=True, outcome="unexplained"))
    assert of("judge").names_no_cause(result(kind="process", outcome="process noise"))


def test_row_has_medians_and_counts(of):
    (row,) = of("judge").rows(
        [result(), result(seed=1, ratio=3.0, wrong=2), result(removed=True, outcome="proxies")]
    )
    assert (row.studies, row.failed, row.first, row.place, row.no_cause) == (
        2,
        0,
        (2, 2),
        (1, 1),
        (1, 1),
    )
    assert row.ratio == pytest.approx((2.0, np.e))
    assert (row.wrong, row.outcomes, row.naive) == (1.0, {"explained": 2}, (0, 2))


@pytest.mark.parametrize(
    ("count", "of_all", "low", "high"), [(0, 500, 0.0, 0.00735), (5, 500, 0.00325, 0.02318)]
)
def test_share_interval_equals_clopper_pearson(of, count, of_all, low, high):
    """At zero the upper end is `1 - 0.025^(1/n)`; the other pair solves the two binomial tails, by
    SciPy's `binomtest`.
    """
    assert of("judge").Share(count, of_all).interval == pytest.approx((low, high), abs=1e-5)


def test_shortfall_names_effect_added_instead(of):
    words = of("table").shortfall(
        result(first_right=False, effects=["b"], ratio=1.5, **{"in": [False]})
    )
    assert words.startswith("b (explained; truth 100; worse by: a 90)")
    assert words.endswith("ratio 1.500")
    assert of("table").shortfall(result()) == ""
