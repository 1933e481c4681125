"""Findings on records before a fit: each check fires on its fault and is silent without it."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring

import jaxid
from jaxid._foundation.types import Array
from jaxid.study import FindingKind, advice

TRUTH, MODEL = Spring(jnp.array(2.0), jnp.array(0.3)), Spring(jnp.array(1.0), jnp.array(0.2))
SIGMA, DT, SAMPLES = 0.02, 0.1, 400
TIME = DT * np.arange(SAMPLES)
QUIET = slice(0, 40)


def excitation(kind, rng):
    """A common input; all but the noise begin with rest."""
    u = np.zeros(SAMPLES)
    if kind == "noise":
        return rng.normal(size=SAMPLES)
    if kind == "3-2-1-1":
        edges = 40 + 8 * np.cumsum([0, 3, 2, 1, 1])
        for start, stop, sign in zip(edges, edges[1:], (1, -1, 1, -1), strict=False):
            u[start:stop] = sign
    elif kind == "held":
        u[40:] = np.repeat(rng.normal(size=18), 20)
    elif kind == "sweep":
        u[40:] = np.sin(2 * np.pi * (0.05 + 0.006 * TIME[:360]) * TIME[:360])
    else:
        phase = rng.uniform(0, 2 * np.pi, 11)
        u[40:] = sum(np.sin(0.3 * k * TIME[:360] + phase[k]) for k in range(1, 11)) / 3
    return u


class Both(Spring):
    """The spring with its speed measured as well."""

    outputs = ("x", "v")

    def output(self, t, x, u):
        return x


KINDS = ("noise", "held", "3-2-1-1", "sweep", "multisine")


def measure(seed=0, kind="held", delay=0, **units):
    """Time, input and output of the true spring, with noise."""
    rng = np.random.default_rng(seed)
    u = excitation(kind, rng)
    late = np.concatenate([np.full(delay, u[0]), u[: SAMPLES - delay]])
    y = np.asarray(jaxid.simulate(TRUTH, TIME, late[:, None], np.zeros(2)).y)[:, 0]
    return TIME, u, y + SIGMA * rng.normal(size=SAMPLES)


def made(t, u, z, **options):
    return jaxid.record(t, u, z, inputs=("force",), outputs=("x",), **options)


def kinds(record, model=MODEL):
    return [finding.kind for finding in advice(record, model).findings]


def only(record, kind, model=MODEL):
    """Return the single finding of a record, which must be of this kind."""
    findings = advice(record, model).findings
    assert [finding.kind for finding in findings] == [kind], findings
    return findings[0]


@pytest.mark.parametrize("kind", KINDS)
def test_clean_records_have_no_finding(kind):
    """A false alarm in 1,000 records (of 600 there is none) has 2 % in these twenty."""
    records = [made(*measure(seed, kind)) for seed in range(4)]
    assert advice(records, MODEL).findings == ()


def test_hole_in_time_is_found():
    t, u, z = measure()
    keep = np.r_[0:150, 200:SAMPLES]
    finding = only(made(t[keep], u[keep], z[keep]), FindingKind.HOLE)
    assert finding.numbers["seconds"] == pytest.approx(51 * DT)


def test_uneven_times_are_found():
    t, u, z = measure()
    jitter = 0.02 * np.sin(np.arange(SAMPLES))
    finding = only(made(t + jitter, u, z), FindingKind.UNEVEN_TIMES)
    assert 0.5 < finding.numbers["shortest"] < 1 < finding.numbers["longest"] < 1.5


def test_missing_samples_are_found_with_share_and_length():
    t, u, z = measure()
    z[100:140] = np.nan
    finding = only(made(t, u, z), FindingKind.MISSING)
    assert finding.numbers["share"] == pytest.approx(0.1)
    assert finding.numbers["longest"] == pytest.approx(41 * DT)


def test_constant_channels_are_found():
    t, u, z = measure()
    assert FindingKind.CONSTANT in kinds(made(t, u, np.full(SAMPLES, 0.5)))
    assert FindingKind.CONSTANT in kinds(made(t, np.zeros(SAMPLES), z))


def test_coarse_steps_are_found_with_their_size():
    t, u, z = measure()
    finding = only(made(t, u, 0.1 * np.round(z / 0.1)), FindingKind.QUANTISATION)
    assert finding.numbers["step"] == pytest.approx(0.1)
    assert kinds(made(t, u, 1e-4 * np.round(z / 1e-4))) == []  # fine steps


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_saturation_is_found_at_both_ends(sign):
    t, u, z = measure()
    finding = only(made(t, u, sign * np.minimum(sign * z, 0.3)), FindingKind.SATURATION)
    assert finding.numbers["value"] == sign * 0.3


def test_settled_output_is_not_saturated():
    """A step that ends at rest at its largest value, in coarse steps."""
    t = np.arange(SAMPLES) * DT
    u = np.where(t < 10, 0.0, 1.0)
    settled = 0.001 * np.round(1000 * np.where(t < 10, 0.0, 1 - np.exp(10 - t)))
    assert FindingKind.SATURATION not in kinds(made(t, u, settled))


def test_offset_at_rest_is_found_with_its_value():
    t, u, z = measure()
    finding = only(made(t, u, z + 0.1), FindingKind.OFFSET)
    assert finding.numbers["value"] == pytest.approx(0.1, abs=4 * SIGMA / np.sqrt(40))


def test_offset_is_not_reported_where_the_model_has_other_points_of_rest():
    """The position of a mass without a spring may have any value at rest."""
    t, u, z = measure()
    mass = Spring(jnp.array(0.0), jnp.array(0.3))
    assert FindingKind.OFFSET not in kinds(made(t, u, z + 0.1), mass)


@pytest.mark.parametrize("kind", KINDS)
def test_drift_is_found_with_its_slope(kind):
    t, u, z = measure(kind=kind)
    findings = advice(made(t, u, z + 0.01 * t), MODEL).of(FindingKind.DRIFT)
    assert [finding.numbers["slope"] for finding in findings] == [pytest.approx(0.01, rel=0.2)]


@pytest.mark.parametrize("kind", ["noise", "3-2-1-1"])
def test_delay_is_found_with_its_time(kind):
    finding = only(made(*measure(kind=kind, delay=4)), FindingKind.DELAY)
    assert finding.names == ("force", "x")
    assert finding.numbers["seconds"] == pytest.approx(4 * DT, abs=DT)


def closed_loop(seed, gain=1.5, *, at_once):
    """Position fed back to the force, from this sample or from the one before."""
    from scipy.linalg import expm

    rng, x, z, u = np.random.default_rng(seed), np.zeros(2), np.zeros(SAMPLES), np.zeros(SAMPLES)
    block = np.zeros((3, 3))
    block[:2] = [[0, 1, 0], [-2, -0.3, 1]]
    step, programme = expm(DT * block), np.repeat(rng.normal(size=20), 20)
    for i in range(SAMPLES):
        z[i] = x[0] + SIGMA * rng.normal()
        u[i] = programme[i] - gain * z[i if at_once else max(i - 1, 0)]
        x = step[:2, :2] @ x + step[:2, 2] * u[i]
    return made(TIME, u, z)


@pytest.mark.parametrize("at_once", [True, False])
def test_feedback_is_found(at_once):
    """In three of four records; large steps of the programme can hide it in the others."""
    found = [FindingKind.FEEDBACK in kinds(closed_loop(seed, at_once=at_once)) for seed in range(4)]
    assert sum(found) >= 3


class TwoForces(jaxid.AbstractModel):
    """A mass on a spring with two forces."""

    k: Array
    first: Array
    second: Array
    states, inputs, outputs = ("x", "v"), ("a", "b"), ("x",)

    def rhs(self, t, x, u):
        force = self.first * u[0] + self.second * u[1]
        return jnp.stack([x[1], force - self.k * x[0] - 0.3 * x[1]])

    def output(self, t, x, u):
        return x[:1]


def two_forces(independent):
    t, u, z = measure(kind="noise")
    rng = np.random.default_rng(3)
    both = np.stack([u, u + (1.0 if independent else 0.05) * rng.normal(size=SAMPLES)], axis=1)
    return jaxid.record(t, both, z, inputs=("a", "b"), outputs=("x",))


def test_collinear_inputs_are_found_with_their_inflation():
    model = TwoForces(jnp.array(2.0), jnp.array(0.5), jnp.array(0.5))
    findings = advice(two_forces(independent=False), model).of(FindingKind.COLLINEAR)
    assert [finding.names for finding in findings] == [("a",), ("b",)]
    assert findings[0].numbers["inflation"] == pytest.approx(1 / 0.05**2, rel=0.2)
    assert not advice(two_forces(independent=True), model).of(FindingKind.COLLINEAR)


def test_parameters_that_no_record_shows_are_found():
    """With one force in place of two, only the sum of their gains is determined."""
    t, u, z = measure(kind="noise")
    record = jaxid.record(t, np.stack([u, u], 1), z, inputs=("a", "b"), outputs=("x",))
    model = TwoForces(jnp.array(2.0), jnp.array(0.5), jnp.array(0.5))
    given = advice(record, model)
    (finding,) = given.of(FindingKind.UNDETERMINED)
    assert finding.names == ("first", "second")
    assert given.information.undetermined == finding.names
    only_first = jaxid.free(model, "k", "first", per_record=("initial_state",))
    assert not advice(record, model, only_first).of(FindingKind.UNDETERMINED)


class Letters(jaxid.AbstractModel):
    """An oscillator with forces whose gains have names that words contain."""

    m: Array
    d: Array
    e: Array
    states, inputs, outputs = ("x", "v"), ("a", "b"), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], self.d * u[0] - 2.0 * x[0] - 0.3 * x[1] + 0.0 * self.m])

    def output(self, t, x, u):
        return x[:1] + self.e * u[1]


def test_finding_on_a_direction_has_its_own_parameters_only():
    """m acts nowhere, and the input of e is always zero; the sentences contain d, e and m."""
    t, u, z = measure(kind="noise")
    record = jaxid.record(
        t, np.stack([u, 0.0 * u], 1), z, inputs=Letters.inputs, outputs=Letters.outputs
    )
    given = advice(record, Letters(jnp.array(1.0), jnp.array(1.0), jnp.array(0.5)))
    names = sorted(finding.names for finding in given.of(FindingKind.UNDETERMINED))
    assert names == [("e",), ("m",)]


def test_hardly_determined_parameters_are_found():
    t, u, z = measure(kind="noise")
    loud = z + 3.0 * np.random.default_rng(1).normal(size=SAMPLES)
    findings = advice(made(t[:80], u[:80], loud[:80]), MODEL).of(FindingKind.HARDLY)
    assert findings
    assert all(finding.numbers["relative"] > 0.5 for finding in findings)


def test_information_of_records_adds():
    records = [made(*measure(seed)) for seed in range(2)]
    one, two = (advice(part, MODEL).information for part in (records[:1], records))
    both = [advice(record, MODEL).information.factor for record in records]
    together = sum(factor.T @ factor for factor in both)
    np.testing.assert_allclose(two.factor.T @ two.factor, together, rtol=0.2)
    assert np.all(two.standard_errors < one.standard_errors)


def test_slow_sampling_and_short_record_are_found():
    t, u, z = measure(kind="noise")
    fast = Spring(jnp.array(400.0), jnp.array(2.0))
    assert FindingKind.SLOW_SAMPLING in kinds(made(t, u, z), fast)
    slow = Spring(jnp.array(1e-3), jnp.array(1e-3))
    assert FindingKind.SHORT_RECORD in kinds(made(t, u, z), slow)


def test_mode_without_power_of_the_inputs_is_found():
    t, _, z = measure()
    u = np.sin(2 * np.pi * 1.6 * t)  # seven times the mode's frequency
    finding = only(made(t, u, z), FindingKind.UNEXCITED_MODE)
    assert finding.numbers["rate"] == pytest.approx(1.0)


class Torsion(Spring):
    """The spring as a rotating one, with units."""

    def units(self):
        return {"x": "rad", "force": "rad"}


TORSION = Torsion(jnp.array(1.5), jnp.array(0.3))


@pytest.mark.parametrize("ratio", [180 / np.pi, 30 / np.pi, 1000.0])
@pytest.mark.parametrize("other", [0, 1])
def test_output_in_another_unit_than_in_the_other_record_is_found(ratio, other):
    scales = np.array([1.0, 1.0])
    scales[other] = ratio
    records = [
        made(t, u, scale * z)
        for scale, (t, u, z) in zip(scales, (measure(seed) for seed in range(2)), strict=True)
    ]
    (finding,) = advice(records, MODEL).of(FindingKind.OTHER_UNIT)
    assert (finding.record, finding.names) == (str(other), ("x", "force"))
    assert finding.numbers["ratio"] == pytest.approx(ratio, rel=0.1)
    assert f"in record {1 - other}" in str(finding)


def test_records_of_different_size_are_not_in_another_unit():
    """Input and output 57.3 times smaller, at the noise, or the model far from the truth."""
    t, u, z = measure()
    small = made(t, u / 57.3, z / 57.3)
    noise = made(t, u / 57.3, 0.02 * np.random.default_rng(1).normal(size=SAMPLES))
    stiff = Spring(jnp.array(20.0), jnp.array(0.2))
    for records, model in (([made(t, u, z), small, noise], MODEL), ([made(t, u, z), small], stiff)):
        assert advice(records, model).of(FindingKind.OTHER_UNIT) == ()


def test_angles_in_degrees_are_found():
    t, u, z = measure()
    assert kinds(made(t, u, z, units={"x": "rad"}), TORSION) == []
    found = advice(made(t, 57.3 * u, 57.3 * z, units={"x": "rad"}), TORSION)
    assert [finding.names for finding in found.of(FindingKind.DEGREES)] == [("force",)]
    found = advice(made(t, u, 57.3 * z, units={"x": "rad"}), TORSION)
    assert [finding.names for finding in found.of(FindingKind.DEGREES)] == [("x",)]


def test_output_without_a_sample_in_the_longest_piece_is_named():
    t, u, z = measure()
    both = np.stack([z, z], axis=1)
    both[100:, 1] = np.nan
    holed = np.where(np.arange(SAMPLES) < 100, t, t + 20.0)
    given = jaxid.record(holed, u, both, inputs=("force",), outputs=("x", "v"))
    model = Both(jnp.array(1.0), jnp.array(0.2))
    missing = advice(given, model).of(FindingKind.MISSING)
    assert [finding.names for finding in missing] == [("v",)]


def test_other_units_than_the_models_are_found():
    t, u, z = measure()
    finding = only(made(t, u, z, units={"x": "m"}), FindingKind.UNIT, TORSION)
    assert (finding.names, finding.units) == (("x",), ("m", "rad"))


def test_milliseconds_are_found():
    t, u, z = measure()
    findings = kinds(made(np.round(1000 * t), u, z))
    assert FindingKind.MILLISECONDS in findings
    assert FindingKind.SLOW_SAMPLING not in findings
    assert kinds(made(np.round(1000 * t), u, z, units={"t": "ms"})) == []


def test_diverging_model_is_found_with_its_time():
    t, u, z = measure()
    unstable = Spring(jnp.array(-400.0), jnp.array(-50.0))
    given = advice(made(t, u, z), unstable)
    (finding,) = given.of(FindingKind.DIVERGENCE)
    assert 0 < finding.numbers["seconds"] <= TIME[-1]
    assert given.information is None


class Scale(jaxid.AbstractModel):
    """A static calibration."""

    gain: Array
    states, inputs, outputs = (), ("true",), ("read",)

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return self.gain * u


def test_static_model_has_advice():
    t, u, _ = measure(kind="noise")
    record = jaxid.record(t, u, 2 * u, inputs=("true",), outputs=("read",))
    given = advice(record, Scale(jnp.array(1.0)))
    assert given.findings == ()
    assert given.information.names == ("gain",)


def test_table_has_every_finding_input_and_parameter():
    t, u, z = measure()
    given = advice(made(t, u, z + 0.1, name="flight 7"), MODEL)
    for words in ("offset at rest", "flight 7", "force", "standard errors", "well, to"):
        assert words in str(given)
    assert "offset at rest" in given._repr_html_()
    plain = given.to_dict()
    assert plain["findings"][0]["kind"] == "offset at rest"
    assert set(plain["standard_errors"]) == {"k", "c"}
    assert "No finding." in str(advice(made(t, u, z), MODEL))


def test_every_kind_has_words():
    from jaxid.study.record_checks.wording import SENTENCES

    assert set(SENTENCES) == {kind.name for kind in FindingKind}


def test_record_with_more_channels_is_reduced_and_without_them_refused():
    t, u, z = measure()
    more = jaxid.record(t, u, np.stack([z, z], 1), inputs=("force",), outputs=("x", "other"))
    assert advice(more, MODEL).findings == ()
    wrong = jaxid.record(t, u, z, inputs=("force",), outputs=("position",))
    with pytest.raises(jaxid.InputError, match="does not fit the model"):
        advice(wrong, MODEL)
    with pytest.raises(jaxid.InputError, match="no record"):
        advice([], MODEL)


class Tank(jaxid.AbstractModel):
    """A tank that empties, and its level."""

    outflow: Array
    states, inputs, outputs = ("level",), ("inflow",), ("measured",)

    def rhs(self, t, x, u):
        return u - self.outflow * jnp.sqrt(x)

    def output(self, t, x, u):
        return x


class Pipe(Tank):
    """A tank with a linear outflow, whose rate of flow is measured behind an orifice."""

    def rhs(self, t, x, u):
        return u - self.outflow * x

    def output(self, t, x, u):
        return jnp.sqrt(x)


@pytest.mark.parametrize("first", [0.0, 0.5])
@pytest.mark.parametrize("tank", [Tank, Pipe])
def test_model_with_an_infinite_slope_has_advice(tank, first):
    """The slope of a root is infinite at zero: at the first sample, or in the test for rest."""
    rng = np.random.default_rng(0)
    inflow = 0.3 + 0.05 * excitation("held", rng)
    measured = 0.7 + 0.3 * TIME / TIME[-1] + 0.002 * rng.normal(size=SAMPLES)
    given = advice(
        jaxid.record(
            TIME,
            inflow,
            measured,
            inputs=("inflow",),
            outputs=("measured",),
            constants={"initial_state.level": first},
        ),
        tank(jnp.array(0.4)),
    )
    assert not given.of(FindingKind.OFFSET)
    assert len(given.excitation) == 1
