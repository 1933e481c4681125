"""`identified`: `identify` on the training records of a study file, by its section [identify]."""

from collections.abc import Callable, Mapping
from typing import Any

from .._foundation.checks import require, require_known
from ..data.io.study import StudyFile
from ..models.base import AbstractModel
from ..structure import AbstractRule, MaximumF, Minimum
from .from_file import per_record_of
from .identification import Identification
from .identify import identify
from .identify_options import IdentifyOptions
from .model_from_file import (
    BuiltIn,
    built_in_model,
    given_terms,
    likelihood_of,
    model_of_module,
    model_with_terms,
)

RULES: dict[str, Callable[[], AbstractRule]] = {
    "F": MaximumF,
    "PSE": lambda: Minimum("PSE"),
    "PRESS": lambda: Minimum("PRESS"),
    "AIC": lambda: Minimum("AIC"),
    "BIC": lambda: Minimum("BIC"),
}


def identified(
    file: StudyFile,
    built_in: Mapping[str, BuiltIn],
    *,
    weak_radius: float | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Return the result of `identify` on the training records of a study file.

    Terms that [model.terms] names are taken as they are; otherwise the regression selects among the
    candidates. Parameters in [free] and the sections of checks, tests, the loop and the design have
    no effect.

    Args:
        file: result of `read_study`.
        built_in: models that the file may name, by name.
        weak_radius: replaces the value of the file [s].
        progress: function that receives a short text at every step.

    Raises:
        InputError: for a name or value in the file that does not fit the model; see `identify`.
    """
    if weak_radius is not None:
        file = file._replace(identify=file.identify | {"weak_radius": weak_radius})
    options = _options(file)
    model = _model(file, built_in)
    with file.at("identify"):
        return identify(
            model,
            file.train,
            options=options,
            likelihood=likelihood_of(file, model),
            per_record=per_record_of(file),
            progress=progress,
        )


def _model(file: StudyFile, built_in: Mapping[str, BuiltIn]) -> AbstractModel:
    """Return the model of the file, with its terms or with those that a regression may select."""
    use, candidates = file.model["use"], file.identify.get("candidates")
    with file.at("identify", "candidates"):
        require(
            candidates is None or (use in built_in and "terms" not in file.model),
            "candidates are for a built-in model without [model.terms]. Leave one of them out.",
        )
    if use not in built_in:
        return model_of_module(file, tuple(built_in))
    if "terms" in file.model:
        return model_with_terms(file, built_in[use])
    others = {} if candidates is None else {"candidates": candidates}
    return built_in_model(file, built_in[use], **others)


def _options(file: StudyFile) -> IdentifyOptions:
    """Return the options of the section [identify]."""
    section: dict[str, Any] = {key: file.identify[key] for key in file.identify}
    section.pop("candidates", None)
    section["prior"] = {name: tuple(pair) for name, pair in section.get("prior", {}).items()}
    rule = section.pop("rule", "F")
    with file.at("identify", "rule"):
        require_known("rule", [rule], RULES)
    terms = given_terms(file) if "terms" in file.model else {}
    with file.at("identify"):
        return IdentifyOptions(**(terms | section), rule=RULES[rule]())
