"""The closed loop on a spring: missing effects, complete models, and undecidable cases."""

import dataclasses
import functools
import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import SIGMA, Spring, fly

from jaxid import AbstractModel, LoopOptions, OutputError, close_loop, free, record, simulate
from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.design import Determinant, Limits, design_input, sample_times
from jaxid.diagnosis import LocalisationResult, Place
from jaxid.effects import (
    Augmented,
    DryFriction,
    EffectCard,
    InputBetweenSamples,
    InputDelay,
    InputLag,
    InputRateLimit,
    LaggedSignal,
    Location,
    LocationKind,
    ParameterShift,
    Placement,
    QuadraticDrag,
    Resonance,
    SensorBias,
    SensorDelay,
    SensorLag,
    SensorSaturation,
    SensorScale,
    Term,
)
from jaxid.effects.base import Effect
from jaxid.estimation.estimate import as_stack
from jaxid.loop import Coloured, Hypothesis, LoopProblem, Outcome, RandomForces
from jaxid.loop.assess import in_place, one_function
from jaxid.loop.evidence import Decision, is_degenerate
from jaxid.loop.fit import fit
from jaxid.loop.wording import NO_PLACE
from jaxid.models import FixedNoise
from jaxid.study import next_record
from jaxid.study.candidates import candidates
from jaxid.study.rivals import discrimination
from jaxid.study.study_records import TEST_BEYOND, channels_beyond
from jaxid.study.wording import location_line

WINDOW = 60
COMPILED = "/jax/core/compile/backend_compile_duration"
TRAIN, CHECK, TEST = (0, 1, 2), (3, 4), (5, 6)


LIBRARY = (
    *(Term("v", product) for product in ("1", "x^2", "x v", "x^3", "x^2 v", "v^3")),
    *(kind("x") for kind in (SensorBias, SensorSaturation)),
    InputDelay("force"),
)


def study(effect, seed, effects=LIBRARY, likelihood=None, first=0):
    """A study of seven records."""
    flown = [fly(1000 * seed + first + index, effect)[0] for index in range(7)]
    return closed(flown, effects, likelihood)


def closed(flown, effects=LIBRARY, likelihood=None):
    """The loop on seven records, with stiffness and damping free."""
    train, check, test = ([flown[index] for index in part] for part in (TRAIN, CHECK, TEST))
    model = Spring(1.0, 0.1)
    chosen = free(model, "k", "c", per_record=("initial_state",))
    options = dict(effects=effects, window=WINDOW)
    return close_loop(
        model, chosen, likelihood or OutputError(), train=train, check=check, test=test, **options
    )


def realised(effect, seed):
    """RMS of the noise that stands in the scored samples of the test records."""
    noise = np.concatenate([fly(1000 * seed + index, effect)[1][WINDOW:] for index in TEST])
    return float(np.sqrt(np.mean(noise**2)))


PLANTED = {
    "x^3 in v": Term("v", "x^3", jnp.array(-0.6)),
    "x^2 in v": Term("v", "x^2", jnp.array(0.3)),
    "delay of input force": InputDelay("force", jnp.array(0.15)),
}


@pytest.fixture(scope="module")
def planted_study():
    """Function from the name of a planted effect to its study, computed once."""
    return functools.cache(lambda name: study(PLANTED[name], seed=1))


@pytest.mark.parametrize("name", PLANTED)
def test_loop_adds_only_the_planted_effect(planted_study, name):
    result = planted_study(name)
    assert result.effects == (name,)
    assert result.outcome is Outcome.EXPLAINED
    assert result.error_notes == ()
    assert result.before.rms["test"]["x"] > 1.5 * result.after.rms["test"]["x"]
    # The estimate costs a few degrees of freedom of hundreds of samples: within 3 % of the noise
    # that is really there.
    assert result.after.rms["test"]["x"] == pytest.approx(realised(PLANTED[name], 1), rel=0.03)
    value = result.after.estimate.value(f"{name}.gain")
    error = result.after.estimate.standard_error(f"{name}.gain")
    assert abs(value - float(PLANTED[name].gain)) < 4 * error


