"""Which instruments disagree: a cart whose accelerometer, position and speed are measured, and
simulated flights.
"""

import importlib
import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from notebook_cells import assert_has_printed_lines
from statsmodels.stats.multitest import multipletests

import jaxid
from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array, Float
from jaxid.data import stack
from jaxid.estimation.input_noise import input_noise_covariance
from jaxid.simulation import Linear
from jaxid.study.consistency_result import SensorError

ROOT = Path(__file__).resolve().parent.parent.parent
T = 0.05 * np.arange(200)
SIGMA = np.array([0.02, 0.05])
ERRORS = ("bias.force", "scale.speed", "bias.place")


class Errors(eqx.Module):
    """Errors by channel, so that their names are `bias.force` and so on."""

    force: Float[Array, ""]
    speed: Float[Array, ""]
    place: Float[Array, ""]


class Cart(jaxid.AbstractModel):
    """Acceleration integrated twice, as three erring instruments show it; linear in its three usual
    errors.
    """

    bias: Errors
    scale: Errors
    states, inputs, outputs = ("place", "speed"), ("force",), ("place", "speed")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], (u[0] - self.bias.force) / (1.0 + self.scale.force)])

    def output(self, t, x, u):
        shown = jnp.stack([1.0 + self.scale.place, 1.0 + self.scale.speed]) * x
        return shown + jnp.stack([self.bias.place, self.bias.speed])

    def sensor_errors(self):
        return ("bias.force", "scale.speed")

    def units(self):
        return {"bias.force": "m/s^2", "bias.place": "m"}

    def corrected(self, record):
        u = (record.u - self.bias.force) / (1.0 + self.scale.force)
        bias, scale = ((of.place, of.speed) for of in (self.bias, self.scale))
        z = (record.z - jnp.stack(bias)[None]) / (1.0 + jnp.stack(scale)[None])
        return jaxid.record(
            record.t, u, z, inputs=record.inputs, outputs=record.outputs, name=record.names[0]
        )


def errors(force=0.0, speed=0.0, place=0.0):
    return Errors(jnp.array(force), jnp.array(speed), jnp.array(place))


PERFECT = Cart(errors(), errors())


def measured(key, bias=PERFECT.bias, scale=PERFECT.scale, name="run", input_noise=0.0):
    """A record of the cart, its force a smooth sum of sines, with errors and white noise."""
    force = np.sin(0.9 * T) + 0.7 * np.cos(2.3 * T)
    shown = (1.0 + scale.force) * force + bias.force
    y = jaxid.simulate(
        Cart(bias, scale), T, shown[:, None], jnp.array([1.0, 0.5]), hold=jaxid.hold.Cubic()
    ).y
    for_z, for_u = jax.random.split(key)
    z = y + SIGMA[None] * jax.random.normal(for_z, y.shape)
    u = shown[:, None] + input_noise * jax.random.normal(for_u, (T.size, 1))
    return jaxid.record(T, u, z, inputs=("force",), outputs=("place", "speed"), name=name)


@pytest.fixture(scope="module")
def record():
    return measured(jax.random.key(1), errors(force=0.3), errors(speed=0.1))


@pytest.fixture(scope="module")
def result(record):
    return jaxid.consistency(PERFECT, record)


def test_verdict_states_instruments_and_sizes_of_errors(result):
    assert result.verdict.startswith("force is off by +0.3 m/s^2; speed reads 1")
    assert result.verdict.endswith("% too high.")
    assert [error.name for error in result.significant_errors] == ["bias.force", "scale.speed"]
    for error, true in zip(result.errors, (0.3, 0.1), strict=True):
        assert abs(error.value - true) < 4.0 * float(result.estimate.standard_error(error.name))
    words = str(result)
    assert "bias.force" in words
    assert "* significant at 0.05 over all 2 tried (Holm)" in words
    assert "give `input_noise`" in words


def test_result_is_a_dictionary_of_plain_numbers(result):
    content = json.loads(json.dumps(result.to_dict()))
    assert (content["verdict"], content["records"]) == (result.verdict, ["run"])
    bias = next(error for error in content["errors"] if error["name"] == "bias.force")
    assert (bias["value"], bias["significant"]) == (result.estimate.value("bias.force"), True)
    assert [channel["after"] for channel in content["channels"]] == [
        channel.after for channel in result.channels
    ]
    assert content["estimate"]["successful"] is True


def test_result_is_a_labelled_dataset(result):
    dataset = result.to_xarray()
    bias = dataset.sel(error="bias.force")
    assert float(bias["value"]) == result.estimate.value("bias.force")
    assert bool(bias["significant"])
    assert (str(bias["error_unit"].values), str(bias["record"].values)) == ("m/s^2", "")
    assert dataset["after"].values.tolist() == [channel.after for channel in result.channels]
    assert list(dataset["channel"].values) == [channel.name for channel in result.channels]
    assert dataset.attrs == {"verdict": result.verdict, "level": result.level}


def test_result_is_shown_as_it_prints(result):
    assert_has_printed_lines(result)


