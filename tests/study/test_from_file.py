"""From a study file to the model, its free parameters and candidates; what does not exist is
refused where it stands.
"""

import dataclasses
import re
import sys
import tomllib
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from written_flight import MASS, SIZE, TRUE, flight

from jaxid import LoopOptions
from jaxid import __main__ as command
from jaxid._foundation.checks import InputError
from jaxid.aircraft import model_of
from jaxid.data.io.study import read_study
from jaxid.models import DiagonalNoise
from jaxid.models.names import read_parameters
from jaxid.simulation.hold import BandLimited, Cubic, Linear, ZeroOrder
from jaxid.study.from_file import case_of
from jaxid.study.model_from_file import BuiltIn

GUIDE = Path(__file__).resolve().parent.parent.parent / "docs" / "study_file.md"
SETTINGS = ("mass", "Iy", "S", "b", "cbar", "states", "held")
BUILT_IN = {"aircraft": BuiltIn(model_of, SETTINGS)}

MODULE = """
import jax
import jax.numpy as jnp
import jaxid
from jaxid.effects import SensorBias, Term


class Spring(jaxid.AbstractModel):
    k: jax.Array
    c: jax.Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return x[:1]


def stiff(k, c=0.5):
    return Spring(100.0 * k, c)


def text(k, c):
    return "a spring"


def own(model):
    return (Term("v", "x^5"), SensorBias("x"))


def wrong(model):
    return ("x^5",)


NUMBER = 5
"""
GOOD = """
[model]
use = "own_springs:Spring"
parameters = { k = 1.0, c = 2 }
[free]
parameters = ["k"]
bounds = { k = [0.0, inf] }
[records]
inputs = ["spare", "force"]
outputs = ["x", "y"]
train = ["a.csv"]
[noise]
x = "5 mm"
[loop]
window = 3
level = 0.05
[library]
general = false
effects = ["own_springs:own"]
leave_out = ["bias of x"]
"""


@pytest.fixture
def changed(tmp_path, monkeypatch):
    """A function that reads a study file with some of its text changed."""
    (tmp_path / "own_springs.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.delitem(sys.modules, "own_springs", raising=False)
    t = 0.1 * np.arange(20)
    header = "t,spare,force,x [mm],y [V]"
    np.savetxt(
        tmp_path / "a.csv", np.column_stack([t] * 5), delimiter=",", header=header, comments=""
    )

    def made(*changes):
        text = GOOD
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        (tmp_path / "study.toml").write_text(text, encoding="utf-8")
        return case_of(read_study(tmp_path / "study.toml"), BUILT_IN)

    return made


def test_class_in_folder_of_file_becomes_declared_model(changed):
    case = changed()
    assert (float(case.model.k), float(case.model.c)) == (1.0, 2.0)
    assert (case.free.shared, case.free.per_record) == (
        ("k",),
        ("initial_state.x", "initial_state.v"),
    )
    assert (float(case.free.lower["k"]), float(case.free.upper["k"])) == (0.0, np.inf)
    assert (case.train[0].inputs, case.train[0].outputs) == (("force",), ("x",))
    assert case.likelihood.noise.R.tolist() == [[pytest.approx(25e-6, rel=1e-12)]]
    assert [effect.name for effect in case.effects] == ["x^5 in v"]
    assert (case.window, case.options.level, case.options.refits) == (3, 0.05, LoopOptions().refits)
    assert (case.check, case.test) == (None, None)


def test_unknown_candidate_of_many_gets_the_nearest_names_and_the_list(changed):
    with pytest.raises(InputError) as refused:
        changed(("general = false", "general = true"), ("bias of x", "x^33 in v"))
    message = str(refused.value)
    assert "Did you mean 'x^3 in v' or " in message
    assert message.endswith(
        "`python -m jaxid close-loop STUDY.toml --candidates` lists all of them."
    )
    assert len(message) < 400


def test_command_lists_the_candidates(changed, tmp_path, monkeypatch, capsys):
    case = changed(("general = false", "general = true"))
    monkeypatch.chdir(tmp_path)
    command.study_file(tmp_path / "study.toml", list_candidates=True)
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split() == ["candidate", "family", "place", "description"]
    assert len(lines) == len(case.effects) > 20
    assert all(line.startswith(each.name) for line, each in zip(lines, case.effects, strict=True))
    assert not (tmp_path / "jaxid-study").exists()


def test_command_lists_the_default_candidates(changed, tmp_path, monkeypatch, capsys):
    """A file without a section [library] has the same ones as `general = true`."""
    library = GOOD[GOOD.index("[library]") :]
    default = changed((library, ""))
    monkeypatch.chdir(tmp_path)
    command.study_file(tmp_path / "study.toml", list_candidates=True)
    names = [effect.name for effect in changed((library, "[library]\ngeneral = true")).effects]
    assert [effect.name for effect in default.library] == names
    lines = capsys.readouterr().out.splitlines()[1:]
    assert all(line.startswith(name) for line, name in zip(lines, names, strict=True))


@pytest.mark.parametrize("option", ["json", "out"])
def test_list_of_candidates_writes_no_file(changed, tmp_path, option):
    changed()
    with pytest.raises(InputError, match="Leave --json and --out out"):
        command.study_file(
            tmp_path / "study.toml", list_candidates=True, **{option: tmp_path / "other"}
        )


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("linear", Linear),
        ("zero_order", ZeroOrder),
        ("cubic", Cubic),
        ("band_limited", BandLimited),
    ],
)
def test_hold_of_file_is_that_of_likelihood_with_and_without_noise(name, kind, changed):
    hold = ("[free]", f'hold = "{name}"\n[free]')
    assert isinstance(changed(hold).likelihood.hold, kind)
    assert isinstance(changed(hold, ('[noise]\nx = "5 mm"', "")).likelihood.hold, kind)


