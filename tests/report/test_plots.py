"""Records, estimates and predictions in a notebook: figures, HTML, dictionaries, datasets."""

import json

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from notebook_cells import assert_has_printed_lines, rows_and_notes
from small_spring import SIGMA, Spring, fly

import jaxid
from jaxid._foundation.checks import InputError
from jaxid._foundation.notebook import Table, preformatted
from jaxid.design import PlannedInformation
from jaxid.diagnosis import Prediction
from jaxid.uncertainty.profile import Profile

PNG = b"\x89PNG\r\n"


@pytest.fixture(scope="module")
def record():
    """Ten samples of an angle with a gap, under a force."""
    t = np.arange(10.0)
    z = np.radians(t)[:, None]
    z[3] = np.nan
    return jaxid.record(
        *(t, 2.0 * t, z),
        inputs=("force",),
        outputs=("tilt",),
        units={"tilt": "rad"},
        name="<first>",
    )


@pytest.fixture(scope="module")
def flown():
    return fly(7)[0]


@pytest.fixture(scope="module")
def fit(flown):
    model = Spring(jnp.array(1.0), jnp.array(0.1))
    chosen = jaxid.free(model, "k", "c", per_record=("initial_state",), bounds={"c": (0.0, None)})
    return jaxid.estimate(model, chosen, flown, jaxid.OutputError())


@pytest.fixture
def prediction():
    """Two records of five and of four samples; the first two of each are not scored."""
    t = jnp.array([[0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 2.0, 3.0, 3.0]])
    y = jnp.arange(10.0).reshape(2, 5, 1)
    scored = jnp.array([[0, 0, 1, 1, 1], [0, 0, 1, 1, 0]], bool)[..., None]
    channels = ("height",), ("m",), ("first", "second")
    return Prediction(t, y + 0.5, y, scored, jnp.zeros((2, 1)), *channels)


def line(axes, number=0):
    return axes.lines[number].get_xdata(), axes.lines[number].get_ydata()


# Figures. -----------------------------------------------------------------------------------------


def test_a_record_is_drawn_channel_by_channel(record):
    force, tilt = record.plot().axes
    np.testing.assert_array_equal(line(force), [record.t, 2.0 * np.arange(10.0)])
    y = line(tilt)[1]
    np.testing.assert_allclose(np.delete(y, 3), np.delete(np.arange(10.0), 3))  # in degrees
    assert np.isnan(y[3])
    assert (force.get_ylabel(), tilt.get_ylabel()) == ("force", "tilt [deg]")


def test_one_record_of_a_stack_is_drawn_without_padding(record):
    stack = jaxid.stack([record, record.window(0, 4)])
    assert line(stack.plot(case=1).axes[0])[0].tolist() == [0.0, 1.0, 2.0, 3.0]
    with pytest.raises(InputError, match="There is no record 2 among 2"):
        stack.plot(case=2)


def test_a_fit_draws_its_residual_and_autocorrelation(fit):
    left, right = fit.plot().axes
    v = np.asarray(fit.residuals)[0, :, 0]
    np.testing.assert_allclose(line(left)[1], v)
    r = [np.mean(v[:-lag] * v[lag:]) / np.mean(v**2) for lag in (1, 2, 40)]
    np.testing.assert_allclose(line(right)[1][[0, 1, 39]], r, rtol=1e-6)
    with pytest.raises(InputError, match="There is no record 1 among 1"):
        fit.plot(case=1)


def test_a_prediction_draws_scored_samples_only(prediction):
    (axes,) = prediction.plot(case=1).axes
    t, measured = line(axes, 0)
    assert t.tolist() == [0.0, 1.0, 2.0, 3.0]  # without the padding
    np.testing.assert_array_equal(measured, [np.nan, np.nan, 7.5, 8.5])
    np.testing.assert_array_equal(line(axes, 1)[1], [5.0, 6.0, 7.0, 8.0])
    assert axes.get_ylabel() == "height [m]"


def test_a_notebook_shows_the_figure(record):
    assert record.plot()._repr_png_().startswith(PNG)


# Text. --------------------------------------------------------------------------------------------


def test_text_is_escaped_and_keeps_its_lines():
    assert preformatted("a < b\n  & c").endswith(">a &lt; b\n  &amp; c</pre>")


def test_status_of_a_fit_is_shown(fit):
    assert str(fit).splitlines()[-1] in fit._repr_html_()


@pytest.mark.parametrize("name", ["fit", "prediction"])
def test_a_notebook_has_a_table_of_the_printed_cells(name, request):
    assert_has_printed_lines(request.getfixturevalue(name))


def test_a_notebook_has_the_range_of_each_channel(record):
    rows, (title,) = rows_and_notes(record)
    assert title.startswith("Record '<first>': 10 samples, 9 s, 10 % of the samples missing")
    assert rows == [
        ["channel", "role", "minimum", "maximum", "missing [%]", "unit"],
        ["force", "input", "0", "18", "0", ""],
        ["tilt", "output", "0", f"{np.radians(9):.4g}", "10", "rad"],
    ]


def test_ranges_of_a_stack_are_without_padding(record):
    stack = jaxid.stack([record.window(6, 10), record.window(6, 8)])
    rows, _ = rows_and_notes(stack)
    assert rows[1][:5] == ["force", "input", "12", "18", "0"]
    assert rows[2][:5] == ["tilt", "output", f"{np.radians(6):.4g}", f"{np.radians(9):.4g}", "0"]


def test_record_without_inputs_has_outputs_only(record):
    free = jaxid.record(record.t, None, np.arange(10.0), inputs=(), outputs=("x",))
    rows, (title,) = rows_and_notes(free)
    assert rows[1:] == [["x", "output", "0", "9", "0", ""]]
    assert title == repr(free).splitlines()[0]


