"""Parts of the page that state where a study comes from, and its numbers in more detail."""

import hashlib
import subprocess
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from spring_study import HOSTILE, make_study

from jaxid.effects import (
    DryFriction,
    Effect,
    InputDeadZone,
    InputDelay,
    InputPositionLimit,
    QuadraticDrag,
    SensorCrossTalk,
    SensorCurve,
    SensorLag,
    SensorSaturation,
    Term,
)
from jaxid.report import words
from jaxid.report.equations import equation
from jaxid.report.error_tables import error_rows, record_error_rows
from jaxid.report.figures import ranking
from jaxid.report.provenance import git_revision, provenance
from jaxid.report.tables import (
    correlation_rows,
    effect_rows,
    eigenvalues,
    remains_rows,
    round_rows,
)


@pytest.fixture(scope="session")
def study():
    return make_study()


def test_provenance_names_records_settings_and_files(study, tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(b"t,u\n")
    origin = provenance(study, [path])
    assert [(row.role, row.name) for row in origin.records] == [
        ("training", "a"),
        ("training", "b"),
        ("check", "c"),
        ("test: quick", "d"),
        ("test: quick", "e"),
        (f"test: {HOSTILE}", "f <script>"),
    ]
    assert {row.samples for row in origin.records} == {"200"}
    assert len({row.digest for row in origin.records}) == 6
    assert origin.files == ((str(path), hashlib.sha256(b"t,u\n").hexdigest()),)
    path.unlink()
    assert provenance(study, [path]).files[0][1].startswith("cannot be read any more")
    settings = dict(origin.settings)
    assert settings["window of the initial state"] == "20 samples"
    assert settings["second opinion"] == "999 draws, seed 0"
    assert "hold Linear" in settings["likelihood"]
    assert "1 step between samples" in settings["likelihood"]


def test_provenance_names_the_git_revision(study, tmp_path, monkeypatch):
    def git(*arguments):
        author = ("-c", "user.name=A", "-c", "user.email=a@example.org")
        command = ("git", *author, "-C", str(tmp_path), *arguments)
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert git_revision() == ""
    assert "git revision" not in dict(provenance(study).settings)
    git("init")
    assert git_revision() == ""  # no commit yet
    (tmp_path / "model.py").write_text("k = 1\n")
    git("add", "model.py")
    git("commit", "--message", "Add a model")
    (tmp_path / "report.txt").write_text("not followed by git\n")
    revision = git("rev-parse", "HEAD")
    assert git_revision() == revision
    (tmp_path / "model.py").write_text("k = 2\n")
    assert dict(provenance(study).settings)["git revision"] == f"{revision} with changes"
    monkeypatch.setenv("PATH", "")
    assert git_revision() == ""


def test_digest_changes_with_one_number_of_a_record(study):
    changed = study.check.z.at[0, 50, 0].add(1e-15)
    other = replace(study, check=replace(study.check, z=changed))
    first, second = (provenance(each).records for each in (study, other))
    assert [a.digest == b.digest for a, b in zip(first, second, strict=True)] == [
        *(True, True, False, True, True, True)
    ]


def test_errors_by_record_pool_to_the_error_of_the_set(study):
    rows = record_error_rows(study, "quick")
    assert [(row.record, row.channel) for row in rows] == [
        *(("d", "x"), ("d", "tilt"), ("e", "x"), ("e", "tilt"))
    ]
    scored = np.asarray(study.after.tests["quick"].scored)[..., 0].sum(axis=1)
    parts = [float(row.after) for row in rows if row.channel == "x"]
    pooled = np.sqrt(np.sum(scored * np.square(parts)) / scored.sum())
    assert pooled == pytest.approx(study.after.rms["quick"]["x"], rel=1e-3)
    assert record_error_rows(study, HOSTILE) == ()


def test_fit_in_percent_stands_beside_the_error(study):
    record, prediction = study.tests[HOSTILE], study.after.tests[HOSTILE]
    z = np.asarray(record.z)[np.asarray(prediction.scored)[..., 0], 0]
    expected = 100 * (1 - study.after.rms[HOSTILE]["x"] / np.std(z))
    assert error_rows(study, HOSTILE)[0].fit == f"{expected:.1f} %"


def test_candidates_that_replace_different_effects_have_different_rows(study):
    entry = study.rounds[0]
    first = replace(entry.candidates[0], instead_of=("x^2 in v",))
    both = replace(first, instead_of=("x^2 in v", "bias of x"))
    exchanges = replace(entry, candidates=(first, both), added=None)
    (row,) = round_rows(replace(study, rounds=(exchanges,)))
    assert [one.description.rpartition(", in place of ")[2] for one in row.candidates] == [
        "x² in v",
        "x² in v and bias of x",
    ]
    labels = [label.get_text() for label in ranking(exchanges).axes[0].get_yticklabels()]
    assert len(set(labels)) == 2


def test_final_table_starts_at_the_declared_values(study):
    """The search refits from other values; the declared ones stand in `make_study`."""
    starts = dict(zip(study.after.estimate.names, study.after.estimate.start, strict=True))
    assert {name: float(start) for name, start in starts.items()} == {
        "k": 1.0,
        "c": 0.1,
        "x^3 in v.gain": 0.0,
    }


def test_correlations_are_those_of_the_covariance(study):
    estimate = study.after.estimate
    rows = correlation_rows(estimate)
    assert [len(row.values) for row in rows] == [1, 2, 3]
    covariance = np.asarray(estimate.covariance)
    expected = covariance[2, 0] / np.sqrt(covariance[0, 0] * covariance[2, 2])
    assert rows[2].values[0] == f"{expected:.2f}"
    assert rows[2].values[2] == "1.00"
    assert len(eigenvalues(estimate).split(", ")) == 3


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        (Term("v", "x^3"), "d(v)/dt += gain * x^3"),
        (InputDelay("force"), "u(t) -> u(t - gain)"),
        (SensorLag("x"), "lag dw/dt = y - w\ny -> w\nlag = gain in seconds"),
        (DryFriction("v", "w"), "d(v)/dt += gain * tanh(w / width)"),
        # a state that has the name of another field
        (QuadraticDrag("speed", "wind"), "d(speed)/dt += gain * |wind| wind"),
        (SensorCrossTalk("p", "r"), "p -> p + gain r"),
        (
            SensorCurve("x"),
            "d = y - centre\n"
            "y -> y + gain d^2 / range    square: a curved characteristic\n"
            "y -> y + gain |d|    absolute: the slope is 1 + gain above, 1 - gain below",
        ),
        (
            InputDeadZone("u"),
            "u -> u + gain (changed(u) - u)\nchanged = u - clip(u - centre, -width, width)",
        ),
    ],
)
def test_equation_of_an_effect_has_its_channels(effect, expected):
    assert equation(effect) == expected


