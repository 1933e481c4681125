"""The final model of one study is the declared model of the next: effects in the model are no
longer candidates, all others are.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring, fly
from test_static_model import Lift

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.effects import InputLag, SensorSaturation, Term, general_effects
from jaxid.loop.outcome import Outcome
from jaxid.study.candidates import candidates

LAG = InputLag("force", gain=jnp.array(1.0), time=jnp.array(0.4))
CUBE, SQUARE = (
    Term("v", product, gain=jnp.array(gain)) for product, gain in (("x^3", -0.4), ("x^2", -0.3))
)
STATES = ("initial_state.x", "initial_state.v")


def flights(seed, count, *effects):
    """Records of the spring with these effects, a lag among them settled at first."""
    records = []
    for index in range(count):
        still, noise = fly(100 * seed + index)
        truth = jaxid.Augmented(Spring(1.5, 0.2), effects)
        begin = truth.initial_state(still).at[:2].set(0.0)
        moved = jaxid.simulate(truth, still.t, still.u, begin).y + noise
        records.append(eqx.tree_at(lambda node: node.z, still, moved))
    return records


def declared():
    """The lag, that a study could have found, and the declared spring; the cube is still
    missing.
    """
    model = jaxid.Augmented(Spring(1.5, 0.2), (LAG,))
    return model, jaxid.free(model, "k", "c", "lag of input force.time", per_record=STATES)


@pytest.mark.parametrize("lacks", [CUBE, SQUARE], ids=["cube", "square"])
def test_loop_continues_from_model_with_effects(seed, lacks):
    model, free = declared()
    flown = flights(seed, 4, LAG, lacks)
    library = [
        effect
        for effect in candidates(model, free, flown[0])
        if isinstance(effect, Term | SensorSaturation)
    ]
    study = jaxid.close_loop(
        model,
        free,
        jaxid.OutputError(),
        train=flown[:2],
        check=flown[2],
        test=flown[3],
        window=60,
        effects=library,
    )
    assert study.outcome is Outcome.EXPLAINED
    assert study.effects == (lacks.name,)
    assert all(
        place.location.name != "lagged force" for place in study.localisation["before"].places
    )  # the equation of an effect's own state is exact
    again = {
        effect.name for effect in candidates(study.after.model, study.after.estimate.free, flown[0])
    }
    assert not {LAG.name, lacks.name} & again
    assert "sign(v) in v" in again


def test_effect_in_model_raises_error_as_candidate():
    model, free = declared()
    flown = flights(0, 2, LAG)
    with pytest.raises(InputError, match=r"holds 'lag of input force' already"):
        jaxid.close_loop(
            model,
            free,
            jaxid.OutputError(),
            train=flown[0],
            check=flown[1],
            effects=(eqx.tree_at(_gain, LAG, 0.0),),
        )


def _gain(effect):
    return effect.gain


def test_uneven_times_with_band_limited_input_raise_error():
    model = Spring(1.5, 0.2)
    free = jaxid.free(model, "k", "c", per_record=STATES)
    even, other = fly(0)[0], fly(2)[0]
    uneven = eqx.tree_at(
        lambda node: node.t, other, other.t + 0.02 * jnp.sin(jnp.arange(other.t.size))
    )
    names = [
        {effect.name for effect in candidates(model, free, even, held)} for held in (even, uneven)
    ]
    assert names[0] - names[1] == {"force between samples"}
    band_limited = jaxid.OutputError(hold=jaxid.hold.BandLimited())
    with pytest.raises(InputError, match="uniform sampling"):
        jaxid.close_loop(
            model, free, band_limited, train=even, check=fly(1)[0], test=uneven, effects=(SQUARE,)
        )


def test_static_model_continues_with_effects_on_outputs():
    lag = InputLag("alpha", gain=jnp.array(1.0), time=jnp.array(0.1))
    late = jaxid.Augmented(Lift(jnp.array(5.0), jnp.array(0.4)), (lag,))
    offered = {effect.name for effect in general_effects(late)}
    assert {"alpha^2 in CL", "bias of CL"} <= offered
    assert not any("lagged" in name for name in offered)
    t, u = 0.01 * np.arange(200.0), np.column_stack([np.full(200, 0.2), np.zeros(200)])
    both = jaxid.Augmented(late, (Term("CL", "alpha^2", gain=jnp.array(3.0)),))
    result = jaxid.simulate(both, t, u, np.array([0.1])).y[:, 0]
    alpha = 0.2 - 0.1 * np.exp(-t / 0.1)
    # steps of a tenth of the lag
    np.testing.assert_allclose(result, 5.0 * alpha + 3.0 * alpha**2, rtol=0, atol=1e-5)
