"""Output of the command line: brackets in messages, and paths that cannot be written."""

import errno
from pathlib import Path

import pytest
from rich.console import Console

from jaxid import __main__ as command
from jaxid._foundation.checks import InputError
from jaxid.report import folder
from jaxid.report.folder import require_writable, write_or_elsewhere
from jaxid.report.progress import show_progress
from jaxid.study import Study
from jaxid.study.identification import Identification

FULL = OSError(errno.ENOSPC, "No space left on device")


@pytest.fixture
def printed(monkeypatch, capsys):
    """A function that runs `main` with a job in place of the application, and returns what it
    printed on standard error and its exit status.
    """
    monkeypatch.setattr(command, "configure", lambda: None)

    def run(job):
        monkeypatch.setattr(command, "console", Console(stderr=True))
        monkeypatch.setattr(command, "app", job)
        with pytest.raises(SystemExit) as end:
            command.main()
        return capsys.readouterr().err, end.value.code

    return run


def failing(error):
    def job():
        raise error

    return job


@pytest.mark.parametrize(
    "message", ["study.toml, [free]: no", "[/b]", "[red]x[/red]", "\\[free]", "x [mm", ":warning:"]
)
def test_refusal_prints_brackets_unchanged(message, printed):
    assert printed(failing(InputError(message))) == (f"jaxid: {message}\n", 2)


def test_error_of_file_is_one_message(printed):
    assert printed(failing(FULL)) == (
        "jaxid: [Errno 28] No space left on device. Check the file, its folder and their rights.\n",
        2,
    )


@pytest.mark.parametrize("is_terminal", [False, True])
def test_progress_prints_brackets_unchanged(is_terminal, capsys):
    console = Console(stderr=True, force_terminal=is_terminal, width=100)
    with show_progress(console) as progress:
        progress("refit with [/b] in [free]")
    assert "refit with [/b] in [free]" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["taken/out", "taken/deep/out", "/proc/out"])
def test_path_that_cannot_be_created_raises_error(name, tmp_path):
    (tmp_path / "taken").write_text("")
    if name.startswith("/") and not Path(name).parent.is_dir():
        pytest.skip("no such file system")
    with pytest.raises(InputError, match="cannot be created"):
        require_writable(tmp_path / name)


def test_path_that_can_be_created_leaves_nothing(tmp_path):
    require_writable(tmp_path / "new" / "deep" / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("json", "out"),
    [("taken/a.json", None), (None, "taken/out"), ("nowhere/a.json", None), ("taken", None)],
)
def test_output_is_checked_before_run(json, out, tmp_path, monkeypatch):
    (tmp_path / "taken").write_text("")
    monkeypatch.chdir(tmp_path)
    paths = [None if name is None else Path(name) for name in (json, out)]
    with pytest.raises(InputError, match=r"cannot be created|no folder|exists"):
        command._require_output(*paths)


def test_results_are_saved_elsewhere_where_path_fails(tmp_path, monkeypatch):
    monkeypatch.setattr(folder.tempfile, "gettempdir", lambda: str(tmp_path))
    requested = tmp_path / "requested"

    def write(path):
        if path == requested:
            raise FULL
        path.write_text("study")
        return path

    written = write_or_elsewhere(write, requested)
    assert written.error is FULL
    assert written.path.read_text() == "study"
    assert written.path.parent.parent == tmp_path
    assert write_or_elsewhere(write, tmp_path / "other") == (tmp_path / "other", None)


def test_error_of_requested_path_is_raised_where_no_place_can_be_written(tmp_path, monkeypatch):
    monkeypatch.setattr(folder.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(folder.Path, "home", lambda: tmp_path / "nowhere")

    def write(path):
        raise OSError(errno.EACCES, str(path))

    with pytest.raises(OSError, match="requested"):
        write_or_elsewhere(write, tmp_path / "requested")


def test_command_prints_place_of_results_and_fails(tmp_path, monkeypatch, printed):
    monkeypatch.setattr(folder.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.chdir(tmp_path)

    def write_study(study, path, title, exist, files):
        if path == Path("mine"):
            raise InputError("'mine' exists [now].")
        path.mkdir()
        return path

    monkeypatch.setattr(command, "write_study", write_study)
    study = object.__new__(Study)
    monkeypatch.setattr(Study, "__str__", lambda _: "a study")
    message, status = printed(lambda: command._deliver(study, "title", None, Path("mine")))
    assert status == 1
    place = message.partition("saved in '")[2].rpartition("'")[0]
    assert message.startswith("jaxid: 'mine' exists [now]. The results are saved in")
    assert Path(place).is_dir()


def test_terms_are_saved_elsewhere_where_path_is_taken_meanwhile(tmp_path, monkeypatch, printed):
    def identified(*_, **__):
        (tmp_path / "terms.json").write_text("another's")
        return object.__new__(Identification)

    monkeypatch.setattr(Identification, "__str__", lambda _: "terms")
    monkeypatch.setattr(Identification, "to_json", lambda _: "{}")
    monkeypatch.setattr(folder.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(command, "read_study", lambda _: None)
    monkeypatch.setattr(command, "identified", identified)
    message, status = printed(
        lambda: command.identify_file(tmp_path / "a.toml", tmp_path / "terms.json")
    )
    (saved,) = tmp_path.glob("jaxid-*/terms.json")
    assert (saved.read_text(), status) == ("{}\n", 1)
    assert f"The results are saved in {str(saved)!r}" in message
