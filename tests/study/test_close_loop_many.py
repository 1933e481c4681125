"""Many studies in processes: each finds its effect, fails alone, and is not repeated."""

import importlib
import pickle
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import ClassVar

import jax.numpy as jnp
import pytest
from small_spring import SIGMA, Spring, fly

from jaxid import LoopOptions, OutputError, free
from jaxid._foundation.checks import InputError
from jaxid.effects import Term
from jaxid.models import FixedNoise
from jaxid.study import close_loop_many
from jaxid.study.many.close_loop_many import KILLED, _run, run_study
from jaxid.study.many.studies import Studies, StudyResult
from jaxid.study.many.study_folder import StudyFolder

# its package has a function of the same name
module = importlib.import_module("jaxid.study.many.close_loop_many")
CUBE = Term("v", "x^3", gain=jnp.array(-0.3))
OPTIONS = LoopOptions(max_rounds=1, swap_limit=0, beam_width=1)


def arguments(seed):
    """Return the smallest study: one candidate, 200 samples."""
    model = Spring(jnp.array(1.5), jnp.array(0.2))
    records = [fly(seed + i, CUBE, samples=200)[0] for i in range(3)]
    return {
        "model": model,
        "free": free(model, "k", "c"),
        "likelihood": OutputError(FixedNoise(jnp.array([SIGMA**2]))),
        "train": records[0],
        "check": records[1],
        "test": records[2],
        "effects": (Term("v", "x^3"),),
        "options": OPTIONS,
    }


@pytest.fixture(scope="module")
def studies():
    """A study, one that is refused, and one that another process cannot read."""

    class Local(Spring):
        pass

    good = arguments(1)
    local = good | {"model": Local(jnp.array(1.5), jnp.array(0.2))}
    return {"flight 1": good, "no/channel": good | {"effects": (Term("v", "y"),)}, "local": local}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("studies") / "results"


@pytest.fixture(scope="module")
def many(studies, folder):
    return close_loop_many(studies, folder=folder, processes=1)


def test_study_in_a_process_finds_planted_effect_and_its_gain(many):
    result = many["flight 1"]
    assert result.effects == ("x^3 in v",)
    gain = result.content["parameters"]["x^3 in v.gain"]
    assert abs(gain["value"] + 0.3) < 5 * gain["standard_error"] < 0.2


def test_failed_studies_carry_their_reasons(many):
    assert list(many.failures) == ["no/channel", "local"]
    assert "'y'" in many.failures["no/channel"]
    assert "cannot be sent to another process" in many.failures["local"]


def test_table_has_one_row_per_study(many):
    table = many.to_dataframe()
    assert list(table.index) == ["flight 1", "no/channel", "local"]
    assert list(table.outcome) == [many["flight 1"].outcome.value, "failed", "failed"]
    assert table.before.iloc[0] > 2 * table.after.iloc[0] > SIGMA
    lines = str(many).splitlines()
    assert lines[1].startswith("flight 1    ")
    assert lines[1].endswith("x^3 in v")


def test_second_call_repeats_failed_studies_only(many, studies, folder):
    repeated = []
    failing = {name: studies[name] for name in ("flight 1", "local")}
    again = close_loop_many(failing, folder=folder, processes=1, progress=repeated.append)
    assert [result.name for result in repeated] == ["local"]
    assert again["flight 1"] == many["flight 1"]


def test_folder_of_other_studies_is_refused(studies, folder, many):
    other = {"flight 1": studies["flight 1"] | {"options": LoopOptions(max_rounds=2)}}
    with pytest.raises(InputError, match=r"flight 1.json' belongs to another study"):
        close_loop_many(other, folder=folder)


def test_folder_of_other_equations_is_refused(studies, folder, many, monkeypatch):
    monkeypatch.setattr(Spring, "output", lambda self, t, x, u: 2.0 * x)
    with pytest.raises(InputError, match=r"flight 1.json' belongs to another study: its code is"):
        close_loop_many({"flight 1": studies["flight 1"]}, folder=folder)


