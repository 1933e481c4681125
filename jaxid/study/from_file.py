"""`case_of`: the arguments of `close_loop` from a study file; every name in the file is checked
against the model.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from .._foundation.checks import require, require_known
from ..data.io.named_objects import Product, call, named_object
from ..data.io.study import StudyFile
from ..data.record import Record
from ..data.stack import stack
from ..effects.base import Effect
from ..estimation.likelihoods import OutputError
from ..loop.options import LoopOptions
from ..models.base import AbstractModel
from ..models.free import Free, free
from .close_loop import candidates
from .identify import identify
from .identify_options import IdentifyOptions
from .model_from_file import (
    BuiltIn,
    given_terms,
    likelihood_of,
    model_of_module,
    model_with_terms,
    weak_radius_of,
    with_constant,
)

ALL_CANDIDATES = "`python -m jaxid close-loop STUDY.toml --candidates` lists all of them."
EFFECTS = Product(Effect, is_collection=True, description="effects")


class Case(NamedTuple):
    """Arguments of `close_loop`.

    Attributes:
        model, free, likelihood: declared model, its free parameters, and measure of the misfit.
        train, check, test: records, with the model's channels.
        effects: candidates; None for the default library.
        window, options: window of the predictions, and levels and limits of the loop.
    """

    model: AbstractModel
    free: Free
    likelihood: OutputError
    train: tuple[Record, ...]
    check: tuple[Record, ...] | None
    test: dict[str, tuple[Record, ...]] | None
    effects: tuple[Effect, ...] | None
    window: int | None
    options: LoopOptions

    @property
    def library(self) -> tuple[Effect, ...]:
        """The candidates: the default library if the file has no section [library]."""
        if self.effects is not None:
            return self.effects
        parts = (self.train, self.check, *(self.test or {}).values())
        return candidates(self.model, self.free, *(stack(part) for part in parts if part))


def case_of(
    file: StudyFile,
    built_in: Mapping[str, BuiltIn],
    progress: Callable[[str], None] = lambda _: None,
) -> Case:
    """Build the model of a study file, and check the contents of the file against it.

    Args:
        file: result of `read_study`.
        built_in: models that the file may name instead of `module:Class`, by name; the section of
            the settings has the same name.
        progress: function that receives a short text at every step.

    Returns:
        The arguments of `close_loop`.

    Raises:
        InputError: if a module, class, parameter, channel, candidate or option does not exist or
            has the wrong type; the message names the file, the section and the key.
    """
    window, options = _loop(file)
    use = file.model["use"]
    if use not in built_in:
        model = model_of_module(file, tuple(built_in))
        likelihood = likelihood_of(file, model)
    else:
        blank = model_with_terms(file, built_in[use])
        likelihood = likelihood_of(file, blank)
        _names(file, blank, bounded=False)  # wrong names are refused before the regression
        progress("regression on the chosen terms, and a first estimate")
        model = _regressed(file, blank, likelihood)
    named = _names(file, model)
    return Case(
        model,
        named.free,
        likelihood,
        named.train,
        named.check or None,
        named.test or None,
        named.effects,
        window,
        options,
    )


class _Named(NamedTuple):
    """The parts of a study file that name parameters, channels and candidates of the model.

    Attributes:
        free: free parameters.
        train, check: records with the model's channels.
        test: the same by name of set.
        effects: candidates; None for the default library.
    """

    free: Free
    train: tuple[Record, ...]
    check: tuple[Record, ...]
    test: dict[str, tuple[Record, ...]]
    effects: tuple[Effect, ...] | None


def _names(file: StudyFile, model: AbstractModel, bounded: bool = True) -> _Named:
    """Free parameters, records with the model's channels, and candidates."""
    with file.at("records"):
        train, check = _prepared(model, file.train), _prepared(model, file.check or ())
        tests = {name: _prepared(model, part) for name, part in (file.test or {}).items()}
    chosen = _free(file, model, bounded)
    stacks = [stack(part) for part in (train, check, *tests.values()) if part]
    effects = _library(file, model, chosen, stacks) if file.library else None
    return _Named(chosen, train, check, tests, effects)


