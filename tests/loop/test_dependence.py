"""Dependence of a noise on signals."""

import pytest
from searched_spring import problem

from jaxid.loop import Hypothesis, RandomForces
from jaxid.loop import dependence as module
from jaxid.loop.dependence import followed_by_forces, followed_signals
from jaxid.loop.fit import fit
from jaxid.loop.random_forces import fit_forces

CUBIC = "x^3 in v.gain"


def test_time_needs_no_least_fall(monkeypatch):
    """Time is known exactly; other signals follow from the linear model, an approximation."""
    tests = [("t", (20.0, 1)), ("x", (20.0, 1)), ("v", (30.0, 1)), ("force", (4.0, 1))]
    monkeypatch.setattr(module, "_candidate_tests", lambda *_: tests[1:])
    monkeypatch.setattr(module, "_signal_tests", lambda *_: tests[:1])
    fitted = fit(problem(30), Hypothesis())
    whitened = module.Whitened(fitted.motion, {}, (), fitted.whitened)
    assert module._followed(fitted, whitened, 0.01) == ("v", "t")


def test_dependence_of_forces_does_not_rest_on_the_estimates_of_the_filter():
    """The filter of a fit has another force between samples. Where the force forgets within a
    step, that filter took all of an accelerometer for the force, and its noise for nothing.
    """
    given = problem(31, gust=0.6, gust_time=0.3)
    fitted = fit(given, Hypothesis((), RandomForces({"v": 0.5}, {}, 0.3)))
    assert followed_signals(fitted, 0.01) == ()
    fitted.estimates["sensor.v"] = (1e-4, 1.0)
    assert followed_signals(fitted, 0.01) == ()


@pytest.mark.parametrize("effects", [(), ("x^3 in v",)])
def test_error_of_linear_model_is_allowed_for_where_the_model_is_not_linear(monkeypatch, effects):
    allowed = []
    monkeypatch.setattr(module, "_followed", lambda *arguments: allowed.append(arguments[3]) or ())
    noise = RandomForces({"v": 0.5}, {}, 0.3)
    fitted = fit(problem(31, gust=0.6, gust_time=0.3), Hypothesis(effects), start={CUBIC: -0.3})
    assert fitted.motion.is_linear is not bool(effects)
    forces = fit_forces(fitted.motion, noise, noise.initial(fitted.noise_covariance))
    followed_by_forces(fitted, forces, noise, 0.01)
    assert (allowed[0] > 0.0) is bool(effects)