def test_residuals_fall_to_noise_level(result):
    """RMS of 200 samples: sigma within 4 of its own 5 % deviations."""
    for channel, sigma in zip(result.channels, SIGMA, strict=True):
        assert channel.before > 1.3 * sigma
        np.testing.assert_allclose(channel.after, sigma, rtol=0.2)


def test_corrected_record_has_no_significant_error(result, record):
    again = jaxid.consistency(PERFECT, result.corrected(record))
    assert again.verdict == "The instruments agree within their errors."
    assert not again.significant_errors
    for error in again.errors:
        assert abs(error.value) < 0.01 * error.standard_error


def test_error_imitated_by_initial_state_is_undetermined(record):
    result = jaxid.consistency(PERFECT, record, ERRORS)
    assert result.verdict.endswith("the records do not determine bias.place.")
    assert "bias.place cannot be distinguished from a different initial state" in result.weak
    assert [error.name for error in result.errors] == list(ERRORS)
    assert (result.errors[2].value, result.errors[2].standard_error, result.errors[2].chance) == (
        0.0,
        np.inf,
        1.0,
    )
    assert [error.name for error in result.significant_errors] == ["bias.force", "scale.speed"]


def test_nearly_collinear_pairs_are_reported(record):
    """About its maximum the speed hardly changes, and its bias and scale are one."""
    fastest = int(jnp.argmax(record.z[10:-10, 1])) + 10
    result = jaxid.consistency(
        PERFECT, record.window(fastest - 10, fastest + 10), ("scale.speed", "bias.speed")
    )
    assert any("can hardly be distinguished" in words for words in result.weak)


def test_holm_correction_equals_statsmodels():
    from jaxid.study.consistency import _tested

    values = np.array([2.6, 0.3, -3.5, 2.2, np.nan, 2.4])
    p = np.array([2 * (1 - _normal(abs(v))) if np.isfinite(v) else 1.0 for v in values])
    rows = [
        SensorError(f"e{k}", None, float(v), 1.0 if np.isfinite(v) else np.nan, "")
        for k, v in enumerate(values)
    ]
    tested = _tested(rows, 0.05)
    reject, corrected, *_ = multipletests(p, 0.05, "holm")
    np.testing.assert_allclose([row.chance for row in tested], corrected, rtol=1e-9)
    assert [row.significant for row in tested] == list(reject)


def _normal(x):
    return 0.5 * (1.0 + float(jax.scipy.special.erf(x / np.sqrt(2.0))))


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("instruments.scale.alpha", 0.049, "alpha reads 4.9 % too high"),
        ("instruments.scale.V", -0.02, "V reads 2 % too low"),
        ("input_bias.q", -0.01, "q is off by -0.01 rad/s"),
        ("instruments.delay.beta", 0.06, "beta is 0.06 s late"),
        ("delay of beta.gain", -0.06, "beta is 0.06 s early"),
        ("instruments.lag.alpha", 0.06, "alpha lags by 0.06 s"),
        ("bias of q.gain", 0.02, "q is off by +0.02 rad/s"),
        ("wind.north", 3.0, "wind.north is 3 rad/s"),
    ],
)
def test_description_names_error_of_instrument(name, value, words):
    assert SensorError(name, None, value, 1.0, "rad/s").description == words
    assert SensorError(name, "A", value, 1.0, "rad/s").description == f"{words} in A"


def test_sensor_effects_are_accepted_as_errors(record):
    cart = jaxid.Augmented(
        PERFECT, (jaxid.effects.SensorScale("speed"), jaxid.effects.SensorBias("place"))
    )
    result = jaxid.consistency(cart, record, ("scale of speed.gain", "bias.force"))
    assert result.verdict.startswith("speed reads 1")
    with pytest.raises(InputError, match="Augmented has no correction of a record"):
        result.corrected(record)
    with pytest.raises(InputError, match="proposes no errors"):
        jaxid.consistency(cart, record)


@pytest.fixture(scope="module")
def two():
    """Two runs whose accelerometer has drifted between them, the scale error of the speed being the
    same.
    """
    first = measured(jax.random.key(2), errors(force=0.3), errors(speed=0.1), "first")
    return first, measured(jax.random.key(3), errors(force=-0.2), errors(speed=0.1), "second")


def test_per_record_error_has_one_value_per_record(two):
    result = jaxid.consistency(PERFECT, two, per_record=("bias.force",))
    assert [(e.name, e.record) for e in result.errors] == [
        ("scale.speed", None),
        ("bias.force", "first"),
        ("bias.force", "second"),
    ]
    assert (
        "force is off by +0.3 m/s^2 in first; force is off by -0.2 m/s^2 in second"
        in result.verdict
    )
    np.testing.assert_allclose(
        [error.value for error in result.errors], [0.1, 0.3, -0.2], atol=0.01
    )
    for flight, bias in zip(two, (0.3, -0.2), strict=True):
        taken = float((flight.u - result.corrected(flight).u)[0, 0])
        np.testing.assert_allclose(taken, bias, atol=0.01)
    with pytest.raises(InputError, match=r"one per record\. Correct one record"):
        result.corrected(stack(two))
    with pytest.raises(InputError, match="no record with errors of its own"):
        result.corrected(measured(jax.random.key(0)))


