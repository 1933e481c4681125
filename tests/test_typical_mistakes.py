"""Typical mistakes of users: each message names the thing, and the remedy."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.io
from small_spring import Spring

import jaxid
from jaxid import FilterError, FixedNoise, FullNoise, InputError, OutputError
from jaxid.estimation import AutoregressiveNoise as Coloured
from jaxid.estimation import InnovationForm

T = 0.1 * np.arange(30)
U, X = np.sin(T), np.cos(T)
NAMES = {"inputs": ("force",), "outputs": ("x",)}
MODEL = Spring(jnp.array(1.0), jnp.array(0.1))
MISFIT = OutputError()
KNOWN = OutputError(FixedNoise(jnp.array([1e-4])))


def record(t=T, u=U, x=X, **options):
    return jaxid.record(t, u, x, **NAMES | options)


def changed(values, row, value):
    values = np.array(values, object if isinstance(value, str) else float)
    values[row] = value
    return values


def holed(values, start, stop):
    values = np.array(values)
    values[start:stop] = np.nan
    return values


def csv(folder, text, **options):
    path = folder / "log.csv"
    path.write_text(text)
    return jaxid.read_csv(path, **NAMES | options)


class NoRhsShape(Spring):
    def rhs(self, t, x, u):
        return x[1]


class NumpyModel(Spring):
    def rhs(self, t, x, u):
        return np.array([x[1], u[0] - self.k * x[0]])


class Branching(Spring):
    def rhs(self, t, x, u):
        return x if x[0] > 0 else -x


class CommaForgotten(Spring):
    inputs = "force"


class WithUnits(Spring):
    def units(self):
        return {"x": "rad"}


class InDegrees(Spring):
    def units(self):
        return {"x": "deg"}


class Accelerometer(Spring):
    outputs = ("a",)
    output = jaxid.AbstractModel.output


def other(inputs=("force",), outputs=("x",)):
    return jaxid.record(T, U, X, inputs=inputs, outputs=outputs)


def fit(model=MODEL, free=None, records=None, likelihood=MISFIT, **options):
    free = jaxid.free(model, "k", "c") if free is None else free
    return jaxid.estimate(model, free, records or record(), likelihood, **options)


def with_noises():
    """The model as a fit by `FilterError` returns it, with its own noises."""
    free, records = jaxid.free(MODEL, "k"), jaxid.stack([record()])
    return FilterError({"v": 0.1}).prepared(MODEL, free, records)[0]


def loop(effect, likelihood=MISFIT, **options):
    free = jaxid.free(MODEL, "k", "c")
    records = {"train": record(), **options}
    return jaxid.close_loop(MODEL, free, likelihood, **records, effects=(effect,))


RECORDS = {
    "names as one string": (lambda: record(inputs="force"), "`inputs` is the string.*tuple"),
    "a name for two columns": (
        lambda: record(outputs=("x", "v")),
        r"`z` has shape \(30,\).*2 outputs.*one column",
    ),
    "other length": (lambda: record(x=X[:-1]), "29 rows and time 't' has 30.*Resample"),
    "channels in rows": (lambda: record(u=U[None]), r"shape \(1, 30\).*one column per name"),
    "time backwards": (lambda: record(t=T[::-1]), "does not increase at row 1.*sort by time"),
    "time twice": (lambda: record(t=changed(T, 3, T[2])), "row 3.*Remove repeated rows"),
    "time in minutes by unit": (
        lambda: record(units={"t": "m"}),
        "'m' of 't' is not a unit of time",
    ),
    "NaN in an input": (lambda: record(u=changed(U, 4, np.nan)), "'force' is NaN at row 4.*interp"),
    "infinite output": (lambda: record(x=changed(X, 5, np.inf)), "'x' is infinite at row 5.*NaN"),
    "dead output": (lambda: record(x=np.full(30, np.nan)), "'x' has no valid sample.*Leave it out"),
    "text in a channel": (
        lambda: record(x=changed(X, 6, "off")),
        "'x' holds 'off'.*row 6.*Convert",
    ),
    "complex channel": (lambda: record(x=X + 1j), "x is complex.*two channels"),
    "misspelt unit": (lambda: record(units={"x": "degre"}), "'x'.*'degre'"),
    "unit of another name": (lambda: record(units={"y": "m"}), "no channel 'y'.*names are"),
    "g for gravity": (lambda: record(units={"x": "g"}), "ambiguous.*'g0'"),
    "a cut outside": (lambda: jaxid.data.split_at(record(), 1.5), "cut at 1.5.*inside the record"),
    "one name twice": (lambda: record(outputs=("force",)), "'force' occurs twice.*Rename"),
    "no output": (lambda: record(outputs=(), x=np.zeros((30, 0))), "no output.*Name at least one"),
    "one sample": (lambda: record(t=T[:1], u=U[:1], x=X[:1]), "1 samples.*at least 2"),
    "stack in a stack": (lambda: jaxid.stack([jaxid.stack([record()])]), "a stack already"),
    "records with other channels": (
        lambda: jaxid.stack([record(), other(outputs=("y",))]),
        "outputs differ in 'x', 'y'.*same channels",
    ),
    "a window past the end": (lambda: record().window(0, 99), "outside its 30 samples.*Choose"),
    "a channel that is not there": (lambda: record().channel("y"), "no channel 'y'.*names are"),
}
MODELS = {
    "misspelt parameter": (lambda: jaxid.free(MODEL, "kk"), "no parameter 'kk'.*names are"),
    "no parameter": (lambda: jaxid.free(MODEL), "No parameter is free.*Name at least one"),
    "parameter twice": (lambda: jaxid.free(MODEL, "k", "k"), "'k' occurs twice"),
    "bounds without the start": (
        lambda: jaxid.free(MODEL, "k", bounds={"k": (2.0, 3.0)}),
        "'k'.*bounds",
    ),
    "negative deviation": (lambda: jaxid.free(MODEL, "k", prior={"k": (1.0, -1.0)}), "prior.*'k'"),
    "rhs of one value": (lambda: fit(NoRhsShape(*[jnp.array(1.0)] * 2)), "`rhs`.*2 states.*stack"),
    "NumPy in rhs": (lambda: fit(NumpyModel(*[jnp.array(1.0)] * 2)), "`rhs`.*NumPy.*`jax.numpy`"),
    "a branch in rhs": (
        lambda: fit(Branching(*[jnp.array(1.0)] * 2)),
        "`rhs`.*branch.*`jnp.where",
    ),
    "an output without a method": (
        lambda: fit(Accelerometer(*[jnp.array(1.0)] * 2), records=other(outputs=("a",))),
        "no method `output`.*no states: a",
    ),
    "records of another model": (
        lambda: fit(records=other(inputs=("torque",))),
        r"model's inputs are \(force\), the records' are \(torque\).*Name and order",
    ),
    "no record": (
        lambda: jaxid.estimate(MODEL, jaxid.free(MODEL, "k"), [], OutputError()),
        "no rec",
    ),
    "a comma forgotten in the names": (
        lambda: fit(CommaForgotten(*[jnp.array(1.0)] * 2)),
        r"`inputs`.*text 'force'.*\('force',\)",
    ),
    "1/min for rpm": (
        lambda: fit(WithUnits(*[jnp.array(1.0)] * 2), records=record(units={"x": "1/min"})),
        r"'x' is in \[1/s\].*\[rad\].*'rpm'",
    ),
    "degrees in the model": (
        lambda: fit(InDegrees(*[jnp.array(1.0)] * 2), records=record(units={"x": "deg"})),
        r"'x' is in \[rad\] in the records and in \[deg\] in the model.*SI units",
    ),
    "an effect of another equation": (
        lambda: loop(jaxid.effects.DryFriction("w", "v")),
        "no equation.*'w'.*names are: x, v",
    ),
    "an effect of another speed": (
        lambda: loop(jaxid.effects.DryFriction("v", "w")),
        r"sign\(w\) in v.*'w'.*x, v, force",
    ),
    "a training record as test": (
        lambda: loop(jaxid.effects.SensorBias("x"), test=record()),
        "test set 'test'.*is a training record.*no other use",
    ),
    "a training record as check": (
        lambda: loop(jaxid.effects.SensorBias("x"), check=record()),
        "check record.*is a training record.*no other use",
    ),
    "a part of a training record as test": (
        lambda: loop(jaxid.effects.SensorBias("x"), test=record().window(3)),
        "test set 'test'.*a part of one.*no other use",
    ),
    "a check record as test": (
        lambda: loop(jaxid.effects.SensorBias("x"), check=record(x=2 * X), test=record(x=2 * X)),
        "test set 'test'.*is a check record.*no other use",
    ),
    "a study with noise that it tries by itself": (
        lambda: loop(jaxid.effects.SensorBias("x"), likelihood=OutputError(Coloured(1))),
        r"tries random forces and coloured noise by itself.*OutputError\(\)",
    ),
    "a study with an innovation form": (
        lambda: loop(jaxid.effects.SensorBias("x"), likelihood=InnovationForm()),
        r"tries random forces and coloured noise by itself.*OutputError\(\)",
    ),
    "a starting value that is no number": (
        lambda: jaxid.free(Spring(jnp.array(jnp.nan), jnp.array(0.1)), "k"),
        "value of 'k' is nan.*Give a number",
    ),
    "a prior without a mean": (
        lambda: jaxid.free(MODEL, "k", prior={"k": (np.nan, 1.0)}),
        "prior mean of 'k' is nan",
    ),
    "a record without any error": (
        lambda: fit(
            records=record(u=0 * U, x=0 * X), likelihood=OutputError(FullNoise()), throw=True
        ),
        "simulation is finite.*covariance of the residuals is singular.*FixedNoise",
    ),
    "new noises for a model that has its own": (
        lambda: fit(with_noises(), likelihood=FilterError({"v": 0.5})),
        r"own noises.*starting values of process\.v would be ignored.*`fit\.model\.model`",
    ),
    "unknown noises for a model that has its own": (
        lambda: fit(with_noises(), likelihood=FilterError({"gust": 0.5})),
        r"process\.gust is none of them",
    ),
    "times that stand still": (
        lambda: jaxid.simulate(MODEL, changed(T, 5, T[4]), U[:, None], jnp.zeros(2)),
        "case 0 do not increase at row 5: 0.4 s after 0.4 s.*Sort",
    ),
    "a single sample time": (
        lambda: jaxid.simulate(MODEL, T[:1], U[:1, None], jnp.zeros(2)),
        "one sample time.*two or more",
    ),
    "information of several records": (
        lambda: jaxid.design.information_of(
            MODEL, jaxid.free(MODEL, "k"), jaxid.stack([record(), record()]), KNOWN
        ),
        r"planned for one record, and these are 2.*`stack\[i\]`.*`earlier`",
    ),
    "chi-square of a comparison with unknown noise": (
        lambda: jaxid.design.expected_chi_square(
            *[(MODEL, jaxid.free(MODEL, "k"))] * 2, record(), MISFIT
        ),
        "noise",
    ),
    "a misspelt signal of a centre": (
        lambda: jaxid.structure.columns(("x",), {"x": X}, {"y": 0.3}),
        "no signal \\(in `centre`\\) 'y'",
    ),
    "a level above one": (
        lambda: jaxid.consistency(MODEL, record(), level=5.0),
        "level is 5.0; a probability lies between",
    ),
    "a window without a valid sample": (
        lambda: jaxid.predict(MODEL, record(x=holed(X, 0, 5)), OutputError(), window=5),
        "window has 5 samples, with 0 valid values.*at least 2 for 2 states",
    ),
    "an effect of another sensor": (
        lambda: loop(jaxid.effects.SensorBias("y")),
        "no output.*'y'.*names are: x",
    ),
    "a hole in time": (
        lambda: fit(records=record(t=T + 9 * (T > 1))),
        "1 hole: rows 10 to 11.*Split",
    ),
}
FILES = {
    "several units in titles": (
        "t,force,x_deg,y_ft\n0,1,2,3\n",
        {"outputs": ("x_deg", "y_ft")},
        "titles 'x_deg', 'y_ft'.*units={'x_deg': 'deg', 'y_ft': 'ft'}",
    ),
    "no such column": ("t,force,y\n0,1,2\n", {}, "no column in log.csv 'x'.*names are"),
    "decimal comma": (
        "t;force;x\n0;1,5;2\n",
        {"delimiter": ";"},
        "line 2.*'1,5' is not a number.*decimal=','",
    ),
    "forgotten units row": ("t,force,x\ns,N,m\n0,1,2\n", {}, "'s' is not a number.*units_row=True"),
    "other delimiter": (
        "t;force;x\n0;1;2\n",
        {},
        "log.csv: the header 't;force;x' is one cell. Give `delimiter=';'`",
    ),
    "a unit in the title alone": (
        "t,force,x_deg\n0,1,2\n",
        {"outputs": ("x_deg",)},
        "title 'x_deg' seems to hold the unit 'deg'.*Give `units=",
    ),
    "a row too short": ("t,force,x\n0,1\n", {}, "line 2: 2 cells, and the header has 3"),
}


@pytest.mark.parametrize("mistake", [*RECORDS, *MODELS])
def test_mistake_has_a_message_with_its_remedy(mistake):
    function, words = (RECORDS | MODELS)[mistake]
    with pytest.raises(InputError, match=f"(?s){words}"):
        function()


@pytest.mark.parametrize("mistake", FILES)
def test_mistake_in_a_file_has_a_message_with_its_remedy(mistake, tmp_path):
    text, options, words = FILES[mistake]
    with pytest.raises(InputError, match=f"(?s){words}"):
        csv(tmp_path, text, **options)


def test_file_of_another_kind_names_its_reader(tmp_path):
    scipy.io.savemat(tmp_path / "log.mat", {"t": T, "x": X})
    with pytest.raises(InputError, match=r"log\.mat.*`jaxid\.read_mat`"):
        jaxid.read_csv(tmp_path / "log.mat", **NAMES)


@pytest.fixture(scope="module")
def fitted():
    return fit()


def rooted(model):
    return np.sqrt(model.k)


def as_number(model):
    return float(model.k)


def branched(model):
    return model.k if model.k > 0 else -model.k


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (rooted, "'rooted'.*NumPy"),
        (as_number, "'as_number'.*`float`"),
        (branched, "'branched'.*if"),
    ],
)
def test_function_of_python_numbers_is_refused_by_propagate(function, words, fitted):
    with pytest.raises(InputError, match=words):
        jaxid.propagate(fitted, function)


def test_misspelt_parameter_of_a_fit_is_refused(fitted):
    with pytest.raises(InputError, match="no shared free parameter 'kk'"):
        fitted.value("kk")
    with pytest.raises(InputError, match="`own`"):
        fitted.standard_error("initial_state.x")


def test_fit_of_too_few_samples_says_so():
    free = jaxid.free(MODEL, "k", "c", per_record=("initial_state",))
    few = jaxid.estimate(MODEL, free, record(T[:4], U[:4], X[:4]), OutputError())
    assert "no more valid measurements than free parameters" in str(few)


def test_there_are_forty():
    assert len(RECORDS) + len(MODELS) + len(FILES) >= 40
