"""`python -m jaxid design`: the next record as CSV and a figure, and the section [design]."""

import contextlib
import importlib
import io

import numpy as np
import pytest
from many_lags import lag_records

from jaxid import read_csv
from jaxid._foundation.checks import InputError
from jaxid.report import folder

MODULE = importlib.import_module("jaxid.__main__")
COMMAND = MODULE.design  # as a function; typer converts its arguments

STUDY = """
[model]
use = "many_lags:Hardening"
parameters = { p = 1.0, b = 0.7, cubic = 0.05 }

[free]
parameters = ["p", "b"]

[records]
inputs = ["u"]
outputs = ["x"]
train = ["lag.csv"]

[design]
duration = 6.0
sample_time = 0.1
knots = 8
amplitude = { u = 1.0 }
rate = { u = 5.0 }
envelope = { x = [-0.5, 0.5] }
"""


def write_study(folder, text=STUDY):
    (one,) = lag_records(1, seed=21)
    columns = np.column_stack([one.t, one.u[:, 0], one.z[:, 0]])
    np.savetxt(folder / "lag.csv", columns, delimiter=",", header="t,u,x", comments="")
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def test_record_to_fly_keeps_the_limits(tmp_path):
    study, out = write_study(tmp_path), tmp_path / "new" / "next"
    with contextlib.redirect_stdout(io.StringIO()) as output:
        COMMAND(study, out=out)
    assert "limits used: u, amplitude" in output.getvalue()
    flown = read_csv(out / "design.csv", inputs=("u",), outputs=("x",))
    np.testing.assert_allclose(flown.t, 0.1 * np.arange(61), atol=1e-9)
    assert np.max(np.abs(flown.u)) <= 1.0
    assert 0.3 < np.max(np.abs(flown.z)) <= 0.5 * (1 + 1e-4)
    assert (out / "design.png").read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in out.parent.iterdir()] == ["next"]


def test_design_is_saved_elsewhere_where_its_folder_appears_meanwhile(
    tmp_path, monkeypatch, capsys
):
    design, out = MODULE.informative_input, tmp_path / "next"

    def late(*arguments):
        out.mkdir()
        return design(*arguments)

    monkeypatch.setattr(MODULE, "informative_input", late)
    monkeypatch.setattr(folder.tempfile, "gettempdir", lambda: str(tmp_path))
    with pytest.raises(SystemExit, match="1"):
        COMMAND(write_study(tmp_path), out=out)
    (saved,) = tmp_path.glob("jaxid-*/next/design.csv")
    message = "".join(capsys.readouterr().err.split())
    assert str(saved.parent) in message
    assert list(out.iterdir()) == []


def test_channel_that_no_header_can_hold_is_refused_before_the_estimate(tmp_path):
    module = "from many_lags import Hardening\nclass Odd(Hardening):\n    inputs = ('u(1)',)\n"
    (tmp_path / "odd_input.py").write_text(module)
    text = STUDY.replace("many_lags:Hardening", "odd_input:Odd").replace('["u"]', '["u(1)"]')
    text = text.replace("u = ", '"u(1)" = ').replace(
        "[design]", 'columns = { "u(1)" = "u" }\n[design]'
    )
    with pytest.raises(
        InputError, match=r"\[model\]: Channel 'u\(1\)' has a comma, quote or bracket"
    ):
        COMMAND(write_study(tmp_path, text), out=tmp_path / "next")
    assert not (tmp_path / "next").exists()


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("duration = 6.0", "", "duration must be given"),
        ("duration = 6.0", "duration = inf", r"\[design\]: The duration is inf s"),
        ("u = 1.0", "u = 1.0, v = 2.0", r"\[design\] amplitude: .*no input 'v'"),
        ("u = 1.0", "u = nan", r"\[design\] amplitude: The limit of 'u' is nan"),
        ("u = 1.0", "u = -1.0", r"\[design\] amplitude: The limit of 'u' is -1"),
        (
            "{ u = 1.0 }",
            '{}\naxes = ["u"]',
            r"\[design\] axes: The amplitude of the input 'u' has no limit",
        ),
        ("u = 1.0", "u = inf", r"\[design\] axes: The amplitude of the input 'u' has no limit"),
        ("u = 5.0", "gone = 1.0", r"\[design\] rate: .*no input 'gone'"),
        ("u = 5.0", "u = 0.0", r"\[design\] rate: The limit of 'u' is 0"),
        ("rate =", "energy = -1.0\nrate =", r"\[design\] energy: The limit of 'energy' is -1"),
        ("envelope = { x", "envelope = { z", r"\[design\] envelope: .*'z'"),
        ("[-0.5, 0.5]", "[1.0, -1.0]", r"\[design\] envelope: the range of 'x' is 1 to -1"),
        ("[-0.5, 0.5]", "[-0.5, nan]", r"\[design\] envelope: the range of 'x' is -0.5 to nan"),
        ("[-0.5, 0.5]", "[0.2, 0.5]", r"\[design\] envelope: .* exclude the trim"),
        ("knots = 8", "initial_state = { x = nan }", r"\[design\] initial_state: x is nan"),
        ("knots = 8", "knots = 80", "80 knots for 61 samples"),
        ("knots = 8", "trim_input = { w = 1.0 }", "no trim input 'w'"),
        ("knots = 8", "colour = 1", "no key 'colour'"),
    ],
)
def test_section_is_checked_before_the_estimate(tmp_path, monkeypatch, old, new, match):
    monkeypatch.delattr(MODULE, "estimate")
    head, section = STUDY.split("[design]")
    study = write_study(tmp_path, f"{head}[design]{section.replace(old, new)}")
    with pytest.raises(InputError, match=match):
        COMMAND(study, out=tmp_path / "next")


def test_existing_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="exists"):
        COMMAND(write_study(tmp_path), out=tmp_path)
