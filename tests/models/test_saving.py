"""`save` and `load`: numbers come back bit for bit, and what does not fit is refused in words."""

import json
import re

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.effects import Augmented, Term
from jaxid.models.names import flat_vector, parameter_names

PRIOR = {"k": (1.4, 0.1)}
BOUNDS = {"c": (0.0, None)}


def spring(k=1.0 / 3.0, c=0.1 + 0.2):
    return Spring(jnp.array(k), jnp.array(c))


@pytest.fixture
def saved(tmp_path):
    """A spring with a term, saved with its free parameters: the file, model and selection."""
    model = Augmented(spring(), (Term("v", "x^3", jnp.array(-1e-17)),))
    chosen = jaxid.free(
        model,
        *("k", "c", "x^3 in v.gain"),
        per_record=("initial_state",),
        bounds=BOUNDS,
        scale={"k": 2.0},
        prior=PRIOR,
    )
    return jaxid.save(tmp_path / "spring.json", model, chosen), model, chosen


def like(*effects):
    return Augmented(spring(9.0, 9.0), effects or (Term("v", "x^3"),))


def change(path, **entries):
    """Replace entries of the file; a text is written as it stands in JSON."""
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, **entries}))


def test_values_come_back_bit_for_bit(saved):
    path, model, _ = saved
    loaded, *_ = jaxid.load(path, like())
    assert parameter_names(loaded) == parameter_names(model)
    assert np.asarray(flat_vector(loaded)).tolist() == np.asarray(flat_vector(model)).tolist()


def test_free_parameters_come_back(saved):
    path, _, chosen = saved
    _, again, errors = jaxid.load(path, like())
    assert errors is None
    assert (again.shared, again.per_record) == (chosen.shared, chosen.per_record)
    for kind in ("lower", "upper", "scale", "prior"):
        written, read = getattr(chosen, kind), getattr(again, kind)
        assert {n: np.ravel(v).tolist() for n, v in read.items()} == {
            n: np.ravel(v).tolist() for n, v in written.items()
        }
    assert float(again.upper["c"]) == np.inf


def test_a_model_without_free_parameters_is_saved(tmp_path):
    path = jaxid.save(tmp_path / "k.json", spring())
    assert jaxid.load(path, spring(5.0)).free is None
    assert float(jaxid.load(path, spring(5.0)).model.k) == 1.0 / 3.0


def test_numbers_that_are_not_finite_come_back(tmp_path):
    path = jaxid.save(tmp_path / "k.json", spring(np.inf, np.nan))
    model = jaxid.load(path, spring()).model
    assert np.isinf(model.k)
    assert np.isnan(model.c)


def test_an_existing_file_is_kept(saved):
    path, model, _ = saved
    before = path.read_text()
    with pytest.raises(InputError, match="exists already and is not overwritten"):
        jaxid.save(path, model)
    assert path.read_text() == before
    assert [file.name for file in path.parent.iterdir()] == ["spring.json"]


def test_a_failure_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.setattr("pathlib.Path.rename", _full)
    with pytest.raises(InputError, match=r"cannot be written: No space left"):
        jaxid.save(tmp_path / "spring.json", spring())
    assert not list(tmp_path.iterdir())


def _full(*_):
    raise OSError(28, "No space left on device")


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        jaxid.save(tmp_path / "none" / "spring.json", spring())


def fit_of(likelihood):
    """An estimate of two records of 40 samples with a bound that holds c."""
    t, rng = 0.1 * np.arange(40), np.random.default_rng(5)
    records = [
        jaxid.record(
            t,
            np.sin(t),
            np.sin(2 * t) + 0.1 * rng.normal(size=40),
            inputs=("force",),
            outputs=("x",),
        )
        for _ in range(2)
    ]
    model = spring(4.0, 0.5)
    chosen = jaxid.free(model, "k", "c", per_record=("initial_state",), bounds={"c": (0.5, None)})
    return model, jaxid.estimate(model, chosen, records, likelihood)


def test_errors_of_a_fit_come_back_bit_for_bit(tmp_path):
    model, fit = fit_of(jaxid.OutputError())
    loaded, chosen, errors = jaxid.load(jaxid.save(tmp_path / "fit.json", fit), model)
    assert float(loaded.k) == fit.value("k")
    assert (chosen.shared, chosen.per_record) == (fit.free.shared, fit.free.per_record)
    for name in errors.arrays():
        np.testing.assert_array_equal(getattr(errors, name), np.asarray(getattr(fit, name)))
    assert np.isnan(errors.standard_error("c"))  # on its bound
    assert errors.own.shape == (2, 2)
    assert (errors.names, errors.outputs, errors.status) == (("k", "c"), ("x",), fit.status)
    assert str(errors).splitlines()[1].split()[:2] == ["k", f"{fit.value('k'):.6g}"]


def test_a_fit_by_filter_error_is_saved_as_the_model_without_noises(tmp_path):
    model, fit = fit_of(jaxid.FilterError())
    loaded, chosen, errors = jaxid.load(jaxid.save(tmp_path / "fit.json", fit), model)
    assert type(loaded) is Spring
    assert chosen.shared == ("k", "c")
    assert float(chosen.lower["c"]) == 0.5
    assert errors.names == ("k", "c", "sensor.x")
    assert errors.standard_error("sensor.x") == fit.standard_error("sensor.x")


