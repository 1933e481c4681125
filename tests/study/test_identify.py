"""The integrated process on a system of a user's own: structure, decisions, overrules, and the
refusals.
"""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from notebook_cells import assert_has_printed_lines

import jaxid
from jaxid import OutputError, identify
from jaxid._foundation.checks import InputError
from jaxid.estimation.model_programs import PROGRAMS
from jaxid.models import AbstractModel, Polynomial
from jaxid.models.pseudo_measurements import PseudoMeasurements
from jaxid.structure import least_squares
from jaxid.study import IdentifyOptions
from jaxid.study.terms.reduction import Reduction, power

CANDIDATES = ("x", "v", "force", "x^2", "x v", "x^3", "x^2 v", "v^2", "v^3", "|v| v")
TRUE = {"x": -2.0, "v": -0.3, "force": 1.0, "x^3": -1.5}
SIGMA = {"x": 0.004, "v": 0.01, "w": 0.05, "vdot": 0.02, "wdot": 0.05}


class Oscillator(AbstractModel):
    """x' = v, v' = stiffness(x, v, force), and a state w of its own that nothing drives: w' =
    drift(w).
    """

    stiffness: Polynomial
    drift: Polynomial
    without_w: bool
    outputs = ("x", "v", "w")

    @property
    def states(self):
        return ("x", "v") if self.without_w else ("x", "v", "w")

    @property
    def inputs(self):
        return ("force", "w") if self.without_w else ("force",)

    def rhs(self, t, x, u):
        now = dict(zip(self.states + self.inputs, jnp.concatenate([x, u]), strict=True))
        rates = [now["v"], self.stiffness(now)]
        return jnp.stack(rates if self.without_w else [*rates, self.drift(now)])

    def output(self, t, x, u):
        return jnp.concatenate([x, u[1:]])

    def pseudo_measurements(self, record):
        z = {name: record.channel(name) for name in (*record.inputs, *record.outputs)}
        return PseudoMeasurements(
            t=record.t,
            responses={"stiffness": z["vdot"], "drift": z["wdot"]},
            signals={name: z[name] for name in ("x", "v", "w", "force")},
            valid=jnp.all(record.mask, axis=-1),
            candidates=(("stiffness", CANDIDATES), ("drift", ("w", "w^2"))),
        )

    def without(self, responses):
        return Oscillator(self.stiffness, self.drift, "drift" in responses) if responses else self


TRUTH = Oscillator(Polynomial(TRUE), Polynomial({"w": 0.0}), False)
EMPTY = Oscillator(Polynomial({}), Polynomial({}), False)


