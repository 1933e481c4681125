"""Polynomials: values of terms, centres, derivatives, names, and terms that cannot be parsed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.models.names import parameter_names
from jaxid.models.polynomial import (
    Polynomial,
    factors,
    monomials,
    monomials_of_samples,
    next_powers,
    signals_in,
    sums_of_monomials,
)

ALPHA, BETA = 0.37, -0.11
TERMS = {  # value by term without a centre
    "1": 1.0,
    "alpha": ALPHA,
    "alpha^3 beta": ALPHA**3 * BETA,
    "|beta|": 0.11,
    "|beta| beta": -(0.11**2),
    "|beta|^3": 0.11**3,
    "(alpha-0.26)+": 0.11,
    "(alpha-0.26)+^2 beta": 0.11**2 * BETA,
    "(alpha-0.4)+^2": 0.0,
    "(beta+0.2)+": 0.09,
    "(beta-.5e-1)+": 0.0,
    "(alpha-beta)^2": 0.48**2,
    "|beta-alpha| beta": 0.48 * BETA,
}


def signals():
    return {"alpha": jnp.array(ALPHA), "beta": jnp.array(BETA)}


def test_terms_of_every_kind_have_known_value():
    np.testing.assert_allclose(
        monomials(tuple(TERMS), signals()), list(TERMS.values()), rtol=1e-14, atol=1e-16
    )


def test_terms_at_samples_equal_terms_at_each_instant():
    rng = np.random.default_rng(1)
    histories = {name: rng.normal(size=5) for name in ("alpha", "beta")}
    centre = {"alpha": jnp.array(0.1)}
    ours = monomials_of_samples(histories, centre, terms=tuple(TERMS))
    theirs = jax.vmap(lambda now: monomials(tuple(TERMS), now, centre))(histories)
    np.testing.assert_allclose(ours, theirs, rtol=1e-14, atol=1e-16)


def test_polynomial_in_other_terms_has_same_value():
    poly = Polynomial({"alpha": 2.0, "1": -0.5, "beta": 7.0}, centre={"alpha": 0.1})
    wide = poly.with_terms(("1", "alpha^9", "|beta|", "beta", "alpha"))
    assert wide.terms == ("1", "alpha^9", "|beta|", "beta", "alpha")
    np.testing.assert_allclose(wide(signals()), poly(signals()), rtol=1e-14)
    assert wide.with_terms(poly.terms).coefficients.tolist() == [2.0, -0.5, 7.0]
    assert wide.with_terms(("beta",)).coefficients.tolist() == [7.0]


def test_centre_is_subtracted_before_absolute_value_and_knot():
    poly = Polynomial({term: 1.0 for term in TERMS}, centre={"alpha": 0.1})
    moved = {"alpha": jnp.array(ALPHA - 0.1), "beta": jnp.array(BETA)}
    np.testing.assert_allclose(poly(signals()), jnp.sum(monomials(tuple(TERMS), moved)), rtol=1e-14)
    about_beta = monomials(("|beta|", "(beta-0.2)+"), signals(), {"beta": jnp.array(-0.5)})
    np.testing.assert_allclose(about_beta, [0.39, 0.19], rtol=1e-13)


def test_centre_of_unknown_signal_is_refused():
    poly = Polynomial({"alpha": 2.0}, centre={"alpah": 0.1})
    with pytest.raises(InputError, match=r"no signal 'alpah'.*'alpha'"):
        poly({"alpha": jnp.array(0.3)})


def test_polynomial_without_centre_has_only_coefficients():
    plain = Polynomial({"alpha": 2.0, "1": 1.0})
    assert len(jax.tree.leaves(plain)) == 1
    assert parameter_names(plain) == ("alpha", "1")
    assert parameter_names(Polynomial({"alpha": 2.0}, centre={"beta": 1.0, "alpha": 0.0})) == (
        "alpha",
        "centre.alpha",
        "centre.beta",
    )


def test_derivatives_are_finite_at_kinks_and_correct_elsewhere():
    def value(alpha):
        return monomials(("alpha^2", "|alpha|", "(alpha-0.2)+", "(alpha-0.2)+^2"), {"alpha": alpha})

    slope = jax.jit(jax.jacfwd(value))
    np.testing.assert_allclose(slope(0.5), [1.0, 1.0, 1.0, 0.6], rtol=1e-14)
    np.testing.assert_allclose(slope(-0.5), [-1.0, -1.0, 0.0, 0.0], rtol=1e-14)
    assert np.isfinite(slope(0.0)).all()
    np.testing.assert_array_equal(slope(0.2)[2:], 0.0)


def sums_and_reference(terms):
    """Two sums of weighted terms as functions of weights and signals, and their definition."""
    incidence = np.random.default_rng(1).integers(0, 2, (2, len(terms))).astype(float)

    def sums(weights, alpha, beta):
        return sums_of_monomials(incidence, weights, terms, {"alpha": alpha, "beta": beta})

    def reference(weights, alpha, beta):
        values = monomials(terms, {"alpha": alpha, "beta": beta})
        return jnp.asarray(incidence, float) @ (weights * values)

    return sums, reference


@pytest.mark.parametrize("terms", [tuple(TERMS), ("alpha^2 beta",), ("1",)])
def test_sums_of_terms_have_derivatives_of_their_definition(terms):
    sums, reference = sums_and_reference(terms)
    at = (jnp.linspace(-1.0, 2.0, len(terms)), jnp.array(ALPHA), jnp.array(BETA))
    np.testing.assert_allclose(sums(*at), reference(*at), rtol=1e-14, atol=1e-16)
    derivatives = (
        lambda function: jax.jacfwd(function, (0, 1, 2)),
        lambda function: jax.jacrev(function, (0, 1, 2)),
        lambda function: jax.jacfwd(function, 0),
        lambda function: jax.jacrev(function, (1, 2)),
        lambda function: jax.jacfwd(jax.jacfwd(function, (0, 1, 2)), (0, 1, 2)),
    )
    for derivative in derivatives:
        expected = jax.tree.leaves(jax.jit(derivative(reference))(*at))
        for got, right in zip(
            jax.tree.leaves(jax.jit(derivative(sums))(*at)), expected, strict=True
        ):
            np.testing.assert_allclose(got, right, rtol=1e-12, atol=1e-14)


def test_next_powers_have_one_more_factor():
    assert next_powers("alpha^2 q") == ("alpha^3 q", "alpha^2 q^2")
    assert next_powers("|v| v") == ("|v|^2 v", "|v| v^2")
    assert next_powers("(x-y)^2") == ("(x-y)^3",)
    assert next_powers("(alpha-0.26)+") == ("(alpha-0.26)+^2",)
    assert next_powers("1") == ()


def test_factors_and_signals_of_terms_are_returned():
    assert factors("alpha^2 |q|") == (("alpha", 2), ("|q|", 1))
    assert factors("(alpha-0.26)+^2 beta") == (("(alpha-0.26)+", 2), ("beta", 1))
    assert factors("1") == ()
    assert signals_in(("1", "|beta| q^2", "(alpha+1e-1)+")) == ("alpha", "beta", "q")
    assert factors("(x-y)^3 |x-y|") == (("(x-y)", 3), ("|x-y|", 1))
    assert signals_in(("(x-y)^3 y",)) == ("x-y", "y")


@pytest.mark.parametrize(
    "term", ["", "alpha^", "alpha^x", "alpha^1.5", "alpha^-1", "alpha^0", "|alpha", "(alpha-1)"]
)
def test_unreadable_term_is_refused(term):
    with pytest.raises(InputError, match=r"cannot be read|no factor"):
        factors(term)


def test_missing_signal_of_term_is_refused():
    with pytest.raises(InputError, match=r"no signal 'bet'.*beta"):
        Polynomial({"|bet|": 1.0})(signals())


@pytest.mark.parametrize("count", [0, 3, len(TERMS)])
def test_polynomial_and_its_gradient_are_those_of_its_terms(count):
    """Few terms are products of scalars, many are sums of products of vectors."""
    terms = dict(list(TERMS.items())[:count])
    poly = Polynomial({term: 1.0 + index for index, term in enumerate(terms)})
    value, gradient = jax.value_and_grad(lambda poly: poly(signals()))(poly)
    expected = sum((1.0 + index) * value for index, value in enumerate(terms.values()))
    np.testing.assert_allclose(value, expected, rtol=1e-14)
    np.testing.assert_allclose(gradient.coefficients, [*terms.values()], rtol=1e-14, atol=1e-16)