def test_a_fit_by_innovation_form_is_saved_as_the_model_without_gains(tmp_path):
    model, fit = fit_of(jaxid.InnovationForm({"v": {"x": 0.1}}))
    loaded, chosen, errors = jaxid.load(jaxid.save(tmp_path / "fit.json", fit), model)
    assert type(loaded) is Spring
    assert chosen.shared == ("k", "c")
    assert errors.names == fit.names
    assert set(errors.names) > {"k", "c"}


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"names": ["k"]}, "errors: 'values' has the shape (2,), and (1,) belongs to its names"),
        ({"covariance": [[1.0, 2.0]]}, "errors: 'covariance' has the shape (1, 2), and (2, 2)"),
        ({"covariance": [[1.0, 2.0], [3.0]]}, "errors: 'covariance' has the shape (2,)"),
        ({"own": None}, "errors: 'own' has the shape ()"),
        ({"noise": [["much"]]}, "errors: 'noise' is 'much', which is not a number"),
        ({"status": None}, "errors: 'status' is missing or no str"),
        ({"noise_known": 0}, "errors: 'noise_known' is missing or no bool"),
        ({"outputs": "x"}, "errors: 'outputs' is missing or no list of names"),
    ],
)
def test_errors_that_do_not_fit_are_refused(tmp_path, entries, words):
    model, fit = fit_of(jaxid.OutputError())
    path = jaxid.save(tmp_path / "fit.json", fit)
    change(path, errors={**json.loads(path.read_text())["errors"], **entries})
    with pytest.raises(InputError, match=re.escape(words)):
        jaxid.load(path, model)


def test_free_parameters_given_with_a_fit_are_refused(tmp_path):
    _, fit = fit_of(jaxid.OutputError())
    with pytest.raises(InputError, match="An estimate has its free parameters"):
        jaxid.save(tmp_path / "fit.json", fit, fit.free)


def test_free_parameters_of_another_model_are_refused(tmp_path):
    chosen = jaxid.free(like(), "x^3 in v.gain")
    with pytest.raises(InputError, match=r"no parameter 'x\^3 in v\.gain'"):
        jaxid.save(tmp_path / "spring.json", spring(), chosen)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"format": "other"}, "is not a file of the format 'jaxid model'"),
        ({"version": 2}, "has version 2 of its format, and this jaxid reads up to 1"),
        ({"version": "1"}, "the version is '1', not a whole number"),
        ({"version": True}, "the version is True"),
        ({"model": "Tank"}, "holds a model of the class 'Tank', and `like` is a 'Augmented'"),
        ({"outputs": ["x", "v"]}, "the outputs are ['x', 'v'], and those of the model ['x']"),
        ({"parameters": None}, "'parameters' is missing or no object"),
        ({"parameters": {"k": 1.0, "m": 2.0}}, "lacks c, x^3 in v.gain. The model lacks m."),
        ({"free": []}, "'free' is no object"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(saved, entries, words):
    path = saved[0]
    change(path, **entries)
    with pytest.raises(InputError, match=re.escape(words)):
        jaxid.load(path, like())


@pytest.mark.parametrize("value", ["1.0", None, True, [1.0], 10**400])
def test_a_value_that_is_no_number_is_refused(saved, value):
    path = saved[0]
    parameters = json.loads(path.read_text())["parameters"]
    change(path, parameters={**parameters, "k": value})
    with pytest.raises(InputError, match=r"'k' is .* not a number"):
        jaxid.load(path, like())


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"shared": ["k", "m"]}, "There is no parameter 'm'"),
        ({"shared": ["k", "k"]}, "occurs twice"),
        ({"shared": "k"}, "'shared' is missing or no list of names"),
        ({"lower": {"c": 0.5}}, "lies outside its bounds"),
        ({"scale": {"k": -1.0}}, "must be positive"),
        ({"prior": {"k": [1.0]}}, "it is a mean and a standard deviation"),
        ({"prior": {"k": [1.0, "wide"]}}, "'wide', which is not a number"),
    ],
)
def test_free_parameters_that_do_not_fit_are_refused(saved, entries, words):
    path = saved[0]
    chosen = json.loads(path.read_text())["free"]
    change(path, free={**chosen, **entries})
    with pytest.raises(InputError, match=f"spring.json: .*{re.escape(words)}"):
        jaxid.load(path, like())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is not a JSON file"),
        ("{", "is not a JSON file"),
        ("[" * 100_000, "is not a JSON file"),
        ("[]", "is not a file of the format"),
        ('{"k": 1, "k": 2}', "'k' occurs twice"),
    ],
)
def test_other_files_are_refused(tmp_path, text, words):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        jaxid.load(path, spring())


def test_binary_and_missing_files_are_refused(tmp_path):
    path = tmp_path / "other.json"
    path.write_bytes(b"\x80\x04\x95\xff")
    with pytest.raises(InputError, match="is not a JSON file"):
        jaxid.load(path, spring())
    with pytest.raises(InputError, match="There is no file"):
        jaxid.load(tmp_path / "none.json", spring())