def test_early_input_is_named_as_negative_delay():
    others = (InputLag("force"), InputRateLimit("force"))  # less than none of either leads as well
    result = study(InputDelay("force", jnp.array(-0.15)), seed=4, effects=(*LIBRARY, *others))
    assert result.effects == ("delay of input force",)
    assert "acts earlier than it is recorded" in result.verdict
    refitted = {
        candidate.name: candidate.decision
        for candidate in result.rounds[0].candidates
        if candidate.cost_fall is not None
    }
    assert refitted["lag of input force"] is Decision.DEGENERATE
    assert refitted["rate limit of input force (from 20%)"] is Decision.DEGENERATE


def test_caveat_names_test_records_with_worse_prediction():
    cubic = PLANTED["x^3 in v"]
    softer = Term("v", "x^3", jnp.array(0.02))
    others = [fly(2005 + index, softer)[0] for index in range(2)]
    result = closed([*(fly(2000 + index, cubic)[0] for index in range(5)), *others])
    assert result.effects == ("x^3 in v",)
    assert result.after.rms["test"]["x"] > result.before.rms["test"]["x"]
    assert "On test the error grows in x" in result.verdict
    well = study(cubic, seed=2)
    assert "grows" not in well.verdict
    used, pushed = as_stack(others), dataclasses.replace(others[0], u=1.5 * others[0].u)
    assert channels_beyond(used, as_stack(others[1]), TEST_BEYOND) == ()
    assert channels_beyond(used, as_stack(pushed), TEST_BEYOND) == ("force",)


class Undamped(AbstractModel):
    """`dv/dt = force - k x`, with the position seen."""

    k: Array
    states, inputs, outputs = Spring.states, Spring.inputs, Spring.outputs

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0]])

    def output(self, t, x, u):
        return x[:1]


def test_undeclared_damping_is_named():
    """Among the terms, drag and friction of the library that the loop takes by itself."""
    train, check, test = (
        [fly(4000 + index, None)[0] for index in part] for part in (TRAIN, CHECK, TEST)
    )
    model = Undamped(1.0)
    chosen = free(model, "k", per_record=("initial_state",))
    known = candidates(model, chosen, as_stack(train))
    library = [effect for effect in known if isinstance(effect, Term | DryFriction | QuadraticDrag)]
    parts = dict(train=train, check=check, test=test, effects=library, window=WINDOW)
    result = close_loop(model, chosen, OutputError(), **parts)
    assert result.effects == ("v in v",)
    assert result.outcome is Outcome.EXPLAINED
    error = result.after.estimate.standard_error("v in v.gain")
    assert abs(result.after.estimate.value("v in v.gain") + 0.2) < 4 * error


MODES = ((0.3, 4.0, 0.04), (0.5, 6.5, 0.03))  # gain, frequency, damping


@pytest.mark.parametrize("modes", [MODES[:1], MODES], ids=["one", "two"])
def test_planted_resonances_are_identified_among_memory_shapes(modes):
    """Among the shapes with a memory, from starts that know nothing of where they are; two of one
    family act at once.
    """
    in_v = Placement.equation("v")
    planted = [
        Resonance(in_v, "force", peak, *map(jnp.array, values))
        for peak, values in enumerate(modes, start=1)
    ]
    library = (
        *(Resonance(in_v, "force", peak) for peak in (1, 2, 3)),
        LaggedSignal(in_v, "v"),
        *LIBRARY,
    )
    result = closed([fly(2000 + index, *planted)[0] for index in range(7)], library)
    assert len(result.effects) == len(modes)
    assert all(name.startswith("resonance to force in v") for name in result.effects)
    assert result.outcome is Outcome.EXPLAINED
    assert result.verdict.count("excites a resonance") == 1
    estimate = result.after.estimate
    near = sorted(result.effects, key=lambda name: float(estimate.value(f"{name}.frequency")))
    for name, mode in zip(near, planted, strict=True):
        for field in ("gain", "frequency", "damping"):
            error = estimate.standard_error(f"{name}.{field}")
            assert (
                abs(estimate.value(f"{name}.{field}") - float(getattr(mode, field))) < 4 * error
            ), (name, field)