def test_file_accepts_every_option_of_loop(changed):
    """But noise hypotheses, which are classes."""
    defaults = {field.name: field.default for field in dataclasses.fields(LoopOptions)}
    defaults.pop("noises")
    with pytest.raises(InputError, match="noises"):
        changed(("level = 0.05", "noises = 1"))
    text = "\n".join(f"{name} = {value}" for name, value in defaults.items())
    assert changed(("level = 0.05", text)).options == LoopOptions()
    assert changed(("level = 0.05", "beam_width = 1")).options.beam_width == 1


def test_defaults_of_file_equal_defaults_of_loop(changed):
    loop, library = "[loop]\nwindow = 3\nlevel = 0.05", GOOD[GOOD.index("[library]") :]
    case = changed(
        ("Spring", "stiff"),
        ("c = 2", "c = 1"),
        ('[noise]\nx = "5 mm"', ""),
        (loop, ""),
        (library, ""),
    )
    assert float(case.model.k) == 100.0  # of the function
    assert isinstance(case.likelihood.noise, DiagonalNoise)
    assert (case.window, case.effects) == (None, None)
    assert changed(("general = false", "")).effects != changed().effects


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "own_springs:Spring",
            "own_springs",
            r"\[model\] use: found 'own_springs', and "
            r"`module:name`.*: aircraft",
        ),
        (
            "own_springs:Spring",
            "nowhere:Spring",
            r"\[model\] use: there is no module 'nowhere' "
            r"in the file's folder",
        ),
        (
            "own_springs:Spring",
            "own_springs:Sprin",
            r"There is no name in the module .* 'Sprin'. Did you mean 'Spring'",
        ),
        ("own_springs:Spring", "own_springs:NUMBER", r"own_springs:NUMBER is neither a class"),
        ("own_springs:Spring", "own_springs:text", r"\[model\] use: own_springs:text gives a str"),
        (
            "c = 2",
            "d = 2",
            r"\[model\] parameters: There is no parameter of own_springs:Spring 'd'",
        ),
        (", c = 2", "", r"\[model\] parameters: c must have a starting value. Give c = 1.0"),
        (
            "[free]",
            "terms = { Cm = [] }\n[free]",
            r"\[model\] terms: it belongs to a built-in model",
        ),
        ("c = 2", f"c = {10**400}", r"\[model\] parameters: found '1000000.*a number"),
        ("c = 2", "c = [[1.0], [1.0, 2.0]]", r"\[model\] parameters: found .*a number"),
        ("level = 0.05", f"level = {10**400}", r"\[loop\] level: found 1000.*a number is wanted"),
        ("level = 0.05", f"level = {'9' * 5000}", r"study.toml is not a TOML file"),
        ('parameters = ["k"]', 'parameters = ["kk"]', r"\[free\]: There is no parameter 'kk'"),
        ('parameters = ["k"]', "", r"\[free\]: `parameters` is missing"),
        ("k = [0.0", "k = [2.0", r"\[free\]: The starting value of 'k'"),
        ('"x", "y"', '"y"', r"\[noise\]|\[records\]: There is no channel"),
        ('x = "5 mm"', 'z = "5 mm"', r"\[noise\]: There is no output 'z'"),
        ("5 mm", "5 V", r"\[noise\]: x = '5 V' is no number with a unit of this channel"),
        ('"5 mm"', "0.0", r"\[noise\]: the standard deviation of x is 0.0"),
        ('"5 mm"', "inf", r"\[noise\]: the standard deviation of x is inf"),
        ('"5 mm"', '"inf mm"', r"\[noise\]: the standard deviation of x is inf mm"),
        ('"5 mm"', "1e200", r"\[noise\]: the standard deviation of x is 1e\+200"),
        (
            "level = 0.05",
            "levels = 0.05",
            r"\[loop\]: There is no key 'levels'. Did you mean "
            r"'level'",
        ),
        ("level = 0.05", "level = 5", r"\[loop\]: level is 5.0; it must lie between 0 and 1"),
        (
            "level = 0.05",
            "refits = 2.5",
            r"\[loop\] refits: found 2.5, and a whole number is wanted",
        ),
        ("level = 0.05", "beam_width = 0", r"\[loop\]: beam_width is 0; it must be at least 1"),
        (
            "own_springs:own",
            "own_springs:wrong",
            r"\[library\] effects: own_springs:wrong returns an object that is not",
        ),
        (
            "bias of x",
            "bias of z",
            r"\[library\] leave_out: There is no candidate or family 'bias "
            r"of z'",
        ),
        (
            "[free]",
            'hold = "zero"\n[free]',
            r"\[model\] hold: There is no hold of the inputs 'zero'.*'zero_order'",
        ),
        (
            'outputs = ["x", "y"]',
            'outputs = ["y"]',
            r"\[records\]: There is no channel \(needed as output\) 'x'.*`columns`",
        ),
        ('["bias of x"]', '["bias of x", "x^5 in v"]', r"\[library\]: no candidate is left"),
    ],
)
def test_unknown_name_raises_error_with_section_and_key(old, new, words, changed):
    with pytest.raises(InputError, match=words):
        changed((old, new))


