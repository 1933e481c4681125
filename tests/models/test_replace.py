"""Replacement of a model's polynomials, by the names of their parameters."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.flight.longitudinal_flight import planted, true_aircraft
from jaxid.effects import Augmented
from jaxid.models import Polynomial, parameter_names, polynomials_of, with_polynomials


class Inner(eqx.Module):
    drag: Polynomial
    share: jnp.ndarray


class Outer(eqx.Module):
    parts: tuple[Inner, ...]
    lift: dict[str, Polynomial]


def outer():
    inner = tuple(Inner(Polynomial({"1": float(k), "x": 2.0}), jnp.array(0.5)) for k in range(2))
    return Outer(inner, {"left": Polynomial({"x": 1.0})})


def test_polynomial_is_replaced_by_one_with_other_terms():
    model = true_aircraft()
    changed = with_polynomials(
        model, {"Cm": Polynomial({"1": 0.5, "alpha^3": -8.0}, {"alpha": 0.1}), "CX": Polynomial({})}
    )
    named = [
        name for name in parameter_names(changed) if name.partition(".")[0] in ("CX", "CZ", "Cm")
    ]
    assert named[:4] == [f"CZ.{term}" for term in model.CZ.terms]
    assert named[4:] == ["Cm.1", "Cm.alpha^3", "Cm.centre.alpha"]
    x, u = jnp.array([180.0, 20.0, 0.1, 0.1]), jnp.array([-0.05])
    np.testing.assert_allclose(
        changed.Cm(changed.signals(jnp.zeros(()), x, u)),
        0.5 - 8.0 * (np.arctan2(20, 180) - 0.1) ** 3,
    )
    assert model.Cm.terms == true_aircraft().Cm.terms  # the model is not changed


def test_polynomial_names_match_parameter_names_in_wrappers_and_containers():
    wrapped = Augmented(true_aircraft(), (planted(),))
    assert tuple(polynomials_of(wrapped)) == ("CX", "CZ", "Cm")
    assert polynomials_of(with_polynomials(wrapped, {"Cm": Polynomial({"1": 1.0})}))[
        "Cm"
    ].terms == ("1",)
    assert tuple(polynomials_of(outer())) == ("parts.0.drag", "parts.1.drag", "lift.left")
    changed = with_polynomials(
        outer(), {"parts.1.drag": Polynomial({"y": 3.0}), "lift.left": Polynomial({"x^2": 1.0})}
    )
    assert parameter_names(changed) == (
        "parts.0.drag.1",
        "parts.0.drag.x",
        "parts.0.share",
        "parts.1.drag.y",
        "parts.1.share",
        "lift.left.x^2",
    )


def test_replacement_by_nothing_keeps_model_and_unknown_name_is_refused():
    model = true_aircraft()
    assert with_polynomials(model, {}) is model
    with pytest.raises(InputError, match=r"no polynomial 'Cn'.*CX, CZ, Cm"):
        with_polynomials(model, {"Cn": Polynomial({})})