def test_evident_stop_is_added_before_effect_with_larger_cost_fall():
    flown = [fly(3000 + index, PLANTED["x^3 in v"])[0] for index in range(7)]
    level = 0.6 * max(float(jnp.max(record.z)) for record in flown[:3])
    stopped = [
        eqx.tree_at(lambda record: record.z, record, jnp.minimum(record.z, level))
        for record in flown
    ]
    result = closed(stopped)
    assert [entry.added for entry in result.rounds] == ["upper saturation of x", "x^3 in v", None]
    falls = {candidate.name: candidate.cost_fall for candidate in result.rounds[0].candidates}
    assert falls["x^3 in v"] > 2 * falls["upper saturation of x"]
    assert result.outcome is Outcome.EXPLAINED
    assert result.after.estimate.value("upper saturation of x.level") == pytest.approx(
        level, abs=SIGMA
    )


def test_bias_and_constant_force_are_alternatives_for_spring():
    # With free initial states a bias b of x and a force of -k b give the same records.
    result = study(SensorBias("x", jnp.array(0.1)), seed=1)
    (kept,) = result.effects
    alternatives = {effect.name: effect for effect in result.alternatives}
    assert {kept, *alternatives} >= {"bias of x", "1 in v"}
    other = ({"bias of x", "1 in v"} - {kept}).pop()
    # Neither is shown to be the cause.
    assert result.outcome is Outcome.PROXIES
    assert result.objections[0].names == (other,)
    assert alternatives[other].instead_of == (kept,)
    # of a hundred and more: the solver stops where a decision needs no more
    assert abs(alternatives[other].chi_square) < 0.1
    # No record of the same kind would distinguish them either.
    assert discrimination(result, fly(77, None)[0])[other] < 1e-6


def test_complete_model_gains_no_effect():
    # At a level of 1 % a false find in five studies has a probability of 5 %; the seeds are fixed.
    result = [study(None, seed) for seed in range(2, 7)]
    assert [study.effects for study in result] == [()] * 5
    assert {study.outcome for study in result} == {Outcome.NOTHING_MISSING}
    assert all(study.after.rms == study.before.rms for study in result)


def test_true_effect_outside_library_yields_no_cause():
    library = tuple(
        effect for effect in LIBRARY if effect.name not in ("x^3 in v", "x^2 v in v", "v^3 in v")
    )
    result = study(PLANTED["x^3 in v"], seed=1, effects=library)
    assert result.outcome in (Outcome.PROXIES, Outcome.UNEXPLAINED)
    assert result.verdict.startswith("Something is missing")


def shaken(seed, samples=300, cubic=0.0):
    """A record of the spring, with a cubic part or without, and with a random force of 0.1 1/s^2
    and 0.5 s in it, in steps of a twentieth of a sample."""
    rng = np.random.default_rng(seed)
    t, u = 0.1 * np.arange(samples), np.convolve(rng.normal(size=samples), np.ones(8) / 2.5, "same")
    keep, h = np.exp(-0.005 / 0.5), 0.005
    d, x, y = 0.1 * rng.normal(), np.zeros(2), []
    for i in range(samples):
        y.append(x[0])
        for part in range(20):
            force = u[i] + part / 20 * (u[min(i + 1, samples - 1)] - u[i])
            d = keep * d + np.sqrt(1 - keep**2) * 0.1 * rng.normal()
            x = x + h * np.array([x[1], force - 1.5 * x[0] - cubic * x[0] ** 3 - 0.2 * x[1] + d])
    z = np.array(y)[:, None] + SIGMA * rng.normal(size=(samples, 1))
    return record(t, u[:, None], z, inputs=("force",), outputs=("x",), name=f"record {seed}")


@pytest.fixture(scope="module")
def shaken_study():
    return closed([shaken(10 + index) for index in range(7)])


def test_random_force_is_reported_as_process_noise_without_effects(shaken_study):
    result = shaken_study
    assert (result.outcome, result.effects) == (Outcome.PROCESS_NOISE, ())
    assert isinstance(result.noise_model, RandomForces)
    assert result.noise_model.equations == ("v",)
    for name, true in (("process.v", 0.1), ("correlation_time.v", 0.5)):
        value, error = (
            float(getattr(result.after.estimate, part)(name))
            for part in ("value", "standard_error")
        )
        assert abs(value - true) < 4.0 * error < 4.0 * true
    assert "random forces" in result.verdict
    note = "does not contain the motion that the random forces cause"
    assert note in str(result)
    assert note in result._repr_html_()