def test_folder_that_cannot_be_read_or_written_is_refused(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        StudyFolder(tmp_path / "file", {})
    (tmp_path / "a.json").write_text("{")
    with pytest.raises(InputError, match="is not the result of a study"):
        StudyFolder(tmp_path, {"a": {}})


def test_wrong_input_is_refused_in_words(studies):
    good = studies["flight 1"]
    with pytest.raises(InputError, match="no study"):
        close_loop_many({})
    with pytest.raises(InputError, match="'a' has no train"):
        close_loop_many({"a": {name: good[name] for name in good if name != "train"}})
    with pytest.raises(InputError, match="has `progress`"):
        close_loop_many({"a": good | {"progress": print}})
    with pytest.raises(InputError, match="`processes` is 0"):
        close_loop_many({"a": good}, processes=0)


def test_error_of_a_study_is_returned_with_its_traceback(studies, monkeypatch):
    def fail(**arguments):
        raise ZeroDivisionError("planted")

    monkeypatch.setattr(module, "close_loop", fail)
    result = run_study("a", pickle.dumps(studies["flight 1"]))
    assert "ZeroDivisionError: planted" in result.failure
    assert str(Studies((result,))).endswith("ZeroDivisionError: planted")


class DyingPool(ProcessPoolExecutor):
    """A pool with a process that dies after some studies; their number differs by pool."""

    accepted: ClassVar[list[int]] = []

    def __init__(self, *arguments):
        self.left = self.accepted.pop(0) if self.accepted else 0

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        pass

    def submit(self, run, name, pickled):
        if self.left == 0:
            raise BrokenProcessPool
        self.left -= 1
        future = Future()
        future.set_result(StudyResult(name, 0.0, {}))
        return future


@pytest.mark.parametrize("processes", [1, 2])
@pytest.mark.parametrize("accepted", [[1, 2], [2, 1], [1, 1, 1]])
def test_study_that_a_broken_pool_refuses_runs_in_the_next_one(monkeypatch, processes, accepted):
    monkeypatch.setattr(module, "ProcessPoolExecutor", DyingPool)
    monkeypatch.setattr(DyingPool, "accepted", list(accepted))
    results = list(_run({"a": {}, "b": {}, "c": {}}, processes))
    assert sorted((result.name, result.failure) for result in results) == [
        ("a", ""),
        ("b", ""),
        ("c", ""),
    ]


def test_pools_that_accept_no_study_come_to_an_end(monkeypatch):
    monkeypatch.setattr(module, "ProcessPoolExecutor", DyingPool)
    results = list(_run({"a": {}, "b": {}}, 2))
    assert sorted((result.name, result.failure) for result in results) == [
        ("a", KILLED),
        ("b", KILLED),
    ]


def row(before, after, noise):
    """Return channel and errors in the table of a result with one set of test records."""
    tests = {"t": {"before": before, "after": after}}
    content = {"outcome": "explained", "effects": [], "noise": noise, "tests": tests}
    cells = StudyResult("a", 1.0, content).row()
    return cells["channel"], cells["before"], cells["after"]


def test_prediction_that_diverges_has_infinite_error_in_the_table():
    assert row({"x": None}, {"x": 1.0}, {"x": 1.0}) == ("x", float("inf"), 1.0)
    both = row({"x": None}, {"x": None}, {"x": 1.0})
    assert both == ("x", float("inf"), float("inf"))


def test_channel_without_a_test_sample_is_not_in_the_table():
    """Its errors are NaN, which JSON stores as null, and so may be its noise."""
    before, after = {"x": None, "y": 2.0}, {"x": None, "y": 1.0}
    for noise in (1.0, None):
        assert row(before, after, {"x": noise, "y": 0.5}) == ("y", 2.0, 1.0)


def test_channel_without_noise_is_in_the_table_if_it_has_an_error():
    before, after = {"x": 0.1, "y": 2.0}, {"x": 0.0, "y": 1.0}
    assert row(before, after, {"x": 0.0, "y": 0.5}) == ("x", 0.1, 0.0)
    before["x"] = 0.0
    assert row(before, after, {"x": 0.0, "y": 0.5}) == ("y", 2.0, 1.0)
