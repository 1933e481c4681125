"""Each check of a search's result, in the scenario that it alone decides."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2
from searched_spring import NOISE, Spring, fly, problem

from jaxid import InputError, OutputError
from jaxid.effects import (
    DeadBand,
    DryFriction,
    InputDelay,
    Placement,
    QuadraticDrag,
    SensorBias,
    SensorDelay,
    SensorLag,
    Term,
)
from jaxid.loop import Outcome, search_effects
from jaxid.loop.assess import Check, Objection, falls_by_spread, one_function
from jaxid.loop.fit import fit
from jaxid.loop.hypothesis import Hypothesis
from jaxid.loop.wording import objection_words
from jaxid.models import FixedNoise

LATE_INPUT = InputDelay("force", jnp.array(0.1))
CUBIC = Term("v", "x^3", jnp.array(-0.3))
FAINT = Term("v", "x^3", jnp.array(-0.01))


def checks(found):
    return [objection.check for objection in found.assessment.objections]


def test_shapes_of_one_function():
    """A cubic and a dead band of one signal are one cause; two terms, or two signals, are not."""
    cubic, square = Term("v", "v^3"), Term("v", "v^2")
    kink = DeadBand(Placement.equation("v"), "v")
    objection = one_function((cubic, kink))
    assert objection is not None
    assert set(objection.names) == {cubic.name, kink.name}
    assert one_function((cubic, square)) is None
    assert one_function((Term("v", "x^3"), kink)) is None


def test_shapes_that_imitate_a_drag_together_are_proxies():
    """Of a quadratic drag outside the library a cubic and a dead band leave nothing but noise."""
    library = (
        *(Term("v", "v^3"), DryFriction("v", "v"), DeadBand(Placement.equation("v"), "v")),
        *(Term("v", "x^3"), SensorBias("v")),
    )
    drag = QuadraticDrag("v", "v", jnp.array(-0.3))
    found = search_effects(problem(18, drag, library=library, size=1.5))
    assert set(found.effects) == {"v^3 in v", "dead band of v in v"}
    assert checks(found) == [Check.ONE_FUNCTION]
    assert found.outcome is Outcome.PROXIES


def test_effects_elsewhere_are_proxies():
    """A late input delays both sensors alike, which two late sensors imitate in full."""
    late = problem(11, LATE_INPUT).without("delay of input force", "lag of input force")
    found = search_effects(late)
    assert set(found.effects) == {"delay of x", "delay of v"}
    assert checks(found) == [Check.IN_PLACE]
    assert found.outcome is Outcome.PROXIES


def test_lag_taken_for_delay_is_proxy():
    """The library has no lag of a sensor; a delay leaves white noise, but the course in time."""
    late = problem(34, SensorLag("x", gain=jnp.array(0.1)))
    found = search_effects(late.without("lag of input force", "scale of v"))
    assert found.effects == ("delay of x",)
    assert checks(found) == [Check.SPREAD]
    words = objection_words(found.assessment.objections[0])
    assert "another course in time fits better" in words


@pytest.mark.parametrize("late", [LATE_INPUT, SensorDelay("x", jnp.array(0.1))])
def test_true_delay_has_its_course_in_time(late):
    """Its fall of chi-square is chance: of 30 draws more than 9 exceed its 10 % quantile with
    a probability of 0.0005.
    """
    true, gain = Hypothesis((late.name,)), {f"{late.name}.gain": 0.1}
    draws = [fit(problem(seed, late), true, start=gain) for seed in range(100, 130)]
    falls = np.array([falls_by_spread(drawn)[late.name] for drawn in draws])
    assert np.sum(falls > chi2.isf(0.1, 1)) <= 9
    assert np.max(falls) > 1  # the response is tested at all


def test_lag_of_partial_gain_is_proxy():
    """A delay looks like a lag whose gain is not one."""
    late = problem(12, InputDelay("force", jnp.array(0.02))).without(
        "delay of input force", "delay of x", "delay of v"
    )
    found = search_effects(late)
    assert found.effects == ("lag of input force",)
    assert checks(found) == [Check.UNIT_GAIN]
    assert found.outcome is Outcome.PROXIES


def test_effect_with_exact_equal_at_another_place_is_proxy():
    """A constant force moves the place of rest as a bias of the position does, in every record."""
    library = (Term("v", "1"), SensorBias("x"), Term("v", "x^3"))
    found = search_effects(problem(14, Term("v", "1", jnp.array(0.3)), library=library))
    (objection,) = found.assessment.objections
    assert objection.check is Check.ALTERNATIVE
    assert {*found.effects, *objection.names} == {"1 in v", "bias of x"}
    assert objection.numbers == pytest.approx([0.0], abs=1e-3)
    assert found.outcome is Outcome.PROXIES
    (equal,) = objection.names
    assert f"These records cannot distinguish this from {equal}: chi-square is the same." in str(
        found
    )
    assert f"Next best: {equal} with white noise, with the same chi-square." in str(found)


def test_alternatives_are_worded_by_their_fit():
    """Rounding may give an equal fit either sign."""
    names, numbers = ("a", "b + c", "d", "e", "f"), (0.0, -1e-9, 3.21, 0.2, -12.0)
    assert objection_words(Objection(Check.ALTERNATIVE, names, numbers)) == (
        "These records cannot distinguish this from a or b + c: chi-square is the same. "
        "Other hypotheses fit nearly as well, with chi-square larger by: d (3.21), e (0.2). "
        "Other hypotheses fit better, with chi-square smaller by: f (12)."
    )


def test_faint_effect_is_proxy():
    """Of a faint effect the records show that it is there, not which shape it has."""
    found = search_effects(problem(13, FAINT))
    assert found.effects == ("x^3 in v",)
    assert checks(found) == [Check.ALTERNATIVE]
    assert found.outcome is Outcome.PROXIES


def test_effect_that_does_not_carry_over_is_proxy():
    found = search_effects(problem(14, CUBIC), test={"new spring": fly(150, size=2.0)})
    assert found.effects == ("x^3 in v",)
    assert checks(found) == [Check.CARRIES_OVER]
    assert found.assessment.objections[0].names == ("new spring",)
    assert found.outcome is Outcome.PROXIES


FRICTION = (
    *(DryFriction("v", "v", free_width=free) for free in (False, True)),
    *(QuadraticDrag("v", "v"), Term("v", "v^3"), Term("v", "x^3")),
)


def test_width_of_friction_is_estimated_where_the_records_show_it():
    wide = DryFriction("v", "v", jnp.array(-0.3), width=jnp.array(0.4))
    found = search_effects(problem(20, wide, library=FRICTION))
    assert (found.effects, found.outcome) == (("smooth sign(v) in v",), Outcome.EXPLAINED)
    value, error = found.estimates["smooth sign(v) in v.width"]
    assert abs(value - 0.4) < 4 * error < 0.1


def test_refinement_is_no_alternative_to_the_effect_that_it_refines():
    """Narrow friction is fitted as well with a free width, which the records do not show."""
    narrow = DryFriction("v", "v", jnp.array(-0.15), width=jnp.array(0.02))
    found = search_effects(problem(21, narrow, library=FRICTION))
    assert (found.effects, found.outcome) == (("sign(v) in v",), Outcome.EXPLAINED)
    assert any(fit.effects == ("smooth sign(v) in v",) for fit in found.tree.fits())


class Pendulum(Spring):
    """The spring with `k sin x` in place of `k x`."""

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * jnp.sin(x[0]) - self.c * x[1]])


def test_power_is_proxy_where_a_sine_leaves_it():
    """Up to 1.5 rad a cubic is the sine to the noise, but at 2.3 rad it is not."""
    truth = Pendulum(jnp.array(1.5), jnp.array(0.2))
    given = problem(19, truth=truth, size=0.5)
    near = search_effects(given, test={"near": fly(190, truth=truth, size=0.5)})
    far = search_effects(given, test={"far": fly(195, truth=truth, size=1.0)})
    assert near.effects == far.effects == ("x^3 in v",)
    assert (near.outcome, checks(far)) == (Outcome.EXPLAINED, [Check.CARRIES_OVER])
    assert far.outcome is Outcome.PROXIES


def test_residual_above_given_noise_is_unexplained():
    """The model is complete, and its noise a quarter larger than declared."""
    found = search_effects(problem(17, likelihood=OutputError(FixedNoise((0.8 * NOISE) ** 2))))
    assert found.effects == ()
    assert checks(found) == [Check.NOISE_LIKE]
    assert found.outcome is Outcome.UNEXPLAINED


def test_library_without_an_unknown_name_is_refused():
    assert "x^3 in v" not in problem(15).without("x^3 in v").effects
    with pytest.raises(InputError, match="effect of the library"):
        problem(15).without("x^7 in v")
