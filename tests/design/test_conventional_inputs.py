"""Conventional inputs: their scale, orthogonality and peak factors."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.design import signals

T = signals.sample_times(10.0, 0.02)
AXES = ("aileron", "rudder")


@pytest.fixture(scope="module")
def inputs():
    return signals.conventional_inputs(T, 0.5, (0.1, 2.0), (*AXES, "flap"), axes=AXES, start=0.5)


@pytest.fixture(scope="module")
def multisine():
    return signals.multisine_inputs(T, 0.1, 2.0, AXES)


def test_all_inputs_have_unit_peak_and_leave_other_axes_at_trim(inputs):
    assert len(inputs) == 8
    for signal in inputs.values():
        np.testing.assert_allclose(jnp.max(signal.peak[:2]), 1.0, rtol=0.01)
        assert signal.peak[2] == 0


def test_scale_by_energy_and_by_peak(inputs):
    signal = inputs["3-2-1-1"]
    np.testing.assert_allclose(jnp.sum(signal.with_energy(3.0).energy), 3.0)
    np.testing.assert_allclose(jnp.max(signal.with_peak(0.2).peak), 0.2)


def test_pulses_have_requested_widths():
    pulses = np.asarray(signals.alternating_pulses(T, (0.6, 0.4, 0.2), 1.0))
    changes = np.flatnonzero(np.diff(pulses)) + 1
    np.testing.assert_allclose(np.asarray(T)[changes], [1.0, 1.6, 2.0, 2.2])
    np.testing.assert_array_equal(pulses[changes], [1.0, -1.0, 1.0, 0.0])


def test_multisines_are_orthogonal_and_begin_at_zero(multisine):
    u = np.asarray(multisine.u)[:-1]
    np.testing.assert_allclose(u.T @ u / len(u), np.eye(2), atol=1e-9)
    assert np.all(np.abs(u[0]) < 1e-3)


def test_optimised_phases_lower_the_peak_factor(multisine):
    """Below 1.1 for 10 harmonics of equal power (Morelli, Flight test maneuvers, 2012: 1.0 to
    1.2).
    """
    schroeder = signals.multisine_inputs(T, 0.1, 2.0, AXES, optimise=False)
    assert np.all(np.asarray(multisine.relative_peak_factor) < 1.1)
    assert np.all(multisine.relative_peak_factor < schroeder.relative_peak_factor)


def test_peak_factor_of_a_sine_is_one():
    wave = signals.multisine_inputs(T, 0.5, 0.5, ("elevator",))
    np.testing.assert_allclose(wave.relative_peak_factor, 1.0, rtol=2e-3)


def test_impossible_signals_are_refused():
    with pytest.raises(InputError, match="1 harmonics for 2 inputs"):
        signals.multisine_inputs(T, 0.5, 0.5, AXES)
    with pytest.raises(InputError, match="no three samples"):
        signals.sample_times(0.1, 0.1)
    with pytest.raises(InputError, match="no input 'flaps'"):
        signals.combine(T, {"flaps": T}, ("flap",))


def test_inputs_of_a_late_start_are_the_same(inputs):
    late = signals.conventional_inputs(
        T + 100.0, 0.5, (0.1, 2.0), (*AXES, "flap"), axes=AXES, start=0.5
    )
    for name in ("doublet", "3-2-1-1", "step", "sweep"):
        changed = np.any(np.abs(np.asarray(late[name].u - inputs[name].u)) > 1e-6, axis=1)
        assert np.sum(changed) <= 8  # a jump between two samples is rounded to one of them
