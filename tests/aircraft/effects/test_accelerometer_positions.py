"""Positions of the accelerometers: of each one, and of all in one package."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import AbstractModel, OutputError, free, record, simulate
from jaxid.aircraft import Instruments
from jaxid.aircraft.effects.parameters import (
    ACCELEROMETERS,
    SENSOR_COORDINATES,
    accelerometer_packages,
    sensor_positions,
)
from jaxid.effects import Augmented, ParameterShift
from jaxid.loop import LoopProblem, Outcome, search_effects
from jaxid.models import parameter_names

STEP, SAMPLES, NOISE = 0.05, 300, 0.02  # s, -, m/s^2


class Readings(AbstractModel):
    """Accelerometers in a known angular motion, under a force that the weight scales."""

    weight: object
    instruments: Instruments
    states, inputs = (), ("p", "q", "r", "pdot", "qdot", "rdot", "force")
    outputs = ACCELEROMETERS

    def rhs(self, t, x, u):
        return jnp.zeros(0)

    def output(self, t, x, u):
        signals = dict(zip(self.inputs, u, strict=True))
        force = {name: self.weight * signals["force"] for name in ACCELEROMETERS}
        return self.instruments.read(signals | force)


MODEL = Readings(jnp.array(1.0), Instruments(ACCELEROMETERS, position={"ax": (2.0, 0.3, -0.4)}))
NAMES = parameter_names(MODEL)
PACKAGES = accelerometer_packages(NAMES)
ARMS = sensor_positions(NAMES, SENSOR_COORDINATES)


def motion(seed, effect):
    """Return a record of the readings with an effect, in a rotation about all axes."""
    rng, t = np.random.default_rng(seed), STEP * np.arange(SAMPLES)
    phase = rng.uniform(0, 2 * np.pi, (4, 3))
    frequency, size = np.array([1.1, 2.3, 3.7, 5.2]), 0.25
    angle = frequency[:, None, None] * t + phase[..., None]
    rates = size * np.sum(np.sin(angle), axis=0).T
    changes = size * np.sum(frequency[:, None, None] * np.cos(angle), axis=0).T
    u = np.column_stack([rates, changes, rng.normal(size=SAMPLES)])
    y = np.asarray(simulate(Augmented(MODEL, (effect,)), t, u, jnp.zeros(0)).y)
    z = y + NOISE * rng.normal(size=y.shape)
    return record(t, u, z, inputs=MODEL.inputs, outputs=MODEL.outputs, name=f"record {seed}")


def test_package_moves_all_accelerometers_along_one_axis():
    assert [effect.parameter for effect in PACKAGES] == [
        f"instruments.position.ax.{axis}" for axis in "xyz"
    ]
    for axis, effect in zip("xyz", PACKAGES, strict=True):
        moved = effect.parameter_offsets(jnp.zeros(()))
        assert set(moved) == {f"instruments.position.{name}.{axis}" for name in ACCELEROMETERS}
        assert effect.card.unit == "m"
    names = [effect.name for effect in (*PACKAGES, *ARMS)]
    assert len(set(names)) == len(names) == 3 + 9


@pytest.mark.parametrize(("channels", "count"), [(("ax", "az", "p"), 3), (("ax", "p"), 0), ((), 0)])
def test_package_needs_two_accelerometers(channels, count):
    names = [f"instruments.position.{name}.{axis}" for name in channels for axis in "xyz"]
    packages = accelerometer_packages(names)
    assert len(packages) == count
    assert all(len(effect.linked) == 1 for effect in packages)


@pytest.mark.parametrize("planted", [PACKAGES[0], ARMS[-3]], ids=["package", "single arm"])
def test_package_and_single_arm_are_told_apart(planted):
    moved = ParameterShift(
        planted.parameter, planted.linked, channel=planted.channel, gain=jnp.array(0.3)
    )
    flown = [motion(seed, moved) for seed in range(3)]
    found = search_effects(
        LoopProblem.of(
            MODEL, (*PACKAGES, *ARMS), free(MODEL, "weight"), OutputError(), flown[:2], flown[2:]
        )
    )
    assert found.outcome is Outcome.EXPLAINED
    assert found.effects == (planted.name,)
    gain, error = found.estimates[f"{planted.name}.gain"]
    assert abs(gain - 0.3) < 4.0 * error < 0.1
