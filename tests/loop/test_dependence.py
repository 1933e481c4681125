"""Dependence of a noise on signals."""

from searched_spring import problem

from jaxid.loop import Hypothesis, RandomForces
from jaxid.loop import dependence as module
from jaxid.loop.dependence import followed_signals
from jaxid.loop.fit import fit


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
