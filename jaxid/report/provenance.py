"""`provenance`: origin of a study: versions, settings, records and files."""

import hashlib
import importlib.metadata
import platform
import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..data.io.assemble import sha256
from ..data.record import Record
from ..study.study import Study
from .words import number

SHOWN_DIGITS = 16  # of the SHA-256 of a record (chosen)
GIT_SECONDS = 5.0  # longest wait for git (chosen)


class RecordRow(NamedTuple):
    """One record: its role, name, samples, duration [s], and the SHA-256 of its numbers."""

    role: str
    name: str
    samples: str
    duration: str
    digest: str


class Provenance(NamedTuple):
    """Origin of a study.

    Attributes:
        settings: name and value, both words.
        records: all records of the study.
        files: path and SHA-256 of the files that were read, as far as they are known.
    """

    settings: tuple[tuple[str, str], ...]
    records: tuple[RecordRow, ...]
    files: tuple[tuple[str, str], ...]


def provenance(study: Study, files: Sequence[str | Path] = ()) -> Provenance:
    """Return the origin of a study.

    Args:
        study: the study.
        files: the files that were read for it.
    """
    sets = {"training": study.train, "check": study.check} | {
        f"test: {name}": records for name, records in study.tests.items()
    }
    rows = [_row(role, one) for role, records in sets.items() for one in records]
    digests = tuple((str(path), _file_digest(Path(path))) for path in files)
    return Provenance(tuple(_settings(study).items()), tuple(rows), digests)


def _file_digest(path: Path) -> str:
    """Return the SHA-256 of a file; a file that is gone must not cost the report."""
    try:
        return sha256(path)
    except OSError as error:
        return f"cannot be read any more ({error.strerror})"


def _settings(study: Study) -> dict[str, str]:
    """Return date, versions and settings by name, in words."""
    likelihood, options = study.likelihood, study.options
    parts = {
        name: getattr(likelihood, name)
        for name in ("noise", "hold", "stepper")
        if hasattr(likelihood, name)
    }
    steps = getattr(parts.get("stepper"), "substeps", 0)
    window = "none" if study.window is None else f"{study.window} samples"
    return {
        "written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "versions": ", ".join(
            [f"{name} {_version(name)}" for name in ("jaxid", "jax", "numpy")]
            + [f"Python {platform.python_version()}", platform.platform(terse=True)]
        ),
        **({"git revision": words} if (words := git_revision()) else {}),
        "likelihood": ", ".join(
            [type(likelihood).__name__, *(f"{n} {type(p).__name__}" for n, p in parts.items())]
            + [f"{steps} step{'s' * (steps > 1)} between samples"] * (steps > 0)
        ),
        "window of the initial state": window,
        "level": f"{number(options.level)} for one false effect",
        "second opinion": f"{options.draws} draws, seed {options.seed}",
    }


def git_revision() -> str:
    """Return the revision of the repository of the working directory, with a note of changes in
    files that git follows; "" where there is no repository or no git.
    """
    revision = _git("rev-parse", "HEAD")
    changes = _git("status", "--porcelain", "--untracked-files=no") if revision else ""
    return f"{revision} with changes" if changes else revision


def _git(*arguments: str) -> str:
    """Return the output of git in the working directory, "" where it fails."""
    try:
        answer = subprocess.run(
            ("git", "--no-optional-locks", *arguments),
            capture_output=True,
            text=True,
            errors="replace",
            timeout=GIT_SECONDS,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return answer.stdout.strip()


def _version(name: str) -> str:
    """Return the version of a package, "unknown" where it is not installed."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


def _row(role: str, record: Record) -> RecordRow:
    """Return the row of a single record."""
    total = hashlib.sha256()
    for part in (record.t, record.u, record.z, record.mask):
        total.update(np.ascontiguousarray(part).tobytes())
    t = np.asarray(record.t)
    digest = total.hexdigest()[:SHOWN_DIGITS]
    return RecordRow(role, record.names[0], str(t.size), number(float(t[-1] - t[0])), digest)
