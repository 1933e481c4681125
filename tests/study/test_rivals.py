"""Which record would tell two effects apart."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring

from jaxid import Augmented, OutputError, ZeroOrder, estimate, free, record, simulate
from jaxid._foundation.checks import InputError
from jaxid.models import FixedNoise, Term
from jaxid.study import Rival, told_apart

SIGMA = 0.02


def with_term(product, gain):
    return Augmented(Spring(1.5, 0.2), (Term("v", product, jnp.array(gain)),))


def plan(size):
    t = 0.1 * np.arange(200)
    u = size * np.sin(0.9 * t + 0.02 * t**2)[:, None]
    return record(t, u, np.zeros((200, 1)), inputs=("force",), outputs=("x",))


@pytest.fixture(scope="module")
def study():
    """A cubic spring was named; a square of position times speed would do as well."""
    named, rival = with_term("x^3", -0.05), with_term("x^2 v", -0.02)
    chosen = free(rival, "k", "c", "x^2 v in v.gain")
    return SimpleNamespace(
        rivals=(Rival("x^2 v in v", "x^2 v", ("x^3 in v",), 1.0, rival, chosen),),
        after=SimpleNamespace(model=named, estimate=SimpleNamespace(free=chosen)),
        noise={"x": SIGMA},
        outputs=("x",),
        likelihood=OutputError(hold=ZeroOrder()),
    )


def test_what_is_left_is_what_a_fit_of_the_rival_leaves(study):
    """The fit is nonlinear, what is told is linear: they agree within a few per cent where the difference is small."""
    small = plan(0.25)
    told = told_apart(study, small)["x^2 v in v"]
    y = simulate(study.after.model, small.t, small.u, jnp.zeros(2), hold=ZeroOrder()).y
    expected = record(small.t, small.u, y, inputs=("force",), outputs=("x",))
    (rival,) = study.rivals
    fit = estimate(rival.model, rival.free, expected, OutputError(FixedNoise([SIGMA**2]), ZeroOrder()))
    left = float(np.sum((np.asarray(fit.residuals) / SIGMA) ** 2))
    assert left > 1e-3
    np.testing.assert_allclose(told, left, rtol=0.05)


def test_a_larger_input_tells_more(study):
    little, much = (told_apart(study, plan(size))["x^2 v in v"] for size in (0.25, 1.0))
    assert little < 6.0 < much


def test_refusals(study):
    with pytest.raises(InputError, match="no rivals"):
        told_apart(SimpleNamespace(rivals=()), plan(1.0))