def test_record_without_a_valid_sample_has_no_range(record):
    empty = eqx.tree_at(lambda node: node.mask, record, jnp.zeros((10, 1), bool))
    assert rows_and_notes(empty)[0][2] == ["tilt", "output", "", "", "100", "rad"]


def test_cells_of_a_table_are_escaped():
    table = Table(("a", "b", "c"), (1, 1), (("<i>", "1", "&"),))
    assert "&lt;i&gt;" in table.html()
    assert table.lines() == ["a   b  c", "<i> 1  &"]


def test_a_plan_is_shown_as_it_prints():
    plan = PlannedInformation(
        *("step", ("k",), ("N/m",), np.array([2.0]), np.array([[50.0]]), np.array([0.02]), ())
    )
    assert "well, to 1 %" in plan._repr_html_()


def test_a_prediction_prints_names_errors_and_fits(prediction):
    """Scored are 2.5, 3.5, 4.5 and 7.5, 8.5, predicted 0.5 too low."""
    z = np.array([2.5, 3.5, 4.5, 7.5, 8.5])
    fit = 100 * (1 - 0.5 * np.sqrt(z.size) / np.linalg.norm(z - z.mean()))
    assert str(prediction).splitlines() == [
        "Prediction of 2 records (first, second), 5 scored samples",
        "output    RMS error   fit [%]  unit",
        f"height          0.5 {fit:>9.2f}  m",
    ]


def test_a_prediction_has_the_channels_and_the_names_of_its_records(record):
    class Still(Spring):
        inputs, outputs = ("force",), ("tilt",)

        def output(self, t, x, u):
            return x[:1]

    model = Still(jnp.array(1.0), jnp.array(0.1))
    prediction = jaxid.predict(model, record, jaxid.OutputError())
    assert prediction.outputs == ("tilt",)
    assert prediction.units == ("rad",)
    assert prediction.names == record.names


# Dictionaries and datasets. -----------------------------------------------------------------------


def test_an_estimate_is_a_dictionary_of_plain_numbers(fit):
    content = json.loads(json.dumps(fit.to_dict()))
    assert list(content["parameters"]) == ["k", "c"]
    k = content["parameters"]["k"]
    assert (k["value"], k["standard_error"]) == (fit.value("k"), fit.standard_error("k"))
    assert k["start"] == 1.0
    assert k["on_bound"] is False
    assert content["noise"][0][0] == pytest.approx(SIGMA**2, rel=0.3)
    assert content["per_record"][0]["initial_state.v"]["value"] == float(fit.own[0, 1])
    assert content["successful"] is True
    assert content["outputs"] == ["x"]


def test_an_estimate_is_a_labelled_dataset(fit):
    dataset = fit.to_xarray()
    assert float(dataset["values"].sel(parameter="c")) == fit.value("c")
    assert dataset["residuals"].dims == ("case", "row", "output")
    assert float(dataset["noise"].sel(output="x", output_2="x")) == float(fit.noise[0, 0])
    table = dataset[["values", "standard_errors"]].to_dataframe()
    assert table.loc["k", "standard_errors"] == fit.standard_error("k")


def test_a_prediction_is_a_dictionary_and_a_labelled_dataset(prediction):
    content = json.loads(json.dumps(prediction.to_dict()))
    assert content["rms"] == {"height": 0.5}
    assert content["fit"]["height"] == float(prediction.statistics.fit[0])
    assert (content["units"], content["records"]) == ({"height": "m"}, ["first", "second"])
    assert content["y"][1][3] == [8.0]
    dataset = prediction.to_xarray()
    assert dataset["measured"].sel(output="height", case="first").isel(row=4) == 4.5
    assert dataset["t"].values.tolist() == prediction.t.tolist()
    assert int(dataset["scored"].sum()) == 5


def mode(model):
    return {"frequency": jnp.sqrt(model.k), "k < 9": model.k}


RESULTS = {
    "residual tests": lambda fit, record: jaxid.residual_tests(fit, signals=record),
    "maps": lambda fit, record: jaxid.diagnosis.residual_maps(
        fit.residuals, fit.mask, {"force": record.u[None, :, 0]}, ("x",)
    ),
    "propagated": lambda fit, record: jaxid.propagate(fit, mode),
    "constants": lambda fit, record: jaxid.uncertainty.consider(
        free_k(fit, record), record, jaxid.OutputError(), {"c": 0.01}
    ),
    "comparison": lambda fit, record: jaxid.uncertainty.compare_errors(fit),
    "combination": lambda fit, record: jaxid.uncertainty.combine([fit, fit]),
    "advice": lambda fit, record: jaxid.advice(record, fit.model, fit.free),
}


def free_k(fit, record):
    chosen = jaxid.free(fit.model, "k", per_record=("initial_state",))
    return jaxid.estimate(fit.model, chosen, record, jaxid.OutputError())


@pytest.mark.parametrize("name", RESULTS)
def test_results_are_tables_with_the_printed_cells(name, fit, flown):
    assert_has_printed_lines(RESULTS[name](fit, flown))


def test_frequency_response_is_a_table_of_each_pair_of_channels(fit):
    record = jaxid.record(
        *(0.1 * np.arange(200), np.sin(np.arange(200.0) ** 1.5), np.cos(np.arange(200.0))),
        inputs=("force",),
        outputs=("x",),
    )
    assert_has_printed_lines(jaxid.diagnosis.frequency_response(record, fit.model))


def test_profile_is_shown_as_it_prints():
    """The method prints the object, whatever it holds."""

    class Shown:
        def __str__(self):
            return "a < b"

    assert "a &lt; b" in Profile._repr_html_(Shown())