def measured(seed, rows=400):
    rng = np.random.default_rng(seed)
    t = 0.05 * np.arange(rows)
    force = np.repeat(rng.normal(size=(rows // 20, 1)), 20, axis=0)
    solution = jaxid.simulate(
        TRUTH, t, force, np.array([0.1, 0.0, 0.2]), stepper=jaxid.RK4(4, unrolled=False)
    )
    rates = jax.vmap(TRUTH.rhs)(solution.t, solution.x, jnp.asarray(force))[:, 1:]
    clean = np.column_stack([solution.y, rates])
    z = clean + rng.normal(size=clean.shape) * np.array([*SIGMA.values()])
    return jaxid.record(t, force, z, inputs=("force",), outputs=tuple(SIGMA))


@pytest.fixture(scope="module")
def record():
    return measured(3)


@pytest.fixture(scope="module")
def result(record):
    return identify(EMPTY, record)


def test_structure_is_identified_without_equation_of_absent_motion(result):
    assert set(result.equations["stiffness"].regression.names) == set(TRUE)
    assert result.left_out == ("drift",)
    assert "below 100" in result.equations["drift"].reason
    assert result.model.states == ("x", "v")
    assert result.model.inputs == ("force", "w")


def test_initial_value_of_a_state_with_measured_history_is_not_estimated(record, result):
    names = ("initial_state.x", "initial_state.v", "initial_state.w")
    named = identify(EMPTY, record, per_record=names)
    assert named.left_out == ("drift",)
    assert named.estimate.names == result.estimate.names
    np.testing.assert_allclose(named.estimate.values, result.estimate.values, rtol=1e-9)
    with pytest.raises(InputError, match=r"no parameter 'initial_state\.u'"):
        identify(EMPTY, record, per_record=("initial_state.u",))


def test_maximum_likelihood_removes_bias_of_regression(result):
    """Noise in x and v biases the regression; the estimates are within four of their standard
    errors.
    """
    fit = result.estimate
    assert bool(fit.successful)
    for name, value, error in zip(fit.names, fit.values, fit.standard_errors, strict=True):
        assert abs(float(value) - TRUE.get(name.partition(".")[2], 0.0)) < 4 * float(error), name
    assert float(fit.cost) < result.start.cost


def test_parameters_list_results_of_both_stages(result):
    rows = {row.name: row for row in result.parameters}
    regression = result.equations["stiffness"].regression
    for name, value, F in zip(regression.names, regression.values, regression.F, strict=True):
        row = rows[f"stiffness.{name}"]
        np.testing.assert_allclose(
            (row.regression, row.regression_F, row.start), (value, F, value), rtol=1e-12
        )
        assert np.isfinite(row.start_F)
    assert "stiffness.x^3" in str(result)
    assert "drift: left out" in str(result)


def test_result_is_a_dictionary_of_plain_numbers(result):
    content = json.loads(json.dumps(result.to_dict()))
    assert {name: one["kept"] for name, one in content["equations"].items()} == {
        **{"stiffness": True, "drift": False}
    }
    regression = result.equations["stiffness"].regression
    assert content["equations"]["stiffness"]["terms"] == list(regression.names)
    row, name = content["parameters"]["stiffness.x^3"], "stiffness.x^3"
    assert row["value"] == result.estimate.value(name)
    assert row["regression"] == regression.values[regression.names.index("x^3")]
    assert content["estimate"] == json.loads(json.dumps(result.estimate.to_dict()))


def test_result_is_a_labelled_dataset(result):
    dataset, name = result.to_xarray(), "stiffness.x^3"
    row = next(row for row in result.parameters if row.name == name)
    for column in ("regression", "regression_F", "start", "start_F", "value", "F"):
        assert float(dataset[column].sel(parameter=name)) == getattr(row, column), column
    assert float(dataset["standard_error"].sel(parameter=name)) == row.standard_error
    assert dataset["kept"].to_series().to_dict() == {"stiffness": True, "drift": False}
    R2 = float(result.equations["drift"].regression.R2)
    assert float(dataset["R2"].sel(equation="drift")) == R2


def test_result_is_shown_as_it_prints(result):
    assert_has_printed_lines(result)


def test_cost_of_start_equals_first_cost_of_estimate(result):
    np.testing.assert_allclose(result.start.cost, result.estimate.costs[0], rtol=1e-12)


def test_unused_flight_is_predicted_to_noise_level(result):
    """400 samples: the RMS scatters by 3.5 %; 15 % is four of these, and the initial state is the
    measured one.
    """
    other = measured(8)
    prediction = result.predict(other, window=10)
    rms = dict(zip(result.model.outputs, np.asarray(prediction.rms), strict=True))
    assert rms["x"] < 1.15 * SIGMA["x"]
    assert rms["v"] < 1.15 * SIGMA["v"]


def test_prediction_bands_cover_true_response(result, record):
    band = result.prediction_bands("v").signals["v"]
    assert band.value.shape == (1, 400)
    assert np.all(np.asarray(band.deviation) > 0)


def test_options_override_every_decision_by_name(record):
    options = IdentifyOptions(
        keep=("drift",),
        terms={"drift": ("w",), "stiffness": ("x", "v", "force", "x^3", "x^2")},
        fix={"stiffness": ("v",)},
        estimate={"stiffness": ("x^2",)},
        constants=False,
    )
    result = identify(EMPTY, record, options=options)
    names = result.estimate.names
    assert "stiffness.x^2" in names
    assert "stiffness.v" not in names
    assert "stiffness.1" not in names
    assert result.left_out == ()
    assert result.equations["drift"].reason == "kept by name"
    regression = result.equations["stiffness"].regression
    kept = dict(zip(regression.names, regression.values, strict=True))["v"]
    assert float(
        result.model.stiffness.coefficients[result.model.stiffness.terms.index("v")]
    ) == pytest.approx(kept)


def test_two_records_are_identified_jointly(record, result):
    """Twice the data: standard errors fall by about the square root of two."""
    both = identify(
        EMPTY, [record, measured(4)], options=IdentifyOptions(terms={"stiffness": tuple(TRUE)})
    )
    ratio = both.estimate.standard_error("stiffness.x") / result.estimate.standard_error(
        "stiffness.x"
    )
    assert 0.5 < ratio < 0.95


def test_result_equals_estimate_of_selected_terms_alone(result):
    """The model that `identify` simulates has all candidates; the one here only those selected."""
    ours = result.estimate
    free = jaxid.free(result.start_model, *ours.names, per_record=("initial_state",))
    theirs = jaxid.estimate(result.start_model, free, result.records, OutputError())
    np.testing.assert_allclose(ours.cost, theirs.cost, rtol=1e-10)
    moved = np.asarray(ours.values) - np.asarray(theirs.values)
    np.testing.assert_array_less(np.abs(moved / theirs.standard_errors), 1e-5)
    np.testing.assert_allclose(ours.standard_errors, theirs.standard_errors, rtol=1e-6)
    assert result.model.stiffness.terms == theirs.model.stiffness.terms
    np.testing.assert_allclose(
        result.model.stiffness.coefficients, theirs.model.stiffness.coefficients, rtol=1e-5
    )


def test_other_terms_use_same_programs_of_model(record):
    """Other terms, another number of them, and a prediction by each: one program of each kind."""
    for program in PROGRAMS:
        program.clear()
    for terms in (tuple(TRUE), ("x", "v", "force", "x^3", "x v"), ("x", "force", "x^2")):
        options = IdentifyOptions(terms={"stiffness": terms}, leave_out=("drift",))
        result = identify(EMPTY, record, options=options)
        assert result.model.stiffness.terms == ("1", *terms)
        result.predict(record)
    assert [len(program.known) for program in PROGRAMS] == [1, 1]


def test_candidate_of_regression_alone_leaves_other_results_unchanged(record, result):
    """The model does not know the signal `noise`, which only the regression has."""

    class Regressed(Oscillator):
        def pseudo_measurements(self, record):
            known = super().pseudo_measurements(record)
            signals = {**known.signals, "noise": np.sin(7.0 * np.asarray(record.t))}
            candidates = (("stiffness", (*CANDIDATES, "noise")), known.candidates[1])
            return dataclasses.replace(known, signals=signals, candidates=candidates)

        def without(self, responses):
            return Regressed(self.stiffness, self.drift, "drift" in responses)

    other = identify(Regressed(Polynomial({}), Polynomial({}), False), record)
    assert other.candidates == {}
    assert other.estimate.names == result.estimate.names
    np.testing.assert_allclose(other.estimate.cost, result.estimate.cost, rtol=1e-10)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (IdentifyOptions(keep=("stifness",)), "stifness"),
        (IdentifyOptions(leave_out=("stiffness",)), "keep"),
        (IdentifyOptions(add=("offset.x",)), "offset.x"),
        (IdentifyOptions(estimate={"stiffness": ("v^3",)}), "v\\^3"),
        (IdentifyOptions(terms={"stiffness": ("x", "y")}), "'y'"),
    ],
)
def test_unknown_name_or_empty_structure_raises_error(record, options, words):
    with pytest.raises(InputError, match=words):
        identify(EMPTY, record, options=options)


def test_options_out_of_range_raise_error():
    with pytest.raises(InputError, match="share"):
        IdentifyOptions(share=2.0)
    with pytest.raises(InputError, match="drift"):
        IdentifyOptions(keep=("drift",), leave_out=("drift",))


def test_model_without_pseudo_measurements_raises_error(record):
    class Silent(AbstractModel):
        states, inputs, outputs = ("x",), ("force",), ("x",)

        def rhs(self, t, x, u):
            return -x + u

        def output(self, t, x, u):
            return x

    with pytest.raises(InputError, match="pseudo-measurements"):
        identify(Silent(), record)


def test_least_r2_omits_equation_with_small_explained_share(record):
    """None of the two responses is explained to four nines."""
    strict = IdentifyOptions(least_F=0.0, least_R2=0.9999)
    with pytest.raises(
        InputError,
        match=r"No equation is left: stiffness left out: overall F .*, and R2 below "
        r"0.9999; drift",
    ):
        identify(EMPTY, record, options=strict)
    with pytest.raises(InputError, match="least_R2 is 1"):
        IdentifyOptions(least_R2=1.0)


def misled(slope, cube, rows=200):
    """A record whose recorded acceleration has an error that grows with x: the regression then
    finds an unstable model, which a simulation cannot follow.
    """
    record = measured(3, rows)
    x, at = np.asarray(record.channel("x")), record.outputs.index("vdot")
    z = np.array(record.z)
    z[:, at] += slope * x + cube * x**3
    return jaxid.record(record.t, record.u, z, inputs=record.inputs, outputs=record.outputs)


def test_start_that_diverges_takes_lower_powers_and_says_so():
    result = identify(EMPTY, misled(0.0, 12.0))
    terms = result.equations["stiffness"].regression.names
    assert (
        result.reduced == "terms up to power 2, because the terms as selected diverge at the start"
    )
    assert all(power(term) <= 2 for term in terms)
    assert str(result).startswith("reduced: terms up to power 2")
    assert np.isfinite(result.start.cost)
    assert float(result.estimate.cost) < result.start.cost


def test_named_terms_that_diverge_are_estimated_by_multiple_shooting():
    """The wrong cubic term makes the motion escape in the whole record, not in its pieces; the
    estimate in these starts the whole record, which then has the values of a correct start.
    """
    terms = {"stiffness": tuple(TRUE)}
    options = IdentifyOptions(terms=terms, share=0.0)
    result = identify(EMPTY, misled(0.0, 2.5), options=options)
    assert result.reduced.startswith("started from an estimate in pieces of ")
    assert result.equations["stiffness"].regression.names == terms["stiffness"]
    assert result.records.t.shape == (1, 200)
    known = identify(EMPTY, misled(0.0, 0.0), options=options)
    assert known.reduced == ""
    np.testing.assert_allclose(result.estimate.values, known.estimate.values, rtol=1e-5)


def test_structure_that_never_starts_is_refused_with_its_cause():
    with pytest.raises(InputError) as caught:
        identify(EMPTY, misled(2e4, 0.0))
    words = str(caught.value)
    for part in ("(the terms as selected)", "stops being finite at t = ", "stiffness = x"):
        assert part in words


def test_reduction_keeps_strong_terms_in_order():
    candidates = {"Cm": ("alpha", "alpha^2 beta", "alpha^9", "qhat", "alpha qhat")}
    assert Reduction(2).admitted(candidates)["Cm"] == ("alpha", "qhat", "alpha qhat")
    assert Reduction().admitted(candidates) == candidates
    x = np.linspace(-1.0, 1.0, 50)
    X = np.stack([x, x**2, x**3], axis=1)
    y = 0.3 * x + 2.0 * x**2 - x**3 + 0.01 * np.sin(40.0 * x)
    regression = least_squares(X, y, ("x", "x^2", "x^3"), response="y")
    assert Reduction(None, 2).kept(regression) == ("x^2", "x^3")
