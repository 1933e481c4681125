"""Tests of the report-loop benchmark: models and errors; the best method is not tested."""

import contextlib
import importlib
import io
import json
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.effects import Augmented

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.report_loop")


@pytest.fixture(scope="module")
def linear(benchmark):
    """Motion, flights, and the declared model of the longitudinal case, of one training flight."""
    motion = benchmark.MOTIONS["longitudinal 2"]
    flights = benchmark.fly_all(motion, 0, benchmark.NOISE_ALONE)
    train = [benchmark.record_of(flights[name], motion.setting) for name in motion.train]
    model = benchmark.undetermined(motion, next(iter(flights.values())))
    return motion, flights, benchmark.declared(motion, model, train)


def test_train_check_and_test_flights_are_disjoint(benchmark):
    for motion in benchmark.MOTIONS.values():
        assert len(motion.flights) == len(motion.train) + len(motion.check) + len(motion.test)


def test_all_flights_share_one_aircraft(linear):
    _, flights, _ = linear
    first, *others = flights.values()
    for other in others:
        assert eqx.tree_equal(first.aircraft.instruments, other.aircraft.instruments)
    assert len(
        {float(np.asarray(one.truth.channel("alpha"))[-1]) for one in flights.values()}
    ) == len(flights)


def test_declared_model_is_linear_with_regression_candidates(benchmark, linear):
    motion, _, model = linear
    names = {effect.name for effect in benchmark.terms_to_try(motion, model)}
    # Of 22 terms in Table 6.1 nine have sideslip, and three are declared.
    assert len(names) == 3 * (22 - 9 - 3)
    assert {"alpha^9 in CX", "alpha^2 stabilator in Cm", "alpha stabilator in CZ"} <= names
    for terms in benchmark.polynomials(model).values():
        assert [term for term, _, _ in terms] == ["1", "alpha", "qhat", "stabilator"]


def test_coefficient_of_augmented_model_includes_effect(benchmark, linear):
    motion, flights, model = linear
    effect = next(
        one for one in benchmark.terms_to_try(motion, model) if one.name == "alpha^3 in Cm"
    )
    effect = eqx.tree_at(lambda one: one.gain, effect, jnp.array(-2.0))
    at = benchmark.motion_of(next(iter(flights.values())))
    with_it = benchmark.coefficient(benchmark.polynomials(Augmented(model, (effect,)))["Cm"], at)
    without = benchmark.coefficient(benchmark.polynomials(model)["Cm"], at)
    np.testing.assert_allclose(with_it - without, -2.0 * at["alpha"] ** 3, rtol=0, atol=1e-14)
    expected = model.airframe.aerodynamics.Cm(
        {name: jnp.asarray(value[7]) for name, value in at.items()}
    )
    np.testing.assert_allclose(without[7], expected, rtol=1e-12)


def test_errors_of_linear_model_are_within_known_ranges(benchmark, linear):
    """A linear CZ draws most of the lift, and a linear Cm not half of the moment; the mean error of
    CX is no larger.
    """
    motion, flights, model = linear
    errors = benchmark.errors(model, [flights[name] for name in motion.test])
    assert set(errors) == {"CX", "CZ", "Cm"}
    assert 0.0 < errors["CZ"]["whole"] < 0.15
    assert all(0.0 < value < 3.0 for one in errors.values() for value in one.values())


def test_json_and_table_report_medians_over_seeds(benchmark, monkeypatch):
    """With stand-in studies: one JSON object, and a table with medians over seeds."""
    numbers = {"terms_in_all": 9, "static": 0.1, "whole": 0.2, "terms": {"Cm": ["alpha"]}}

    def measure(motion, seed, level, progress):
        models = {"declared, linear": numbers | {"prediction": 1.0 + seed}}
        return {"case": motion.case, "seed": seed, "verdict": "found", "ways": models}

    monkeypatch.setattr(benchmark, "measure", measure)
    words = io.StringIO()
    with contextlib.redirect_stdout(words):
        assert benchmark.main(["--json", "--seeds", "3", "--case", "lateral 1"]) == 0
    output = json.loads(words.getvalue())
    assert (output["status"], output["calibrated"], len(output["rows"])) == ("measured", False, 3)
    (row,) = (
        line
        for line in benchmark.table(output["rows"]).splitlines()
        if line.startswith("  declared, linear  ")
    )
    assert row.split()[-4:] == ["9", "2", "0.1", "0.2"]