def test_next_record_after_random_forces_is_refused(shaken_study):
    t, limits = sample_times(5.0, 0.1), Limits({"force": 0.3})
    with pytest.raises(InputError, match=r"random forces in the equation of v.*`jaxid\.design"):
        next_record(shaken_study, t, limits)
    design = design_input(
        shaken_study.after.model,
        shaken_study.before.estimate.free,
        t,
        shape=None,
        measure=Determinant(),
        limits=limits,
        likelihood=OutputError(FixedNoise(jnp.array([SIGMA**2]))),
    )
    assert design.information.names == ("k", "c")


def coloured(seed, effect=None):
    """A record of the spring, with an effect, whose position has a noise of 0.02 that remembers 0.5
    s.
    """
    flown, noise = fly(seed, effect)
    fresh, keep = (
        SIGMA * np.random.default_rng([seed, 1]).normal(size=noise.shape),
        np.exp(-0.1 / 0.5),
    )
    error = fresh[:1]
    for draw in fresh[1:]:
        error = np.concatenate([error, keep * error[-1:] + np.sqrt(1 - keep**2) * draw[None]])
    return eqx.tree_at(lambda node: node.z, flown, flown.z - noise + error)


def test_coloured_sensor_noise_is_reported_without_effects(seed):
    result = closed([coloured(seed + index) for index in range(7)])
    assert (result.outcome, result.effects) == (Outcome.COLOURED_NOISE, ())
    assert isinstance(result.noise_model, Coloured)
    assert "coloured sensor noise" in result.verdict
    assert "coloured" in json.loads(result.to_json())["noise_model"]


def test_effect_made_superfluous_by_coloured_noise_is_removed():
    # Of a hundred and more such studies, one whose noise has a mean that a score without regard to
    # its colour takes for a constant.
    result = closed([coloured(7 + index) for index in range(7)])
    assert result.effects == ()
    assert result.outcome in (Outcome.COLOURED_NOISE, Outcome.UNEXPLAINED)


def test_planted_effect_is_named_under_coloured_noise(seed):
    result = closed([coloured(seed + index, PLANTED["x^3 in v"]) for index in range(7)])
    assert (result.outcome, result.effects) == (Outcome.EXPLAINED, ("x^3 in v",))
    assert isinstance(result.noise_model, Coloured)
    assert "consistent with coloured sensor noise" in result.verdict


def test_constant_sensor_error_is_not_reported_as_coloured_noise():
    """A bias that the library does not know would be noise with an endless memory."""
    result = study(SensorBias("x", jnp.array(0.1)), seed=1, effects=LIBRARY[1:6])
    assert result.outcome in (Outcome.PROXIES, Outcome.UNEXPLAINED)
    # The reported noise is the white part of the residual, not the complete residual. The limit is
    # three times the 3 % scatter of 600 samples.
    assert result.noise["x"] == pytest.approx(SIGMA, rel=0.1)
    assert float(result.after.estimate.noise[0, 0]) > (1.5 * SIGMA) ** 2


def hard_spring(seed):
    """One record of a spring that hardens, so much that the linear one is far from it."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(200)
    u = np.convolve(3.0 * rng.normal(size=200), np.ones(8) / 2.5, "same")[:, None]
    truth = Augmented(Spring(jnp.array(1.5), jnp.array(0.2)), (Term("v", "x^3", jnp.array(-0.3)),))
    y = np.asarray(simulate(truth, t, u, jnp.zeros(2)).y)
    return record(t, u, y + SIGMA * rng.normal(size=y.shape), inputs=("force",), outputs=("x",))


@pytest.mark.parametrize("time", [0.5, 1e9])
def test_lag_longer_than_any_record_is_degenerate(time):
    """It follows nothing any more, and its gain is the damping's: the records determine neither."""
    late = LaggedSignal(Placement.equation("v"), "v", gain=jnp.array(-0.4), time=jnp.array(0.5))
    model, absent = Spring(1.5, 0.2), LaggedSignal(Placement.equation("v"), "v")
    flown = as_stack([fly(60 + seed, late)[0] for seed in range(2)])
    problem = LoopProblem.of(model, (absent,), free(model, "k", "c"), OutputError(), flown, flown)
    start = {f"{late.name}.gain": 0.1, f"{late.name}.time": time}
    fitted = fit(problem, Hypothesis((late.name,)), start=start)
    assert is_degenerate(fitted, [late.name]) == (time > 1e6)