def test_folder_of_file_is_not_on_path_and_replaces_no_installed_package(changed, tmp_path):
    (tmp_path / "own_neighbour.py").write_text("K = 1.0\n")
    (tmp_path / "pint.py").write_text("raise SystemExit('a neighbour was run')\n")
    (tmp_path / "own_springs.py").write_text("import own_neighbour, pint\n" + MODULE)
    before = list(sys.path)
    changed()
    assert sys.path == before
    assert Path(sys.modules["pint"].__file__).parent != tmp_path


@pytest.mark.parametrize(
    ("use", "words"),
    [
        ("subprocess:getoutput", "'subprocess' is a module of Python's standard library"),
        ("os.path:exists", "'os' is a module of Python's standard library"),
        ("numpy:loadtxt", "numpy:loadtxt is (neither a class nor|a function of an installed)"),
        ("scipy.io:whosmat", "does not declare that it returns a model"),
        ("pint:UnitRegistry", "pint:UnitRegistry is a class, and no subclass"),
        ("jaxid:AbstractModel", "jaxid:AbstractModel is an abstract class"),
        ("own_borrowed:getoutput", "is a function of the module 'subprocess'"),
        ("..own_springs:Spring", "found '..own_springs:Spring', and `module:name` is wanted"),
        ("own_springs:Spring.rhs", "and `module:name` is wanted"),
        ("own_raises:Spring", r"raises ZeroDivisionError \(own_raises.py, line 2\): division"),
        ("own_leaves:Spring", "raises SystemExit"),
        ("own_syntax:Spring", r"raises SyntaxError \(own_syntax.py, line 1\)"),
        ("own_springs:breaks", r"own_springs:breaks raises KeyError \(own_springs.py, line"),
        ("numpy:Spring", "'numpy' is in the file's folder, and another module 'numpy' is inst"),
    ],
)
def test_object_that_makes_no_model_raises_error_before_it_is_called(use, words, changed, tmp_path):
    (tmp_path / "own_borrowed.py").write_text("from subprocess import getoutput\n")
    (tmp_path / "own_raises.py").write_text("x = 0\n1 / x\n")
    (tmp_path / "own_leaves.py").write_text("raise SystemExit(3)\n")
    (tmp_path / "own_syntax.py").write_text("def\n")
    if use == "numpy:Spring":
        (tmp_path / "numpy.py").write_text("raise RuntimeError\n")
    breaks = MODULE + "\n\ndef breaks(k, c):\n    return {}[k.shape]\n"
    (tmp_path / "own_springs.py").write_text(breaks)
    marker = tmp_path / "called"
    command = f"parameters = {{ cmd = 'touch {marker}' }}"
    changes = [("own_springs:Spring", use)]
    if "getoutput" in use:
        changes.append(("parameters = { k = 1.0, c = 2 }", command))
    with pytest.raises(InputError, match=words):
        changed(*changes)
    assert not marker.exists()