def test_group_with_one_value_per_record_is_expanded(two):
    """`bias` holds an error that is proposed for all records; it has one value for each record."""
    result = jaxid.consistency(
        PERFECT, two, ("bias.force", "bias.speed", "scale.speed"), per_record=("bias",)
    )
    names = [(error.name, error.record) for error in result.errors]
    assert names[0] == ("scale.speed", None)
    assert {name for name, record in names if record == "second"} == {
        "bias.force",
        "bias.speed",
        "bias.place",
    }


def test_refusals(record, two):
    with pytest.raises(InputError, match=r"no parameter 'bias\.forc'"):
        jaxid.consistency(PERFECT, record, ("bias.forc",))
    with pytest.raises(InputError, match="`skip` is 20 s, and a record is not longer"):
        jaxid.consistency(PERFECT, record, skip=20.0)
    with pytest.raises(InputError, match="There is no record to check"):
        jaxid.consistency(PERFECT, [])
    with pytest.raises(InputError, match="record name 'run' occurs twice"):
        jaxid.consistency(PERFECT, [record, record], per_record=("bias.force",))
    with pytest.raises(InputError, match=r"no input \(in `noise`\) 'place'"):
        jaxid.consistency(PERFECT, record, input_noise={"place": 0.1})
    with pytest.raises(InputError, match=r"noise of 'force' is -0\.1"):
        jaxid.consistency(PERFECT, record, input_noise={"force": -0.1})
    with pytest.raises(InputError, match="`input_noise` applies to errors that all records share"):
        jaxid.consistency(PERFECT, two, per_record=("bias.force",), input_noise={"force": 0.1})
    with pytest.raises(InputError, match="FilterError corrects the states by the measurements"):
        jaxid.consistency(
            PERFECT, record, likelihood=jaxid.FilterError(), input_noise={"force": 0.1}
        )


def test_skip_omits_first_seconds(record):
    """With 1 s of nonsense at the beginning masked, the estimate is that of the rest, initial state
    and all.
    """
    corrupted = jaxid.record(
        T,
        record.u,
        np.where(T[:, None] < 1.0, 7.0, record.z),
        inputs=record.inputs,
        outputs=record.outputs,
    )
    skipped = jaxid.consistency(PERFECT, corrupted, skip=1.0)
    expected = jaxid.consistency(PERFECT, record, skip=1.0)
    np.testing.assert_allclose(skipped.estimate.values, expected.estimate.values, rtol=1e-8)
    assert int(jnp.sum(skipped.estimate.mask)) == 2 * 180


# Noise of the inputs ------------------------------------------------------------------------------


def test_input_noise_covariance_equals_propagated_input_samples(record):
    """A linear model and R known: `added = K diag(sigma^2) K'` with K by moving single input
    samples and estimating again.
    """
    likelihood = jaxid.OutputError(jaxid.FixedNoise(SIGMA**2), hold=Linear())
    complete = stack([record.window(0, 40)])
    free = jaxid.free(PERFECT, "bias.force", "bias.speed", per_record=("initial_state",))
    begin = jaxid.estimate(PERFECT, free, complete, likelihood)
    added = input_noise_covariance(PERFECT, begin, complete, likelihood, {"force": 0.2})

    def moved(k):
        other = eqx.tree_at(lambda r: r.u, complete, complete.u.at[0, k, 0].add(0.5))
        return (jaxid.estimate(PERFECT, free, other, likelihood).values - begin.values) / 0.5

    K = np.stack([np.asarray(moved(k)) for k in range(40)], axis=1)
    np.testing.assert_allclose(added, 0.2**2 * K @ K.T, rtol=1e-6, atol=1e-12)


def test_input_noise_increases_standard_errors(record):
    plain, noisy = (
        jaxid.consistency(PERFECT, record, input_noise=noise) for noise in (None, {"force": 0.5})
    )
    assert noisy.errors[0].standard_error > 1.2 * plain.errors[0].standard_error
    assert "give `input_noise`" not in str(noisy)
    assert noisy.estimate.value("bias.force") == plain.estimate.value("bias.force")


# Flights ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.consistency")


@pytest.mark.parametrize(("noisy", "kind"), [(False, "bound"), (True, "input noise")])
def test_intervals_of_simulated_flights_cover_planted_errors(benchmark, noisy, kind):
    """200 flights of 6 s, thirteen errors: the band, 0.88 to 0.995, holds a right estimator
    with 99.9 % probability.

    `python -m benchmarks.consistency` does the same with 1,000 flights of 10 s. With noise in the
    inputs the Cramer-Rao bound alone covers too little, which it must, or the noise was none.
    """
    coverage = benchmark.coverage(
        benchmark.flights(200, noisy_inputs=noisy, chunk=200, seconds=6.0)
    )
    assert coverage["converged"] == 200
    assert 0.87 < coverage["band"][0] < 0.89
    assert benchmark.within(coverage, kind), benchmark.table(
        "flights", coverage | {"seconds": 0.0}, kind
    )
    assert benchmark.within(coverage, "bound") != noisy
