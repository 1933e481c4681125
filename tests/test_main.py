"""The command line as a user meets it: the main job's figures, its files, and what it says to bad
input.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import jaxtyping
import pytest
from rich.console import Console

from jaxid import __main__ as command

GUIDE = Path(__file__).resolve().parent.parent / "docs" / "study_file.md"


def run(arguments, folder, timeout=600, program=("-m", "jaxid")):
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("JAX_ENABLE_X64", "JAXID_DATA")
    }
    command = [sys.executable, *program, *map(str, arguments)]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=timeout
    )


@pytest.fixture
def run_here(tmp_path, monkeypatch, capsys):
    """As `run`, in this process and without its settings of JAX: returns status and output."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("JAXID_DATA", raising=False)
    monkeypatch.setattr(command, "configure", lambda: None)
    # for users, annotations are not checked
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)

    def call(arguments):
        monkeypatch.setattr(command, "console", Console(stderr=True))
        monkeypatch.setattr(sys, "argv", ["jaxid", *arguments])
        with pytest.raises(SystemExit) as end:
            command.main()
        return end.value.code, capsys.readouterr()

    return call


def test_a_flight_names_the_planted_effect_and_reaches_the_noise(tmp_path):
    """The small flight, for its time; the loop on the embedded one is tested in
    tests/benchmarks/test_benchmark_loop_cost.py.
    """
    done = run(["longitudinal", "--json", "out.json"], tmp_path)
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "out.json").read_text())
    assert figures["effects"] == ["alpha^3 in Cm"]
    assert figures["outcome"] == "explained"
    assert "alpha^3 in the aerodynamic coefficient Cm" in figures["verdict"]
    for channel, noise in figures["noise"].items():
        # Three per cent of the noise that stands in the scored samples of the test records, as the
        # main job promises.
        assert figures["after"][channel] <= 1.03 * noise, channel
    assert figures["before"]["alpha"] > 5 * figures["after"]["alpha"]
    page = (tmp_path / "jaxid-study" / "study.html").read_text()
    # the page sets powers as powers
    assert "The model lacked: alpha³ in the aerodynamic coefficient Cm" in page
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_a_study_file_runs_as_the_guide_prints_it(tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    named = re.findall(
        r"^```(?:python|toml)\n# (\S+)\n(.*?)^```", GUIDE.read_text(encoding="utf-8"), re.M | re.S
    )
    for name, text in named:
        (folder / name).write_text(text, encoding="utf-8")
    simulated = run([], folder, program=("records.py",))
    assert simulated.returncode == 0, simulated.stderr
    done = run(["close-loop", "mine/study.toml", "--json", "out.json"], tmp_path)
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "out.json").read_text())
    assert (figures["outcome"], figures["effects"]) == ("explained", ["x^3 in v"])
    # no terminal: a log of lines
    assert re.search(r"^ +\d+ s  round 1: refit with x\^3 in v \(1/\d+\)$", done.stderr, re.M)
    assert "soft stop" in [one["name"] for one in figures["rounds"][0]["candidates"]]
    # 10 mm of noise in 380 scored samples, within 12 %: three standard deviations of its RMS.
    assert figures["after"]["x"] == pytest.approx(0.01, rel=0.12)
    assert figures["before"]["x"] > 0.1
    assert "A spring" in (tmp_path / "jaxid-study" / "study.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["close-loop", "taken.json"], "taken.json is not a TOML file"),
        (["dataset", "tanks"], "JAXID_DATA"),
        (["dataset", "silverbox", "nowhere"], "SNLS80mV.mat"),
        (["--json", "taken.json"], "taken.json"),
        (["--seed", "3", "longitudinal"], "--seed stands before 'longitudinal'"),
    ],
)
def test_bad_input_is_a_sentence_and_not_a_traceback(arguments, words, run_here, tmp_path):
    (tmp_path / "taken.json").write_text("{}")
    status, printed = run_here(arguments)
    assert status == 2
    assert words in printed.err.replace("\n", "")
    assert "Traceback" not in printed.err
    assert (tmp_path / "taken.json").read_text() == "{}"


def test_without_what_draws_the_report_it_says_what_to_install(tmp_path):
    without = (
        "import runpy, sys; sys.modules['matplotlib'] = None; "
        "runpy.run_module('jaxid', run_name='__main__')"
    )
    done = run([], tmp_path, program=("-c", without))
    assert done.returncode == 2
    assert "pip install 'jaxid[report]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_help_tells_of_the_jobs(run_here):
    status, printed = run_here(["--help"])
    assert status == 0
    for word in ("dataset", "longitudinal", "close-loop", "--json"):
        assert word in printed.out
