"""`html`: a study as one self-contained page."""

import base64
import hashlib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined

from ..loop.hypothesis import Coloured
from ..loop.wording import STOPPED
from ..study.study import Study
from .error_tables import error_rows, record_error_rows
from .gallery import Gallery, gallery
from .provenance import provenance
from .tables import (
    correlation_rows,
    decided,
    effect_rows,
    eigenvalues,
    parameter_rows,
    place_rows,
    remains_rows,
    round_rows,
)
from .words import COLOURED_WORDS, NEXT, NOISE_KNOWN, OUTCOMES, percent, raised

TEMPLATE, SCRIPT = "study.html.j2", "page.js"


def html(
    study: Study,
    title: str = "jaxid study",
    drawn: Gallery | None = None,
    files: Sequence[str | Path] = (),
) -> str:
    """Return a study as one self-contained HTML page, with figures and style inside.

    Args:
        study: the study.
        title: heading of the page.
        drawn: the study's figures, if already drawn.
        files: the files that were read for the study; the page states their SHA-256.

    Returns:
        The page.
    """
    drawn = gallery(study) if drawn is None else drawn
    coloured = isinstance(study.noise_model, Coloured)
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    script = _resource(SCRIPT)
    return environment.from_string(_resource(TEMPLATE)).render(
        title=title,
        script=script,
        script_hash=_source_hash(script),
        study=study,
        verdict=raised(study.verdict),
        stopped=STOPPED if study.interrupted else "",
        outcome_words=OUTCOMES[study.outcome],
        noise_words=NOISE_KNOWN[study.noise_known] + COLOURED_WORDS * coloured,
        facts=_facts(study),
        drawn=drawn,
        errors={test: error_rows(study, test) for test in study.tests},
        record_errors={test: record_error_rows(study, test) for test in study.tests},
        error_notes=study.error_notes,
        decided=decided(study),
        effects=effect_rows(study),
        parameters=parameter_rows(study),
        correlations=correlation_rows(study.after.estimate),
        eigenvalues=eigenvalues(study.after.estimate),
        rounds=list(zip(round_rows(study), drawn.rounds, strict=True)),
        remains=remains_rows(study),
        level=percent(study.residual_reports["after"].tests.level),
        places=place_rows(study),
        next_steps=NEXT[study.outcome],
        origin=provenance(study, files),
        degrees=any(unit.startswith("rad") for unit in study.output_units),
    )


def _resource(name: str) -> str:
    """Return the text of a file of this folder."""
    folder = resources.files(__package__ or "jaxid.report")
    return folder.joinpath(name).read_text(encoding="utf-8")


def _source_hash(script: str) -> str:
    """Return the hash by which the page's security policy permits this script and no other."""
    digest = hashlib.sha256(script.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def _facts(study: Study) -> dict[str, str | tuple[str, ...]]:
    """Return the model, the records and the status of the fit, in words."""
    estimate, declared = study.after.estimate, study.before.estimate
    records = int(np.prod(np.asarray(estimate.mask).shape[:-2]))
    measurements = int(np.sum(np.asarray(estimate.mask)))
    tests = [
        f"{name} ({_records(test.n_cases)}, {int(np.sum(np.asarray(test.samples)))} samples)"
        for name, test in study.tests.items()
    ]
    return {
        "model": _model_name(study),
        "train": f"{_records(records)}, {measurements} valid measurements",
        "tests": tuple(tests),
        "candidates": str(sum(len(each.parts) == 1 for each in study.rounds[0].candidates)),
        "before_status": declared.status,
        "status": estimate.status,
        "weak": tuple(raised(words) for words in estimate.weak_directions),
        "own": tuple(estimate.free.per_record),
    }


def _records(number: int) -> str:
    return f"{number} record{'s' if number > 1 else ''}"


def _model_name(study: Study) -> str:
    """Return the class name of the declared model."""
    return type(study.before.model).__name__