def test_model_of_plain_numbers_has_library():
    model, arrays = Spring(1.0, 0.1), Spring(jnp.array(1.0), jnp.array(0.1))
    flown = as_stack([fly(0, None)[0]])
    names, names_of_arrays = (
        [effect.name for effect in candidates(m, free(m, "k", "c"), flown)] for m in (model, arrays)
    )
    assert names == names_of_arrays
    assert "x^3 in v" in names


class Bent(Effect):
    """A cubic spring."""

    gain: Array = eqx.field(default_factory=lambda: jnp.zeros(()))

    card = EffectCard(name="bent", description="bent", location=Location(LocationKind.MODEL, ""))

    def equations(self, dx, signals):
        return {"v": self.gain * signals["x"] ** 3}


class BentTwice(Effect):
    """The same, with a fifth power."""

    gain: Array = eqx.field(default_factory=lambda: jnp.zeros(()))
    fifth: Array = eqx.field(default_factory=lambda: jnp.zeros(()))

    card = EffectCard(
        name="bent twice",
        description="bent twice",
        location=Location(LocationKind.MODEL, ""),
        refines="bent",
    )

    def equations(self, dx, signals):
        x = signals["x"]
        return {"v": self.gain * x**3 * (1.0 + self.fifth * x**2)}


def test_refining_effect_replaces_simple_effect_in_later_round():
    truth = BentTwice(jnp.array(-0.6), jnp.array(0.5))
    result = study(truth, 3, effects=(*LIBRARY[:3], BentTwice(), Bent()))
    first, second, last = result.rounds
    assert "bent twice" not in {candidate.name for candidate in first.candidates}
    assert "bent" not in {candidate.name for candidate in last.candidates}
    assert (first.added, second.added, second.dropped, last.added) == (
        "bent",
        "bent twice",
        ("bent",),
        None,
    )
    assert (result.effects, result.outcome) == (("bent twice",), Outcome.EXPLAINED)
    estimate = result.after.estimate
    for name, true in (("bent twice.gain", -0.6), ("bent twice.fifth", 0.5)):
        at = estimate.names.index(name)
        assert abs(estimate.values[at] - true) < 4.0 * estimate.corrected_errors[at]


class BothObserved(Spring):
    """The spring with its speed seen too."""

    outputs = ("x", "v")

    def output(self, t, x, u):
        return x


