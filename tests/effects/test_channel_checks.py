"""Candidates whose card contradicts them are refused before any computation."""

import dataclasses

import jax.numpy as jnp
import pytest

from jaxid import AbstractModel, InputError
from jaxid.effects import InputScale, SensorDelay, Term, channel_checks
from jaxid.effects.augmented import split_effects
from jaxid.effects.channel_checks import check_candidates
from jaxid.models.equation_shapes import check_equations


class Lag(AbstractModel):
    rate: object
    states, inputs, outputs = ("x",), ("u",), ("y",)

    def rhs(self, t, x, u):
        return jnp.stack([self.rate * (u[0] - x[0])])

    def output(self, t, x, u):
        return x


class MisspeltDelay(InputScale):
    @property
    def card(self):
        return dataclasses.replace(super().card, delay="time")


class LateTerm(Term):
    @property
    def card(self):
        return dataclasses.replace(super().card, delay="gain")


@pytest.mark.parametrize("effect", [MisspeltDelay("u"), LateTerm("x", "x^2")])
def test_delay_that_is_no_time_of_an_input_or_a_sensor_is_refused(effect):
    model = Lag(jnp.array(1.0))
    check_candidates(model, (SensorDelay("y"),))
    with pytest.raises(InputError, match=r"as `delay` of its card.*at an input or a sensor"):
        check_candidates(model, (effect,))


def test_candidates_are_evaluated_together_until_one_fails(monkeypatch):
    """One evaluation for all of a library; alone only to name an effect of an unknown signal."""
    model, evaluated = Lag(jnp.array(1.0)), []

    def counted(augmented):
        evaluated.append(len(split_effects(augmented)[1]))
        check_equations(augmented)

    monkeypatch.setattr(channel_checks, "check_equations", counted)
    good = (Term("x", "x^2"), Term("x", "x^3"), SensorDelay("y"))
    check_candidates(model, good)
    assert evaluated == [3]
    with pytest.raises(InputError, match=r"The candidate 'z in x'"):
        check_candidates(model, (*good, Term("x", "z")))
    assert evaluated == [3, 4, 1, 1, 1, 1]
