"""Tests of the harder truths: draws, flights, answers, and one small study."""

import contextlib
import importlib
import io
import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.effects import InputDelay, SensorBias, Term

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def of():
    """A module of the benchmark by name; benchmarks are not part of the installed package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)
        yield lambda name: importlib.import_module(f"benchmarks.missing_effects.{name}")


@pytest.mark.parametrize("name", ["spring", "ship", "longitudinal"])
def test_draws_repeat_and_depend_on_seed(of, name):
    scenarios, drawn = of(f"harder.{name}").system().scenarios, of("measure").drawn_numbers
    assert len({one.name for one in scenarios}) == len(scenarios) > 10
    assert {one.kind for one in scenarios} == {of("scenarios").HARDER}
    for one in scenarios:
        first, again, other = (drawn(one.drawn(seed)) for seed in (0, 0, 1))
        assert first == again, one.name
        assert first != other, one.name
    usual = of(name).system().scenarios
    assert all(one.drawn(1) is one for one in usual)


def test_drawn_sizes_keep_sign_and_range(of):
    generator = np.random.default_rng(0)
    sizes = np.array([of("harder.draw").sized(generator, -3.0) for _ in range(200)])
    assert -6.0 <= sizes.min() < -5.0
    assert -2.0 < sizes.max() <= -1.5


def test_draw_leaves_inputs_and_noise_of_scenario_alone(of):
    one = of("harder.spring").system().scenario("mass steps")
    assert one.generator(3).normal() == one.drawn(3).generator(3).normal()


def test_every_harder_truth_changes_records_of_spring_by_more_than_noise(of):
    spring, truth = of("spring"), of("truth")
    t = spring.STEP * np.arange(220)
    force = {"force": spring.forced(np.random.default_rng(0), 1)[:, : t.size]}
    start, noise = {"x": np.zeros(1), "v": np.zeros(1)}, np.array(list(spring.NOISE.values()))
    equations = spring.plant(0.0, 0.0)
    without = truth.fly(equations, (), t, force, start)
    for one in of("harder.spring").system().scenarios:
        effects = one.drawn(0).effects
        y = truth.fly(equations, effects, t, force, start)
        y = truth.recorded(effects, y, equations.outputs)
        change = np.sqrt(np.mean(((y - without) / noise) ** 2, axis=(0, 1)))
        assert np.max(change) > 2.0, one.name


def test_mass_step_divides_rate_from_its_time_on(of):
    steps = (of("truth_only").MassStep("v", 0.25, 2.0),)
    rates = {"x": np.ones(1), "v": np.full(1, 5.0)}
    assert of("truth_effects").after_mass_steps(steps, 1.9, rates) == rates
    assert of("truth_effects").after_mass_steps(steps, 2.1, rates) == {"x": 1.0, "v": 4.0}


def test_curved_sensors_add_square_and_absolute_value(of):
    only, y = of("truth_only"), np.array([[[-2.0, -3.0], [1.0, 2.0]]])
    effects = only.SensorSquare("a", 0.5), only.SensorAbsolute("b", 0.1)
    read = of("truth_effects").read(effects, np.arange(2.0), y, ("a", "b"))
    assert read == pytest.approx(np.array([[[0.0, -2.7], [1.5, 2.2]]]))


def test_names_expected_of_a_later_library_are_accepted(of):
    (one,) = of("harder.spring").system().scenario("square of a sensor").drawn(0).planted
    channel = one.effect.channel
    for name in (f"curvature of {channel}", f"curvature of {channel} (from 20%)"):
        assert one.accepts(name, "a family")
        assert one.accepts("a name", name)
    assert not one.accepts(f"curvature of {channel}lpha", f"bias of {channel}")


def test_inputs_sensors_and_height_act_on_the_longitudinal_aircraft(of):
    """The delay of the elevator, the delay of the vane, and lift that depends on height."""
    harder, flight = of("harder.longitudinal"), of("harder.flight")
    aircraft, t, u, start = harder.manoeuvred(np.ones(7))
    t, u = t[:150], u[:1, :150]

    def flown(late, delay, height):
        effects = (
            InputDelay("elevator", gain=jnp.array(late)),
            of("harder.sensors").late("alpha", delay).effect,
            of("truth_only").HeightDependence("CZ", height, 50.0),
        )
        return flight.flown(aircraft, effects, t, u, start)[0]

    without = flown(0.0, 0.0, 0.0)
    noise = {"alpha": 0.05, "pitch": 0.05}
    late, vane, height = flown(0.05, 0.0, 0.0), flown(0.0, 0.05, 0.0), flown(0.0, 0.0, -0.3)

    def change(y, channel):
        at = aircraft.outputs.index(channel)
        return np.degrees(np.sqrt(np.mean((y - without)[:, at] ** 2))) / noise[channel]

    assert change(late, "pitch") > 2.0
    assert change(vane, "alpha") > 2.0
    assert change(vane, "pitch") == 0.0
    assert change(height, "pitch") > 2.0


@pytest.fixture(scope="module")
def study(of):
    """A curved accelerometer, with a library that lacks it."""
    system = of("harder.spring").system()
    library = (*(Term("v", product) for product in ("x^2", "x^3", "v^3")), SensorBias("a"))
    one = system.scenario("square of a sensor")
    return of("measure").measure(system, one, 0, library=library)


def test_truth_that_the_library_lacks_is_measured_against_the_noise(of, study):
    assert study["failed"] is None
    assert (study["offered"], study["identifiable"], study["in"]) == ([False], [True], [False])
    assert study["attainable"] == pytest.approx(np.mean(np.log([0.02, 0.05])))
    assert study["planted"][0][0] == "curvature of a"
    assert of("judge").answer(study) in (of("judge").Answer.DOUBT, of("judge").Answer.WRONG)
    assert json.loads(json.dumps(study)) == study


def harder_result(**changes):
    """A study of a harder truth with two effects that went well."""
    return {
        **{"system": "spring", "scenario": "made up", "kind": "harder", "seed": 0},
        **{"removed": False, "failed": None, "outcome": "explained", "effects": ["a", "b"]},
        **{"first_right": True, "top_three": [True, True], "in": [True, True], "wrong": 0},
        **{"offered": [True, True], "identifiable": [True, True], "ratio": 1.0},
        **{"planted": [["a", {}], ["b", {}]], "error_before": 1.0, "attainable": 0.0},
        **{"chi_square": 100.0, "naive": {"right": False, "terms": 3}, "seconds": 2.0},
    } | changes


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, "right"),
        ({"in": [True, False]}, "part"),
        ({"in": [True, False], "identifiable": [True, False]}, "right"),
        ({"wrong": 1}, "wrong"),
        ({"outcome": "proxies", "wrong": 2}, "doubt"),
        ({"outcome": "unexplained", "effects": []}, "doubt"),
        ({"outcome": "nothing missing", "effects": []}, "wrong"),
        ({"outcome": "process noise", "effects": []}, "wrong"),
        ({"outcome": "nothing missing", "identifiable": [False, False]}, "unseen"),
        ({"failed": "broken"}, "failed"),
    ],
)
def test_answer_to_harder_truth(of, changes, expected):
    assert of("judge").answer(harder_result(**changes)).value == expected


def test_harder_truths_are_counted_separately(of):
    results = [harder_result(), harder_result(seed=1, wrong=1), harder_result(seed=2)]
    results.append(harder_result(seed=3, outcome="proxies", offered=[True, False]))
    goals = {one.name: one for one in of("judge").goals(results)}
    assert set(goals) == {"harder truths: no wrong cause named", "studies that failed"}
    assert goals["harder truths: no wrong cause named"].share == (3, 4)
    words = of("table").text(results)
    row = next(line for line in words.splitlines() if line.startswith("spring       made up"))
    assert row.split()[3:] == ["4", "1", "2", "0", "1", "0", "1", "0"]
    assert "spring, made up, seed 1: wrong: a, b (explained) for a and b" in words
    assert "seed 3" not in words


def test_option_runs_only_harder_truths(of, monkeypatch):
    requested = []

    def stand_in(system, scenario, seed, *, removed=False):
        requested.append((scenario.name, seed, removed))
        return harder_result(scenario=scenario.name, seed=seed)

    monkeypatch.setattr(of("measure"), "measure", stand_in)
    words = io.StringIO()
    with contextlib.redirect_stdout(words), contextlib.redirect_stderr(io.StringIO()):
        main = of("__main__").main
        assert main(["--json", "--harder", "--systems", "spring", "--seeds", "2"]) == 0
    names = [one.name for one in of("harder.spring").system().scenarios]
    assert requested == [(name, seed, False) for seed in (0, 1) for name in names]
    assert len(json.loads(words.getvalue())["studies"]) == 2 * len(names)