def both_observed(seed, effect):
    """One record from rest."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(200)
    u = np.convolve(rng.normal(size=200), np.ones(8) / 2.5, "same")[:, None]
    truth = Augmented(BothObserved(1.5, 0.2), (effect,))
    y = np.asarray(simulate(truth, t, u, jnp.zeros(2)).y)
    return record(t, u, y + SIGMA * rng.normal(size=y.shape), inputs=("force",), outputs=("x", "v"))


@pytest.mark.parametrize(
    ("effects", "parts"),
    [
        ((Term("v", "x^2"), Term("v", "x^3")), ()),  # a series is a way to write a function
        ((Term("v", "x^3"), QuadraticDrag("v", "v")), ()),
        ((SensorBias("x"), SensorScale("x")), ()),
        ((Term("v", "x^3"), DryFriction("v", "v"), Term("v", "v^3")), ("sign(v) in v", "v^3 in v")),
        ((SensorDelay("x"), SensorBias("x"), SensorLag("v")), ()),
        (
            (InputDelay("force"), InputBetweenSamples("force")),
            ("delay of input force", "force between samples"),
        ),
        ((ParameterShift("r[0]", channel="x"), ParameterShift("r[1]", channel="x")), ()),
        ((ParameterShift("r[0]", channel="x"), SensorDelay("x")), ("shift of r[0]", "delay of x")),
    ],
    ids=[
        *(
            "series",
            "two signals",
            "one sensor",
            "shapes of one signal",
            "late and off",
            "late in two ways",
        ),
        *("elsewhere along two axes", "elsewhere and late"),
    ],
)
def test_shapes_of_one_signal_are_one_cause(effects, parts):
    assert (found.names if (found := one_function(effects)) else ()) == parts


def place(kind, name, share):
    return Place(Location(kind, name), 100.0, 10, share, np.zeros((1, 2)), np.ones((1, 2)))


@pytest.mark.parametrize(
    ("effects", "elsewhere"),
    [
        ((InputDelay("force"),), False),
        ((Term("v", "x^3"), SensorBias("x")), False),  # one of them does
        ((SensorDelay("x"), SensorDelay("a")), True),
        ((SensorDelay("x"), ParameterShift("k")), False),  # a parameter may act anywhere
        ((SensorDelay("b"),), False),  # nearly as well
        ((SensorDelay("b"), SensorDelay("a")), True),  # the limit is stricter for two effects
        # most of them act elsewhere
        ((SensorDelay("x"), InputDelay("force"), SensorDelay("a")), True),
        # between two parts: in the equations of both
        ((Term("v1", "(x1-x2)^3"), DryFriction("v2", "x1-x2")), False),
        ((Term("v1", "(x1-x2)^3"), Term("v2", "(v1-v2)^3")), True),  # two actions
        ((Term("v1", "x^3"), Term("v2", "x^3")), True),  # of one signal: not between two parts
        ((Term("v1", "(x1-x2)^3"),), True),  # on one part alone
    ],
    ids=[
        "there",
        "one of two",
        "elsewhere",
        "anywhere",
        "near",
        "near with another",
        "one of three",
        "between",
        "two between",
        "of one signal",
        "on one part",
    ],
)
def test_cause_must_act_at_location_of_residual(effects, elsewhere):
    places = (
        place(LocationKind.INPUT, "force", 0.9),
        place(LocationKind.EQUATION, "v", 0.88),
        place(LocationKind.SENSOR, "b", 0.8),
        place(LocationKind.SENSOR, "x", 0.6),
        place(LocationKind.SENSOR, "a", 0.1),
        place(LocationKind.EQUATION, "v1", 0.1),
        place(LocationKind.EQUATION, "v2", 0.1),
    )
    where = LocalisationResult(places, np.zeros((1, 2)), {}, (2, 20), 1.0)
    assert (in_place(effects, where, 0.01) is not None) is elsewhere
    chance = where._replace(places=tuple(one._replace(score=10.0) for one in places))
    assert in_place(effects, chance, 0.01) is None  # no place stands out


@pytest.mark.parametrize(("score", "expected"), [(10.0, False), (21.0, False), (24.0, True)])
def test_free_form_explanation_beyond_chance_excludes_noise(score, expected):
    # The chi-square of ten degrees of freedom is above 23.2 in one case of a hundred, above 25.2 in
    # one of two hundred.
    places = (
        Place(
            Location(LocationKind.EQUATION, "v"), score, 10, 0.1, np.zeros((1, 2)), np.ones((1, 2))
        ),
        place(LocationKind.SENSOR, "x", 0.0),
    )
    where = LocalisationResult((places[0],), np.zeros((1, 2)), {}, (2, 20), 1.0)
    assert where.is_significant(0.01) is expected
    assert where.significant(0.01) == (places[:1] if expected else ())
    assert (NO_PLACE in location_line(where, 0.01)) is not expected
    assert NO_PLACE not in location_line(where, 0.5)  # a level of the user
    more = where._replace(places=(places[0], places[1]._replace(score=1.0)))
    assert not more.is_significant(0.01)


def test_faint_effect_with_near_equivalent_shape_is_no_cause():
    # Faint dry friction, which the library lacks: a drag resembles it to within the noise.
    friction = DryFriction("v", "v", jnp.array(-0.012), width=jnp.array(0.01))
    effects = (QuadraticDrag("v", "v"), Term("v", "v^3"), Term("v", "x^3"), SensorBias("x"))
    result = study(friction, seed=1, effects=effects)
    assert len(result.effects) == 1
    assert result.outcome is Outcome.PROXIES
    assert "Other hypotheses fit nearly as well" in result.verdict


def test_residual_is_tested_against_known_noise():
    result = study(PLANTED["x^3 in v"], seed=1, likelihood=OutputError(FixedNoise([SIGMA**2])))
    assert (result.effects, result.outcome, result.noise_known) == (
        ("x^3 in v",),
        Outcome.EXPLAINED,
        True,
    )
    assert result.noise["x"] == pytest.approx(SIGMA, rel=1e-9)


def test_single_record_is_cut_for_check_and_complete_in_final_estimate():
    complete, _ = fly(3, PLANTED["x^3 in v"], samples=900)
    test, _ = fly(4, PLANTED["x^3 in v"])
    model = Spring(1.0, 0.1)
    result = close_loop(
        model,
        free(model, "k", "c", per_record=("initial_state",)),
        OutputError(),
        train=complete,
        test={"other": test},
        effects=LIBRARY,
    )
    assert result.effects == ("x^3 in v",)
    assert result.after.estimate.residuals.shape[1] == 900
    assert set(result.rounds[0].errors) == {"train", "check"}


def test_second_study_of_same_shapes_compiles_nothing():
    compilations = []

    def listen(event, duration, **_):
        if event == COMPILED:
            compilations.append(event)

    flown = [
        [fly(1000 * seed + index, PLANTED["x^3 in v"])[0] for index in range(7)] for seed in (7, 8)
    ]
    for count, records in enumerate(flown):
        model = Spring(1.0, 0.1) if count == 0 else Spring(jnp.float32(1.1), 0.12)
        chosen = free(model, "k", "c", per_record=("initial_state",))
        train, check, test = ([records[index] for index in part] for part in (TRAIN, CHECK, TEST))
        if count == 1:
            jax.monitoring.register_event_duration_secs_listener(listen)
        try:
            result = close_loop(
                model,
                chosen,
                OutputError(),
                train=train,
                check=check,
                test=test,
                effects=LIBRARY,
                window=WINDOW,
            )
        finally:
            if count == 1:
                jax.monitoring.unregister_event_duration_listener(listen)
        assert result.effects == ("x^3 in v",)
    assert compilations == []


def test_json_is_plain_and_complete(planted_study):
    figures = json.loads(planted_study("x^3 in v").to_json())
    assert {"verdict", "effects", "before", "after", "noise", "tests", "rounds"} <= set(figures)
    assert figures["effects"] == ["x^3 in v"]
    assert set(figures["before"]) == {"x"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"effects": (SensorBias("x"), SensorBias("x"))}, "'bias of x' occurs twice"),
        ({"window": 5000}, "window has 5000 samples"),
        ({"test": {}}, "`test` is empty"),
    ],
)
def test_invalid_input_raises_error_before_computation(change, words):
    flight, other, last = (fly(seed, None)[0] for seed in (1, 2, 3))
    model = Spring(1.0, 0.1)
    arguments = {
        "train": [flight],
        "check": [other],
        "test": [last],
        "effects": (SensorScale("x"),),
    } | change
    with pytest.raises(InputError, match=words):
        close_loop(model, free(model, "k"), OutputError(), **arguments)


def test_diverging_start_raises_error():
    flight, _ = fly(1, None)
    model = Spring(-5000.0, 0.1)
    words = r"stops being finite at t = .* s, in (x, )?v.* initial state was x = .*, v = "
    with pytest.raises(InputError, match=words):
        close_loop(
            model, free(model, "k"), OutputError(), train=flight, effects=(SensorScale("x"),)
        )


@pytest.mark.parametrize(
    "change",
    [{"level": 0.0}, {"refits": 0}, {"max_check_loss": -1.0}, {"max_predictable_share": 1.5}],
)
def test_invalid_options_raise_error(change):
    with pytest.raises(InputError, match=next(iter(change))):
        LoopOptions(**change)
