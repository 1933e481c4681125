"""Effects that are the same on several inputs: one actuator type for all surfaces."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import AbstractModel, OutputError, free, record, simulate
from jaxid._foundation.checks import InputError
from jaxid.effects import (
    Augmented,
    CommonInputLag,
    CommonInputRateLimit,
    InputLag,
    InputRateLimit,
    general_effects,
)
from jaxid.effects.channel_checks import check_candidates
from jaxid.loop import LoopProblem, Outcome, search_effects

STEP, SAMPLES, NOISE = 0.05, 240, 0.01
SURFACES = ("left", "right")


class Wing(AbstractModel):
    """A damped roll rate `p` and a pitch rate `q`, under two surfaces and a thrust."""

    damping: object
    states, inputs, outputs = ("p", "q"), (*SURFACES, "thrust"), ("p", "q")

    def rhs(self, t, x, u):
        return jnp.stack([u[0] - u[1] - self.damping * x[0], u[0] + 0.5 * u[1] + 0.1 * u[2] - x[1]])

    def output(self, t, x, u):
        return x

    def units(self):
        return dict.fromkeys(SURFACES, "rad") | {"thrust": "N"}


MODEL = Wing(jnp.array(0.8))
LAG, LIMIT = (kind(SURFACES, "rad") for kind in (CommonInputLag, CommonInputRateLimit))
SINGLE = tuple(kind(name) for kind in (InputLag, InputRateLimit) for name in SURFACES)


def fly(seed, *effects, noise=NOISE):
    """Return a record of the wing with some effects; the surfaces move at different times."""
    rng, t = np.random.default_rng(seed), STEP * np.arange(SAMPLES)
    white = rng.normal(size=(SAMPLES, 3))
    u = np.stack([np.convolve(column, np.ones(8) / 4, "same") for column in white.T], axis=1)
    model = Augmented(MODEL, effects)
    y = np.zeros((SAMPLES, 2))
    made = record(t, u, y, inputs=MODEL.inputs, outputs=MODEL.outputs, units=MODEL.units())
    y = np.asarray(simulate(model, t, u, model.initial_state(made).at[:2].set(0.0)).y)
    z = y + noise * rng.normal(size=y.shape)
    return record(
        t,
        u,
        z,
        inputs=MODEL.inputs,
        outputs=MODEL.outputs,
        units=MODEL.units(),
        name=f"record {seed}",
    )


@pytest.mark.parametrize(
    ("common", "single", "shape"),
    [(CommonInputLag, InputLag, "time"), (CommonInputRateLimit, InputRateLimit, "limit")],
    ids=["lag", "rate limit"],
)
def test_common_effect_equals_same_effect_on_each_input(common, single, shape):
    parameters = {"gain": jnp.array(0.7), shape: jnp.array(0.4)}
    together = fly(1, common(SURFACES, "rad", **parameters), noise=0.0)
    each = fly(1, *(single(name, **parameters) for name in SURFACES), noise=0.0)
    without = fly(1, noise=0.0)
    np.testing.assert_allclose(together.z, each.z, rtol=0, atol=1e-13)
    # both surfaces are affected, and alone one of them moves less
    first = fly(1, single(SURFACES[0], **parameters), noise=0.0)
    for other in (without, first):
        assert np.max(np.abs(np.asarray(together.z) - np.asarray(other.z))) > 0.05


def test_limit_starts_at_fraction_of_largest_rate_of_all_inputs():
    t = np.arange(4.0)
    signals = {"t": t, "left": 2.0 * t, "right": np.array([0.0, -5.0, -5.0, -4.0])}
    assert float(LIMIT.initialise_shape(signals, {}, 1.0).limit) == 0.2 * 5.0
    assert float(LAG.initialise_shape(signals, {}, 0.1).time) == 0.2


def test_library_has_common_effects_of_inputs_of_one_unit():
    names = [effect.name for effect in general_effects(MODEL)]
    common = {name for name in names if "all inputs" in name}
    assert common == {"lag of all inputs in rad", "rate limit of all inputs in rad (from 20%)"}
    assert names.index("lag of all inputs in rad") < names.index("lag of input left")


class Measured(Wing):
    """A wing with one surface that no actuator drives."""

    def actuated(self):
        return ("left", "thrust")


def test_common_effects_need_two_actuated_inputs():
    names = [effect.name for effect in general_effects(Measured(jnp.array(0.8)))]
    assert not any("all inputs" in name for name in names)


def test_common_effect_on_unknown_input_is_refused():
    with pytest.raises(InputError, match=r"'flap'.*left, right, thrust"):
        check_candidates(MODEL, (CommonInputRateLimit(("left", "flap"), "rad"),))


@pytest.mark.parametrize(
    ("planted", "name"),
    [
        (CommonInputLag(SURFACES, "rad", jnp.array(1.0), jnp.array(0.25)), LAG.name),
        (InputLag("left", jnp.array(1.0), jnp.array(0.25)), "lag of input left"),
        (
            CommonInputRateLimit(SURFACES, "rad", gain=jnp.array(1.0), limit=jnp.array(1.5)),
            LIMIT.name,
        ),
    ],
    ids=["common lag", "single lag", "common rate limit"],
)
def test_common_effect_and_single_one_are_told_apart(planted, name):
    flown = [fly(10 + seed, planted) for seed in range(3)]
    chosen = free(MODEL, "damping", per_record=("initial_state",))
    found = search_effects(
        LoopProblem.of(
            MODEL, (LAG, LIMIT, *SINGLE), chosen, OutputError(), flown[:2], flown[2:], window=20
        )
    )
    assert found.outcome is Outcome.EXPLAINED, str(found)
    assert found.effects == (name,)
