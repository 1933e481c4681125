"""`python -m jaxid identify`: the section [identify], the weak form, and refusals."""

import contextlib
import importlib
import io
import json

import numpy as np
import pytest
from written_flight import MASS, SIZE, TRUE, flight

from jaxid._foundation.checks import InputError

# The command as a function; typer converts its arguments.
COMMAND = importlib.import_module("jaxid.__main__").identify_file

STUDY = f"""
[model]
use = "aircraft"

[model.aircraft]
states = "longitudinal"
mass = {MASS["mass"]}
Iy = {MASS["Iy"]}
S = {SIZE["S"]}
b = {SIZE["b"]}
cbar = {SIZE["cbar"]}
held = {{ aileron = 0.0, rudder = 0.0 }}

[records]
inputs = ["stabilator", "thrust"]
outputs = ["V", "alpha", "q", "pitch", "ax", "az", "altitude"]
train = ["flight.csv"]

[identify]
weak_radius = 0.6
rule = "BIC"

[identify.candidates]
CX = ["alpha", "alpha^2"]
CZ = ["alpha", "qhat", "stabilator"]
Cm = ["alpha", "qhat", "stabilator", "alpha^2"]
"""
CHANNELS = ("stabilator", "thrust", "V", "alpha", "q", "pitch", "ax", "az", "altitude")


def write_study(folder, text=STUDY):
    measured = flight(seconds=20.0, which=("stabilator",), seed=5)
    columns = np.column_stack([measured[name] for name in ("t", *CHANNELS)])
    header = ",".join(("t", *CHANNELS))
    np.savetxt(folder / "flight.csv", columns, delimiter=",", header=header, comments="")
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def test_terms_are_selected_without_angular_accelerations(tmp_path):
    with contextlib.redirect_stdout(io.StringIO()) as output:
        COMMAND(write_study(tmp_path), json=tmp_path / "terms.json")
    assert "status: converged" in output.getvalue()
    content = json.loads((tmp_path / "terms.json").read_text())
    assert {"stabilator", "alpha", "qhat"} <= {*content["equations"]["Cm"]["terms"]}
    for name in ("alpha", "qhat", "stabilator"):
        row = content["parameters"][f"Cm.{name}"]
        error = abs(row["value"] - TRUE["Cm"][name])
        assert error < 4.0 * row["standard_error"], name


def test_prior_of_the_file_is_that_of_the_estimate(tmp_path):
    """A narrow a-priori value decides; the deviation stands in the file."""
    text = STUDY.replace(
        "[identify.candidates]", 'prior = { "Cm.qhat" = [-20.0, 1e-3] }\n[identify.candidates]'
    )
    with contextlib.redirect_stdout(io.StringIO()):
        COMMAND(write_study(tmp_path, text), json=tmp_path / "terms.json")
    row = json.loads((tmp_path / "terms.json").read_text())["parameters"]["Cm.qhat"]
    assert abs(row["value"] + 20.0) < 4e-3
    assert abs(row["standard_error"] - 1e-3) < 5e-5


def test_angular_acceleration_is_needed_on_samples_alone(tmp_path):
    study = write_study(tmp_path, STUDY.replace("weak_radius = 0.6\n", ""))
    with pytest.raises(InputError, match="the model needs 'qdot' for the coefficients"):
        COMMAND(study)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('rule = "BIC"', 'rule = "best"', r"\[identify\] rule: .*no rule 'best'"),
        ("weak_radius = 0.6", "weak_radius = -1.0", r"\[identify\]: weak_radius is -1"),
        ("[records]", '[model.terms]\nCm = ["alpha"]\n[records]', "Leave one of them out"),
        ("CX = [", "CQ = [", "no aerodynamic coefficient"),
        ("weak_radius = 0.6", "radius = 0.6", "no key 'radius'"),
    ],
)
def test_section_is_checked(tmp_path, old, new, match):
    with pytest.raises(InputError, match=match):
        COMMAND(write_study(tmp_path, STUDY.replace(old, new)))


def test_option_replaces_the_radius_of_the_file(tmp_path):
    with pytest.raises(InputError, match=r"a test function 30 s"):
        COMMAND(write_study(tmp_path), weak_radius=15.0)


def test_option_replaces_angular_accelerations_for_terms_of_the_file(tmp_path):
    """The model with the terms is built with the radius of the option, as with the file's."""
    model, _, _ = STUDY.partition("[identify]")
    terms = '[model.terms]\nCm = ["alpha", "qhat", "stabilator"]\nCZ = ["alpha"]\n'
    study = write_study(tmp_path, model + terms)
    with contextlib.redirect_stdout(io.StringIO()) as output:
        COMMAND(study, weak_radius=0.6)
    assert "status: converged" in output.getvalue()
    with pytest.raises(InputError, match="the model needs 'qdot' for the coefficients"):
        COMMAND(study)