@pytest.mark.parametrize("end", ["upper", "lower"])
def test_saturations_have_one_formula_for_each_end(end):
    ends = "    at the upper end", "    at the lower end"
    sensor, actuator = SensorSaturation("y1", end=end), InputPositionLimit("u", end=end)
    assert equation(sensor).splitlines() == [
        f"y -> y - gain max(y - level, 0){ends[0]}",
        f"y -> y - gain min(y - level, 0){ends[1]}",
    ]
    assert equation(actuator).splitlines() == [
        "u -> u + gain (changed(u) - u)",
        f"changed = min(u, level){ends[0]}",
        f"changed = max(u, level){ends[1]}",
    ]
    level, y = jnp.array(1.5), np.array([-2.0, 1.5, 4.0])
    limited = np.minimum(y, 1.5) if end == "upper" else np.maximum(y, 1.5)
    full = replace(sensor, gain=jnp.array(1.0), level=level)
    np.testing.assert_allclose(full.reading(y, y), limited)
    np.testing.assert_allclose(replace(actuator, level=level).changed(y), limited)


def test_effect_without_an_equation_has_none():
    class Silent(Effect):
        """An effect without a formula."""

        gain: jax.Array = eqx.field(default_factory=lambda: jnp.array(0.0))

    assert equation(Silent()) == ""


def test_row_of_an_effect_has_its_equation(study):
    (row,) = effect_rows(study)
    assert row.equation == "d(v)/dt += gain * x³"


def test_residual_of_a_verdict_of_noise_follows_nothing(study):
    assert [row.follows_after for row in remains_rows(study)] == ["nothing", "nothing"]


def test_every_outcome_has_next_steps():
    assert set(words.NEXT) == set(words.OUTCOMES)
    assert all(words.NEXT.values())
