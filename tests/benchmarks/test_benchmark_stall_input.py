"""Aircraft of `benchmarks.stall_input` and `benchmarks.input_design`; the report's two sines."""

import jax.numpy as jnp
import numpy as np

from benchmarks.input_design import coupled, longitudinal_likelihood
from benchmarks.stall_input import (
    CENTRE,
    RANGE,
    REPORT,
    Sine,
    aircraft,
    curve_error,
    curve_rows,
    free_parameters,
    sine,
    trim_state,
)
from jaxid.design import curve_width, information_of, planned_record, sample_times


def test_trim_is_level_flight_with_a_loss_of_stability_in_the_range():
    model = aircraft()
    state = trim_state(model)
    np.testing.assert_allclose(model.rhs(0.0, state, jnp.zeros(1)), 0.0, atol=1e-12)
    alpha = np.linspace(*RANGE, 50) - CENTRE
    slope = 0.0529 - 2 * 2.41 * alpha - 3 * 33.3 * alpha**2
    assert slope.max() > 0.1
    assert slope.min() < -0.5


def test_slower_and_smaller_sine_shows_the_curve_better():
    """The report's lesson (section 5.4.1), by the predicted standard errors."""
    model = aircraft()
    chosen, noise, state = free_parameters(model), longitudinal_likelihood(model), trim_state(model)
    t = sample_times(12.0, 0.04)
    width = curve_width(lambda alpha: curve_rows(alpha, len(chosen.shared)), *RANGE)
    variances = []
    for name, given in REPORT.items():
        record = planned_record(model, sine(t, *given, name), noise, initial_state=state)
        shown = information_of(model, chosen, record, noise, initial_state=state)
        variances.append(shown.measure(width))
    first, second = np.sqrt(variances)
    assert second < 0.7 * first


def test_error_of_a_curve_is_its_root_mean_square_over_the_range():
    error = jnp.zeros(12).at[0].set(0.003)
    np.testing.assert_allclose(curve_error(error, jnp.zeros(12)), 0.003)


def test_periods_of_the_sine_are_bounded():
    shape = Sine(sample_times(12.0, 0.04))
    for place, period in ((-20.0, 1.5), (20.0, 12.0)):
        np.testing.assert_allclose(shape.period(jnp.array([1.0, place])), period)
    scaled = shape.scaled(jnp.array([[0.5, 1.0]]), jnp.array(2.0))
    np.testing.assert_allclose(scaled, [[1.0, 1.0]])


def test_coupled_aircraft_of_the_designs_is_trimmed_at_15_deg():
    """But for the speed over ground, the derivatives of all states are zero."""
    case = coupled()
    rates = dict(
        zip(
            case.model.states,
            case.model.rhs(jnp.zeros(()), case.trim_state, case.trim_input).tolist(),
            strict=True,
        )
    )
    moving = {name for name, rate in rates.items() if abs(rate) > 1e-9}
    assert len(moving) == 1
    u, w = case.trim_state[0], case.trim_state[2]
    np.testing.assert_allclose(np.degrees(np.arctan2(w, u)), 15.0, rtol=1e-9)
    np.testing.assert_allclose(rates[moving.pop()], np.hypot(u, w), rtol=1e-9)
