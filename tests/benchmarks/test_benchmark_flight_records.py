"""Tests of the benchmark on flights of DLR: skipped cases, a declared flight and its row."""

import contextlib
import importlib
import io
import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from written_flight import MASS, SIZE, flight, write_hfb

from jaxid.aircraft import ConstantThrust, Engine
from jaxid.loop.outcome import Outcome

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)  # benchmarks are not part of the installed package
        yield importlib.import_module("benchmarks.flight_records")


def test_case_without_data_is_skipped_and_names_the_file(benchmark, tmp_path):
    words = io.StringIO()
    with contextlib.redirect_stdout(words):
        assert benchmark.main(["--json", "--data", str(tmp_path)]) == 0
    output = json.loads(words.getvalue())
    assert output["status"] == "no data"
    files = {one["case"]: one["why"] for one in output["rows"]}
    assert list(files) == list(benchmark.CASES)
    for case, file in (("stall", "fAttas_qst01.asc"), ("pulse", "hfb320_1_10.asc")):
        assert f"There is no file {tmp_path / file}" in files[case]
    assert "pulse skipped: " in benchmark.table(output["rows"])


def test_unknown_case_raises_usage_error(benchmark, capsys):
    with pytest.raises(SystemExit):
        benchmark.main(["--data", ".", "--cases", "spin"])
    assert "there is no case 'spin'; there are stall" in capsys.readouterr().err


def test_loop_is_given_first_part_and_reports_second(benchmark, tmp_path, monkeypatch):
    """A simulated flight in the columns of the HFB-320; the estimates, which other tests hold, are
    left out.
    """
    write_hfb(tmp_path / "hfb320_1_10.asc", flight(step=0.05, which=("stabilator",)))
    monkeypatch.setattr(benchmark, "HFB_SIZE", MASS | SIZE)
    monkeypatch.setattr(benchmark, "HFB_ENGINES", (Engine(ConstantThrust(0.0)),))
    given = {}

    def identified(model, records, *, options):
        given.update(model=model, identified=records)
        return SimpleNamespace(model=model, estimate=SimpleNamespace(free=None))

    def side(error):
        return SimpleNamespace(rms={"pulse": {"alpha": error}})

    def closed(model, free, likelihood, **records):
        given.update(records)
        return SimpleNamespace(
            before=side(0.02),
            after=side(0.01),
            outcome=Outcome.PROXIES,
            verdict="Something is missing.",
            to_dict=lambda: {"effects": ["bias of q"], "parameters": {}},
        )

    monkeypatch.setattr(benchmark, "identify", identified)
    monkeypatch.setattr(benchmark, "close_loop", closed)
    row = benchmark.measure("pulse", tmp_path, lambda words: None)
    (record,), (train,), (test,) = given["identified"], given["train"], given["test"]
    assert (record.t.size, train.t.size, test.t.size) == (231, 231, 369)
    assert train.outputs == given["model"].outputs
    assert float(test.t[0]) > float(train.t[-1])
    assert row["effects"] == ["bias of q"]
    lines = benchmark.table([row]).splitlines()
    assert any(line.split() == ["alpha", "0.02", "0.01"] for line in lines)
