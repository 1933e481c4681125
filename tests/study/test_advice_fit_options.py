"""Advice with the likelihood of the later fit: its hold, its stepper and its noise count."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring

import jaxid
from jaxid._foundation.types import Array
from jaxid.study import FindingKind, advice

DT = 0.01
TIME = DT * np.arange(600)
HELD = jaxid.OutputError(hold=jaxid.hold.ZeroOrder(), stepper=jaxid.RK4(10, unrolled=False))


class Motor(jaxid.AbstractModel):
    """A motor whose current settles in 1 ms, ten times faster than it is sampled."""

    R: Array
    K: Array
    states, inputs, outputs = ("current", "speed"), ("voltage",), ("current", "speed")

    def rhs(self, t, x, u):
        current, speed = x
        rate = (u[0] - self.R * current - self.K * speed) / (1e-3 * self.R)
        return jnp.stack([rate, (self.K * current - 2e-4 * speed) / 1e-4])


MOTOR = Motor(jnp.array(2.0), jnp.array(0.05))


@pytest.fixture(scope="module")
def held():
    """A record of the motor whose voltage a converter holds for 250 ms at a time."""
    rng = np.random.default_rng(2)
    voltage = np.repeat(rng.normal(size=24), 25)[:, None]
    options = {"hold": HELD.hold, "stepper": HELD.stepper}
    y = np.asarray(jaxid.simulate(MOTOR, TIME, voltage, np.zeros(2), **options).y)
    y = y + np.array([0.005, 0.2]) * rng.normal(size=y.shape)
    return jaxid.record(TIME, voltage, y, inputs=MOTOR.inputs, outputs=MOTOR.outputs)


def test_stepper_and_hold_of_the_fit_remove_their_findings(held):
    kinds = {finding.kind for finding in advice(held, MOTOR).findings}
    assert FindingKind.SLOW_SAMPLING in kinds
    assert advice(held, MOTOR, None, HELD).findings == ()


def test_a_delay_is_found_and_measured_under_a_held_input(held):
    """Three samples late, beyond the half sample by which straight lines are early."""
    late = np.concatenate([np.tile(held.u[:1], (3, 1)), held.u[:-3]])
    late = jaxid.record(TIME, late, held.z, inputs=MOTOR.inputs, outputs=MOTOR.outputs)
    early = jaxid.record(
        TIME[:-3], held.u[3:], held.z[:-3], inputs=MOTOR.inputs, outputs=MOTOR.outputs
    )
    found = advice(early, MOTOR, None, HELD).of(FindingKind.DELAY)
    assert found
    for finding in found:
        assert finding.numbers["seconds"] == pytest.approx(3 * DT, abs=DT)
    assert not advice(late, MOTOR, None, HELD).of(FindingKind.DELAY)


def test_known_noise_gives_the_expected_errors():
    """Expected errors are in proportion to the deviation of the noise."""
    spring = Spring(jnp.array(2.0), jnp.array(0.3))
    rng, t = np.random.default_rng(0), 0.1 * np.arange(200)
    u = rng.normal(size=(200, 1))
    y = np.asarray(jaxid.simulate(spring, t, u, np.zeros(2)).y) + 0.02 * rng.normal(size=(200, 1))
    record = jaxid.record(t, u, y, inputs=("force",), outputs=("x",))

    def errors(likelihood=None):
        return advice(record, spring, None, likelihood).information.standard_errors

    known = [errors(jaxid.OutputError(jaxid.FixedNoise([s**2]))) for s in (0.02, 0.06)]
    np.testing.assert_allclose(known[1], 3.0 * known[0], rtol=1e-6)
    np.testing.assert_allclose(errors(), known[0], rtol=0.3)
    np.testing.assert_allclose(errors(jaxid.OutputError()), errors(), rtol=1e-12)
    with_process = jaxid.FilterError({"v": 0.1})
    np.testing.assert_allclose(errors(with_process), errors(), rtol=1e-12)