def test_function_of_installed_package_is_not_called_for_effects(changed):
    with pytest.raises(InputError, match="does not declare that it returns effects"):
        changed(("own_springs:own", "scipy.io:whosmat"))
    with pytest.raises(InputError, match="is a class, and a function is wanted"):
        changed(("own_springs:own", "own_springs:Spring"))


def test_function_of_installed_package_that_declares_effects_is_called(changed):
    case = changed(("own_springs:own", "jaxid.effects:general_effects"), ("bias of x", "x^2 in v"))
    assert "x^3 in v" in [effect.name for effect in case.effects]


def test_missing_import_of_module_raises_error_with_its_name(changed, tmp_path):
    (tmp_path / "own_needs.py").write_text("import a_package_that_is_nowhere\n")
    with pytest.raises(
        InputError,
        match=r"own_needs.py imports 'a_package_that_is_nowhere', which "
        r"is not installed",
    ):
        changed(("own_springs:Spring", "own_needs:Spring"))


# The guide's aircraft -----------------------------------------------------------------------------

SI = {"deg": np.pi / 180, "deg/s": np.pi / 180, "kt": 1852 / 3600, "ft": 0.3048, "g0": 9.80665}


@pytest.fixture(scope="module")
def aircraft_file(tmp_path_factory):
    """The guide's file for an aircraft, with one simulated flight under its five names."""
    folder = tmp_path_factory.mktemp("aircraft")
    (text,) = re.findall(
        r'^```toml\n(\[model\]\nuse = "aircraft".*?)^```', GUIDE.read_text("utf-8"), re.M | re.S
    )
    changed = tomllib.loads(text)
    settings, records = changed["model"]["aircraft"], changed["records"]
    assert {name: settings[name] for name in ("mass", "Iy", *SIZE)} == {
        "mass": MASS["mass"],
        "Iy": MASS["Iy"],
        **SIZE,
    }
    measured = flight(seconds=16.0, which=("stabilator",), seed=3)
    names, units = ("t", *records["inputs"], *records["outputs"]), records["units"]
    table = np.column_stack([measured[name] / SI.get(units.get(name), 1.0) for name in names])
    for file in ("doublets", "3211", "pulls", "slow", "sweep"):
        np.savetxt(
            folder / f"{file}.csv", table, delimiter=",", header=",".join(names), comments=""
        )
    return folder, text


def read_aircraft(aircraft_file, old="", new=""):
    folder, text = aircraft_file
    assert old in text
    (folder / "study.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    return case_of(read_study(folder / "study.toml"), BUILT_IN)


def test_aircraft_starts_at_first_estimate_of_its_terms(aircraft_file):
    # every coefficient has its constant
    case = read_aircraft(aircraft_file, 'Cm = ["alpha"', 'Cm = ["1", "alpha"')
    assert case.model.states == ("u", "w", "q", "pitch")
    assert case.window == 25
    assert [*case.test] == ["slow", "sweep"]
    expected = {f"{name}.{term}" for name in ("CX", "CZ", "Cm") for term in ("1", *TRUE[name])}
    assert set(case.free.shared) == expected
    # Two copies of one flight: the strong derivatives come within some standard errors, of about 1
    # %.
    for name in ("CZ.alpha", "Cm.alpha", "Cm.qhat", "Cm.stabilator"):
        coefficient, term = name.split(".")
        assert float(read_parameters(case.model, (name,))[0]) == pytest.approx(
            TRUE[coefficient][term], rel=0.05
        ), name
    assert all(bool(jnp.all(record.mask)) for record in case.train)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass = 5000.0", "masses = 5000.0", r"\[model\] aircraft: There is no setting 'masses'"),
        ("mass = 5000.0", "", r"\[model\] aircraft: Record 'doublets' lacks mass"),
        ('Cm = ["alpha"', 'Cm = ["alfa"', r"\[model\] terms: .*'alfa'"),
        ("Cm = [", "CY = [", r"\[model\] terms: There is no coefficient 'CY'"),
        ('derivatives = { q = "qdot" }', "", r"\[model\] terms: .*needs 'qdot'"),
        (
            "[loop]",
            '[free]\nparameters = ["Cm.beta"]\n[loop]',
            r"\[free\]: There is no parameter "
            r"'Cm.beta'",
        ),
        ("[loop]", "[noise]\nq = 0.1\n[loop]", r"\[noise\]: .* has no standard deviation"),
    ],
)
def test_incomplete_aircraft_raises_error_before_fit(old, new, words, aircraft_file):
    with pytest.raises(InputError, match=words):
        read_aircraft(aircraft_file, old, new)
