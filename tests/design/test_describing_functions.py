"""Describing functions: closed forms, the linear case, and predicted against flown information."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring

from jaxid import AbstractModel, FixedNoise, Free, LinearModel, OutputError, free
from jaxid._foundation.checks import InputError
from jaxid.design import (
    Determinant,
    information_of,
    optimal_spectrum,
    planned_record,
    quasi_linear_spectrum,
    sample_times,
)
from jaxid.design.linear.describing_functions import QuasiLinear

STEP, NOISE = 0.05, 0.02
KNOWN = OutputError(FixedNoise(jnp.array([NOISE**2])))
GRID = np.linspace(0.02, 0.8, 79)


class Duffing(AbstractModel):
    """A spring with a cubic part."""

    k: jnp.ndarray
    c: jnp.ndarray
    cubic: jnp.ndarray
    states, inputs, outputs = ("x", "v"), ("force",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1] - self.cubic * x[0] ** 3])


HARDENING = Duffing(jnp.array(1.5), jnp.array(0.6), jnp.array(2.0))


def test_cubic_spring_has_its_known_describing_function():
    """E[3 a x^2] of a Gaussian x: the stiffness is k + 3 a sigma^2 (Gelb and Vander Velde)."""
    sigma = 0.4
    rng = np.random.default_rng(1)
    points = sigma * rng.normal(size=(200_000, 3))
    linear = QuasiLinear(HARDENING, jnp.zeros(3), jnp.asarray(points))
    slopes = linear.describing_function(jnp.zeros(()), HARDENING.rhs)[1]
    np.testing.assert_allclose(slopes[1, 0], -(1.5 + 3 * 2.0 * sigma**2), rtol=5e-3)
    np.testing.assert_allclose(slopes[1, 1:], [-0.6, 1.0], rtol=1e-12)


def test_stiffness_of_a_design_is_that_of_its_own_amplitude():
    chosen = free(HARDENING, "k", "c")
    design = quasi_linear_spectrum(
        HARDENING, chosen, GRID, Determinant(), KNOWN, 0.09, sample_time=STEP
    )
    slopes = design.model.describing_function(jnp.zeros(()), HARDENING.rhs)[1]
    expected = 1.5 + 3 * 2.0 * design.deviations["x"] ** 2
    np.testing.assert_allclose(-slopes[1, 0], expected, rtol=1e-3)
    np.testing.assert_allclose(design.deviations["force"], 0.3, rtol=1e-3)


def test_linear_model_has_the_spectrum_of_the_frequency_domain():
    model = Spring(jnp.array(1.5), jnp.array(0.6))
    chosen = free(model, "k", "c")
    both = [
        optimal_spectrum(model, chosen, GRID, Determinant(), KNOWN, sample_time=STEP),
        quasi_linear_spectrum(
            model, chosen, GRID, Determinant(), KNOWN, 0.09, sample_time=STEP
        ).spectrum,
    ]
    np.testing.assert_allclose(both[1].value, both[0].value, atol=1e-4)
    np.testing.assert_allclose(both[1].lines[0], both[0].lines[0], rtol=1e-6)


def test_mean_moves_where_the_nonlinearity_is_not_even():
    """dx/dt = u - x - x^2/2: at rest in the mean, m + (m^2 + s^2)/2 = 0."""

    class Lag(AbstractModel):
        a: jnp.ndarray
        states, inputs, outputs = ("x",), ("u",), ("x",)

        def rhs(self, t, x, u):
            return u - self.a * x - 0.5 * x**2

    model = Lag(jnp.array(1.0))
    design = quasi_linear_spectrum(
        model, free(model, "a"), GRID, Determinant(), KNOWN, 0.04, sample_time=STEP
    )
    m, s = float(design.model.mean[0]), design.deviations["x"]
    assert s > 0.1
    np.testing.assert_allclose(m + 0.5 * (m**2 + s**2), 0.0, atol=1e-4)


def test_prediction_holds_on_the_flown_signal_where_the_tangent_fails():
    """Standard errors of the realised multisine in the nonlinear model, over 200 s."""
    chosen = free(HARDENING, "k", "c")
    power, t = 0.16, sample_times(200.0, STEP)
    designs = {
        "tangent": optimal_spectrum(
            HARDENING, chosen, GRID, Determinant(), KNOWN, sample_time=STEP
        ),
        "describing": quasi_linear_spectrum(
            HARDENING, chosen, GRID, Determinant(), KNOWN, power, sample_time=STEP
        ).spectrum,
    }
    predicted, flown = {}, {}
    for name, spectrum in designs.items():
        predicted[name] = spectrum.value - 2.0 * np.log(power * t[-1])
        record = planned_record(HARDENING, spectrum.realise(t, power), KNOWN)
        factor = information_of(HARDENING, chosen, record, KNOWN).factor
        flown[name] = float(Determinant().cost(factor))
    # a logarithm of the determinant of two covariances counts each standard error twice
    ratios = {name: np.exp(abs(flown[name] - predicted[name]) / 4) for name in designs}
    assert ratios["describing"] < 1.15
    np.testing.assert_allclose(ratios["tangent"], 2.3, rtol=0.03)
    gain = np.exp((flown["describing"] - flown["tangent"]) / 4)
    np.testing.assert_allclose(gain, 0.71, rtol=0.03)


def test_designs_that_mean_nothing_are_refused():
    chosen = free(HARDENING, "k", "c")
    with pytest.raises(InputError, match="must be positive"):
        quasi_linear_spectrum(HARDENING, chosen, GRID, Determinant(), KNOWN, 0.0, sample_time=STEP)
    with pytest.raises(InputError, match="together do not determine all parameters"):
        quasi_linear_spectrum(
            HARDENING,
            free(HARDENING, "k", "cubic"),
            *(GRID, Determinant(), KNOWN, 0.09),
            sample_time=STEP,
        )
    with pytest.raises(InputError, match=r"not stable.*exp\(0 t\)"):
        quasi_linear_spectrum(
            LinearModel(
                [[0.0]], [[1.0]], [[1.0]], [[0.0]], states=("x",), inputs=("u",), outputs=("y",)
            ),
            Free(("B[0,0]",), ()),
            *(GRID, Determinant(), KNOWN, 0.09),
            sample_time=STEP,
        )
    running_away = Duffing(jnp.array(-1.5), jnp.array(0.6), jnp.array(-2.0))
    with pytest.raises(InputError, match="stable"):
        quasi_linear_spectrum(
            running_away,
            free(HARDENING, "c"),
            *(GRID, Determinant(), KNOWN, 0.09),
            sample_time=STEP,
        )
