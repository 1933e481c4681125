"""Power of a planned record to distinguish two effects."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring

from jaxid import OutputError, estimate, free, record, simulate
from jaxid._foundation.checks import InputError
from jaxid.effects import Augmented, Term
from jaxid.models import FixedNoise
from jaxid.simulation.hold import ZeroOrder
from jaxid.study import Alternative, Study, discrimination

SIGMA = 0.02


def with_term(product, gain):
    return Augmented(Spring(1.5, 0.2), (Term("v", product, jnp.array(gain)),))


def partial_study(**fields):
    """A `Study` that has only the fields that `discrimination` reads."""
    study = object.__new__(Study)
    vars(study).update(fields)
    return study


def plan(size):
    t = 0.1 * np.arange(200)
    u = size * np.sin(0.9 * t + 0.02 * t**2)[:, None]
    return record(t, u, np.zeros((200, 1)), inputs=("force",), outputs=("x",))


@pytest.fixture(scope="module")
def study():
    """A cubic spring was named; a square of position times speed would do as well."""
    named, alternative = with_term("x^3", -0.05), with_term("x^2 v", -0.02)
    chosen = free(alternative, "k", "c", "x^2 v in v.gain")
    return partial_study(
        alternatives=(Alternative("x^2 v in v", "x^2 v", ("x^3 in v",), 1.0, alternative, chosen),),
        after=SimpleNamespace(model=named, estimate=SimpleNamespace(free=chosen)),
        noise={"x": SIGMA},
        outputs=("x",),
        likelihood=OutputError(hold=ZeroOrder()),
    )


def test_discrimination_equals_residual_of_refitted_alternative(study):
    """The fit is nonlinear and the prediction linear: for small differences they agree within a few
    per cent.
    """
    small = plan(0.25)
    chi_square = discrimination(study, small)["x^2 v in v"]
    y = simulate(study.after.model, small.t, small.u, jnp.zeros(2), hold=ZeroOrder()).y
    expected = record(small.t, small.u, y, inputs=("force",), outputs=("x",))
    (alternative,) = study.alternatives
    fit = estimate(
        alternative.model,
        alternative.free,
        expected,
        OutputError(FixedNoise([SIGMA**2]), ZeroOrder()),
    )
    expected_chi_square = float(np.sum((np.asarray(fit.residuals) / SIGMA) ** 2))
    assert expected_chi_square > 1e-3
    np.testing.assert_allclose(chi_square, expected_chi_square, rtol=0.05)


def test_larger_input_increases_discrimination(study):
    little, much = (discrimination(study, plan(size))["x^2 v in v"] for size in (0.25, 1.0))
    assert little < 6.0 < much


def test_refusals(study):
    with pytest.raises(InputError, match="no alternatives"):
        discrimination(partial_study(alternatives=()), plan(1.0))