def _loop(file: StudyFile) -> tuple[int | None, LoopOptions]:
    """The window and the options of the loop."""
    defaults = {field.name: field.default for field in dataclasses.fields(LoopOptions)}
    defaults.pop("noises")  # a class, which no file can hold
    with file.at("loop"):
        require_known("key", file.loop, ("window", *defaults))
    counts = {"window", *(name for name, default in defaults.items() if isinstance(default, int))}
    values: dict[str, Any] = {name: _loop_value(file, name, name in counts) for name in file.loop}
    window = values.pop("window", None)
    with file.at("loop"):
        return window, LoopOptions(**values)


def _loop_value(file: StudyFile, name: str, is_count: bool) -> int | float:
    """Value of one key of the section `loop`; a count must be an integer, at least zero."""
    value = file.loop[name]
    if not is_count:
        return float(value)
    with file.at("loop", name):
        require(
            isinstance(value, int) and value >= 0,
            f"found {value}, and a whole number is wanted.",
        )
    return value


def _regressed(file: StudyFile, blank: AbstractModel, likelihood: OutputError) -> AbstractModel:
    """Model with the values of a regression and a first estimate."""
    options = IdentifyOptions(**given_terms(file), weak_radius=weak_radius_of(file))
    with file.at("model", "terms"):
        return identify(
            blank,
            file.train,
            options=options,
            likelihood=likelihood,
            per_record=per_record_of(file),
            progress=False,  # its caller shows the progress
        ).model


def _prepared(model: AbstractModel, records: tuple[Record, ...]) -> tuple[Record, ...]:
    return tuple(model.prepared(record) for record in records)


def _free(file: StudyFile, model: AbstractModel, bounded: bool) -> Free:
    """Free parameters: those that the file names, or by default all coefficients of the terms of a
    built-in model.
    """
    by_coefficient = file.model.get("terms", {}).items()
    terms = (
        f"{name}.{term}" for name, products in by_coefficient for term in with_constant(products)
    )
    names = tuple(file.free.get("parameters", terms))
    bounds = {
        name: (float(low), float(high)) for name, (low, high) in file.free.get("bounds", {}).items()
    }
    with file.at("free"):
        require(
            len(names) > 0,
            "`parameters` is missing or empty. Name the parameters that the data shall determine.",
        )
        chosen = free(
            model, *names, per_record=per_record_of(file), bounds=bounds if bounded else None
        )
        require_known("free parameter (in `bounds`)", bounds, chosen.shared + chosen.per_record)
    return chosen


def per_record_of(file: StudyFile) -> tuple[str, ...]:
    return tuple(file.free.get("per_record", ("initial_state",)))


def _library(
    file: StudyFile, model: AbstractModel, chosen: Free, records: Sequence[Record]
) -> tuple[Effect, ...]:
    """Default candidates and those of the file, without the candidates that it leaves out."""
    effects = candidates(model, chosen, *records) if file.library.get("general", True) else ()
    for name in file.library.get("effects", ()):
        with file.at("library", "effects"):
            function = named_object(name, file.path.parent, EFFECTS)
            added = call(name, function, model)
            require(
                isinstance(added, Sequence) and all(isinstance(effect, Effect) for effect in added),
                f"{name} returns an object that is not a jaxid.Effect.",
            )
        effects += tuple(added)
    with file.at("library", "leave_out"):
        names = [effect.name for effect in effects]
        known = dict.fromkeys(names + [effect.card.family for effect in effects])
        left_out = file.library.get("leave_out", ())
        require_known("candidate or family", left_out, known, ALL_CANDIDATES)
    effects = tuple(
        effect
        for effect in effects
        if effect.name not in left_out and effect.card.family not in left_out
    )
    with file.at("library"):
        require(
            len(effects) > 0, "no candidate is left. Name some by `effects`, or leave out fewer."
        )
    return effects
